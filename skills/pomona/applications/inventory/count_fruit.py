"""The CountFruit skill."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from pomona.applications.inventory.camera_motion import CameraMotion, camera_motion
from pomona.applications.inventory.fruit_page import Page
from pomona.applications.inventory.fruit_report import FruitReport
from pomona.applications.inventory.sighting import FrameSightings, label_of
from pomona.drivers import Frame
from pomona.executive import CellFacts, Float64, Outputs, Port, Problem, Skill, Work
from pomona.skills import inverse
from pomona.skills.perception import AllDetections, misplaced_depth

MOST_APART = (
    0.04  # allowed distance between two frames' contents by their camera poses [m]: half an apple
)


class FruitCount(Outputs):
    """Outputs of CountFruit."""

    fruit: Annotated[int, Port(help="number of fruit")]
    measured: Annotated[int, Port(help="number of measured fruit")]
    unreadable_frames: Annotated[int, Port(help="number of frames that could not be read")]


class CountFruit(Skill):
    """Count the fruit of successive frames, each once, and write the tables.

    Frames with known camera poses are one scene. Without poses the camera's motion is estimated from the contents of
    both frames. If that fails, the frame begins a scene of its own and nothing is merged.
    """

    failures = ("NOT_WRITTEN",)
    moves = ()

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self._report = FruitReport()
        self._before: tuple[Frame, Float64, Float64, float] | None = None

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """Refuse to overwrite existing results."""
        if known.get("out"):
            problem = Page(Path(known["out"])).problem()
            if problem:
                yield Problem("out", problem, "name another folder")

    def run(
        self,
        looked: Annotated[AllDetections | None, Port(help="detections in the frame")] = None,
        finds: Annotated[
            FrameSightings | None, Port(help="measured fruit of this frame; others are ignored")
        ] = None,
        unreadable: Annotated[
            str, Port(help="why the frame could not be searched; its row is kept")
        ] = "",
        frames: Annotated[int, Port(min=0, help="total number of frames; 0: unknown")] = 0,
        join: Annotated[
            bool, Port(help="estimate the camera's motion between frames that do not give it")
        ] = True,
        out: Annotated[
            str,
            Port(help="new folder for tables, page and pictures; nothing is written without it"),
        ] = "",
    ) -> Work[FruitCount]:
        report = self._report
        if unreadable or looked is None:
            report.add_unreadable(unreadable or "no detection was run on it")
        else:
            sightings = finds.sightings if finds is not None and finds.frame is looked.frame else ()
            T, deviation, how, doubt = yield from self._place(looked, join)
            misplaced = (
                (yield from self.compute(misplaced_depth, looked.frame)) if sightings else ""
            )
            if misplaced:
                misplaced += ": is it registered to these pictures, and of the same moment?"
            doubts = "; ".join(filter(None, (misplaced, doubt)))
            report.add(label_of(looked.frame), sightings, T, deviation, how, doubts)
            picture = report.picture(looked.frame.colour)
            self.publish("overlay", picture)
            if out:
                yield from self._guarded(Page(Path(out)).write_picture, report.frames[-1], picture)
        last = len(report.frames) == frames
        if report.is_due(last):
            for topic, table in report.tables().items():
                self.publish(topic, table)
            if out:
                yield from self._guarded(Page(Path(out)).write, report, frames)
        yield report.sentence(frames)
        return FruitCount(
            len(report.book.fruit),
            report.measured,
            sum(bool(entry.unreadable) for entry in report.frames),
        )

    def _place(
        self, looked: AllDetections, join: bool
    ) -> Work[tuple[Float64 | None, float, str, str]]:
        """Return T_scene_base of a frame, its error [m], its origin, and contradictions, both for the operator."""
        frame, before = looked.frame, self._before
        T: Float64 | None = None
        deviation, doubt = 0.0, ""
        if frame.placed:
            how = "the camera's place is known"
            if before is not None and before[0].placed:
                T = np.eye(4)
                if join:
                    motion = yield from self.compute(camera_motion, before[0], frame)
                    doubt = _contradicted(inverse(before[1]) @ looked.T_base_camera, motion, frame)
        elif before is None or before[0].placed:
            how = "the camera poses are not known"
        elif not join:
            how = "the camera poses are not known, and frames are not to be joined"
        else:
            earlier, T_base_camera, T_scene_base, so_far = before
            motion = yield from self.compute(camera_motion, earlier, frame)
            how = f"the camera's motion is not known: {motion.why}"
            if motion.T_earlier_later is not None:
                T = (
                    T_scene_base
                    @ T_base_camera
                    @ motion.T_earlier_later
                    @ inverse(looked.T_base_camera)
                )
                deviation = float(np.hypot(so_far, motion.deviation))
                how = f"the camera's motion was estimated from both frames, to {1e3 * deviation:.1f} mm"
        self._before = frame, looked.T_base_camera, np.eye(4) if T is None else T, deviation
        return T, deviation, how, doubt

    def _guarded(self, write: Any, *what: Any) -> Work[None]:
        try:
            yield from self.compute(write, *what)
        except OSError as error:
            raise self.failure(
                "NOT_WRITTEN", f"{error.filename or 'the tables'}: {error.strerror or error}"
            ) from error


def _contradicted(T_earlier_later: Float64, motion: CameraMotion, later: Frame) -> str:
    """Describe a contradiction between two frames' contents and the camera's given motion (4, 4)."""
    if motion.T_earlier_later is None or later.depth is None:
        return ""
    optics, z = later.intrinsics, float(np.median(later.depth[later.depth > 0.0]))
    x, y = 0.25 * z * optics.width / optics.fx, 0.25 * z * optics.height / optics.fy
    seen = np.array([[i * x, j * y, z, 1.0] for i in (-1.0, 1.0) for j in (-1.0, 1.0)])
    moved = (seen @ (T_earlier_later - motion.T_earlier_later).T)[:, :3]
    apart = float(np.sqrt((moved**2).sum(axis=1).mean()))
    if apart <= MOST_APART + 3.0 * motion.deviation:
        return ""
    return (
        f"the given camera poses disagree with the images by {1e3 * apart:.0f} mm between these two frames: are "
        "they right, in metres, of these frames? Fruit may be counted twice"
    )
