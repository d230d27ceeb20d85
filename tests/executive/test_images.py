"""Image files against OpenCV, which codes them by itself."""

from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from pomona.executive.errors import UsageError
from pomona.executive.images import from_file, shrunk, to_jpeg, to_png

RNG = np.random.default_rng(0)
SMOOTH = cv2.resize(
    RNG.integers(0, 256, (6, 8, 3), dtype=np.uint8), (64, 48), interpolation=cv2.INTER_CUBIC
)
DEPTH = RNG.integers(0, 65536, (48, 64), dtype=np.uint16)


def test_jpeg_is_coded_by_opencv_and_comes_back_as_rgb() -> None:
    content = to_jpeg(SMOOTH, 90)
    coded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.abs(coded.astype(int) - SMOOTH).mean() < 4.0
    assert np.abs(from_file(content).astype(int) - coded).max() <= 2
    assert len(to_jpeg(SMOOTH, 30)) < len(content)


@pytest.mark.parametrize(
    "pixels", [SMOOTH, SMOOTH[..., 0], DEPTH], ids=["colour", "plane", "depth"]
)
def test_png_comes_back_to_the_bit_here_and_in_opencv(pixels: np.ndarray) -> None:
    content = to_png(pixels, 1)
    back = from_file(content)
    assert back.dtype == pixels.dtype
    assert np.array_equal(back, pixels)
    theirs = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(theirs[..., ::-1] if theirs.ndim == 3 else theirs, pixels)


def test_a_shrunk_picture_holds_the_mean_of_the_area_under_each_pixel() -> None:
    small = shrunk(SMOOTH, 0.25)
    expected = SMOOTH.reshape(12, 4, 16, 4, 3).mean(axis=(1, 3))
    assert small.shape == (12, 16, 3)
    assert np.abs(small - expected).max() <= 1.0


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xd8\xff", to_png(DEPTH)[:-40], to_jpeg(SMOOTH, 90)[:200], b"GIF89a"]
)
def test_a_file_that_is_cut_off_or_another_is_refused(content: bytes) -> None:
    with pytest.raises(ValueError, match="an image cannot be decoded"):
        from_file(content)


def test_without_pillow_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    with pytest.raises(UsageError, match=r"an image needs the extra 'pictures': .*pip install"):
        to_jpeg(SMOOTH, 90)
