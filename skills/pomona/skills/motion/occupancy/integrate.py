"""Fuse one depth image into the occupancy map, by projecting every cell into the image instead of tracing every ray.

A cell well in front of the surface seen at its pixel is free. A cell that holds enough surface points is occupied. A
cell close behind such a surface is hidden: the rest of the object. The table is a known plane, not part of the map;
neither are the robot itself, the fruit to pick, other known shapes, and the cells hidden behind them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.interfaces import ArmState, Frame, Intrinsics, Workspace
from pomona.executive.values.arrays import Float32, Float64, Int64, UInt8
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.geometry import angle_between, inverse
from pomona.skills.motion.collision.distance_field import Convex
from pomona.skills.motion.collision.world import standing
from pomona.skills.motion.occupancy.occupancy_map import (
    FREE,
    HIDDEN,
    OCCUPIED,
    UNKNOWN,
    CameraPoseMismatch,
    NothingMeasured,
    OccupancyMap,
)
from pomona.skills.motion.robot import RobotModel

# between two statements about one pose [m, rad]
_DISTANCE = 2e-3
_ANGLE = 5e-3


def pose_of_camera(frame: Frame, model: RobotModel) -> Float64:
    """T_base_camera (4, 4) [m] of a frame: by forward kinematics on the arm, else its mount's pose in the base frame.

    Raises BadJoints: the frame's joints are none of this arm.
    """
    if frame.q is None:
        return frame.T_mount_camera
    T: Float64 = model.fk(frame.q) @ frame.T_mount_camera
    return T


def check_camera_pose(
    frame: Frame, T_base_camera: Float64, model: RobotModel, arm: ArmState
) -> None:
    """Compare a camera pose with the frame's joints, and these with an arm that stands still.

    Raises CameraPoseMismatch, BadJoints: they contradict each other, or are none of this arm.
    """
    T_base_expected = pose_of_camera(frame, model)
    distance = float(np.linalg.norm(T_base_camera[:3, 3] - T_base_expected[:3, 3]))
    angle = angle_between(T_base_expected[:3, :3], T_base_camera[:3, :3])
    if not (distance <= _DISTANCE and angle <= _ANGLE):
        raise CameraPoseMismatch(
            f"it is {1e3 * distance:.1f} mm and {np.degrees(angle):.2f}° from the pose that the frame's joints give",
            distance,
            angle,
        )
    if frame.q is None or arm.moving or abs(arm.stamp - frame.stamp) > 0.05:  # [s]
        return
    off = float(np.max(np.abs(model.checked(frame.q) - arm.q)))
    # between the joints at the exposure and those of an arm that stands still [rad]
    if not off <= 0.02:
        raise CameraPoseMismatch(
            f"the frame's joints are {off:.3f} rad from those of the resting arm"
        )


_INVALID = 0
_SURFACE = 1
_TABLE = 2
_TARGET = 3
_ROBOT = 4
_BELOW_TABLE = 0.03  # points this far under the table cannot be [m] …
_BELOW_TABLE_SHARE = 0.2  # … in a larger share of the points over the table


@dataclass(frozen=True, slots=True)
class Sensing:
    """How a depth image is read."""

    # a cell is free when it is this many cells in front of the surface at its pixel; in front of the table, which is
    # known, a quarter of a cell is enough
    clear: float = 1.5
    min_points: int = 3  # pixels that make a cell occupied; fewer are noise at an edge
    shadow: float = 0.10  # depth behind a surface that counts as the hidden part of the object [m]: the size of a fruit
    table: float = 0.008  # height above the table below which a point is the table's [m]
    robot_padding: float = 0.02  # added to the robot's spheres for the self-filter [m]
    # points of this look closer to the target's refined shape than this belong to it [m]
    target_margin: float = 0.010
    # the same of neighbours, and of the target's cells in earlier looks, if larger [m]
    other_margin: float = 0.010


def integrate(
    previous: OccupancyMap,
    frame: Frame,
    T_base_camera: Float64,
    workspace: Workspace,
    *,
    robot: Float64 | None = None,
    target: Convex | None = None,
    sensing: Sensing | None = None,
) -> OccupancyMap:
    """Return the map after one more frame; `previous` is not changed.

    Args:
        frame: the look; its stamp becomes the age of the cells that it saw.
        robot: spheres that cover the robot at the look, shape (n, 4), in the base frame [m].
        target: refined shape of the fruit to be picked; its cells are kept out of the map. So are those of the shapes
            of `previous` and of the workspace's obstacles, which collision checks have: gaps between them stay open.

    Raises:
        NothingMeasured: the frame has no depth, or none of it lies inside the mapped volume.
        CameraPoseMismatch: much of the depth would lie below the table.
    """
    how = sensing or Sensing()
    if frame.depth is None:
        raise NothingMeasured(frame.label, 0, 0)
    depth = np.require(
        frame.depth, np.float32, ["C", "W"]
    )  # read-only arrays would be compiled for once more
    states = previous.states.copy()
    last_look = previous.last_look.copy()
    look = len(previous.stamps)
    T = np.array(T_base_camera[:3])
    origin = np.array(previous.origin)
    labels = np.empty(depth.shape, np.uint8)
    points = np.zeros(states.shape, np.uint16)
    own = np.zeros(states.shape, np.bool_)
    if robot is not None and len(robot):
        mark_spheres(
            np.ascontiguousarray(robot), how.robot_padding, origin, previous.resolution, own
        )
    shapes = (*(() if target is None else (target,)), *previous.shapes)
    fixed = standing(workspace)
    other = max(how.target_margin, how.other_margin)
    margins = np.array([other] * len(shapes) + [how.table] * len(fixed))
    if target is not None:
        margins[0] = how.target_margin
    left_out = (*shapes, *fixed)
    planes = np.vstack([np.empty((0, 4)), *(shape.planes for shape in left_out)])
    start = np.cumsum([0] + [len(shape.planes) for shape in left_out])
    bounds = np.array([shape.bound for shape in left_out]).reshape(-1, 4)
    lens = frame.intrinsics
    camera = np.array([lens.fx, lens.fy, lens.cx, lens.cy])
    table_z = -np.inf if workspace.table_z is None else workspace.table_z
    valid, inside, below = _label_pixels(
        depth, camera, T, origin, previous.resolution, table_z,
        how.table, own, planes, start, bounds, margins, labels, points,
    )  # fmt: skip
    if below > _BELOW_TABLE_SHARE * max(below + inside, 1):
        raise CameraPoseMismatch(
            f"{below} of {below + inside} points would lie more than 30 mm below the table"
        )
    if inside == 0:
        raise NothingMeasured(frame.label, valid, inside)
    T_camera_base = np.ascontiguousarray(inverse(T_base_camera)[:3])
    _carve(
        depth, labels, camera, T_camera_base, origin, previous.resolution,
        how.clear * previous.resolution, how.shadow, table_z, states, last_look, look,
    )  # fmt: skip
    if target is not None:
        _clear_shape(states, previous, target, other)
    occupied = points >= how.min_points
    states[occupied], last_look[occupied] = OCCUPIED, look
    for shape, margin in zip(left_out, margins, strict=True):
        _clear_shape(states, previous, shape, float(margin))
    return replace(
        previous, states=states, last_look=last_look, stamps=(*previous.stamps, frame.stamp)
    )


def _clear_shape(states: UInt8, grid: OccupancyMap, target: Convex, margin: float) -> None:
    """Clear the blocked cells inside a shape: it is an obstacle of its own."""
    reach = target.bound[3] + margin + grid.resolution
    first = np.maximum(grid.cell_of(target.bound[:3] - reach), 0)
    last = np.minimum(np.array(grid.cell_of(target.bound[:3] + reach)) + 1, states.shape)
    if np.any(first >= last):
        return
    block = states[first[0] : last[0], first[1] : last[1], first[2] : last[2]]
    cells = np.argwhere(block >= OCCUPIED)
    centres = grid.origin + (cells + first + 0.5) * grid.resolution
    within = cells[target.distance(centres) < margin] if len(cells) else cells
    block[within[:, 0], within[:, 1], within[:, 2]] = UNKNOWN


@kernel(nogil=True)
def mark_spheres(
    spheres: Float64, padding: float, origin: Float64, resolution: float, marked: NDArray[np.bool_]
) -> None:
    """Mark the cells whose centre lies in one of the spheres, shape (n, 4), grown by `padding`."""
    nx, ny, nz = marked.shape
    for s in range(spheres.shape[0]):
        radius = spheres[s, 3] + padding
        x = spheres[s, 0] - origin[0]
        y = spheres[s, 1] - origin[1]
        z = spheres[s, 2] - origin[2]
        for i in range(
            max(int((x - radius) / resolution), 0), min(int((x + radius) / resolution) + 1, nx)
        ):
            dx = (i + 0.5) * resolution - x
            for j in range(
                max(int((y - radius) / resolution), 0), min(int((y + radius) / resolution) + 1, ny)
            ):
                dy = (j + 0.5) * resolution - y
                for k in range(
                    max(int((z - radius) / resolution), 0),
                    min(int((z + radius) / resolution) + 1, nz),
                ):
                    dz = (k + 0.5) * resolution - z
                    if dx * dx + dy * dy + dz * dz < radius * radius:
                        marked[i, j, k] = True


@kernel(nogil=True)
def _label_pixels(
    depth: Float32, camera: Float64, T: Float64, origin: Float64, resolution: float, table_z: float, table: float,
    own: NDArray[np.bool_], planes: Float64, start: Int64, bounds: Float64, margins: Float64,
    labels: UInt8, points: NDArray[np.uint16],
) -> tuple[int, int, int]:  # fmt: skip
    """Label every pixel, and count the surface's points in each cell."""
    nx, ny, nz = own.shape
    valid = 0
    inside = 0
    below = 0
    for v in range(depth.shape[0]):
        ry = (v - camera[3]) / camera[1]
        for u in range(depth.shape[1]):
            d = depth[v, u]
            labels[v, u] = _INVALID
            if not (d > 0.0 and d < 1e3):
                continue
            valid += 1
            rx = (u - camera[2]) / camera[0]
            x = d * (T[0, 0] * rx + T[0, 1] * ry + T[0, 2]) + T[0, 3]
            y = d * (T[1, 0] * rx + T[1, 1] * ry + T[1, 2]) + T[1, 3]
            z = d * (T[2, 0] * rx + T[2, 1] * ry + T[2, 2]) + T[2, 3]
            labels[v, u] = _SURFACE
            i = int(np.floor((x - origin[0]) / resolution))
            j = int(np.floor((y - origin[1]) / resolution))
            if i < 0 or j < 0 or i >= nx or j >= ny:
                if z < table_z + table:
                    labels[v, u] = _TABLE
                continue
            if z < table_z + table:
                labels[v, u] = _TABLE
                if z < table_z - _BELOW_TABLE:
                    below += 1
                else:
                    inside += 1
                continue
            k = int(np.floor((z - origin[2]) / resolution))
            if k < 0 or k >= nz:
                continue
            inside += 1
            if own[i, j, k]:
                labels[v, u] = _ROBOT
                continue
            for n in range(bounds.shape[0]):
                ax = x - bounds[n, 0]
                ay = y - bounds[n, 1]
                az = z - bounds[n, 2]
                near = bounds[n, 3] + margins[n]
                if ax * ax + ay * ay + az * az < near * near:
                    outside = -1e9
                    for f in range(start[n], start[n + 1]):
                        outside = max(
                            outside,
                            planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z - planes[f, 3],
                        )
                        if outside >= margins[n]:
                            break
                    if outside < margins[n]:
                        labels[v, u] = _TARGET
                        break
            if labels[v, u] == _TARGET:
                continue
            if points[i, j, k] < 65535:
                points[i, j, k] += 1
    return valid, inside, below


@kernel(nogil=True)
def _carve(
    depth: Float32, labels: UInt8, camera: Float64, T: Float64, origin: Float64, resolution: float, clear: float,
    shadow: float, table_z: float, states: UInt8, last_look: NDArray[np.int16], look: int,
) -> None:  # fmt: skip
    """Mark cells in front of the seen surface free, and those close behind it hidden unless they were seen free.

    Cells under the table are left alone.
    """
    nx, ny, nz = states.shape
    lowest = max(0.0, np.ceil((table_z - origin[2]) / resolution - 0.5))
    first = int(min(lowest, nz))
    height, width = depth.shape
    step_x = T[0, 2] * resolution
    step_y = T[1, 2] * resolution
    step_z = T[2, 2] * resolution
    fx = camera[0]
    fy = camera[1]
    cx = camera[2] + 0.5
    cy = camera[3] + 0.5
    for i in range(nx):
        bx = origin[0] + (i + 0.5) * resolution
        for j in range(ny):
            by = origin[1] + (j + 0.5) * resolution
            bz = origin[2] + (first - 0.5) * resolution
            x = T[0, 0] * bx + T[0, 1] * by + T[0, 2] * bz + T[0, 3]
            y = T[1, 0] * bx + T[1, 1] * by + T[1, 2] * bz + T[1, 3]
            z = T[2, 0] * bx + T[2, 1] * by + T[2, 2] * bz + T[2, 3]
            for k in range(first, nz):
                x = x + step_x
                y = y + step_y
                z = z + step_z
                if z < 1e-3:
                    continue
                inverse_z = 1.0 / z
                column = fx * x * inverse_z + cx
                row = fy * y * inverse_z + cy
                if not (column >= 0.0 and row >= 0.0 and column < width and row < height):
                    continue
                u = int(column)
                v = int(row)
                d = depth[v, u]
                if labels[v, u] == _INVALID:
                    continue
                if z < d - (0.25 * resolution if labels[v, u] == _TABLE else clear):
                    states[i, j, k], last_look[i, j, k] = FREE, look
                elif (
                    labels[v, u] == _SURFACE
                    and z > d
                    and z < d + shadow
                    and states[i, j, k] != FREE
                ):
                    if states[i, j, k] == UNKNOWN:
                        states[i, j, k] = HIDDEN
                    last_look[i, j, k] = look


def warm_up() -> None:
    """Fuse a look at a wall of four pixels, and compute the distance field."""
    lens = Intrinsics(1.0, 1.0, 0.5, 0.5, 2, 2)
    depth = np.full((2, 2), 0.05, dtype=np.float32)
    frame = Frame(0.0, 0, np.zeros((2, 2, 3), np.uint8), depth, lens, None, np.eye(4))
    workspace = Workspace(None, np.full(3, -0.1), np.full(3, 0.1))
    grid = OccupancyMap.empty(workspace.lower, workspace.upper, 0.02)
    robot = np.array([[0.0, 0.0, -1.0, 0.01]])
    target = Convex.of_points("target", np.eye(3))
    _ = integrate(
        grid, frame, np.eye(4), workspace, robot=robot, target=target, sensing=Sensing()
    ).field
