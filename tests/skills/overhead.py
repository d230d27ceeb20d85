"""A depth camera above the table of `picking_scene`: it sees the table, and balls that a test puts there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pomona.drivers.interfaces import Cameras, Frame, Intrinsics, PathWatchSettings, Workspace
from pomona.executive.clock import Clock
from pomona.skills.geometry import inverse, rot_y, transform
from pomona.tools.mock import MockArm
from tests.skills.picking_scene import TABLE_Z, PickingScene

LENS = Intrinsics(305.0, 305.0, 159.5, 119.5, 320, 240)
T_BASE_CAMERA = np.eye(4)
T_BASE_CAMERA[:3, :3] = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
T_BASE_CAMERA[:3, 3] = [0.0, -0.3, 1.5]
BLACK = np.zeros((LENS.height, LENS.width, 3), np.uint8)
Ball = tuple[float, float, float, float]
"""Centre in the base frame and radius [m]."""


def depth_of(*balls: Ball) -> np.ndarray:
    """Return its measured depth, shape (240, 320) [m]."""
    v, u = np.indices((LENS.height, LENS.width))
    rays = np.stack([(u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, np.ones(u.shape)], axis=-1)
    depth = np.full(u.shape, T_BASE_CAMERA[2, 3] - TABLE_Z)
    for *centre, radius in balls:
        c = (inverse(T_BASE_CAMERA) @ np.append(centre, 1.0))[:3]
        part = _around(c, radius)
        a, b = (rays[part] ** 2).sum(axis=-1), rays[part] @ c
        root = b**2 - a * (c @ c - radius**2)
        near = (b - np.sqrt(np.maximum(root, 0.0))) / a
        depth[part] = np.where((root > 0.0) & (near < depth[part]), near, depth[part])
    return depth.astype(np.float32)


def _around(c: np.ndarray, radius: float) -> tuple[slice, slice]:
    """Rows and columns in which a ball (centre in the camera's frame [m]) can be seen: a robot is 700 of them."""
    nearest, farthest = c[2] - radius, c[2] + radius
    assert nearest > 0.0, "the ball is beside or behind the camera"

    def ends(x: float, f: float, middle: float, size: int) -> slice:
        low, high = (x - radius, x + radius)
        first = middle + f * low / (nearest if low < 0.0 else farthest)
        last = middle + f * high / (nearest if high > 0.0 else farthest)
        return slice(
            int(np.clip(np.floor(first), 0, size)), int(np.clip(np.ceil(last) + 1, 0, size))
        )

    return ends(c[1], LENS.fy, LENS.cy, LENS.height), ends(c[0], LENS.fx, LENS.cx, LENS.width)


def untrue_frame(stamp: float, code: str) -> Frame:
    """A frame of the empty table: POSE_MISMATCH states a tilted pose, DEPTH_MISMATCH mirrors depth."""
    T_tilted = T_BASE_CAMERA @ transform(rot_y(np.radians(5.0)))
    depth = depth_of()
    if code == "DEPTH_MISMATCH":
        u = np.broadcast_to((np.arange(LENS.width) - LENS.cx) / LENS.fx, depth.shape)
        above = T_tilted[2, 3] - TABLE_Z
        depth = (-above / (T_tilted[2, 0] * u + T_tilted[2, 2])).astype(np.float32)[:, ::-1]
    return Frame(stamp, round(30 * stamp), BLACK, depth, LENS, None, T_tilted, "above")


def frame(stamp: float, *balls: Ball) -> Frame:
    return Frame(
        stamp, round(30 * stamp), BLACK, depth_of(*balls), LENS, None, T_BASE_CAMERA, "above"
    )


class Overhead:
    """A camera that delivers depth alone; `balls` are visible from the next frame on.

    Attributes:
        untrue: a failure code; its frames are then those of `untrue_frame`.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.balls: tuple[Ball, ...] = ()
        self.untrue = ""
        self.frames = 0

    def latest(self) -> Frame | None:
        """With colour, which only an obstacle asks for: it may be the camera's error."""
        assert self.balls or self.untrue
        return self.latest_depth()

    def latest_depth(self) -> Frame | None:
        self.frames += 1
        now = self.clock.now()
        return untrue_frame(now, self.untrue) if self.untrue else frame(now, *self.balls)


class BeltBeside:
    """Something that carries things to where an arm is.

    Attributes:
        stopped: at each stop, whether the arm had come to rest by then.
    """

    def __init__(self, arm: MockArm) -> None:
        self.stopped: list[bool] = []
        self._arm = arm

    def stop(self) -> bool:
        self.stopped.append(self._arm.settled())
        return True


def watched(scene: PickingScene) -> tuple[dict[type, object], Overhead]:
    """The scene's devices with such a camera, in a cell whose file asks for a watch."""
    camera = Overhead(scene.clock)
    workspace = replace(scene.workspace, watch=PathWatchSettings())
    return {**scene.devices, Workspace: workspace, Cameras: Cameras((camera,))}, camera


def comes_near(scene: PickingScene, camera: Overhead) -> Callable[[int], None]:
    """For `drive(each_tick=…)`: soon after the arm has begun to move, something comes to 12 cm beside the tool."""

    def come(_tick: int) -> None:
        if scene.arm.followed and camera.frames > 3 and not camera.balls:
            x, y, z = scene.tcp[:3, 3]
            camera.balls = ((x + 0.12, y, z, 0.04),)

    return come
