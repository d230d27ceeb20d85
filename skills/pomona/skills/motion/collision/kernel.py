"""Collision checks of postures, compiled by numba; `segment` proves the paths between them.

Distances are lower bounds. The covering spheres of a geom (support points against planes) are only checked if one
sphere around it is not sufficient. Above the distance `enough` the caller needs no exact value.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64, Int64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.motion.collision.distance_field import lookup
from pomona.skills.motion.collision.robot_shape import RobotArrays
from pomona.skills.motion.robot.model import forward

MAP = 0  # number of the map among the obstacles; convex obstacles follow from 1, then half spaces


class WorldArrays(NamedTuple):
    """Obstacles of the robot: c convex obstacles, h half spaces, g geoms of the robot. Base frame, metres."""

    field: Float32  # field, origin, resolution: a distance field, see `pomona.skills.motion.collision.distance_field`
    origin: Float64
    resolution: float
    planes: (
        Float64  # faces of all convex obstacles, shape (n, 4), and `plane_start`, shape (c + 1,)
    )
    plane_start: Int64
    bounds: Float64  # a sphere around each convex obstacle, shape (c, 4)
    half_spaces: Float64  # normal n and offset d: free where n·p > d, shape (h, 4)
    margins: Float64  # distance that each geom keeps from each obstacle, shape (1 + c + h, g)
    self_margin: float  # distance that the robot's parts keep from each other
    ignored: NDArray[np.bool_]  # which geom may touch which obstacle, shape (1 + c + h, g)


@kernel(nogil=True)
def place_spheres(
    spheres: Float64,
    begin: int,
    end: int,
    T: Float64,
    sx: float,
    sy: float,
    sz: float,
    placed: Float64,
) -> None:
    """Write the centres of a geom's spheres, shifted by s in the link's frame, in the base frame."""
    for s in range(begin, end):
        x = spheres[s, 0] + sx
        y = spheres[s, 1] + sy
        z = spheres[s, 2] + sz
        for row in range(3):
            placed[s, row] = T[row, 0] * x + T[row, 1] * y + T[row, 2] * z + T[row, 3]


@kernel(nogil=True)
def _map_distance(
    field: Float32,
    origin: Float64,
    resolution: float,
    spheres: Float64,
    begin: int,
    end: int,
    placed: Float64,
) -> float:
    distance: float = 1e9
    for s in range(begin, end):
        away = (
            lookup(field, origin, resolution, placed[s, 0], placed[s, 1], placed[s, 2])
            - spheres[s, 3]
        )
        distance = min(distance, away)
    return distance


@kernel(nogil=True)
def _convex_distance(
    planes: Float64,
    first: int,
    last: int,
    bound: Float64,
    spheres: Float64,
    begin: int,
    end: int,
    placed: Float64,
) -> float:
    distance: float = 1e9
    for s in range(begin, end):
        x = placed[s, 0]
        y = placed[s, 1]
        z = placed[s, 2]
        radius = spheres[s, 3]
        away = sqrt((x - bound[0]) ** 2 + (y - bound[1]) ** 2 + (z - bound[2]) ** 2) - bound[3]
        if away - radius >= distance:
            continue
        for f in range(first, last):
            away = max(away, planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z - planes[f, 3])
            if away - radius >= distance:  # further planes can only put it further away
                break
        distance = min(distance, away - radius)
    return distance


@kernel(nogil=True)
def _half_space_distance(
    plane: Float64,
    support: Float64,
    begin: int,
    end: int,
    T: Float64,
    sx: float,
    sy: float,
    sz: float,
) -> float:
    """Return the distance of a geom, shifted by s in the link's frame, from a half space; exact."""
    nx = plane[0]
    ny = plane[1]
    nz = plane[2]
    a = nx * T[0, 0] + ny * T[1, 0] + nz * T[2, 0]
    b = nx * T[0, 1] + ny * T[1, 1] + nz * T[2, 1]
    c = nx * T[0, 2] + ny * T[1, 2] + nz * T[2, 2]
    distance: float = 1e9
    for s in range(begin, end):
        distance = min(
            distance, a * support[s, 0] + b * support[s, 1] + c * support[s, 2] - support[s, 3]
        )
    distance += nx * T[0, 3] + ny * T[1, 3] + nz * T[2, 3] - plane[3] + a * sx + b * sy + c * sz
    return distance


@kernel(nogil=True)
def _pair_distance(
    spheres: Float64,
    begin: int,
    end: int,
    other_begin: int,
    other_end: int,
    other: Float64,
    around: float,
    placed: Float64,
) -> float:
    """Return the distance between two placed geoms; `other` and `around` are the sphere around the second one."""
    distance: float = 1e9
    for s in range(begin, end):
        x = placed[s, 0]
        y = placed[s, 1]
        z = placed[s, 2]
        radius = spheres[s, 3]
        limit = distance + radius + around
        if (
            limit <= 0.0
            or (x - other[0]) ** 2 + (y - other[1]) ** 2 + (z - other[2]) ** 2 >= limit * limit
        ):
            continue
        for t in range(other_begin, other_end):
            limit = distance + radius + spheres[t, 3]
            squared = (x - placed[t, 0]) ** 2 + (y - placed[t, 1]) ** 2 + (z - placed[t, 2]) ** 2
            if limit > 0.0 and squared < limit * limit:
                distance = sqrt(squared) - radius - spheres[t, 3]
    return distance


@kernel(nogil=True)
def check_states(
    robot: RobotArrays,
    world: WorldArrays,
    Q: Float64,
    width: float,
    enough: float,
    clearances: Float64,
    closest: Int64,
) -> None:
    """Write the smallest clearance of postures Q, (n, dof), beyond the margins, (n,) [m], at most `enough`.

    `closest` (n, 2) gets a geom, and the number of an obstacle or -1 - another geom. With enough = 0 a posture that
    collides is judged no further.
    """
    numbers = robot.links.shape[0] + robot.pairs.shape[0]
    active = np.ones(numbers, np.bool_)
    wanted = np.empty(numbers)
    found = np.empty(numbers)
    which = np.empty(numbers, np.int64)
    scratch = make_scratch(robot)
    for g in range(robot.links.shape[0]):
        active[g] = robot.links[g] > 0
    wanted[:] = enough
    for n in range(Q.shape[0]):
        place(robot, Q[n], width, scratch)
        worst = evaluate_clearances(robot, world, width, active, wanted, 0.0, scratch, found, which)
        clearances[n], closest[n, 0], closest[n, 1] = enough, -1, -1
        if worst >= 0 and found[worst] < enough:
            clearances[n] = found[worst]
            geom = (
                worst
                if worst < robot.links.shape[0]
                else robot.pairs[worst - robot.links.shape[0], 1]
            )
            closest[n, 0], closest[n, 1] = geom, which[worst]


class Scratch(NamedTuple):
    """Memory for one posture: poses of links, centres of geoms and of spheres, geoms whose spheres are placed."""

    links: Float64
    centres: Float64
    placed: Float64
    ready: NDArray[np.bool_]


@kernel(nogil=True)
def make_scratch(robot: RobotArrays) -> Scratch:
    """Memory to judge postures of a robot in."""
    geoms = robot.links.shape[0]
    return Scratch(
        np.empty((robot.steps.shape[0] + 1, 3, 4)),
        np.empty((geoms, 3)),
        np.empty((robot.spheres.shape[0], 3)),
        np.empty(geoms, np.bool_),
    )


@kernel(nogil=True)
def place(robot: RobotArrays, q: Float64, width: float, scratch: Scratch) -> None:
    """Put the links and the centres of all geoms where they are in a posture."""
    of_geom = robot.links
    slides = robot.slides
    bounds = robot.bounds
    opening = width - robot.closed
    links = scratch.links
    centres = scratch.centres
    ready = scratch.ready
    forward(robot.steps, robot.sliding, q, links)
    for g in range(of_geom.shape[0]):
        n = of_geom[g]
        x = bounds[g, 0] + opening * slides[g, 0]
        y = bounds[g, 1] + opening * slides[g, 1]
        z = bounds[g, 2] + opening * slides[g, 2]
        for row in range(3):
            centres[g, row] = (
                links[n, row, 0] * x
                + links[n, row, 1] * y
                + links[n, row, 2] * z
                + links[n, row, 3]
            )
        ready[g] = False


@kernel(nogil=True)
def evaluate_clearances(
    robot: RobotArrays,
    world: WorldArrays,
    width: float,
    active: NDArray[np.bool_],
    wanted: Float64,
    slack: float,
    scratch: Scratch,
    found: Float64,
    which: Int64,
) -> int:
    """Check the active parts in the present posture: geoms against the world, then pairs of geoms.

    Writes the clearance beyond the margin into `found` (resolved only below `wanted`) and into `which` the obstacle, or
    -1 - the pair's first geom. Returns the number of the smallest. Clearances that exceed the smallest by `slack` [m]
    are not resolved: 0 for the smallest alone, then the check ends after a collision when `wanted` is 0; inf for all.
    """
    # `slack` is no bool, since numba compiles all of this once for True and once for False.
    # Local names: reading an array out of a tuple counts references, which costs more than the arithmetic.
    of_geom = robot.links
    slides = robot.slides
    bounds = robot.bounds
    spheres = robot.spheres
    start = robot.sphere_start
    support = robot.support
    support_start = robot.support_start
    pairs = robot.pairs
    links = scratch.links
    centres = scratch.centres
    placed = scratch.placed
    ready = scratch.ready
    field = world.field
    origin = world.origin
    resolution = world.resolution
    planes = world.planes
    plane_start = world.plane_start
    convex = world.bounds
    half_spaces = world.half_spaces
    margins = world.margins
    ignored = world.ignored
    self_margin = world.self_margin
    opening = width - robot.closed
    geoms = of_geom.shape[0]
    obstacles = convex.shape[0]
    worst: int = -1
    smallest: float = 1e9
    for g in range(geoms - 1, -1, -1):  # the gripper collides most often
        if not active[g]:
            continue
        enough = min(wanted[g], smallest + slack)
        x = centres[g, 0]
        y = centres[g, 1]
        z = centres[g, 2]
        radius = bounds[g, 3]
        sx = opening * slides[g, 0]
        sy = opening * slides[g, 1]
        sz = opening * slides[g, 2]
        n = of_geom[g]
        begin = start[g]
        end = start[g + 1]
        nearest = 1e9
        nearest_is = -1
        if not ignored[MAP, g]:
            margin = margins[MAP, g]
            nearest = lookup(field, origin, resolution, x, y, z) - radius - margin
            nearest_is = MAP
            if nearest < enough:
                place_spheres(spheres, begin, end, links[n], sx, sy, sz, placed)
                ready[g] = True
                nearest = (
                    _map_distance(field, origin, resolution, spheres, begin, end, placed) - margin
                )
        for h in range(half_spaces.shape[0]):
            if ignored[1 + obstacles + h, g]:
                continue
            margin = margins[1 + obstacles + h, g]
            away = (
                half_spaces[h, 0] * x
                + half_spaces[h, 1] * y
                + half_spaces[h, 2] * z
                - half_spaces[h, 3]
            )
            away -= radius + margin
            if away < min(enough, nearest):
                away = _half_space_distance(
                    half_spaces[h],
                    support,
                    support_start[g],
                    support_start[g + 1],
                    links[n],
                    sx,
                    sy,
                    sz,
                )
                away -= margin
            if away < nearest:
                nearest = away
                nearest_is = 1 + obstacles + h
        for k in range(obstacles):
            if ignored[1 + k, g]:
                continue
            away = sqrt((x - convex[k, 0]) ** 2 + (y - convex[k, 1]) ** 2 + (z - convex[k, 2]) ** 2)
            margin = margins[1 + k, g]
            away -= convex[k, 3] + radius + margin
            if away < min(enough, nearest):
                if not ready[g]:
                    place_spheres(spheres, begin, end, links[n], sx, sy, sz, placed)
                    ready[g] = True
                first = plane_start[k]
                last = plane_start[k + 1]
                away = (
                    _convex_distance(planes, first, last, convex[k], spheres, begin, end, placed)
                    - margin
                )
            if away < nearest:
                nearest = away
                nearest_is = 1 + k
        found[g], which[g] = nearest, nearest_is
        if nearest < smallest:
            worst = g
            smallest = nearest
            if slack == 0.0 and nearest < 0.0 and wanted[g] <= 0.0:
                return worst
    for p in range(pairs.shape[0]):
        number = geoms + p
        if not active[number]:
            continue
        enough = min(wanted[number], smallest + slack)
        i = pairs[p, 0]
        j = pairs[p, 1]
        around = bounds[i, 3] + bounds[j, 3] + self_margin
        squared = (
            (centres[i, 0] - centres[j, 0]) ** 2
            + (centres[i, 1] - centres[j, 1]) ** 2
            + (centres[i, 2] - centres[j, 2]) ** 2
        )
        if around + enough > 0.0 and squared < (around + enough) ** 2:
            for g in (i, j):
                if not ready[g]:
                    place_spheres(
                        spheres,
                        start[g],
                        start[g + 1],
                        links[of_geom[g]],
                        opening * slides[g, 0],
                        opening * slides[g, 1],
                        opening * slides[g, 2],
                        placed,
                    )
                    ready[g] = True
            away = _pair_distance(
                spheres,
                start[i],
                start[i + 1],
                start[j],
                start[j + 1],
                centres[j],
                bounds[j, 3],
                placed,
            )
            away -= self_margin
        elif slack == 0.0:
            continue  # its clearance is no smaller than `enough`
        else:
            away = sqrt(squared) - around
        found[number], which[number] = away, -1 - i
        if away < smallest:
            worst = number
            smallest = away
            if slack == 0.0 and away < 0.0 and wanted[number] <= 0.0:
                return worst
    return worst
