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


@njit(cache=True, nogil=True, inline="always")
def _place_bounds(robot: RobotArrays, opening: float, links: Float64, centres: Float64) -> None:
    """Write the centres of the spheres around all geoms in the base frame, shape (g, 3)."""
    of_geom, bounds, slides = robot.links, robot.bounds, robot.slides
    for g in range(of_geom.shape[0]):
        n = of_geom[g]
        x, y, z = (
            bounds[g, 0] + opening * slides[g, 0],
            bounds[g, 1] + opening * slides[g, 1],
            bounds[g, 2] + opening * slides[g, 2],
        )
        for row in range(3):
            centres[g, row] = links[n, row, 0] * x + links[n, row, 1] * y + links[n, row, 2] * z + links[n, row, 3]


@njit(cache=True, nogil=True)
def _place(robot: RobotArrays, g: int, opening: float, links: Float64, placed: Float64, ready: NDArray[np.bool_]) -> None:
    """Write the centres of a geom's spheres in the base frame, once per posture."""
    ready[g] = True
    n, spheres = robot.links[g], robot.spheres
    sx, sy, sz = opening * robot.slides[g, 0], opening * robot.slides[g, 1], opening * robot.slides[g, 2]
    for s in range(robot.sphere_start[g], robot.sphere_start[g + 1]):
        x, y, z = spheres[s, 0] + sx, spheres[s, 1] + sy, spheres[s, 2] + sz
        for row in range(3):
            placed[s, row] = links[n, row, 0] * x + links[n, row, 1] * y + links[n, row, 2] * z + links[n, row, 3]


@njit(cache=True, nogil=True)
def _map_distance(robot: RobotArrays, world: WorldArrays, g: int, placed: Float64) -> float:
    """Distance of a placed geom from blocked cells of the map."""
    field, origin, resolution, spheres = world.field, world.origin, world.resolution, robot.spheres
    distance = 1e9
    for s in range(robot.sphere_start[g], robot.sphere_start[g + 1]):
        away = lookup(field, origin, resolution, placed[s, 0], placed[s, 1], placed[s, 2]) - spheres[s, 3]
        distance = min(distance, away)
    return distance


@njit(cache=True, nogil=True)
def _convex_distance(robot: RobotArrays, world: WorldArrays, g: int, k: int, placed: Float64) -> float:
    """Distance of a placed geom from one convex obstacle."""
    planes, spheres, bounds = world.planes, robot.spheres, world.bounds
    distance = 1e9
    for s in range(robot.sphere_start[g], robot.sphere_start[g + 1]):
        x, y, z, radius = placed[s, 0], placed[s, 1], placed[s, 2], spheres[s, 3]
        away = sqrt((x - bounds[k, 0]) ** 2 + (y - bounds[k, 1]) ** 2 + (z - bounds[k, 2]) ** 2) - bounds[k, 3]
        if away - radius >= distance:
            continue
        for f in range(world.plane_start[k], world.plane_start[k + 1]):
            away = max(away, planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z - planes[f, 3])
        distance = min(distance, away - radius)
    return distance


@njit(cache=True, nogil=True)
def _half_space_distance(
    robot: RobotArrays, world: WorldArrays, g: int, h: int, opening: float, links: Float64
) -> float:
    """Distance of a geom from a half space, exact for polyhedra and capsules."""
    half_spaces, slides, support, n = world.half_spaces, robot.slides, robot.support, robot.links[g]
    nx, ny, nz = half_spaces[h, 0], half_spaces[h, 1], half_spaces[h, 2]
    a = nx * links[n, 0, 0] + ny * links[n, 1, 0] + nz * links[n, 2, 0]
    b = nx * links[n, 0, 1] + ny * links[n, 1, 1] + nz * links[n, 2, 1]
    c = nx * links[n, 0, 2] + ny * links[n, 1, 2] + nz * links[n, 2, 2]
    base = nx * links[n, 0, 3] + ny * links[n, 1, 3] + nz * links[n, 2, 3] - half_spaces[h, 3]
    base += opening * (a * slides[g, 0] + b * slides[g, 1] + c * slides[g, 2])
    distance = 1e9
    for s in range(robot.support_start[g], robot.support_start[g + 1]):
        away = a * support[s, 0] + b * support[s, 1] + c * support[s, 2] - support[s, 3]
        distance = min(distance, base + away)
    return distance


@njit(cache=True, nogil=True)
def _pair_distance(
    robot: RobotArrays, i: int, j: int, placed: Float64, centres: Float64
) -> float:
    """Distance between two placed geoms."""
    spheres, bounds = robot.spheres, robot.bounds
    distance = 1e9
    cx, cy, cz, around = centres[j, 0], centres[j, 1], centres[j, 2], bounds[j, 3]
    for s in range(robot.sphere_start[i], robot.sphere_start[i + 1]):
        px, py, pz, radius = placed[s, 0], placed[s, 1], placed[s, 2], spheres[s, 3]
        limit = distance + radius + around
        if limit <= 0.0 or (px - cx) ** 2 + (py - cy) ** 2 + (pz - cz) ** 2 >= limit * limit:
            continue
        for t in range(robot.sphere_start[j], robot.sphere_start[j + 1]):
            limit = distance + radius + spheres[t, 3]
            squared = (px - placed[t, 0]) ** 2 + (py - placed[t, 1]) ** 2 + (pz - placed[t, 2]) ** 2
            if limit > 0.0 and squared < limit * limit:
                distance = sqrt(squared) - radius - spheres[t, 3]
    return distance


@njit(cache=True, nogil=True, inline="always")
def _world_clearance(
    robot: RobotArrays, world: WorldArrays, g: int, opening: float, enough: float, links: Float64, centres: Float64,
    placed: Float64, ready: NDArray[np.bool_],
) -> tuple[float, int]:  # fmt: skip
    """Clearance of one geom beyond its margin, and the number of the nearest obstacle."""
    ignored, half_spaces, bounds = world.ignored, world.half_spaces, world.bounds
    margin, convex = world.margins[g], bounds.shape[0]
    x, y, z, around = centres[g, 0], centres[g, 1], centres[g, 2], robot.bounds[g, 3] + margin
    nearest, which = 1e9, -1
    if not ignored[MAP, g]:
        nearest, which = lookup(world.field, world.origin, world.resolution, x, y, z) - around, MAP
        if nearest < enough:
            if not ready[g]:
                _place(robot, g, opening, links, placed, ready)
            nearest = _map_distance(robot, world, g, placed) - margin
    for h in range(half_spaces.shape[0]):
        if not ignored[1 + convex + h, g]:
            away = half_spaces[h, 0] * x + half_spaces[h, 1] * y + half_spaces[h, 2] * z - half_spaces[h, 3] - around
            if away < min(enough, nearest):
                away = _half_space_distance(robot, world, g, h, opening, links) - margin
            if away < nearest:
                nearest, which = away, 1 + convex + h
    for k in range(convex):
        if not ignored[1 + k, g]:
            away = sqrt((x - bounds[k, 0]) ** 2 + (y - bounds[k, 1]) ** 2 + (z - bounds[k, 2]) ** 2)
            away -= bounds[k, 3] + around
            if away < min(enough, nearest):
                if not ready[g]:
                    _place(robot, g, opening, links, placed, ready)
                away = _convex_distance(robot, world, g, k, placed) - margin
            if away < nearest:
                nearest, which = away, 1 + k
    return nearest, which


@njit(cache=True, nogil=True, inline="always")
def _pair_clearance(
    robot: RobotArrays, self_margin: float, i: int, j: int, opening: float, enough: float, links: Float64,
    centres: Float64, placed: Float64, ready: NDArray[np.bool_],
) -> float:  # fmt: skip
    """Clearance between two geoms of the robot beyond the margin."""
    x, y, z = centres[i, 0] - centres[j, 0], centres[i, 1] - centres[j, 1], centres[i, 2] - centres[j, 2]
    around = robot.bounds[i, 3] + robot.bounds[j, 3] + self_margin
    far = around + enough
    squared = x * x + y * y + z * z
    if far <= 0.0 or squared >= far * far:
        return sqrt(squared) - around
    if not ready[i]:
        _place(robot, i, opening, links, placed, ready)
    if not ready[j]:
        _place(robot, j, opening, links, placed, ready)
    return _pair_distance(robot, i, j, placed, centres) - self_margin


@njit(cache=True, nogil=True)
def check_states(
    robot: RobotArrays, world: WorldArrays, Q: Float64, width: float, enough: float, clearances: Float64, culprits: Int64
) -> None:
    """Judge postures Q, shape (n, dof), with one opening of the gripper.

    Writes the smallest clearance beyond the margins, shape (n,) [m], capped at `enough`, and who has it, shape (n, 2):
    a geom, and the number of an obstacle or -1 - another geom. With enough = 0, a posture is judged no further once it
    is known to collide.
    """
    geoms, pairs = robot.links.shape[0], robot.pairs
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
            for p in range(pairs.shape[0]):
                i, j = pairs[p, 0], pairs[p, 1]
                away = _pair_clearance(
                    robot, world.self_margin, i, j, opening, smallest, links, centres, placed, ready
                )
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
                i, who = robot.pairs[n - geoms, 0], robot.pairs[n - geoms, 1]
                which = -1 - i
                away = _pair_clearance(
                    robot, world.self_margin, i, who, opening, enough, links, centres, placed, ready
                )
            if away < smallest:
                smallest, geom, other = away, who, which
            if away < 0.0:
                return t, away, who, which
            safe_until[n] = 2.0 if away + slack > rest else t + (away + slack) / rates[n]
