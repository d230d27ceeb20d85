"""The DetectAll skill: every fruit in a frame, not one target."""

from __future__ import annotations

from dataclasses import dataclass

from executive.ports import RATIO, TIME, Port, Ports
from executive.skill import Work
from skills.detect import Detect, find_in_frame, picture
from skills.perception.detection.compact_detector import DetectorOptions
from skills.perception.detection.detection import Detection
from skills.perception.detection.errors import BadFrame


@dataclass(frozen=True, slots=True, eq=False)
class AllDetections:
    """Every fruit that was found in one frame, by falling score."""

    detections: tuple[Detection, ...]

    @property
    def sentence(self) -> str:
        """For people."""
        count = len(self.detections)
        label = self.detections[0].frame.label if count else ""
        return f"{count} fruit found" + (f" in {label}" if label else "")


class DetectAll(Detect):
    """Find every fruit in the camera's newest frame."""

    inputs = Ports(
        fruit=Port(str, help="which fruit to look for: a name in the catalogue, or a path"),
        score=Port(RATIO, default=0.6, min=0.0, max=1.0, help="least belief that it is this fruit"),
        max_age=Port(TIME, default="500 ms", min="1 ms", max="60 s", help="older frames are refused"),
        working_width=Port(
            int, default=320, min=64, max=4096, help="width at which the whole picture is searched [px]"
        ),
        most=Port(int, default=100, min=1, max=1000, help="places that are looked at closely, surest first"),
    )
    outputs = Ports(all=AllDetections)
    failures = ("NO_FRAME", "STALE_FRAME", "NOTHING_FOUND", "NO_WEIGHTS")

    def run(self, fruit: str, score: float, max_age: float, working_width: int, most: int) -> Work:  # type: ignore[override]
        model = self._model(fruit)
        frame = self._frame(max_age)
        T_base_camera = self._camera_pose(frame)
        try:
            options = DetectorOptions(working_width=working_width, most_fruit=most)
            instances = yield from self.compute(find_in_frame, frame, model, options)
        except BadFrame as error:
            raise self.failure("NO_FRAME", f"the camera's frame cannot be used: {error}") from error
        self.publish("detection", picture(frame, T_base_camera, instances, "", score))
        sure = [i for i in instances if i.score >= score and i.T_camera_object is not None]
        if not sure:
            raise self.failure("NOTHING_FOUND", f"no fruit in {frame.label or 'the frame'}", found=len(instances))
        detections = tuple(
            Detection(
                model, frame, T_base_camera, i.T_camera_object, i.keypoints, i.score, i.covariance, k, len(sure)
            )
            for k, i in enumerate(sure)
            if i.T_camera_object is not None and i.covariance is not None
        )  # fmt: skip
        return {"all": AllDetections(detections)}
