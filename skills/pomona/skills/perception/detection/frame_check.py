"""Form of the pictures that networks take."""

from __future__ import annotations

import numpy as np

from pomona.skills.perception.detection.errors import BadFrame

LEAST_SIDE = 32  # pictures smaller than this on either side are refused [px]


def check_picture(colour: object) -> None:
    """Refuse a value that is no RGB picture.

    Raises BadFrame: not an array of shape (h, w, 3), uint8, at least 32 px on each side.
    """
    expected = f"(h, w, 3) uint8 RGB, at least {LEAST_SIDE} px on each side"
    if not isinstance(colour, np.ndarray):
        raise BadFrame(expected, f"a {type(colour).__name__}")
    if colour.dtype != np.uint8 or colour.ndim != 3 or colour.shape[2] != 3 or min(colour.shape[:2]) < LEAST_SIDE:
        raise BadFrame(expected, f"{colour.shape} {colour.dtype}")
