"""Size and completeness of an image file, beside the encoder that made it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.executive.values.image_bytes import is_cut_off, size_of_image

PICTURE = np.random.default_rng(0).integers(0, 256, (60, 80, 3)).astype(np.uint8)


def jpeg(*options: int) -> bytes:
    return bytes(cv2.imencode(".jpg", PICTURE, options)[1].tobytes())


@pytest.mark.parametrize(
    "options",
    [(), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1), (cv2.IMWRITE_JPEG_RST_INTERVAL, 2)],
    ids=["plain", "progressive", "restarts"],
)
def test_a_jpeg_cut_anywhere_is_reported(options: tuple[int, ...]) -> None:
    whole = jpeg(*options)
    assert not is_cut_off(whole)
    assert not is_cut_off(whole + b"\0" * 100 + b"\xff\xda what a telephone adds")
    assert all(is_cut_off(whole[:length]) for length in range(3, len(whole)))


def test_the_end_of_the_small_picture_inside_is_not_the_end() -> None:
    whole, small = jpeg(), jpeg(cv2.IMWRITE_JPEG_QUALITY, 10)
    with_small = whole[:2] + b"\xff\xe1" + (len(small) + 2).to_bytes(2, "big") + small + whole[2:]
    assert not is_cut_off(with_small)
    assert is_cut_off(with_small[: len(small) + 300])


def test_bytes_of_no_jpeg_are_not_cut_off() -> None:
    assert is_cut_off(b"") is False
    assert not is_cut_off(b"\x89PNG\r\n")
    assert not is_cut_off(b"\xff\xd8\xff\xe0\x00\x04ab not a marker")


@given(st.integers(1, 300), st.integers(1, 300))
def test_the_size_is_the_encoders(width: int, height: int) -> None:
    _ok, coded = cv2.imencode(".jpg", np.zeros((height, width, 3), np.uint8))
    assert size_of_image(coded.tobytes()) == [width, height]


@given(st.binary(max_size=200))
def test_bytes_of_no_image_have_no_size_and_do_no_harm(data: bytes) -> None:
    assert len(size_of_image(data)) == 2
