"""Images in messages of ROS: pixels of any encoding, and intrinsics from a CameraInfo."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.devices.frames.folder import are_swapped
from pomona.drivers import Intrinsics
from pomona.executive import UnusablePicture, decode_picture, decode_plane

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
INFO = "sensor_msgs/msg/CameraInfo"

MOST_PIXELS = 50_000_000  # of an image that is decoded

_COLOUR = {
    "rgb8": (3, (0, 1, 2)),
    "bgr8": (3, (2, 1, 0)),
    "rgba8": (4, (0, 1, 2)),
    "bgra8": (4, (2, 1, 0)),
    "mono8": (1, (0, 0, 0)),
}
MILLIMETRE = 1e-3  # unit of depth in whole numbers (REP 118) [m]
FARTHEST = 100.0  # no depth camera measures beyond it: such numbers are in another unit [m]
_DEPTH = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}  # type of a pixel
COMPRESSED_DEPTH = struct.Struct("<iff")
"""What compressed_depth_image_transport writes before the PNG: its format, and a and b of depth = a / (value - b)."""


def colour_of(message: Any, kind: str) -> NDArray[np.uint8]:
    """RGB, shape (h, w, 3). Raises UnusablePicture: it is no colour image that can be read."""
    if kind == COMPRESSED:
        content = np.ascontiguousarray(message.data).tobytes()
        return decode_picture(content, as_taken=True)
    if message.encoding not in _COLOUR:
        raise UnusablePicture(
            f"its encoding is '{message.encoding}', known are {', '.join(_COLOUR)}"
        )
    channels, order = _COLOUR[message.encoding]
    pixels = _rows(message, np.dtype("u1"), channels)
    return np.ascontiguousarray(pixels[..., list(order)])


def depth_of(message: Any, kind: str, unit: float = MILLIMETRE) -> NDArray[np.float32]:
    """Return the depth [m], shape (h, w); 0 where nothing was measured, and where it was not finite or negative.

    `unit` is of whole numbers [m]. Raises UnusablePicture: it is no depth image that can be read.
    """
    if kind == COMPRESSED:
        return _decompressed(message, unit)
    if message.encoding not in _DEPTH:
        raise UnusablePicture(
            f"its encoding is '{message.encoding}', depth has {', '.join(_DEPTH)}"
        )
    order = ">" if message.is_bigendian else "<"
    of = _DEPTH[message.encoding]
    counts = _rows(message, np.dtype(order + of), 1)[..., 0]
    if are_swapped(counts):
        raise UnusablePicture(
            f"its depth is smooth only in the other byte order: is_bigendian {order == '>':d} is wrong"
        )
    return _measured(counts.astype(np.float32) * np.float32(1.0 if of == "f4" else unit))


def _decompressed(message: Any, unit: float) -> NDArray[np.float32]:
    """Return the depth of a PNG of 16 bits, alone or as compressed_depth_image_transport writes it."""
    said = str(message.format)
    content = np.ascontiguousarray(message.data).tobytes()
    encoding = said.partition(";")[0].strip()
    a = 0.0
    b = 0.0
    if "compressedDepth" in said:
        if "rvl" in said.lower() or len(content) < COMPRESSED_DEPTH.size:
            raise UnusablePicture(
                f"its format is '{said}', which is not read: publish it as png or raw"
            )
        _format, a, b = COMPRESSED_DEPTH.unpack_from(content)
        content = content[COMPRESSED_DEPTH.size :]
    image = decode_plane(content)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise UnusablePicture(f"its format is '{said}', compressed and not one channel of 16 bits")
    if "compressedDepth" not in said or encoding != "32FC1":
        return image.astype(np.float32) * np.float32(unit)
    with np.errstate(divide="ignore"):
        depth = a / (image.astype(np.float32) - np.float32(b))
    return _measured(np.where(image > 0, depth, 0.0).astype(np.float32))


def _measured(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    depth[~np.isfinite(depth) | (depth < 0.0)] = 0.0
    middle = float(np.median(depth[depth > 0.0])) if depth.any() else 0.0
    if middle > FARTHEST:
        raise UnusablePicture(
            f"its depth is {middle:g} m in the middle: 32FC1 has metres, 16UC1 has millimetres"
        )
    return depth


def is_rectified(topic: str) -> bool:
    """Return True for a topic of image_proc: of a picture as P of its CameraInfo gives it, without distortion."""
    return any(part.startswith("image_rect") for part in topic.split("/"))


def intrinsics_of(info: Any, rectified: bool = False) -> Intrinsics:
    """Of a CameraInfo of ROS 2 or 1, by K, or by P for a rectified image.

    Raises UnusablePicture: they are none, or the lens distorts.
    """
    k, d, p = (
        np.asarray(getattr(info, name, getattr(info, name.upper(), None)), float) for name in "kdp"
    )
    by_p = rectified and p.size == 12 and p[0] > 0.0
    fx, fy, cx, cy = (float(value) for value in (p[[0, 5, 2, 6]] if by_p else k[[0, 4, 2, 5]]))
    if not (
        np.isfinite([fx, fy, cx, cy]).all()
        and fx > 0
        and fy > 0
        and info.width > 0
        and info.height > 0
    ):
        raise UnusablePicture("it has no focal length, or no size: the camera was not calibrated")
    if not by_p and np.any(d != 0.0):
        remedy = "use the topic image_rect… of image_proc, or write 'intrinsics:' if the image is rectified"
        raise UnusablePicture(
            f"its lens distorts (D is not zero), and only rectified images can be used: {remedy}"
        )
    return Intrinsics(fx, fy, cx, cy, int(info.width), int(info.height))


def _rows(message: Any, dtype: np.dtype[Any], channels: int) -> NDArray[Any]:
    """Return pixels, shape (h, w, channels)."""
    height = int(message.height)
    width = int(message.width)
    step = int(message.step)
    row = width * channels * dtype.itemsize
    data = np.frombuffer(np.ascontiguousarray(message.data).tobytes(), np.uint8)
    if not 0 < height * width <= MOST_PIXELS or step < row or len(data) < height * step:
        raise UnusablePicture(
            f"it has {len(data)} bytes, its header {width} x {height} pixels in rows of {step} bytes"
        )
    rows = data[: height * step].reshape(height, step)[:, :row]
    return np.ascontiguousarray(rows).view(dtype).reshape(height, width, channels)
