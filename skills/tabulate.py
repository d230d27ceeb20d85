"""The Tabulate skill."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from executive.ports import Port
from executive.skill import Skill
from executive.values.arrays import Float64
from executive.views import ImageView, Line2, TableView
from skills.perception.detection.detection import Detection
from skills.perception.measured_fruit import MeasuredFruit

COLUMNS = (
    "frame", "fruit", "u [px]", "v [px]", "score", "width [mm]", "height [mm]", "distance [m]", "± [mm]", "inliers",
    "not measured",
)  # fmt: skip
CLASS_MM = 5
"""Widths are counted in classes of so many millimetres, as fruit is sorted for sale (UNECE standard FFV-50, apples)."""


class Tabulate(Skill):
    """Add a fruit to the run's table, and its outline and number to the picture of its frame.

    A fruit that was found and not measured keeps its row, with the reason.
    """

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self._rows: list[tuple[str, ...]] = []
        self._outlines: dict[str, list[Line2]] = {}
        self._widths: dict[str, list[float]] = {}

    def run(
        self,
        detection: Annotated[Detection, Port(help="the fruit as it was found")],
        measured: Annotated[MeasuredFruit | None, Port(help="the same fruit as it was measured")] = None,
        why: Annotated[str, Port(help="why it was not measured; another fruit's measurement is not used")] = "",
    ) -> None:
        frame = detection.frame
        label = frame.label or f"frame {frame.sequence}"
        outlines = self._outlines.setdefault(label, [])
        number = str(len(outlines) + 1)
        sizes: tuple[str, ...]
        if why or measured is None:
            centre, sizes = detection.keypoints[8], ("",) * 5
            outlines.append(Line2(_hull(detection.keypoints[:8]), number, "muted", closed=True))
        else:
            self._widths.setdefault(label, []).append(1e3 * _width(measured))
            centre, sizes = _centre(measured.contour), _sizes(measured)
            outlines.append(Line2(measured.contour, number, "refined", closed=True))
        u, v = (f"{at:.0f}" for at in centre)
        self._rows.append((label, number, u, v, f"{detection.score:.2f}", *sizes, why))
        caption = f"{sum(map(len, self._widths.values()))} of {len(self._rows)} fruit measured"
        self.publish("measured", TableView(COLUMNS, tuple(self._rows), caption))
        self.publish("sizes", self._sizes_of_frames())
        self.publish("overlay", ImageView(frame.colour, tuple(outlines), caption=f"{label}: {number} found"))
        return

    def _sizes_of_frames(self) -> TableView:
        """How many fruit of each class of width every frame shows, and all of them together."""
        classes = {name: [int(width // CLASS_MM) for width in self._widths.get(name, ())] for name in self._outlines}
        classes["all"] = [each for found in classes.values() for each in found]
        there = range(min(classes["all"], default=0), max(classes["all"], default=-1) + 1)
        counts = {name: len(lines) for name, lines in self._outlines.items()}
        counts["all"] = len(self._rows)
        names = (f"{CLASS_MM * each}-{CLASS_MM * (each + 1)} mm" for each in there)
        rows = tuple(
            (name, str(counts[name]), str(len(found)), *(str(found.count(each)) for each in there))
            for name, found in classes.items()
        )
        return TableView(("frame", "found", "measured", *names), rows, "widths")


def _width(measured: MeasuredFruit) -> float:
    return float(measured.dimensions[[0, 2]].mean())


def _sizes(measured: MeasuredFruit) -> tuple[str, ...]:
    """Width, height, distance, the width's standard deviation, and the share of depth that agrees."""
    distance = float(np.linalg.norm(measured.T_base_fruit[:3, 3] - measured.T_base_camera[:3, 3]))
    spread = float(np.sqrt(max(measured.covariance[3, 3], 0.0)))
    return (
        f"{_width(measured) * 1e3:.1f}",
        f"{measured.dimensions[1] * 1e3:.1f}",
        f"{distance:.3f}",
        f"{spread * 1e3:.1f}",
        f"{measured.inlier_ratio:.0%}",
    )


def _centre(contour: Float64) -> Float64:
    centre: Float64 = contour.mean(axis=0) if contour.size else np.full(2, np.nan)
    return centre


def _hull(points: Float64) -> Float64:
    """The box around points in the image, those that were found, shape (4, 2) [px]; empty without any."""
    if not np.isfinite(points).all(axis=1).any():
        return np.empty((0, 2))
    (left, top), (right, bottom) = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
