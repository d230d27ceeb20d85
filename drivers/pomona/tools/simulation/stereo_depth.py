"""Model of a stereo camera's depth, and frames whose calibration or depth is wrong, for tests and `make faults`.

The camera, its colour and its timestamps are sound: only the frame's data about them is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.depth_model import SIMULATED, DepthModel
from pomona.drivers.interfaces import Frame
from pomona.executive.values.arrays import Float32, Float64
from pomona.executive.values.later import Later

cv2: Any = Later("cv2")

SUBPIXEL = 1.0 / 32.0  # disparity is measured in steps of this [px] …
DEPTH_UNIT = 1e-3  # … and depth is handed out in steps of this [m]
CORRELATION = 1.3  # noise is correlated over the matcher's window: deviation of the blur [px]


@dataclass(frozen=True, slots=True)
class Stereo:
    """Focal length [px], distance of the imagers [m], deviation of the disparity [px], nearest measurable depth [m]."""

    focal: float
    baseline: float
    disparity_noise: float
    nearest: float

    def depth_model(self) -> DepthModel:
        """Return the error model of such a camera; without noise the steps of the disparity remain."""
        noise = max(self.disparity_noise, SUBPIXEL / np.sqrt(12.0))
        return replace(SIMULATED, disparity=noise, baseline=self.baseline)


def measure_depth(true_depth: Float32, stereo: Stereo, rng: np.random.Generator) -> Float32:
    """Simulate the measured depth of a true z-depth, shape (h, w) [m]; 0 without a surface.

    The deviation is z² · disparity_noise / (f · b). Pixels that the second imager does not see, surfaces seen at a
    grazing angle, and those nearer than `nearest` give 0.
    """
    shape = true_depth.shape
    hit = true_depth > 0.0
    strength = np.float32(stereo.focal * stereo.baseline)
    disparity = np.divide(strength, true_depth, out=np.zeros_like(true_depth), where=hit)
    missing = ~hit | (true_depth < stereo.nearest) | _hidden_from_second_imager(disparity)
    missing |= _lost_at_edges(true_depth, stereo.focal, rng)
    missing |= _specks(shape, rng)
    noise = cv2.GaussianBlur(rng.standard_normal(shape, dtype=np.float32), (0, 0), CORRELATION)
    noise *= np.float32(stereo.disparity_noise * 2.0 * np.sqrt(np.pi) * CORRELATION)
    measured = np.round((disparity + noise) / SUBPIXEL) * SUBPIXEL
    missing |= measured <= 0.0
    depth = np.divide(strength, measured, out=np.zeros_like(true_depth), where=~missing)
    stepped: Float32 = (np.round(depth / DEPTH_UNIT) * DEPTH_UNIT).astype(np.float32)
    return stepped


def _hidden_from_second_imager(disparity: Float32) -> NDArray[np.bool_]:
    """Return points behind something nearer on the line of sight of the imager to the right."""
    column = np.arange(disparity.shape[1], dtype=np.float32) - disparity
    nearest_right = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(disparity.shape, bool)
    hidden[:, :-1] = column[:, :-1] > nearest_right[:, 1:] + 0.5
    return hidden


def _lost_at_edges(depth: Float32, focal: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Holes where the surface turns away or breaks off: the likelier, the more grazing."""
    step = depth / np.float32(focal)
    slope_u = cv2.Sobel(depth, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    slope_v = cv2.Sobel(depth, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
    across = np.sqrt(slope_u**2 + slope_v**2)
    cosine = step / np.sqrt(step**2 + across**2 + 1e-12)
    chance = cv2.GaussianBlur(rng.random(depth.shape, dtype=np.float32), (0, 0), 1.0)
    chance = (chance - 0.5) / np.float32(0.163) * np.float32(
        0.3
    ) + 0.5  # back to a wide spread after the blur
    # cosine between the surface's normal and the ray below which most of the depth is missing
    lost: NDArray[np.bool_] = cosine < 0.22 * 2.0 * chance
    return lost


def _specks(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return a few small patches without texture."""
    rows, columns = shape
    specks = np.zeros((rows, columns), np.uint8)
    for _ in range(rng.poisson(6.0)):
        centre = (int(rng.integers(columns)), int(rng.integers(rows)))
        cv2.circle(specks, centre, int(rng.integers(1, 4)), 1, -1)
    return specks.astype(bool)


# error of the camera's stated pose along and about each of its axes [m, rad]
SHIFT = 0.015
TURN = np.radians(3.0)
# relative errors of the focal length and of the depth
FOCAL = 0.05
DEPTH = 0.03
Change = Callable[
    [Frame, Frame], Frame
]  # maps a frame, and an earlier frame of the same size, to the delivered frame


def _posed(axis: int, shift: float, turn: float) -> Change:
    T = np.eye(4)
    T[axis, 3] = shift
    first = (axis + 1) % 3
    second = (axis + 2) % 3
    T[[first, second], [first, second]] = np.cos(turn)
    T[second, first] = np.sin(turn)
    T[first, second] = -T[second, first]

    def change(frame: Frame, _earlier: Frame) -> Frame:
        pose: Float64 = frame.T_mount_camera @ T
        return replace(frame, T_mount_camera=pose)

    return change


def _focal(factor: float) -> Change:
    def change(frame: Frame, _earlier: Frame) -> Frame:
        lens = frame.intrinsics
        return replace(frame, intrinsics=replace(lens, fx=factor * lens.fx, fy=factor * lens.fy))

    return change


def _depth(of: Callable[[np.ndarray], np.ndarray]) -> Change:
    def change(frame: Frame, _earlier: Frame) -> Frame:
        assert frame.depth is not None
        return replace(frame, depth=np.ascontiguousarray(of(frame.depth), dtype=np.float32))

    return change


def _earlier_depth(frame: Frame, earlier: Frame) -> Frame:
    return replace(frame, depth=earlier.depth)


def _half_colour(frame: Frame, _earlier: Frame) -> Frame:
    return replace(frame, colour=frame.colour[::2, ::2])


MISCALIBRATED: dict[str, Change] = {
    **{
        f"moved_{name}{end}": _posed(axis, sign * SHIFT, 0.0)
        for axis, name in enumerate("xyz")
        for end, sign in (("", 1.0), ("_back", -1.0))
    },
    **{
        f"turned_{name}{end}": _posed(axis, 0.0, sign * TURN)
        for axis, name in enumerate("xyz")
        for end, sign in (("", 1.0), ("_back", -1.0))
    },
    "focal_long": _focal(1.0 + FOCAL),
    "focal_short": _focal(1.0 - FOCAL),
    "depth_long": _depth(lambda depth: (1.0 + DEPTH) * depth),
    "depth_short": _depth(lambda depth: (1.0 - DEPTH) * depth),
}
"""Calibrations that are wrong by an amount that no single frame shows for certain."""

WRONG_DEPTH: dict[str, Change] = {
    "depth_late": _earlier_depth,
    "depth_mirrored": _depth(np.fliplr),
    "depth_transposed": _depth(np.transpose),
    "depth_halved": _depth(lambda depth: depth[::2, ::2]),
    "colour_halved": _half_colour,
}
"""Images that do not belong together; the depth of `depth_late` is that of the frame before."""

CHANGES = {**MISCALIBRATED, **WRONG_DEPTH}


class FrameChanger:
    """Delivers frames as a fault changes them; each frame is changed once, so that two calls give the same one."""

    def __init__(self) -> None:
        self._kind = ""
        self._earlier: dict[tuple[int, ...], Frame] = {}
        self._newest: dict[tuple[int, ...], tuple[Frame, Frame]] = {}

    def begin(self, kind: str, before: tuple[Frame, ...]) -> None:
        """Change frames from now on; `before` are those of this moment, one of each size."""
        self._kind = kind
        self._newest = {}
        self._earlier = {_size(frame): frame for frame in before}

    def end(self) -> None:
        """Deliver frames as they are."""
        self._kind = ""

    def delivered(self, frame: Frame | None) -> Frame | None:
        """Return the frame that the camera delivers in place of this one."""
        if frame is None or not self._kind:
            return frame
        size = _size(frame)
        newest = self._newest.get(size)
        if newest is None or newest[0] is not frame:
            newest = frame, CHANGES[self._kind](frame, self._earlier.get(size, frame))
            self._newest[size] = newest
            self._earlier[size] = frame
        return newest[1]


def _size(frame: Frame) -> tuple[int, ...]:
    return frame.colour.shape
