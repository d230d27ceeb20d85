"""The depth of a look as coloured points in the base frame, few enough for a screen."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.images import from_file
from pomona.executive.recording.plain_file import parse_object
from pomona.executive.values.image_bytes import size_of_image
from pomona.executive.views import ImageView, Pinhole

MOST_POINTS = 6_000
MOST_PIXELS = 25_000_000  # of an image that is unpacked
# distance beyond which points are not drawn [m], since they would make the rest small
FARTHEST = 3.0


def cloud_of(view: ImageView) -> dict[str, str] | None:
    """Points of a look: millimetres (int16), colours (uint8), (n, 3) each, in base 64; None without depth or pose."""
    if (
        view.image is None
        or view.depth is None
        or view.pinhole is None
        or view.pinhole.T_base_camera is None
    ):
        return None
    return _packed(view.image, view.depth, view.pinhole)


def cloud_of_messages(image: bytes, depth: bytes, pinhole: Any) -> dict[str, str]:
    """The same from a record: the messages of image and depth, and the camera of their event; empty without depth."""
    if not isinstance(pinhole, dict) or pinhole.get("T_base_camera") is None:
        return {}
    jpeg = _coded(image)
    png = _coded(depth)
    size = size_of_image(jpeg)
    if size_of_image(png) != size or not 0 < math.prod(size) <= MOST_PIXELS:
        return {}  # before anything is unpacked
    colour = from_file(jpeg)
    millimetres = from_file(png)
    if colour.ndim != 3 or millimetres.ndim != 2 or colour.shape[:2] != millimetres.shape:
        return {}
    fx, fy, cx, cy = (float(pinhole[name]) for name in ("fx", "fy", "cx", "cy"))
    lens = Pinhole(fx, fy, cx, cy, np.asarray(pinhole["T_base_camera"], np.float64).reshape(4, 4))
    return _packed(colour, millimetres.astype(np.float32) * np.float32(1e-3), lens) or {}


def _coded(message: bytes) -> bytes:
    return base64.b64decode(parse_object(message)["data"])


def _packed(
    image: NDArray[Any], depth: NDArray[np.float32], pinhole: Pinhole
) -> dict[str, str] | None:
    if image.shape[:2] != depth.shape:
        return None
    step = max(1, int(np.ceil(np.sqrt(depth.size / MOST_POINTS))))
    v, u = np.mgrid[step // 2 : depth.shape[0] : step, step // 2 : depth.shape[1] : step]
    z = depth[v, u].astype(np.float64)
    seen = np.isfinite(z) & (z > 0.0) & (z < FARTHEST)
    u = u[seen]
    v = v[seen]
    z = z[seen]
    if not z.size:
        return None
    p_camera = np.stack(
        [(u - pinhole.cx) * z / pinhole.fx, (v - pinhole.cy) * z / pinhole.fy, z], axis=1
    )
    T = np.asarray(pinhole.T_base_camera, np.float64)
    p_base = p_camera @ T[:3, :3].T + T[:3, 3]
    millimetres = np.clip(np.rint(p_base * 1e3), -32_000, 32_000).astype("<i2")
    colours = np.ascontiguousarray(image[v, u], np.uint8)
    return {
        "mm": base64.b64encode(millimetres.tobytes()).decode(),
        "rgb": base64.b64encode(colours.tobytes()).decode(),
    }
