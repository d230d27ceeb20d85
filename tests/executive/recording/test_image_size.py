"""The size of a JPEG image, beside the encoder that made it."""

from __future__ import annotations

import cv2
import numpy as np
from hypothesis import given, strategies as st

from pomona.executive.recording.image_size import size_of_jpeg


@given(st.integers(1, 300), st.integers(1, 300))
def test_the_size_is_the_encoders(width: int, height: int) -> None:
    _ok, coded = cv2.imencode(".jpg", np.zeros((height, width, 3), np.uint8))
    assert size_of_jpeg(coded.tobytes()) == [width, height]


@given(st.binary(max_size=200))
def test_what_is_no_image_has_no_size_and_does_no_harm(data: bytes) -> None:
    assert len(size_of_jpeg(data)) == 2
