"""RRT-Connect to a set of goals, compiled by numba: a first path in a millisecond or two.

Two trees grow, one from the start and one from all goals; the smaller one takes a step towards a random posture and the
other one tries to reach the new node in steps of its own, until something is in the way (Kuffner and LaValle 2000).
Trees that have not met after a while are thrown away and begun anew with twice the patience: most problems are solved
by small trees, and an unlucky start is cheaper to forget than to repair.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from pomona.executive.values.arrays import Float64, Int64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.motion.collision.kernel import (
    WorldArrays,
    evaluate_clearances,
    make_scratch,
    place,
)
from pomona.skills.motion.collision.robot_shape import RobotArrays
from pomona.skills.motion.collision.segment import check_segment

PROBED = 0.2
"""Segments with a larger step of any joint are first looked at in a few places [rad]: most that collide do so there,
and are refused far more quickly than by proof."""

MAX_STEP = 0.8  # longest edge of a tree [rad]: the quickest of 0.4 to 3 on 56 problems of MotionBenchMaker's Panda

# iterations before two trees are begun anew; each further round has twice as many
FIRST_ROUND = 500

_PROBES = (1.0, 0.5, 0.25, 0.75)


@kernel(nogil=True)
def free_between(
    robot: RobotArrays, world: WorldArrays, width: float, q_a: Float64, q_b: Float64
) -> bool:
    """Return True if a straight joint segment keeps all margins, at every point of it."""
    dof = q_a.shape[0]
    longest = 0.0
    for j in range(dof):
        longest = max(longest, abs(q_b[j] - q_a[j]))
    if longest > PROBED and not _probes_free(robot, world, width, q_a, q_b):
        return False
    at, _, _, _ = check_segment(robot, world, q_a, q_b, width, 0.0)
    return bool(at > 1.0)


@kernel(nogil=True)
def _probes_free(
    robot: RobotArrays, world: WorldArrays, width: float, q_a: Float64, q_b: Float64
) -> bool:
    scratch = make_scratch(robot)
    numbers = robot.links.shape[0] + robot.pairs.shape[0]
    active = np.ones(numbers, np.bool_)
    for g in range(robot.links.shape[0]):
        active[g] = robot.links[g] > 0
    wanted = np.zeros(numbers)
    found = np.empty(numbers)
    which = np.empty(numbers, np.int64)
    q = np.empty(q_a.shape[0])
    for share in _PROBES:
        for j in range(q.shape[0]):
            q[j] = q_a[j] + share * (q_b[j] - q_a[j])
        place(robot, q, width, scratch)
        worst = evaluate_clearances(robot, world, width, active, wanted, 0.0, scratch, found, which)
        if worst >= 0 and found[worst] < 0.0:
            return False
    return True


class Trees(NamedTuple):
    """Nodes of two trees: postures, shape (2, n, dof) [rad], and each one's parent, -1 for a root."""

    q: Float64
    parent: Int64


@kernel(nogil=True)
def _nearest(nodes: Float64, count: int, q: Float64) -> tuple[int, float]:
    """Return the node that is closest to a posture, and how far it is."""
    best = 0
    closest = 1e300
    for n in range(count):
        squared = 0.0
        for j in range(q.shape[0]):
            step = nodes[n, j] - q[j]
            squared += step * step
            if squared >= closest:
                break
        if squared < closest:
            best = n
            closest = squared
    return best, sqrt(closest)


@kernel(nogil=True)
def grow(
    robot: RobotArrays,
    world: WorldArrays,
    width: float,
    lower: Float64,
    upper: Float64,
    trees: Trees,
    roots: int,
    max_step: float,
    iterations: int,
    rng: np.random.Generator,
) -> tuple[int, int, int]:
    """Grow the start's tree (0) and the goals' tree (1) until they meet; robot, world and width as for `check_segment`.

    Args:
        lower, upper: joint limits, shape (dof,) [rad].
        trees: with the start in the first place of tree 0 and the goals in the first `roots` places of tree 1.
        max_step: longest new edge [rad].

    Returns:
        The nodes of both trees that are the same posture, or -1 and -1, and the iterations used.
    """
    q_all = trees.q
    parent = trees.parent
    capacity = q_all.shape[1]
    dof = q_all.shape[2]
    count = np.empty(2, np.int64)
    count[0], count[1] = 1, roots
    q_new = np.empty(dof)
    q_next = np.empty(dof)
    q_random = np.empty(dof)
    for iteration in range(1, iterations + 1):
        ours = 0 if count[0] <= count[1] else 1
        theirs = 1 - ours
        if iteration % 2 == 0:  # a tree of many roots grows too, even where it is the larger one
            ours, theirs = theirs, ours
        for j in range(dof):
            q_random[j] = lower[j] + (upper[j] - lower[j]) * rng.random()
        near, away = _nearest(q_all[ours], count[ours], q_random)
        share = min(1.0, max_step / max(away, 1e-12))
        for j in range(dof):
            q_new[j] = q_all[ours, near, j] + share * (q_random[j] - q_all[ours, near, j])
        if not free_between(robot, world, width, q_all[ours, near], q_new):
            continue
        if count[ours] >= capacity:
            return -1, -1, iteration
        node = count[ours]
        for j in range(dof):
            q_all[ours, node, j] = q_new[j]
        parent[ours, node] = near
        count[ours] += 1
        near, away = _nearest(q_all[theirs], count[theirs], q_new)
        while True:
            last = away <= max_step
            for j in range(dof):
                q_next[j] = (
                    q_new[j]
                    if last
                    else q_all[theirs, near, j]
                    + max_step / away * (q_new[j] - q_all[theirs, near, j])
                )
            if not free_between(robot, world, width, q_all[theirs, near], q_next):
                break
            if last:
                return (node, near, iteration) if ours == 0 else (near, node, iteration)
            if count[theirs] >= capacity:
                return -1, -1, iteration
            for j in range(dof):
                q_all[theirs, count[theirs], j] = q_next[j]
            parent[theirs, count[theirs]] = near
            near = count[theirs]
            count[theirs] += 1
            away -= max_step
    return -1, -1, iterations


def path_between(trees: Trees, from_start: int, from_goal: int) -> Float64:
    """Return the waypoints from the start over the place where two trees met to a goal, shape (n, dof) [rad]."""
    before = []
    after = []
    while from_start >= 0:
        before.append(trees.q[0, from_start])
        from_start = int(trees.parent[0, from_start])
    while from_goal >= 0:
        after.append(trees.q[1, from_goal])
        from_goal = int(trees.parent[1, from_goal])
    path = np.array([*reversed(before), *after])
    moved = np.abs(np.diff(path, axis=0)).max(axis=1) > 0.0
    waypoints: Float64 = path[np.concatenate([[True], moved])]
    return waypoints


def room(q_start: Float64, q_goals: Float64, nodes: int) -> Trees:
    """Memory for two trees with the start and the goals, shape (n, dof), in them."""
    dof = len(q_start)
    trees = Trees(np.empty((2, len(q_goals) + nodes, dof)), np.full((2, len(q_goals) + nodes), -1))
    trees.q[0, 0] = q_start
    trees.q[1, : len(q_goals)] = q_goals
    return trees
