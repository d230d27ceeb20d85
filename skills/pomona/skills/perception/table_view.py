"""The table's plane in a depth image, compared with the cell file's table as the camera's stated pose places it.

A plane shows the camera's height above it and both angles between them: an error of the pose along the plane or about
its normal changes neither. Differently tilted looks see different parts of such an error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.depth_model import DepthModel
from pomona.drivers.interfaces import Frame, Intrinsics, Workspace
from pomona.executive.values.arrays import Float64

LARGEST_TILT = np.radians(20.0)  # greatest angle between the expected table and the seen one [rad]
HEIGHT, TILT = 0.010, np.radians(1.5)
"""Tolerances of a sound cell [m, rad]: hand-eye calibration, levelling of the table and the arm's own accuracy. At a
distance of 0.6 m a tilt of 1.5° displaces a fruit by 16 mm."""
COLUMNS = 80  # pixels of a row that are used; 4800 of an image of 4:3
FARTHEST = 2.0  # depth beyond this is not used [m]: noise grows with its square
LEAST_POINTS, LEAST_SHARE, LEAST_SPREAD = 300, 0.35, 0.04
"""A plane counts as the table with this number of points, this ratio of all points within reach, and this standard
deviation of its points along its shorter side [m]."""
AROUND = 0.02
"""Points this near to a fixed box, or above it, are not on the table [m]: a crate's floor is about parallel to it,
and so is the layer of fruit in it."""
DRAWS = 96  # triples of points that are tried; with a third of the points on the table one in 27 hits it


@dataclass(frozen=True, slots=True)
class SeenTable:
    """The table as the depth image shows it."""

    height: float  # of its middle above the expected plane, negative below [m]
    tilt: float  # angle between both planes [rad]
    distance: float  # of its middle from the camera along the optical axis [m]
    points: int  # number of depth pixels that lie on it, of those that were used
    allowed: float  # height that a sound cell may show at this distance [m]
    height_ratio: float  # error of the depth, of itself, that would show a level table at this height

    @property
    def allowed_tilt(self) -> float:
        """Tilt that a sound cell may show [rad]."""
        return float(TILT)

    @property
    def deviation(self) -> float:
        """The larger of height and tilt, each in units of its tolerance."""
        return float(max(abs(self.height) / self.allowed, self.tilt / TILT))

    @property
    def sound(self) -> bool:
        """True within the tolerances of a sound cell."""
        return self.deviation <= 1.0

    @property
    def sentence(self) -> str:
        """Measured and allowed values."""
        side = "above" if self.height > 0.0 else "below"
        return (
            f"the depth image shows the table {1e3 * abs(self.height):.0f} mm {side} the cell file's height and tilted "
            f"by {np.degrees(self.tilt):.1f}° (allowed: {1e3 * self.allowed:.0f} mm, {np.degrees(TILT):.1f}°)"
        )


def depth_points(depth: NDArray[np.float32], intrinsics: Intrinsics) -> Float64:
    """Return points of a grid of `COLUMNS` columns in the camera frame, shape (n, 3) [m], without missing ones."""
    step = max(1, intrinsics.width // COLUMNS)
    z = depth[::step, ::step].astype(np.float64)
    v, u = np.indices(z.shape) * step
    used = (z > 0.0) & (z < FARTHEST)
    x = (u - intrinsics.cx) / intrinsics.fx * z
    y = (v - intrinsics.cy) / intrinsics.fy * z
    return np.stack([x[used], y[used], z[used]], axis=1)


def view_table(
    points: Float64, T_base_camera: Float64, table_z: float, lens: Intrinsics, errs: DepthModel
) -> SeenTable | None:
    """Find the table, at height table_z in the base frame [m], among points of the camera frame, shape (n, 3) [m].

    None where no plane near the expected one is large enough to be the table. `points`: see `depth_points`.
    """
    normal, offset = T_base_camera[2, :3], float(T_base_camera[2, 3] - table_z)
    height = points @ normal + offset
    within = np.abs(height) <= 0.12  # greatest distance from the expected table at which the seen one is searched [m]
    if np.count_nonzero(within) < LEAST_POINTS:
        return None
    points, height = points[within], height[within]
    # Distance from a plane within which a point lies on it, or three deviations of its noise where these are more [m]
    band = np.maximum(4e-3, 3.0 * errs.deviation(points[:, 2], lens.fx))
    near = np.abs(height) <= HEIGHT + band
    plane = _refined(points, band, near) if near.mean() >= LEAST_SHARE else None
    if plane is None or not _is_table(points, band, plane):
        plane = _refined(points, band, _drawn(points, band, normal))
        if plane is None or not _is_table(points, band, plane):
            return None
    on_it = np.abs(points @ plane[0] + plane[1]) <= band
    middle = points[on_it].mean(axis=0)
    tilt = float(np.arccos(np.clip(plane[0] @ normal, -1.0, 1.0)))
    if tilt > LARGEST_TILT:
        return None
    distance = float(middle[2])
    # standard deviations of the depth's common error that the height may deviate in addition
    allowed = HEIGHT + 2.0 * errs.of_the_whole(distance) * distance
    seen = float(middle @ normal)
    return SeenTable(seen + offset, tilt, distance, int(on_it.sum()), allowed, -(seen + offset) / offset)


Plane = tuple[Float64, float]  # unit normal towards the camera, shape (3,), and offset [m]: normal · p + offset = 0


def _refined(points: Float64, band: Float64, chosen: NDArray[np.bool_]) -> Plane | None:
    """Return the least-squares plane of the chosen points, and then of those in its band."""
    plane = None
    for _ in range(4):
        if np.count_nonzero(chosen) < LEAST_POINTS // 3:
            return None
        weight = 1.0 / band[chosen] ** 2
        centre = weight @ points[chosen] / weight.sum()
        spread = points[chosen] - centre
        normal = np.linalg.eigh((spread * weight[:, None]).T @ spread)[1][:, 0]
        normal = -normal if normal @ centre > 0.0 else normal
        plane = normal, -float(normal @ centre)
        chosen = np.abs(points @ plane[0] + plane[1]) <= band
    return plane


def _drawn(points: Float64, band: Float64, expected: Float64) -> NDArray[np.bool_]:
    """Return points on the best of `DRAWS` planes through three points, of those about parallel to the expected one."""
    triples = points[np.random.default_rng(0).integers(len(points), size=(DRAWS, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 1e-6] / length[length > 1e-6, None]
    origins = triples[length > 1e-6, 0]
    level = np.abs(normals @ expected) > np.cos(LARGEST_TILT)
    normals, origins = normals[level], origins[level]
    away = np.abs(points @ normals.T - np.sum(normals * origins, axis=1)) <= band[:, None]
    if not away.shape[1]:
        return np.zeros(len(points), np.bool_)
    best: NDArray[np.bool_] = away[:, int(away.sum(axis=0).argmax())]
    return best


def _is_table(points: Float64, band: Float64, plane: Plane) -> bool:
    on_it = np.abs(points @ plane[0] + plane[1]) <= band
    if np.count_nonzero(on_it) < LEAST_POINTS or on_it.mean() < LEAST_SHARE:
        return False
    spread = points[on_it] - points[on_it].mean(axis=0)
    shorter = float(np.sqrt(np.linalg.eigvalsh(spread.T @ spread / len(spread))[1]))
    return shorter >= LEAST_SPREAD


def frame_points(frame: Frame, T_base_camera: Float64, workspace: Workspace) -> Float64:
    """Return the `depth_points` beside the cell's fixed obstacles, in the camera frame, shape (n, 3) [m]."""
    assert frame.depth is not None
    points = depth_points(frame.depth, frame.intrinsics)
    return points[_beside(points @ T_base_camera[:3, :3].T + T_base_camera[:3, 3], workspace)]


def _beside(points: Float64, workspace: Workspace) -> NDArray[np.bool_]:
    """Return which points of the base frame, shape (n, 3), are neither near a fixed obstacle nor above it, (n,)."""
    beside = np.ones(len(points), np.bool_)
    for box in workspace.obstacles:
        in_box = (points - box.T_base_box[:3, 3]) @ box.T_base_box[:3, :3]
        in_box[:, 2] = np.minimum(in_box[:, 2], 0.0)  # boxes are turned about z only
        beside &= (np.abs(in_box) > np.array(box.half_extents) + AROUND).any(axis=1)
    for hull in workspace.hulls:
        lower, upper = hull.points.min(axis=0) - AROUND, hull.points.max(axis=0) + AROUND
        beside &= (points < lower).any(axis=1) | (points > upper)[:, :2].any(axis=1)
    return beside


def frame_view(frame: Frame, T_base_camera: Float64, workspace: Workspace) -> SeenTable | None:
    """Return the table in a frame; None without depth or a table, or where it is not in view."""
    if frame.depth is None or workspace.table_z is None or not frame.placed:
        return None
    points = frame_points(frame, T_base_camera, workspace)
    return view_table(points, T_base_camera, workspace.table_z, frame.intrinsics, frame.depth_model)


def should_show_table(frame: Frame, T_base_camera: Float64, workspace: Workspace) -> bool:
    """Return True where the table should fill most of the image, by the camera's stated pose."""
    if frame.depth is None or workspace.table_z is None or not frame.placed:
        return False
    lens, normal = frame.intrinsics, T_base_camera[2, :3]
    u, v = np.meshgrid(np.linspace(0, lens.width - 1, 16), np.linspace(0, lens.height - 1, 12))
    rays = np.stack([(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, np.ones_like(u)], axis=-1).reshape(-1, 3)
    above, falling = float(T_base_camera[2, 3] - workspace.table_z), -(rays @ normal)
    hits = rays[falling > 1e-6] * (above / falling[falling > 1e-6])[:, None]
    hits = hits[(hits[:, 2] > 0.0) & (hits[:, 2] < FARTHEST)] @ T_base_camera[:3, :3].T + T_base_camera[:3, 3]
    inside = ((hits >= workspace.lower) & (hits <= workspace.upper))[:, :2].all(axis=1) & _beside(hits, workspace)
    # share of the image's rays that meet the table inside the workspace, where it should be seen
    return bool(inside.sum() >= 0.6 * len(rays))
