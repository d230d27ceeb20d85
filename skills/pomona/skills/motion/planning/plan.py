"""A checked, timed trajectory from the present joints to the best of many pre-grasps.

Two planners are offered: this project's RRT-Connect, and OMPL's. A planner ends when it has a solution (the plain ones)
or has used its iterations (the optimising ones): counting, not the wall clock, decides, so that a seed gives the same
path on a loaded machine. The wall clock is only the last resort.

1. Straight joint motions to every goal, nearest first: most scenes need nothing else.
2. A planner to the *set* of goals: RRT-Connect for a first path in milliseconds.
3. Shortcuts, rounded corners, time within velocity, acceleration and jerk limits, and a check of the trajectory to
execute.
4. The rest of the budget on an optimising planner; the quicker trajectory is given.

`planner: RRTstar` with one goal and without `improve` is the paper's method.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from pomona.drivers.interfaces import ArmLimits, Trajectory
from pomona.executive.values.arrays import Float64
from pomona.skills.motion.planning.rrt_connect import FIRST_ROUND
from pomona.skills.motion.planning.space import (
    BadRequest,
    Effort,
    PlanningFailed,
    Solution,
    Space,
    path_length,
    shortcut,
)
from pomona.skills.motion.planning.timing import time_polyline


class BudgetUse(Enum):
    """Use of the budget by a planner."""

    FEASIBLE = "ends with the first path"
    OPTIMISING = "shortens its path while the budget lasts"


@dataclass(frozen=True, slots=True)
class PlannerKind:
    """An available planner.

    Attributes:
        kind: its use of the budget.
        iterations_per_second: on an unloaded core (2.5 GHz, warm).
        ompl: the name of OMPL's class, empty for this project's own.
    """

    kind: BudgetUse
    iterations_per_second: float
    ompl: str = ""


PLANNERS: dict[str, PlannerKind] = {
    "RRTConnect": PlannerKind(BudgetUse.FEASIBLE, 20_000.0),
    "OMPL_RRTConnect": PlannerKind(BudgetUse.FEASIBLE, 10_000.0, "RRTConnect"),
    "RRT": PlannerKind(BudgetUse.FEASIBLE, 10_000.0, "RRT"),
    "KPIECE1": PlannerKind(BudgetUse.FEASIBLE, 10_000.0, "KPIECE1"),
    "RRTstar": PlannerKind(BudgetUse.OPTIMISING, 4_400.0, "RRTstar"),
    "InformedRRTstar": PlannerKind(BudgetUse.OPTIMISING, 2_600.0, "InformedRRTstar"),
    "BITstar": PlannerKind(BudgetUse.OPTIMISING, 50_000.0, "BITstar"),
}


def solve(
    space: Space, q_start: Float64, q_goals: Float64, planner: str, effort: Effort
) -> Solution:
    """Run one planner, a name in `PLANNERS`, from a start, shape (dof,), to goals, shape (n >= 1, dof) [rad], all free.

    Raises:
        BadRequest: the planner is OMPL's, which is not installed.
    """
    offered = PLANNERS[planner]
    if offered.ompl:
        wanted = (
            effort if offered.kind is BudgetUse.OPTIMISING else replace(effort, good_enough=None)
        )
        try:
            from pomona.skills.motion.planning.ompl_planners import solve_by_ompl
        except ModuleNotFoundError as error:  # no wheel for this system: trees are still checked
            raise BadRequest(
                f"the planner {planner} needs OMPL, which is not installed ({error})"
            ) from error
        return solve_by_ompl(space, q_start, q_goals, offered.ompl, wanted)
    used = 0
    round_ = FIRST_ROUND
    while used < effort.iterations:
        if time.perf_counter() > effort.deadline:
            return Solution(None, used, out_of_time=True)
        waypoints, took = space.connect(
            q_start, q_goals, min(round_, effort.iterations - used), (effort.seed + used) % 2**31
        )
        used = used + took
        round_ = 2 * round_
        if waypoints is not None:
            return Solution(waypoints, used, out_of_time=False)
    return Solution(None, used, out_of_time=False)


TURN = 2.0 * np.pi  # [rad]

# a path this close to the straight distance to the nearest goal is not worth improving
GOOD_ENOUGH = 1.02


@dataclass(frozen=True, slots=True, eq=False)
class PlanRequest:
    """A planning problem; picklable, since it is planned in another process.

    Attributes:
        space: collision checks with the robot and the obstacles behind them.
        q_start: present joints, shape (dof,) [rad].
        q_goals: alternatives, shape (n, dof) [rad]; any of them will do.
        limits: of the arm's motion.
        planner: a name in `PLANNERS`.
        improve: an optimising planner for the rest of the budget, or empty.
        budget: seconds of planning on an unloaded core; converted to a number of iterations.
        seed: the same seed gives the same path, independent of the machine's load.
        patience: seconds on the wall after which planning is given up: the last resort.
        direct: whether to try straight joint motions first and to be content with a path nearly as short as one; the
            paper's method does neither.
    """

    space: Space
    q_start: Float64
    q_goals: Float64
    limits: ArmLimits
    planner: str = "RRTConnect"
    improve: str = "InformedRRTstar"
    budget: float = 0.2
    seed: int = 0
    patience: float = 10.0
    direct: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class PlanResult:
    """A path that may be executed.

    Attributes:
        path: timed, within limits, every state checked.
        goal: index of the goal that it reaches.
        waypoints: corners of the path before rounding, shape (n, dof) [rad].
        length: of the polyline [rad].
        found_by: straight, or the planner's name.
        iterations: of all planners together.
        first_path_s, total_s: wall time to the first timed and checked trajectory, and altogether [s].
    """

    path: Trajectory
    goal: int
    waypoints: Float64
    length: float
    found_by: str
    iterations: int
    first_path_s: float
    total_s: float


@dataclass(slots=True)
class _Progress:
    """Budget used and paths found so far."""

    began: float = field(default_factory=time.perf_counter)
    iterations: int = 0
    out_of_time: bool = False


def plan(request: PlanRequest) -> PlanResult:
    """Plan to any of the goals.

    Raises:
        PlanningFailed: START_IN_COLLISION, GOAL_UNREACHABLE (there is no goal), GOAL_IN_COLLISION (none is free),
            NO_PATH (iterations used up) or TIMEOUT (wall clock), with data.
        BadRequest: joints that are not finite or too many or few, or a planner that is not offered.
    """
    given, (request, turns) = request, _by_the_short_way(request)
    progress = _Progress()
    rng = np.random.default_rng(request.seed)
    space = request.space
    goals = _free_goals(request)
    waypoints, found_by = _first_path(request, goals, progress)
    waypoints = shortcut(space, waypoints, rng)
    path = time_free_path(space, waypoints, request.limits)
    first_path_s = time.perf_counter() - progress.began
    if request.improve and path_length(waypoints) > GOOD_ENOUGH * _nearest(request, goals):
        better = _improve(request, goals, progress)
        if better is not None:
            better = shortcut(space, better, rng)
            candidate = time_free_path(space, better, request.limits)
            if candidate.duration < path.duration:
                waypoints = better
                path = candidate
                found_by = request.improve
    reached = int(np.linalg.norm(request.q_goals - waypoints[-1], axis=1).argmin())
    if given is not request:
        path = replace(path, q=path.q + turns)
        waypoints = waypoints + turns
    return PlanResult(
        path,
        reached,
        waypoints,
        path_length(waypoints),
        found_by,
        progress.iterations,
        first_path_s,
        time.perf_counter() - progress.began,
    )


def _by_the_short_way(request: PlanRequest) -> tuple[PlanRequest, Float64]:
    """Return the request with the joints that turn without limits near zero, and the whole turns left out (dof,) [rad].

    Each of them goes to its goal by the short way, or by the long one where that leaves the limits of the arm's motion.
    """
    endless = request.space.endless
    start = request.q_start
    goals = np.atleast_2d(request.q_goals)
    if not endless.any() or start.shape != endless.shape or goals.shape[1:] != endless.shape:
        return request, np.zeros(len(endless))
    turns = np.where(endless, TURN * np.round(start / TURN), 0.0)
    nearest = goals + np.where(endless, TURN * np.round((start - goals) / TURN), 0.0)
    nearest = nearest - np.where(endless & (nearest > request.limits.upper), TURN, 0.0)
    nearest = nearest + np.where(endless & (nearest < request.limits.lower), TURN, 0.0)
    return replace(request, q_start=start - turns, q_goals=nearest - turns), turns


def _free_goals(request: PlanRequest) -> Float64:
    """Return the goals that are free of collision, nearest first, shape (n, dof)."""
    space = request.space
    q_goals = np.atleast_2d(request.q_goals)
    for name in (request.planner, request.improve):
        if name and name not in PLANNERS:
            raise BadRequest(f"no planner named {name!r}; there are {', '.join(PLANNERS)}")
    if not (np.isfinite(request.q_start).all() and np.isfinite(q_goals).all()):
        raise BadRequest("start and goals must be finite numbers")
    if q_goals.size == 0:
        raise PlanningFailed("GOAL_UNREACHABLE", "no goal has a joint solution")
    dof = space.lower.size
    if request.q_start.shape != (dof,) or q_goals.shape[1:] != (dof,):
        given = f"start {request.q_start.shape}, goals {q_goals.shape}"
        raise BadRequest(f"start and goals must have the arm's {dof} joints, not shapes {given}")
    if not space.free(request.q_start):
        reason, data = space.explain(request.q_start)
        raise PlanningFailed("START_IN_COLLISION", f"at the arm's present position, {reason}", data)
    inside = ((q_goals >= space.lower) & (q_goals <= space.upper)).all(axis=1)
    if not inside.any():
        raise PlanningFailed(
            "GOAL_UNREACHABLE", f"all {len(q_goals)} goals lie beyond the joint limits"
        )
    within = q_goals[inside]
    free = within[[space.free(q) for q in within]]
    if len(free) == 0:
        reason, data = space.explain(within[0])
        raise PlanningFailed(
            "GOAL_IN_COLLISION",
            f"none of {len(within)} goals is free; at the first, {reason}",
            data | {"goals": len(within)},
        )
    nearest_first: Float64 = free[
        np.linalg.norm(free - request.q_start, axis=1).argsort(kind="stable")
    ]
    return nearest_first


def _first_path(request: PlanRequest, goals: Float64, progress: _Progress) -> tuple[Float64, str]:
    if request.direct:
        for goal in goals:
            if request.space.free_between(request.q_start, goal):
                return np.array([request.q_start, goal]), "straight"
    waypoints = _solve(request, request.planner, goals, 1.0, progress)
    if waypoints is None:
        nearest = float(np.linalg.norm(goals - request.q_start, axis=1).min())
        code, why = (
            ("TIMEOUT", "time ran out")
            if progress.out_of_time
            else ("NO_PATH", "the budget is used up")
        )
        raise PlanningFailed(
            code,
            f"{request.planner} found no path to any of {len(goals)} goals before {why}",
            {
                "planner": request.planner,
                "iterations": progress.iterations,
                "goals": len(goals),
                "nearest_rad": nearest,
            },
        )
    return waypoints, request.planner


def _improve(request: PlanRequest, goals: Float64, progress: _Progress) -> Float64 | None:
    """Return a path by the optimising planner within the rest of the budget."""
    if PLANNERS[request.planner].kind is BudgetUse.OPTIMISING:
        return None
    used = progress.iterations / (request.budget * PLANNERS[request.planner].iterations_per_second)
    return _solve(request, request.improve, goals, 1.0 - used, progress)


def _solve(
    request: PlanRequest, planner: str, goals: Float64, share: float, progress: _Progress
) -> Float64 | None:
    iterations = int(share * request.budget * PLANNERS[planner].iterations_per_second)
    if iterations < 1:
        return None
    good_enough = GOOD_ENOUGH * _nearest(request, goals) if request.direct else 0.0
    effort = Effort(iterations, request.seed, progress.began + request.patience, good_enough)
    solution = solve(request.space, request.q_start, goals, planner, effort)
    progress.iterations += solution.iterations
    progress.out_of_time = progress.out_of_time or solution.out_of_time
    return solution.waypoints


def _nearest(request: PlanRequest, goals: Float64) -> float:
    return float(np.linalg.norm(goals[0] - request.q_start))


_SHARPER = {0.0: 0.35, 0.35: 0.7, 0.7: 1.0}


def time_free_path(space: Space, waypoints: Float64, limits: ArmLimits) -> Trajectory:
    """Time a free polyline, shape (n, dof) [rad]; corners that would touch an obstacle are rounded less.

    A corner at which the motion rests follows the polyline exactly, so this ends with a free motion.

    Raises:
        PlanningFailed: NO_PATH: the polyline itself is not free.
    """
    dwells = np.zeros(len(waypoints))
    while True:
        trajectory = time_polyline(waypoints, limits, dwells)
        blocked = space.first_blocked(trajectory.q)
        if blocked is None:
            return trajectory
        corners = [k for k in range(1, len(waypoints) - 1) if dwells[k] < 1.0]
        if not corners:
            raise PlanningFailed("NO_PATH", "the path touches an obstacle between its waypoints")
        near = min(
            corners, key=lambda k: float(np.linalg.norm(waypoints[k] - trajectory.q[blocked]))
        )
        dwells[near] = _SHARPER[float(dwells[near])]
