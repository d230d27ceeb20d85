"""Fruit as found and measured, without pictures."""

from __future__ import annotations

import numpy as np

from pomona.applications.inventory.measured_frame import FruitInFrame
from pomona.drivers.interfaces import Frame, Intrinsics
from pomona.skills.geometry import transform
from pomona.skills.perception.detection.detection import Detection
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.measured_fruit import MeasuredFruit

APPLE = load_fruit("apple")
MODEL_WIDTH = float(APPLE.dimensions[[0, 2]].mean())
LENS = Intrinsics(300.0, 300.0, 80.0, 60.0, 160, 120)
BOX = np.array([[10.0, 20.0], [40.0, 20.0], [40.0, 50.0], [10.0, 50.0]])
LOOKED = 0.02
"""Relative uncertainty of how large a fruit looks."""


def found(
    number: int = 1,
    size: tuple[float, float] | None = (0.075, 0.07),
    label: str = "a",
    shown: float | None = None,
    sine: float = 1.0,
    deviation: float = 2e-3,
) -> FruitInFrame:
    """Return a fruit of a width and height [m], 1 m before the camera; None: not measured.

    Args:
        shown: width of the model as it was scaled [m].
        sine: of the angle between the line of sight and the stem.
    """
    colour = np.zeros((LENS.height, LENS.width, 3), np.uint8)
    frame = Frame(0.0, 0, colour, None, LENS, None, np.eye(4), label)
    keypoints = np.vstack([BOX, BOX, BOX.mean(axis=0)])
    spread = np.zeros((6, 6))
    spread[5, 5] = LOOKED**2
    ahead = transform(translation=(0.0, 0.0, 1.0))
    detection = Detection(
        APPLE, frame, np.eye(4), ahead, keypoints, 0.9, spread, number - 1, 1, 0.8
    )
    if size is None:
        return FruitInFrame(number, detection, None, "NO_DEPTH")
    angle = np.arcsin(sine)
    turned = ahead.copy()
    turned[:3, :3] = np.array(
        [[1.0, 0.0, 0.0], [0.0, np.sin(angle), np.cos(angle)], [0.0, -np.cos(angle), np.sin(angle)]]
    )
    width, height = size
    measured = MeasuredFruit(
        fruit=APPLE,
        T_base_fruit=turned,
        T_base_camera=np.eye(4),
        dimensions=np.array([width, height, width]),
        mu=(width if shown is None else shown) / MODEL_WIDTH,
        sigma=0.0,
        covariance=deviation**2 * np.eye(6),
        inlier_ratio=0.8,
        residual=1e-3,
        contour=BOX,
        frame=frame,
        method="uniform",
    )
    return FruitInFrame(number, detection, measured)
