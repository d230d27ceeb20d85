"""Planning within a skill: in a process of its own, cancelled at once, with a deadline; and the map that it may use."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.drivers.interfaces import Arm, Gripper, Workspace
from pomona.executive.ports import Acceleration, Length, Port
from pomona.executive.skill import Skill, Work
from pomona.skills.motion.collision.distance_field import DistanceField
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.occupancy.occupancy_map import OccupancyError
from pomona.skills.motion.planning.arm_space import ArmSpace, arm_space
from pomona.skills.motion.planning.plan import PlanRequest, PlanResult, plan
from pomona.skills.motion.planning.space import PlanningFailed
from pomona.skills.perception.measured_fruit import MeasuredFruit

PLANNING_FAILURES = (
    "START_IN_COLLISION",
    "GOAL_UNREACHABLE",
    "GOAL_IN_COLLISION",
    "NO_PATH",
    "TIMEOUT",
)
"""Codes of every skill that plans."""

Clearance = Annotated[
    Length, Port(min="0 mm", help="distance of the links to obstacles; less for the gripper")
]
Spacing = Annotated[
    Length, Port(min="2 mm", help="distance of the links to obstacles; less for the gripper")
]
Obstacles = Annotated[OccupancyMap | None, Port(help="obstacles")]
OtherObstacles = Annotated[OccupancyMap | None, Port(help="obstacles, without the target")]
ToolAcceleration = Annotated[Acceleration, Port(min="0.01 m/s²", max="3 m/s²")]
HeldGrasp = Annotated[
    Grasp | None, Port(help="grasp of the held fruit; collision checks include this fruit")
]
"""Ports that skills share."""

COLD_START = 5.0  # seconds that a process which has never planned may need on top of the budget to import and compile

# wall time of planning on a simulated clock [s]; the budget counts iterations
SIMULATED_PATIENCE = 60.0


def planned(skill: Skill, request: PlanRequest) -> Work[PlanResult]:
    """Plan beside the tick; `skill` must declare `PLANNING_FAILURES`.

    On a real clock planning is given up, and its process killed, when the budget and a cold start are over.
    """
    deadline = skill.context.elapsed() + (
        np.inf if skill.clock.simulated else request.patience + COLD_START
    )
    work = skill.compute(plan, request, isolated=True)
    try:
        while True:
            yield next(work)
            if skill.context.elapsed() > deadline:
                work.close()
                raise skill.failure(
                    "TIMEOUT",
                    f"planning took longer than {request.patience + COLD_START:.1f} s",
                    planner=request.planner,
                    goals=len(request.q_goals),
                    budget_s=request.budget,
                )
    except StopIteration as done:
        result: PlanResult = done.value
        return result
    except PlanningFailed as failed:
        raise skill.failure(failed.code, failed.message, **failed.data) from failed


def patience(skill: Skill, budget: float) -> float:
    """Wall seconds that planning may take: the budget on a real clock, practically no limit on a simulated one."""
    return SIMULATED_PATIENCE if skill.clock.simulated else budget


MAP_AGE = 120.0  # an occupancy map whose newest look is older than this is stale [s]


def space_around(
    skill: Skill,
    map: OccupancyMap | None,
    clearance: float,
    width: float = 0.0,
    target: MeasuredFruit | None = None,
    held: Grasp | None = None,
) -> ArmSpace:
    """Return the obstacles of a skill's arm as in `arm_space`, with the fingers as they are, or open by a width [m].

    `skill` must declare MAP_STALE where a map is wired: see `usable_field`.
    """
    return arm_space(
        skill.device(Arm),
        skill.device(Workspace),
        usable_field(skill, map),
        width or skill.device(Gripper).state().width,
        clearance,
        target,
        held,
    )


def usable_field(skill: Skill, map: OccupancyMap | None) -> DistanceField | None:
    """Return the distance field of a map that may be relied on; None where no map is wired.

    `skill` must declare MAP_STALE: it fails with it when the map is empty or too old.
    """
    if map is None:
        return None
    try:
        return map.usable_field(skill.clock.now(), MAP_AGE)
    except OccupancyError as unusable:
        stamp = map.stamp
        age = None if stamp is None else round(skill.clock.now() - stamp, 3)
        raise skill.failure(
            "MAP_STALE", f"{unusable}: look again", age_s=age, allowed_s=MAP_AGE
        ) from unusable
