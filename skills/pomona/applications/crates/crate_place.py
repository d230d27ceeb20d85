"""The place of a crate by the top faces of its walls in a depth image.

Points at the walls' height are laid on a rectangle of the crate's size: each goes to the side that is nearest, and a
small shift and turn make the distances least; from several beginnings, the fit with most points counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from pomona.drivers import Box, Intrinsics
from pomona.executive import Float64

BAND = 8e-3
"""Distance from the walls' height within which a point may lie on a wall [m]: three deviations of depth at 0.7 m and
1° of tilt over half of a crate."""
REACH = 0.06
"""How far from its place in the cell file a crate is searched [m]."""
BEGINNINGS = (-0.02, 0.0, 0.02), (-0.087, 0.0, 0.087)
"""Shifts along each axis [m] and turns [rad] from which the fit begins."""
GATES = (0.03, 0.03, 0.02, 0.02, 0.012, 0.012, 0.008, 0.008, 0.006, 0.006)
"""Distances from the rectangle beyond which a point counts for nothing, step by step [m]."""
LEAST_SIDE = 25
"""Points on a side that show it, of one pixel in `PIXELS`."""
LEAST_SHARE = 0.5
"""Share of the points at the walls' height that lie on the walls of a crate that is there."""
PIXELS = 2
"""Step between the pixels that are used, along both axes."""


@dataclass(frozen=True, slots=True, eq=False)
class Crate:
    """A crate of the cell file: T_base_crate at the middle of its walls' upper edge (4, 4), half of its outside along x
    and y (2,) [m], and the thickness of a wall [m]."""

    T_base_crate: Float64
    half: Float64
    wall: float


@dataclass(frozen=True, slots=True, eq=False)
class SeenCrate:
    """Where a crate is, relative to the cell file.

    Attributes:
        shift: along the crate's axes x and y, shape (2,) [m].
        turn: about its z axis [rad].
        points: on each side: x low, x high, y low, y high.
    """

    shift: Float64
    turn: float
    points: tuple[int, ...]

    @property
    def farthest(self) -> float:
        """Length of the shift [m]."""
        return float(np.linalg.norm(self.shift))

    @property
    def sentence(self) -> str:
        """Text for the operator."""
        x, y = 1e3 * self.shift
        return f"the crate stands ({x:.0f}, {y:.0f}) mm and {np.degrees(self.turn):.1f}° off its place in the cell file"


def crate_named(name: str, boxes: Sequence[object]) -> Crate | None:
    """Return the crate of a name among the cell file's obstacles: its first box is the floor; None without walls."""
    own = [box for box in boxes if isinstance(box, Box) and box.name == name]
    if len(own) < 2:
        return None
    floor = own[0]
    T_base_crate = own[0].T_base_box.copy()
    up = T_base_crate[:3, 2]
    tops = [
        float((box.T_base_box[:3, 3] - T_base_crate[:3, 3]) @ up) + box.half_extents[2]
        for box in own[1:]
    ]
    T_base_crate[:3, 3] += max(tops) * up
    return Crate(
        T_base_crate,
        np.array(floor.half_extents[:2]),
        2.0 * min(min(box.half_extents) for box in own[1:]),
    )


def crates(boxes: Sequence[object]) -> tuple[str, ...]:
    """Return the names of the crates among the cell file's obstacles: several boxes have one name."""
    names = [box.name for box in boxes if isinstance(box, Box)]
    return tuple(sorted(name for name in set(names) if names.count(name) > 1))


def rim_points(depth: Float64, lens: Intrinsics, T_base_camera: Float64, crate: Crate) -> Float64:
    """Return points of a depth image (h, w) [m] at the height of a crate's walls, in its frame, shape (n, 2) [m]."""
    seen: Float64 = depth[::PIXELS, ::PIXELS].astype(np.float64)
    v, u = np.nonzero(seen > 0.0)
    z = seen[v, u]
    x = (PIXELS * u - lens.cx) / lens.fx * z
    y = (PIXELS * v - lens.cy) / lens.fy * z
    T = np.linalg.inv(crate.T_base_crate) @ T_base_camera
    points = np.column_stack((x, y, z)) @ T[:3, :3].T + T[:3, 3]
    near = (np.abs(points[:, 2]) < BAND) & (np.abs(points[:, :2]) < crate.half + REACH).all(axis=1)
    found: Float64 = points[near, :2]
    return found


def share_in_view(lens: Intrinsics, T_base_camera: Float64, crate: Crate) -> float:
    """Return the share of a crate's upper edge, at its place in the cell file, that a camera sees."""
    t, (a, b) = np.linspace(-1.0, 1.0, 41), crate.half
    edge = np.vstack([np.column_stack((s * a + 0.0 * t, b * t)) for s in (-1, 1)]
                     + [np.column_stack((a * t, s * b + 0.0 * t)) for s in (-1, 1)])  # fmt: skip
    T = np.linalg.inv(T_base_camera) @ crate.T_base_crate
    p = np.column_stack((edge, np.zeros(len(edge)))) @ T[:3, :3].T + T[:3, 3]
    ahead = np.maximum(p[:, 2], 1e-6)
    u = p[:, 0] / ahead * lens.fx + lens.cx
    v = p[:, 1] / ahead * lens.fy + lens.cy
    return float(
        ((p[:, 2] > 0.0) & (u >= 0.0) & (u < lens.width) & (v >= 0.0) & (v < lens.height)).mean()
    )


def find_crate(points: Float64, crate: Crate) -> SeenCrate | None:
    """Return where a crate is by points at its walls' height, in its frame, shape (n, 2) [m]; None without one.

    A crate is there when sides along both axes show, and most of the points lie on its walls.
    """
    if len(points) < 2 * LEAST_SIDE:
        return None
    line = crate.half - crate.wall / 2.0
    best = None
    most = 0
    for dx, dy, turn in product(BEGINNINGS[0], BEGINNINGS[0], BEGINNINGS[1]):
        pose = _fitted(points, line, np.array([dx, dy, turn]))
        side, off = _nearest(_seen_from(points, pose), line)
        on_it = np.abs(off) < crate.wall / 2.0 + 2e-3
        if on_it.sum() > most:
            best = (pose, np.bincount(side[on_it], minlength=4))
            most = int(on_it.sum())
    if best is None:
        return None
    (x, y, turn), counts = best
    shown = counts >= LEAST_SIDE
    if not (shown[:2].any() and shown[2:].any()) or most < LEAST_SHARE * len(points):
        return None
    return SeenCrate(np.array([x, y]), float(turn), tuple(int(each) for each in counts))


def _seen_from(points: Float64, pose: Float64) -> Float64:
    """Return points in the frame of a crate that is shifted and turned by a pose (x, y, angle)."""
    c = np.cos(pose[2])
    s = np.sin(pose[2])
    seen: Float64 = (points - pose[:2]) @ np.array([[c, -s], [s, c]])
    return seen


def _nearest(points: Float64, line: Float64) -> tuple[np.ndarray, Float64]:
    """Return the nearest side of each point, 0 to 3, and how far outside of it the point is, shapes (n,)."""
    off = np.column_stack(
        (
            -line[0] - points[:, 0],
            points[:, 0] - line[0],
            -line[1] - points[:, 1],
            points[:, 1] - line[1],
        )
    )
    side = np.abs(off).argmin(axis=1)
    return side, off[np.arange(len(off)), side]


def _fitted(points: Float64, line: Float64, pose: Float64) -> Float64:
    """Return the pose at which the distances of the points from the rectangle are least, from a pose (x, y, angle)."""
    normals = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
    for gate in GATES:
        own = _seen_from(points, pose)
        side, off = _nearest(own, line)
        used = np.abs(off) < gate
        if used.sum() < LEAST_SIDE:
            return pose
        n = normals[side[used]]
        p = own[used]
        # a step (x, y, angle) in the crate's frame takes from each distance n · (step - angle · p⊥)
        rows = np.column_stack((n, n[:, 1] * p[:, 0] - n[:, 0] * p[:, 1]))
        step = np.linalg.lstsq(rows, off[used], rcond=None)[0]
        c = np.cos(pose[2])
        s = np.sin(pose[2])
        pose = pose + np.array([c * step[0] - s * step[1], s * step[0] + c * step[1], step[2]])
    return pose
