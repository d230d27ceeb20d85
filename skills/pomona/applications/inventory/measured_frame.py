"""All fruit of one frame, found and measured; the frame with their outlines and numbers."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pomona.drivers import Frame
from pomona.executive import Float64, UInt8
from pomona.skills import find_in_frame
from pomona.skills.perception import (
    Detection,
    DetectorOptions,
    FruitModel,
    MeasuredFruit,
    RefineError,
    measure,
)

MOST_FRUIT = 100
"""Largest number of close looks in one frame."""

MEASURED = (90, 200, 60)
FOUND = (240, 180, 40)
"""Colours of outlines: of fruit that was measured, and of fruit that was only found (RGB)."""


@dataclass(frozen=True, slots=True, eq=False)
class FruitInFrame:
    """One fruit of one frame.

    Attributes:
        number: in its frame, from 1, as in the picture.
        measured: None if it could not be measured; `why` is the code of the reason then.
    """

    number: int
    detection: Detection
    measured: MeasuredFruit | None
    why: str = ""

    @property
    def outline(self) -> Float64:
        """Outline in the image, else the corners of the cuboid as detected, shape (n, 2) [px]."""
        if self.measured is not None and len(self.measured.contour):
            return self.measured.contour
        corners = self.detection.keypoints[:8]
        return corners[np.isfinite(corners).all(axis=1)]

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of the outline [px]."""
        left, top = self.outline.min(axis=0)
        right, bottom = self.outline.max(axis=0)
        return float(left), float(top), float(right), float(bottom)


def measure_frame(
    frame: Frame, model: FruitModel, score: float, width: int | None, method: str
) -> list[FruitInFrame]:
    """Find the fruit of a frame and measure each, by falling score.

    Args:
        score: lowest score of a detection, 0 to 1.
        width: at which the picture is searched [px]; None: several widths, up to its own.
        method: of the refinement, as of `measure`.

    Raises DetectError: the frame or the weights cannot be used.
    """
    search = DetectorOptions(working_width=width, most_fruit=MOST_FRUIT)
    instances = [each for each in find_in_frame(frame, model, search) if each.score >= score]
    fruit: list[FruitInFrame] = []
    for instance in instances:
        if instance.T_camera_object is None or instance.covariance is None:
            continue
        number = len(fruit) + 1
        detection = Detection(
            model,
            frame,
            frame.T_mount_camera,
            instance.T_camera_object,
            instance.keypoints,
            instance.score,
            instance.covariance,
            number - 1,
            len(instances),
            instance.visibility,
        )
        try:
            fruit.append(FruitInFrame(number, detection, measure(detection, method)))
        except RefineError as refused:
            fruit.append(FruitInFrame(number, detection, None, refused.code))
    return fruit


def draw(colour: UInt8, fruit: list[FruitInFrame]) -> UInt8:
    """Return a picture, RGB, shape (h, w, 3), with the outline and the number of each fruit."""
    drawn = np.ascontiguousarray(colour).copy()
    thick = max(1, drawn.shape[1] // 960)
    for each in fruit:
        points = np.round(each.outline).astype(np.int32)
        shade = FOUND if each.measured is None else MEASURED
        cv2.polylines(drawn, [cv2.convexHull(points)], True, shade, thick, cv2.LINE_AA)
        left, _, _, bottom = each.box
        place = round(left), round(bottom)
        cv2.putText(
            drawn, str(each.number), place, cv2.FONT_HERSHEY_SIMPLEX, 0.5 * thick, shade, thick
        )
    return drawn
