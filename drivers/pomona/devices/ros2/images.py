"""Images in messages of ROS: pixels of any encoding, and intrinsics from a CameraInfo."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.pictures import UnusablePicture, decode_picture, decode_plane

IMAGE, COMPRESSED, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"

MOST_PIXELS = 50_000_000  # of an image that is decoded

_COLOUR = {
    "rgb8": (3, (0, 1, 2)),
    "bgr8": (3, (2, 1, 0)),
    "rgba8": (4, (0, 1, 2)),
    "bgra8": (4, (2, 1, 0)),
    "mono8": (1, (0, 0, 0)),
}
_DEPTH = {"16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3), "32FC1": ("f4", 1.0)}
"""Type of a pixel, and metres of its unit (REP 118)."""


class UnusableImage(ValueError):
    """An image that cannot be used, with the reason."""


def colour_of(message: Any, kind: str) -> NDArray[np.uint8]:
    """RGB, shape (h, w, 3). Raises UnusableImage: it is no colour image that can be read."""
    if kind == COMPRESSED:
        return _decoded(message, partial(decode_picture, as_taken=True))
    if message.encoding not in _COLOUR:
        raise UnusableImage(f"its encoding is '{message.encoding}', known are {', '.join(_COLOUR)}")
    channels, order = _COLOUR[message.encoding]
    pixels = _rows(message, np.dtype("u1"), channels)
    return np.ascontiguousarray(pixels[..., list(order)])


def depth_of(message: Any, kind: str) -> NDArray[np.float32]:
    """Return the depth [m], shape (h, w); 0 where nothing was measured, and where it was not finite or negative.

    Raises UnusableImage: it is no depth image that can be read.
    """
    if kind == COMPRESSED:
        image = _decoded(message, decode_plane)
        if image.dtype != np.uint16 or image.ndim != 2:
            raise UnusableImage("it is compressed and not one channel of 16 bits [mm]")
        return image.astype(np.float32) * np.float32(1e-3)
    if message.encoding not in _DEPTH:
        raise UnusableImage(f"its encoding is '{message.encoding}', depth has {', '.join(_DEPTH)}")
    kind_of, metres = _DEPTH[message.encoding]
    order = ">" if message.is_bigendian else "<"
    depth = _rows(message, np.dtype(order + kind_of), 1)[..., 0].astype(np.float32) * np.float32(metres)
    depth[~np.isfinite(depth) | (depth < 0.0)] = 0.0
    return depth


def intrinsics_of(info: Any) -> Intrinsics:
    """Of a CameraInfo. Raises UnusableImage: they are none, or the lens distorts."""
    fx, fy, cx, cy = (float(info.k[index]) for index in (0, 4, 2, 5))
    if not (np.isfinite([fx, fy, cx, cy]).all() and fx > 0 and fy > 0 and info.width > 0 and info.height > 0):
        raise UnusableImage("it has no focal length, or no size: the camera was not calibrated")
    if np.any(np.asarray(info.d, float) != 0.0):
        raise UnusableImage("its lens distorts (D is not zero): only rectified images can be used")
    return Intrinsics(fx, fy, cx, cy, int(info.width), int(info.height))


def _rows(message: Any, dtype: np.dtype[Any], channels: int) -> NDArray[Any]:
    """Return pixels, shape (h, w, channels)."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * dtype.itemsize
    data = np.frombuffer(np.ascontiguousarray(message.data).tobytes(), np.uint8)
    if not 0 < height * width <= MOST_PIXELS or step < row or len(data) < height * step:
        raise UnusableImage(
            f"its header gives {width} x {height} pixels in rows of {step} bytes, but it has {len(data)} bytes"
        )
    rows = data[: height * step].reshape(height, step)[:, :row]
    return np.ascontiguousarray(rows).view(dtype).reshape(height, width, channels)


def _decoded(message: Any, decode: Callable[[bytes], NDArray[Any]]) -> NDArray[Any]:
    try:
        return decode(np.ascontiguousarray(message.data).tobytes())
    except UnusablePicture as error:
        raise UnusableImage(str(error)) from error
