"""Proof that a straight joint-space segment is free, by conservative advancement, compiled by numba.

A clearance in one posture is valid for some distance along the segment; the geom is checked again only at its end. How
far a geom's points move while the joints go on by a share s of the segment is bounded twice, and the smaller bound
counts:

- by s times the sum of |dq_j| · reach_j: right for any motion, and far too much for one in which joints work against
  each other, such as a straight line of the tool;
- by s |v| + s²/2 a, where v is how a point moves in the posture at hand and a bounds how that can change: a point p
  of a chain has |d²p/dq_j dq_k| <= reach of the later of the two joints.

A proof needs slack: after an advance by exactly the clearance, the next check would find none. Also, a later check at
other points of the same segment must not contradict an earlier proof: a plan would fail on its own path. So a check may
miss `tolerance` of the margin, and proves `SLACK` less than that. Planning uses no tolerance; the check of a planned
path before its execution uses `SLACK`.

For two geoms the motion of the outer one in the inner one's frame counts, in which the joints before both stand still.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.motion.collision.kernel import (
    WorldArrays,
    evaluate_clearances,
    make_scratch,
    place,
)
from pomona.skills.motion.collision.robot_shape import RobotArrays

SLACK = 5e-4  # by how much a margin may be undershot between two looks [m]


@kernel(nogil=True)
def check_segment(
    robot: RobotArrays,
    world: WorldArrays,
    start: Float64,
    end: Float64,
    width: float,
    tolerance: float,
) -> tuple[float, float, int, int]:
    """Prove a segment free; nothing comes closer than its margin minus `tolerance + SLACK`.

    Returns where something is too close (0 to 1; 2 for nothing), the smallest clearance beyond the margins [m], and who
    has it, as in `check_states`.
    """
    dof = start.shape[0]
    geoms = robot.links.shape[0]
    pairs = robot.pairs
    of_geom = robot.links
    numbers = geoms + pairs.shape[0]
    scratch = make_scratch(robot)
    step = end - start
    turns = np.zeros((dof + 1, 3))
    shifts = np.zeros((dof + 1, 3))
    # [m] per unit of the segment
    rates = np.zeros(numbers)
    bends = np.zeros(numbers)
    speeds = np.zeros(numbers)
    safe_until = np.zeros(numbers)
    active = np.empty(numbers, np.bool_)
    wanted = np.empty(numbers)
    found = np.empty(numbers)
    which = np.empty(numbers, np.int64)
    for n in range(numbers):
        if n < geoms:
            rates[n], bends[n] = bounds_of_motion(robot.reach, step, 0, n)
            if of_geom[n] == 0:
                safe_until[n] = 2.0
        else:
            pair = n - geoms
            rates[n], bends[n] = bounds_of_motion(
                robot.reach, step, of_geom[pairs[pair, 0]], pairs[pair, 1]
            )
    smallest = 1e9
    geom = -1
    other = -1
    q = np.empty(dof)
    while True:
        t = safe_until.min()
        if t > 1.0:
            return 2.0, smallest, geom, other
        for j in range(dof):
            q[j] = start[j] + t * step[j]
        place(robot, q, width, scratch)
        write_twists(robot.sliding, scratch.links, step, turns, shifts)
        rest = 1.0 - t
        for n in range(numbers):
            active[n] = safe_until[n] <= t
            if active[n]:
                inner, outer = (
                    (0, n) if n < geoms else (of_geom[pairs[n - geoms, 0]], pairs[n - geoms, 1])
                )
                speeds[n] = speed_of_ball(
                    turns,
                    shifts,
                    inner,
                    of_geom[outer],
                    scratch.centres[outer],
                    robot.bounds[outer, 3],
                )
                motion = min(rates[n] * rest, (speeds[n] + 0.5 * bends[n] * rest) * rest)
                # clearances beyond this are not resolved further while moving [m]
                wanted[n] = min(motion, 0.15) + 1e-9
        worst = evaluate_clearances(
            robot, world, width, active, wanted, np.inf, scratch, found, which
        )
        if found[worst] < smallest:
            geom = worst if worst < geoms else pairs[worst - geoms, 1]
            smallest = found[worst]
            other = which[worst]
            if smallest < -tolerance:
                return t, smallest, geom, other
        for n in range(numbers):
            if active[n]:
                reached = _reaches(found[n] + tolerance + SLACK, rates[n], speeds[n], bends[n])
                safe_until[n] = 2.0 if reached > rest else t + reached


@kernel(nogil=True)
def check_path(
    robot: RobotArrays, world: WorldArrays, path: Float64, width: float, tolerance: float
) -> tuple[int, float, float, int, int]:
    """Check the segments between waypoints, shape (n, dof), until one is not free.

    Returns its number, or -1, and the result of `check_segment` for it.
    """
    for k in range(max(path.shape[0] - 1, 1)):
        end = path[min(k + 1, path.shape[0] - 1)]
        at, clearance, geom, other = check_segment(robot, world, path[k], end, width, tolerance)
        if at <= 1.0:
            return k, at, clearance, geom, other
    return -1, 2.0, 1e9, -1, -1


@kernel(nogil=True)
def bounds_of_motion(reach: Float64, step: Float64, first: int, geom: int) -> tuple[float, float]:
    """How fast a geom's points can move, and how much that can change, by the joints from `first` on."""
    rate = 0.0
    bend = 0.0
    turned = 0.0
    for j in range(first, step.shape[0]):
        moved = abs(step[j])
        rate += moved * reach[j, geom]
        bend += moved * (2.0 * turned + moved) * reach[j, geom]
        turned += moved
    return rate, bend


@kernel(nogil=True)
def write_twists(
    sliding: NDArray[np.bool_], links: Float64, step: Float64, turns: Float64, shifts: Float64
) -> None:
    """Write how every link moves: a point p that is carried by link n moves by turns[n] x p + shifts[n]."""
    for j in range(step.shape[0]):
        zx = step[j] * links[j + 1, 0, 2]
        zy = step[j] * links[j + 1, 1, 2]
        zz = step[j] * links[j + 1, 2, 2]
        if sliding[j]:
            for axis in range(3):
                turns[j + 1, axis] = turns[j, axis]
            shifts[j + 1, 0] = shifts[j, 0] + zx
            shifts[j + 1, 1] = shifts[j, 1] + zy
            shifts[j + 1, 2] = shifts[j, 2] + zz
        else:
            ox = links[j + 1, 0, 3]
            oy = links[j + 1, 1, 3]
            oz = links[j + 1, 2, 3]
            turns[j + 1, 0] = turns[j, 0] + zx
            turns[j + 1, 1] = turns[j, 1] + zy
            turns[j + 1, 2] = turns[j, 2] + zz
            shifts[j + 1, 0] = shifts[j, 0] - (zy * oz - zz * oy)
            shifts[j + 1, 1] = shifts[j, 1] - (zz * ox - zx * oz)
            shifts[j + 1, 2] = shifts[j, 2] - (zx * oy - zy * ox)


@kernel(nogil=True)
def speed_of_ball(
    turns: Float64, shifts: Float64, inner: int, outer: int, centre: Float64, radius: float
) -> float:
    """Return the largest speed of a ball carried by link `outer`, in the frame of link `inner`."""
    wx = turns[outer, 0] - turns[inner, 0]
    wy = turns[outer, 1] - turns[inner, 1]
    wz = turns[outer, 2] - turns[inner, 2]
    x = centre[0]
    y = centre[1]
    z = centre[2]
    vx = wy * z - wz * y + shifts[outer, 0] - shifts[inner, 0]
    vy = wz * x - wx * z + shifts[outer, 1] - shifts[inner, 1]
    vz = wx * y - wy * x + shifts[outer, 2] - shifts[inner, 2]
    return sqrt(vx * vx + vy * vy + vz * vz) + radius * sqrt(wx * wx + wy * wy + wz * wz)


@kernel(nogil=True)
def _reaches(clear: float, rate: float, speed: float, bend: float) -> float:
    """Return the validity of a clearance along the segment: the larger value of the two bounds of the motion."""
    steady = clear / max(rate, 1e-12)
    bending = 2.0 * clear / max(speed + sqrt(speed * speed + 2.0 * bend * clear), 1e-12)
    return max(steady, bending)
