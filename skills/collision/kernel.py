"""Collision checks of one posture and of one straight joint-space segment, compiled by numba.

Distances are lower bounds. A geom is first judged by one sphere around it; its covering spheres (or, against planes, its
support points) are only looked at when that is not enough. `enough` says which distance the caller does not need to
know more exactly.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skills.collision.robot_shape import RobotArrays
from skills.occupancy.distance_field import lookup
from skills.robot.chain import forward

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

MAP = 0
"""Number of the map among the obstacles; convex obstacles follow from 1, then half spaces."""


class WorldArrays(NamedTuple):
    """What the robot may hit; c convex obstacles, h half spaces, g geoms of the robot. Base frame, metres.

    Attributes:
        field, origin, resolution: a distance field, see `skills.occupancy.distance_field`.
        planes: faces of all convex obstacles, shape (n, 4), and `plane_start`, shape (c + 1,).
        bounds: a sphere around each convex obstacle, shape (c, 4).
        half_spaces: normal n and offset d: free where n·p > d, shape (h, 4).
        margins: distance that each geom keeps from the world, shape (g,).
        self_margin: distance that the robot's parts keep from each other.
        ignored: which geom may touch which obstacle, shape (1 + c + h, g).
    """

    field: Float32
    origin: Float64
    resolution: float
    planes: Float64
    plane_start: Int64
    bounds: Float64
    half_spaces: Float64
    margins: Float64
    self_margin: float
    ignored: NDArray[np.bool_]


@njit(cache=True, nogil=True)
def _place(robot: RobotArrays, g: int, opening: float, links: Float64, placed: Float64, ready: NDArray[np.bool_]) -> None:
    """Write the centres of a geom's spheres in the base frame, once per posture."""
    if ready[g]:
        return
    ready[g] = True
    T = links[robot.links[g]]
    sx, sy, sz = opening * robot.slides[g, 0], opening * robot.slides[g, 1], opening * robot.slides[g, 2]
    for s in range(robot.sphere_start[g], robot.sphere_start[g + 1]):
        x, y, z = robot.spheres[s, 0] + sx, robot.spheres[s, 1] + sy, robot.spheres[s, 2] + sz
        for row in range(3):
            placed[s, row] = T[row, 0] * x + T[row, 1] * y + T[row, 2] * z + T[row, 3]


@njit(cache=True, nogil=True)
def _place_bounds(robot: RobotArrays, opening: float, links: Float64, centres: Float64) -> None:
    """Write the centres of the spheres around all geoms in the base frame, shape (g, 3)."""
    for g in range(robot.links.shape[0]):
        T = links[robot.links[g]]
        x = robot.bounds[g, 0] + opening * robot.slides[g, 0]
        y = robot.bounds[g, 1] + opening * robot.slides[g, 1]
        z = robot.bounds[g, 2] + opening * robot.slides[g, 2]
        for row in range(3):
            centres[g, row] = T[row, 0] * x + T[row, 1] * y + T[row, 2] * z + T[row, 3]


@njit(cache=True, nogil=True)
def _map_distance(
    robot: RobotArrays, world: WorldArrays, g: int, opening: float, enough: float, links: Float64, centres: Float64,
    placed: Float64, ready: NDArray[np.bool_],
) -> float:  # fmt: skip
    c = centres[g]
    distance = lookup(world.field, world.origin, world.resolution, c[0], c[1], c[2]) - robot.bounds[g, 3]
    if distance >= enough:
        return distance
    _place(robot, g, opening, links, placed, ready)
    distance = 1e9
    for s in range(robot.sphere_start[g], robot.sphere_start[g + 1]):
        p = placed[s]
        away = lookup(world.field, world.origin, world.resolution, p[0], p[1], p[2]) - robot.spheres[s, 3]
        distance = min(distance, away)
    return distance


@njit(cache=True, nogil=True)
def _convex_distance(
    robot: RobotArrays, world: WorldArrays, g: int, k: int, opening: float, enough: float, links: Float64,
    centres: Float64, placed: Float64, ready: NDArray[np.bool_],
) -> float:  # fmt: skip
    bound = world.bounds[k]
    x, y, z = centres[g, 0] - bound[0], centres[g, 1] - bound[1], centres[g, 2] - bound[2]
    distance = sqrt(x * x + y * y + z * z) - bound[3] - robot.bounds[g, 3]
    if distance >= enough:
        return distance
    distance = -1e9
    for f in range(world.plane_start[k], world.plane_start[k + 1]):
        n = world.planes[f]
        distance = max(distance, n[0] * centres[g, 0] + n[1] * centres[g, 1] + n[2] * centres[g, 2] - n[3])
    distance -= robot.bounds[g, 3]
    if distance >= enough:
        return distance
    _place(robot, g, opening, links, placed, ready)
    distance = 1e9
    for s in range(robot.sphere_start[g], robot.sphere_start[g + 1]):
        p = placed[s]
        x, y, z = p[0] - bound[0], p[1] - bound[1], p[2] - bound[2]
        away = sqrt(x * x + y * y + z * z) - bound[3]
        if away - robot.spheres[s, 3] >= distance:
            continue
        for f in range(world.plane_start[k], world.plane_start[k + 1]):
            n = world.planes[f]
            away = max(away, n[0] * p[0] + n[1] * p[1] + n[2] * p[2] - n[3])
        distance = min(distance, away - robot.spheres[s, 3])
    return distance


@njit(cache=True, nogil=True)
def _half_space_distance(
    robot: RobotArrays, world: WorldArrays, g: int, h: int, opening: float, enough: float, links: Float64,
    centres: Float64,
) -> float:  # fmt: skip
    n = world.half_spaces[h]
    distance = n[0] * centres[g, 0] + n[1] * centres[g, 1] + n[2] * centres[g, 2] - n[3] - robot.bounds[g, 3]
    if distance >= enough:
        return distance
    T = links[robot.links[g]]
    a = n[0] * T[0, 0] + n[1] * T[1, 0] + n[2] * T[2, 0]
    b = n[0] * T[0, 1] + n[1] * T[1, 1] + n[2] * T[2, 1]
    c = n[0] * T[0, 2] + n[1] * T[1, 2] + n[2] * T[2, 2]
    base = n[0] * T[0, 3] + n[1] * T[1, 3] + n[2] * T[2, 3] - n[3]
    base += opening * (a * robot.slides[g, 0] + b * robot.slides[g, 1] + c * robot.slides[g, 2])
    distance = 1e9
    for s in range(robot.support_start[g], robot.support_start[g + 1]):
        p = robot.support[s]
        distance = min(distance, base + a * p[0] + b * p[1] + c * p[2] - p[3])
    return distance


@njit(cache=True, nogil=True)
def _world_clearance(
    robot: RobotArrays, world: WorldArrays, g: int, opening: float, enough: float, links: Float64, centres: Float64,
    placed: Float64, ready: NDArray[np.bool_],
) -> tuple[float, int]:  # fmt: skip
    """Clearance of one geom beyond its margin, and the number of the nearest obstacle."""
    margin = world.margins[g]
    nearest, which = 1e9, -1
    convex = world.bounds.shape[0]
    if not world.ignored[MAP, g]:
        nearest = _map_distance(robot, world, g, opening, enough + margin, links, centres, placed, ready) - margin
        which = MAP
    for h in range(world.half_spaces.shape[0]):
        if not world.ignored[1 + convex + h, g]:
            stop = min(enough, nearest) + margin
            away = _half_space_distance(robot, world, g, h, opening, stop, links, centres) - margin
            if away < nearest:
                nearest, which = away, 1 + convex + h
    for k in range(convex):
        if not world.ignored[1 + k, g]:
            stop = min(enough, nearest) + margin
            away = _convex_distance(robot, world, g, k, opening, stop, links, centres, placed, ready) - margin
            if away < nearest:
                nearest, which = away, 1 + k
    return nearest, which


@njit(cache=True, nogil=True)
def _pair_clearance(
    robot: RobotArrays, world: WorldArrays, i: int, j: int, opening: float, enough: float, links: Float64,
    centres: Float64, placed: Float64, ready: NDArray[np.bool_],
) -> float:  # fmt: skip
    """Clearance between two geoms of the robot beyond the margin."""
    x, y, z = centres[i, 0] - centres[j, 0], centres[i, 1] - centres[j, 1], centres[i, 2] - centres[j, 2]
    distance = sqrt(x * x + y * y + z * z) - robot.bounds[i, 3] - robot.bounds[j, 3] - world.self_margin
    if distance >= enough:
        return distance
    _place(robot, i, opening, links, placed, ready)
    _place(robot, j, opening, links, placed, ready)
    distance = 1e9
    cx, cy, cz, around = centres[j, 0], centres[j, 1], centres[j, 2], robot.bounds[j, 3]
    for s in range(robot.sphere_start[i], robot.sphere_start[i + 1]):
        px, py, pz, radius = placed[s, 0], placed[s, 1], placed[s, 2], robot.spheres[s, 3]
        limit = distance + radius + around
        if limit <= 0.0 or (px - cx) ** 2 + (py - cy) ** 2 + (pz - cz) ** 2 >= limit * limit:
            continue
        for t in range(robot.sphere_start[j], robot.sphere_start[j + 1]):
            limit = distance + radius + robot.spheres[t, 3]
            squared = (px - placed[t, 0]) ** 2 + (py - placed[t, 1]) ** 2 + (pz - placed[t, 2]) ** 2
            if limit > 0.0 and squared < limit * limit:
                distance = sqrt(squared) - radius - robot.spheres[t, 3]
    return distance - world.self_margin


@njit(cache=True, nogil=True)
def check_states(
    robot: RobotArrays, world: WorldArrays, Q: Float64, width: float, enough: float, clearances: Float64, culprits: Int64
) -> None:
    """Judge postures Q, shape (n, dof), with one opening of the gripper.

    Writes the smallest clearance beyond the margins, shape (n,) [m], capped at `enough`, and who has it, shape (n, 2):
    a geom, and the number of an obstacle or -1 - another geom. With enough = 0, a posture is judged no further once it
    is known to collide.
    """
    geoms = robot.links.shape[0]
    links = np.empty((Q.shape[1] + 1, 3, 4))
    centres = np.empty((geoms, 3))
    placed = np.empty((robot.spheres.shape[0], 3))
    ready = np.empty(geoms, np.bool_)
    opening = width - robot.closed
    for n in range(Q.shape[0]):
        forward(robot.steps, robot.sliding, Q[n], links)
        _place_bounds(robot, opening, links, centres)
        ready[:] = False
        smallest, geom, other = enough, -1, -1
        for g in range(geoms - 1, -1, -1):  # the gripper is what most often collides
            if robot.links[g] == 0:
                continue
            away, which = _world_clearance(robot, world, g, opening, smallest, links, centres, placed, ready)
            if away < smallest:
                smallest, geom, other = away, g, which
                if enough <= 0.0:
                    break
        if enough > 0.0 or smallest >= 0.0:
            for p in range(robot.pairs.shape[0]):
                i, j = robot.pairs[p]
                away = _pair_clearance(robot, world, i, j, opening, smallest, links, centres, placed, ready)
                if away < smallest:
                    smallest, geom, other = away, j, -1 - i
                    if enough <= 0.0:
                        break
        clearances[n], culprits[n, 0], culprits[n, 1] = smallest, geom, other


_LOOK_AHEAD = 0.15  # clearances beyond this are not resolved further while moving [m]


@njit(cache=True, nogil=True)
def check_segment(
    robot: RobotArrays, world: WorldArrays, start: Float64, end: Float64, width: float, slack: float
) -> tuple[float, float, int, int]:
    """Prove a straight joint-space segment free, or find where it is not: conservative advancement.

    A geom's points move by at most sum |dq_j| · reach_j along the segment. So a clearance found at one posture reaches
    some way on; only there the geom is looked at again. Nothing comes closer than its margin minus `slack`.

    Returns:
        Where on the segment something is closer than its margin (0 to 1; 2 when nothing is), the smallest clearance
        met beyond the margins [m], and who has it, as in `check_states`.
    """
    dof, geoms, pairs = start.shape[0], robot.links.shape[0], robot.pairs.shape[0]
    links = np.empty((dof + 1, 3, 4))
    centres = np.empty((geoms, 3))
    placed = np.empty((robot.spheres.shape[0], 3))
    ready = np.empty(geoms, np.bool_)
    opening = width - robot.closed
    rates = np.zeros(geoms + pairs)  # metres per unit of the segment
    safe_until = np.zeros(geoms + pairs)
    for g in range(geoms):
        for j in range(dof):
            rates[g] += abs(end[j] - start[j]) * robot.reach[j, g]
        if robot.links[g] == 0:
            safe_until[g] = 2.0
    for p in range(pairs):
        for j in range(robot.links[robot.pairs[p, 0]], dof):
            rates[geoms + p] += abs(end[j] - start[j]) * robot.reach[j, robot.pairs[p, 1]]
    smallest, geom, other = 1e9, -1, -1
    q = np.empty(dof)
    while True:
        t = 2.0
        for n in range(geoms + pairs):
            t = min(t, safe_until[n])
        if t > 1.0:
            return 2.0, smallest, geom, other
        for j in range(dof):
            q[j] = start[j] + t * (end[j] - start[j])
        forward(robot.steps, robot.sliding, q, links)
        _place_bounds(robot, opening, links, centres)
        ready[:] = False
        for n in range(geoms + pairs):
            if safe_until[n] > t:
                continue
            rest = (1.0 - t) * rates[n]
            enough = min(rest, _LOOK_AHEAD) + 1e-9
            if n < geoms:
                away, which = _world_clearance(robot, world, n, opening, enough, links, centres, placed, ready)
                who = n
            else:
                i, who = robot.pairs[n - geoms]
                which = -1 - i
                away = _pair_clearance(robot, world, i, who, opening, enough, links, centres, placed, ready)
            if away < smallest:
                smallest, geom, other = away, who, which
            if away < 0.0:
                return t, away, who, which
            safe_until[n] = 2.0 if away + slack > rest else t + (away + slack) / rates[n]
