"""The loops of the watch, compiled by numba: what of a depth image is new, and how near the arm would come to it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64, Int64, UInt8
from pomona.skills.motion.collision.kernel import make_scratch, place, place_spheres
from pomona.skills.motion.collision.robot_shape import RobotArrays

UNSEEN, FREE, STANDING = 0, 1, 2
"""What a cell was when it was last seen: not looked at, empty, or taken when it was first seen."""

WIDE = 12
"""Where nothing is measured so far around a pixel, nothing is there [px]: more than a stereo camera's shadows,
which are 8 px of 320 wide beside an arm half a metre before a table."""


@njit(cache=True, nogil=True)
def see(
    depth: Float32, room: bool, lens: Float64, T: Float64, origin: Float64, resolution: float, lowest: float,
    spread: float, known: NDArray[np.bool_], own: NDArray[np.bool_], least_area: float, state: UInt8, area: Float32,
    touched: Int64, found: Float64, moved: NDArray[np.bool_],
) -> int:  # fmt: skip
    """Find the cells of a depth image that hold something which nobody knows, and note which cells are free.

    Args:
        depth: z-depth, shape (h, w) [m]; 0 where nothing was measured.
        room: where nothing was measured far around, there is nothing as far as the camera sees; else what is there may
            as well be too near to it, as what the hand has just left is for a camera beside the hand.
        lens: fx, fy, cx, cy [px].
        T: T_base_camera, shape (3, 4).
        origin, resolution: lower corner of the cells, shape (3,), and their edge [m].
        lowest: what lies lower is the table's [m], where depth is exact.
        spread: by how much it may err, over the square of the distance [1/m].
        known, own: cells that something known, or the robot itself, takes; shape (nx, ny, nz).
        least_area: of a surface in a cell, as the camera sees it; less is noise [m²].
        state: what each cell was, shape (nx, ny, nz); written.
        area, touched: memory: zeros, shape (nx, ny, nz), and room for the number of each cell, (nx · ny · nz,).
        found: centres of what is seen in each new cell, shape (most, 3); written.
        moved: whether the cell was seen free before, shape (most,); written.

    Returns:
        how many new cells were written.
    """
    nx, ny, nz = known.shape
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
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
            if z < lowest + spread * d * d:
                continue
            x = d * (T[0, 0] * rx + T[0, 1] * ry + T[0, 2]) + T[0, 3]
            y = d * (T[1, 0] * rx + T[1, 1] * ry + T[1, 2]) + T[1, 3]
            i, j = int(np.floor((x - origin[0]) / resolution)), int(np.floor((y - origin[1]) / resolution))
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
        i, j, k = number // (ny * nz), (number // nz) % ny, number % nz
        if known[i, j, k] or own[i, j, k] or area[i, j, k] < least_area:
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
    _note_free(depth, room, fx, fy, cx, cy, T, origin, resolution, lowest, own, area, state)
    for n in range(count):
        number = touched[n]
        area[number // (ny * nz), (number // nz) % ny, number % nz] = 0.0
    return new


@njit(cache=True, nogil=True)
def _note_free(
    depth: Float32, room: bool, fx: float, fy: float, cx: float, cy: float, T: Float64, origin: Float64,
    resolution: float, lowest: float, own: NDArray[np.bool_], area: Float32, state: UInt8,
) -> None:  # fmt: skip
    """Mark the cells well in front of what is seen at their pixel, and in which nothing is seen, as free.

    So are those before nothing at all, where that is a room too deep for the camera. A stereo camera's shadows, where
    it measures nothing either, are narrow. What was standing in a cell may go: it stays marked, since at the edge of
    what stands there noise comes and goes.
    """
    nx, ny, nz = own.shape
    height, width = depth.shape
    first = max(0, int(np.floor((lowest - origin[2]) / resolution)))
    clear = 1.5 * resolution
    # The camera's axes in the base frame: T's rotation transposed.
    sx, sy, sz = T[2, 0] * resolution, T[2, 1] * resolution, T[2, 2] * resolution
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
                u, v = int(np.floor(fx * x / z + cx + 0.5)), int(np.floor(fy * y / z + cy + 0.5))
                if u < 0 or v < 0 or u >= width or v >= height:
                    continue
                if area[i, j, k] == 0.0 and not own[i, j, k]:
                    d = depth[v, u]
                    if d > z + clear or (room and d == 0.0 and _nothing_near(depth, u, v)):
                        state[i, j, k] = FREE


@njit(cache=True, nogil=True)
def nearest_ahead(
    robot: RobotArrays, Q: Float64, width: float, points: Float64, bound: Float64, limit: float, away: Float64,
    geom: Int64, which: Int64,
) -> None:  # fmt: skip
    """How near each posture Q, shape (m, dof), comes to points, shape (n, 3), in the sphere `bound` (4,).

    Writes distances, shape (m,) [m], capped at `limit`, the geom and the point that have them, or -1.
    """
    scratch = make_scratch(robot)
    slides, spheres, start, links = robot.slides, robot.spheres, robot.sphere_start, robot.links
    centres, placed, bounds, opening = scratch.centres, scratch.placed, robot.bounds, width - robot.closed
    for m in range(Q.shape[0]):
        place(robot, Q[m], width, scratch)
        best = limit
        geom[m] = which[m] = -1
        for g in range(links.shape[0]):
            if links[g] == 0:
                continue  # what does not move hits nothing
            around = bounds[g, 3]
            x, y, z = centres[g, 0], centres[g, 1], centres[g, 2]
            apart = np.sqrt((x - bound[0]) ** 2 + (y - bound[1]) ** 2 + (z - bound[2]) ** 2) - bound[3] - around
            if apart >= best:
                continue
            ready = False
            for n in range(points.shape[0]):
                px, py, pz = points[n, 0], points[n, 1], points[n, 2]
                if np.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2) - around >= best:
                    continue
                if not ready:
                    place_spheres(
                        spheres, start[g], start[g + 1], scratch.links[links[g]], opening * slides[g, 0],
                        opening * slides[g, 1], opening * slides[g, 2], placed,
                    )  # fmt: skip
                    ready = True
                for s in range(start[g], start[g + 1]):
                    d = (px - placed[s, 0]) ** 2 + (py - placed[s, 1]) ** 2 + (pz - placed[s, 2]) ** 2
                    room = best + spheres[s, 3]
                    if room > 0.0 and d < room * room:
                        best = np.sqrt(d) - spheres[s, 3]
                        geom[m], which[m] = g, n
        away[m] = best


@njit(cache=True, nogil=True)
def _nothing_near(depth: Float32, u: int, v: int) -> bool:
    """Whether nothing is measured all around a pixel."""
    height, width = depth.shape
    for a in (-WIDE, -WIDE // 2, 0, WIDE // 2, WIDE):
        for b in (-WIDE, -WIDE // 2, 0, WIDE // 2, WIDE):
            if depth[min(max(v + a, 0), height - 1), min(max(u + b, 0), width - 1)] > 0.0:
                return False
    return True
