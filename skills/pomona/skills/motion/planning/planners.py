"""The planners that are offered: this project's RRT-Connect, and OMPL's.

A planner ends when it has a solution (the plain ones) or has used its iterations (the optimising ones): counting, not
the wall clock, decides, so that a seed gives the same path on a loaded machine. The wall clock is only the last resort.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from enum import Enum

from pomona.executive.values.arrays import Float64
from pomona.skills.motion.planning.errors import BadRequest
from pomona.skills.motion.planning.rrt_connect import FIRST_ROUND
from pomona.skills.motion.planning.space import Effort, Solution, Space


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


def solve(space: Space, q_start: Float64, q_goals: Float64, planner: str, effort: Effort) -> Solution:
    """Run one planner, a name in `PLANNERS`, from a start, shape (dof,), to goals, shape (n >= 1, dof) [rad], all free.

    Raises:
        BadRequest: the planner is OMPL's, which is not installed.
    """
    offered = PLANNERS[planner]
    if offered.ompl:
        wanted = effort if offered.kind is BudgetUse.OPTIMISING else replace(effort, good_enough=None)
        try:
            from pomona.skills.motion.planning.ompl_planners import solve_by_ompl
        except ModuleNotFoundError as error:  # no wheel for this system: trees are still checked
            raise BadRequest(f"the planner {planner} needs OMPL, which is not installed ({error})") from error
        return solve_by_ompl(space, q_start, q_goals, offered.ompl, wanted)
    used, round_ = 0, FIRST_ROUND
    while used < effort.iterations:
        if time.perf_counter() > effort.deadline:
            return Solution(None, used, out_of_time=True)
        waypoints, took = space.connect(
            q_start, q_goals, min(round_, effort.iterations - used), (effort.seed + used) % 2**31
        )
        used, round_ = used + took, 2 * round_
        if waypoints is not None:
            return Solution(waypoints, used, out_of_time=False)
    return Solution(None, used, out_of_time=False)
