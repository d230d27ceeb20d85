"""Image files in memory: JPEG and PNG from arrays and back, by Pillow.

Pillow is imported where an image is coded: a tree that shows none needs none.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import UInt8
from pomona.executive.values.installation import need

EXTRA = "pictures"


def to_jpeg(rgb: UInt8, quality: int) -> bytes:
    """Code a picture, shape (h, w, 3) or (h, w), as JPEG of a quality of 1 to 95.

    Raises UsageError: Pillow is not installed.
    """
    return _saved(rgb, "JPEG", quality=quality)


def to_png(pixels: NDArray[Any], level: int = 6) -> bytes:
    """Code a picture of bytes, shape (h, w, 3) or (h, w), or of 16-bit numbers, shape (h, w), as PNG.

    Args:
        level: of compression, 0 to 9.

    Raises UsageError: Pillow is not installed.
    """
    return _saved(pixels, "PNG", compress_level=level)


def from_file(content: bytes) -> NDArray[Any]:
    """Decode a JPEG or PNG: RGB (h, w, 3) uint8, or a plane (h, w) uint8 or uint16.

    Raises ValueError: it cannot be decoded; UsageError: Pillow is not installed.
    """
    image_class = _pillow()
    try:
        with image_class.open(io.BytesIO(content), formats=("JPEG", "PNG")) as image:
            plane = image.mode in ("L", "I;16")
            return np.asarray(image if plane else image.convert("RGB"))
    except Exception as error:  # Pillow's readers may raise any exception
        raise ValueError("an image cannot be decoded") from error


def shrunk(rgb: UInt8, factor: float) -> UInt8:
    """Shrink a picture, shape (h, w, 3), by a factor below 1: each pixel is the mean of those that it covers.

    Raises UsageError: Pillow is not installed.
    """
    image_class = _pillow()
    height, width = rgb.shape[:2]
    size = max(1, round(width * factor)), max(1, round(height * factor))
    return np.asarray(
        image_class.fromarray(np.ascontiguousarray(rgb)).resize(size, image_class.Resampling.BOX)
    )


def _saved(pixels: NDArray[Any], form: str, **how: int) -> bytes:
    stream = io.BytesIO()
    _pillow().fromarray(np.ascontiguousarray(pixels)).save(stream, form, **how)
    return stream.getvalue()


def _pillow() -> Any:
    return need("PIL.Image", EXTRA, "an image")
