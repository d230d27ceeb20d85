"""Frames of a camera whose calibration or depth is wrong, for tests and `make faults`.

The camera, its colour and its timestamps are sound: only the frame's data about them is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pomona.drivers.interfaces import Frame
from pomona.executive.values.arrays import Float64

SHIFT, TURN = 0.015, np.radians(3.0)  # error of the camera's stated pose along and about each of its axes [m, rad]
FOCAL, DEPTH = 0.05, 0.03  # relative errors of the focal length and of the depth
Change = Callable[[Frame, Frame], Frame]  # maps a frame, and an earlier frame of the same size, to the delivered frame


def _posed(axis: int, shift: float, turn: float) -> Change:
    T = np.eye(4)
    T[axis, 3] = shift
    first, second = (axis + 1) % 3, (axis + 2) % 3
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
        self._kind, self._newest = kind, {}
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
