"""Compiled loops of the watched path: new obstacles in a depth image, and their distance to the arm's postures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64, Int64, UInt8
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.motion.collision.kernel import make_scratch, place, place_spheres
from pomona.skills.motion.collision.robot_shape import RobotArrays

# state of a cell: never seen, seen empty, or occupied when it was first seen
UNSEEN = 0
FREE = 1
STANDING = 2

WIDE = 12
"""Half-width of the square without any measurement around a pixel that shows free space [px]. The shadows of a stereo
camera are narrower: 8 px of 320 beside an arm half a metre in front of a table."""


class CameraView(NamedTuple):
    """A camera."""

    lens: Float64  # fx, fy, cx, cy [px]
    T_base_camera: Float64  # shape (3, 4)
    # large regions without depth are free. False for a wrist camera, where no depth may mean "too near".
    is_fixed: bool


class WatchedCells(NamedTuple):
    """The volume that is watched, in cells."""

    origin: Float64  # origin, resolution: lower corner, shape (3,), and edge of a cell [m]
    resolution: float
    known: NDArray[
        np.bool_
    ]  # known, own: cells of known obstacles, and of the robot, shape (nx, ny, nz)
    own: NDArray[np.bool_]
    state: UInt8  # `UNSEEN`, `FREE` or `STANDING`, shape (nx, ny, nz); written
    # area, touched: working memory: zeros, shape (nx, ny, nz), and space for the index of each cell, (nx · ny · nz,)
    area: Float32
    touched: Int64


class Noise(NamedTuple):
    """Limits between a surface and noise."""

    lowest: float  # height below which points belong to the table, where depth is exact [m]
    spread: float  # increase of `lowest` with the square of the distance [1/m]
    least_area: float  # area of a surface in a cell, as the camera sees it [m²]


@kernel(nogil=True)
def see(
    depth: Float32,
    camera: CameraView,
    cells: WatchedCells,
    noise: Noise,
    found: Float64,
    moved: NDArray[np.bool_],
) -> int:
    """Find the occupied cells of a depth image that are not known, and note the free cells; return their number.

    Args:
        depth: z-depth, shape (h, w) [m]; 0 where nothing was measured.
        cells: the volume; its state is written.
        found, moved: result: centres of the new cells, (most, 3), and True for those that were free before, (most,).
    """
    origin, resolution, known, own, state, area, touched = cells
    T = camera.T_base_camera
    nx, ny, nz = known.shape
    fx = camera.lens[0]
    fy = camera.lens[1]
    cx = camera.lens[2]
    cy = camera.lens[3]
    height, width = depth.shape
    most = found.shape[0]
    count = 0
    for v in range(height):
        ry = (v - cy) / fy
        for u in range(width):
            d = depth[v, u]
            if not (d > 0.0 and d < 1e3):
                continue
            rx = (u - cx) / fx
            z = d * (T[2, 0] * rx + T[2, 1] * ry + T[2, 2]) + T[2, 3]
            if z < noise.lowest + noise.spread * d * d:
                continue
            x = d * (T[0, 0] * rx + T[0, 1] * ry + T[0, 2]) + T[0, 3]
            y = d * (T[1, 0] * rx + T[1, 1] * ry + T[1, 2]) + T[1, 3]
            i = int(np.floor((x - origin[0]) / resolution))
            j = int(np.floor((y - origin[1]) / resolution))
            k = int(np.floor((z - origin[2]) / resolution))
            if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
                continue
            if area[i, j, k] == 0.0:
                touched[count] = (i * ny + j) * nz + k
                count += 1
            area[i, j, k] += d * d / (fx * fy)
    new = 0
    for n in range(count):
        number = touched[n]
        i = number // (ny * nz)
        j = (number // nz) % ny
        k = number % nz
        if known[i, j, k] or own[i, j, k] or area[i, j, k] < noise.least_area:
            continue
        beside = False
        if state[i, j, k] == FREE:
            for a in range(max(i - 1, 0), min(i + 2, nx)):
                for b in range(max(j - 1, 0), min(j + 2, ny)):
                    for c in range(max(k - 1, 0), min(k + 2, nz)):
                        beside |= state[a, b, c] == STANDING
        if new < most:
            found[new, 0] = origin[0] + (i + 0.5) * resolution
            found[new, 1] = origin[1] + (j + 0.5) * resolution
            found[new, 2] = origin[2] + (k + 0.5) * resolution
            moved[new] = state[i, j, k] == FREE and not beside
            new += 1
        if state[i, j, k] == UNSEEN:
            state[i, j, k] = STANDING
    _note_free(depth, camera, cells, noise.lowest)
    for n in range(count):
        number = touched[n]
        area[number // (ny * nz), (number // nz) % ny, number % nz] = 0.0
    return new


@kernel(nogil=True)
def _note_free(depth: Float32, camera: CameraView, cells: WatchedCells, lowest: float) -> None:
    """Mark the empty cells well in front of the surface that is seen at their pixel as free.

    For a fixed camera, cells on rays of a large region without a return are free, too. The shadows of a stereo camera,
    where it measures nothing either, are narrow. A `STANDING` cell keeps its state, since noise comes and goes at the
    edge of an obstacle.
    """
    origin, resolution, _known, own, state, area, _touched = cells
    T = camera.T_base_camera
    fx = camera.lens[0]
    fy = camera.lens[1]
    cx = camera.lens[2]
    cy = camera.lens[3]
    nx, ny, nz = own.shape
    height, width = depth.shape
    first = max(0, int(np.floor((lowest - origin[2]) / resolution)))
    clear = 1.5 * resolution
    # The camera's axes in the base frame: T's rotation transposed.
    sx = T[2, 0] * resolution
    sy = T[2, 1] * resolution
    sz = T[2, 2] * resolution
    for i in range(nx):
        dx = origin[0] + (i + 0.5) * resolution - T[0, 3]
        for j in range(ny):
            dy = origin[1] + (j + 0.5) * resolution - T[1, 3]
            dz = origin[2] + (first - 0.5) * resolution - T[2, 3]
            x = T[0, 0] * dx + T[1, 0] * dy + T[2, 0] * dz
            y = T[0, 1] * dx + T[1, 1] * dy + T[2, 1] * dz
            z = T[0, 2] * dx + T[1, 2] * dy + T[2, 2] * dz
            for k in range(first, nz):
                x += sx
                y += sy
                z += sz
                if z <= 0.05 or state[i, j, k] != UNSEEN:
                    continue
                u = int(np.floor(fx * x / z + cx + 0.5))
                v = int(np.floor(fy * y / z + cy + 0.5))
                if u < 0 or v < 0 or u >= width or v >= height:
                    continue
                if area[i, j, k] == 0.0 and not own[i, j, k]:
                    d = depth[v, u]
                    if d > z + clear or (
                        camera.is_fixed and d == 0.0 and _nothing_near(depth, u, v)
                    ):
                        state[i, j, k] = FREE


class Nearest(NamedTuple):
    """Distance of each posture to the nearest point."""

    away: Float64  # shape (m,) [m]
    geom: (
        Int64  # geom, which: geom and point that have the distance, shape (m,); -1 beyond the limit
    )
    which: Int64


@kernel(nogil=True)
def nearest_ahead(
    robot: RobotArrays,
    Q: Float64,
    width: float,
    points: Float64,
    bound: Float64,
    limit: float,
    nearest: Nearest,
) -> None:
    """Compute the distance of each posture to points.

    Args:
        robot: the robot's shape.
        Q: postures, shape (m, dof) [rad].
        width: opening of the gripper [m].
        points: shape (n, 3) [m].
        bound: sphere around the points, shape (4,) [m].
        limit: distances are capped at it [m].
        nearest: written.
    """
    away, geom, which = nearest
    scratch = make_scratch(robot)
    slides = robot.slides
    spheres = robot.spheres
    start = robot.sphere_start
    links = robot.links
    centres = scratch.centres
    placed = scratch.placed
    bounds = robot.bounds
    opening = width - robot.closed
    for m in range(Q.shape[0]):
        place(robot, Q[m], width, scratch)
        best = limit
        geom[m] = which[m] = -1
        for g in range(links.shape[0]):
            if links[g] == 0:
                continue  # a part at rest hits nothing
            around = bounds[g, 3]
            x = centres[g, 0]
            y = centres[g, 1]
            z = centres[g, 2]
            apart = (
                np.sqrt((x - bound[0]) ** 2 + (y - bound[1]) ** 2 + (z - bound[2]) ** 2)
                - bound[3]
                - around
            )
            if apart >= best:
                continue
            ready = False
            for n in range(points.shape[0]):
                px = points[n, 0]
                py = points[n, 1]
                pz = points[n, 2]
                if np.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2) - around >= best:
                    continue
                if not ready:
                    place_spheres(
                        spheres,
                        start[g],
                        start[g + 1],
                        scratch.links[links[g]],
                        opening * slides[g, 0],
                        opening * slides[g, 1],
                        opening * slides[g, 2],
                        placed,
                    )
                    ready = True
                for s in range(start[g], start[g + 1]):
                    d = (
                        (px - placed[s, 0]) ** 2
                        + (py - placed[s, 1]) ** 2
                        + (pz - placed[s, 2]) ** 2
                    )
                    within = best + spheres[s, 3]
                    if within > 0.0 and d < within * within:
                        best = np.sqrt(d) - spheres[s, 3]
                        geom[m], which[m] = g, n
        away[m] = best


@kernel(nogil=True)
def _nothing_near(depth: Float32, u: int, v: int) -> bool:
    """Return True if nothing is measured in a large region around a pixel."""
    height, width = depth.shape
    for a in (-WIDE, -WIDE // 2, 0, WIDE // 2, WIDE):
        for b in (-WIDE, -WIDE // 2, 0, WIDE // 2, WIDE):
            if depth[min(max(v + a, 0), height - 1), min(max(u + b, 0), width - 1)] > 0.0:
                return False
    return True
