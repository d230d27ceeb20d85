"""Planning from within a skill: in a process of its own, cancelled at once, given up at a deadline."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from pomona.executive.skill import Skill
from pomona.skills.motion.planning.plan import PlanRequest, PlanResult, plan
from pomona.skills.motion.planning.space import PlanningFailed

PLANNING_FAILURES = ("START_IN_COLLISION", "GOAL_UNREACHABLE", "GOAL_IN_COLLISION", "NO_PATH", "TIMEOUT")
"""Codes of every skill that plans."""

COLD_START = 5.0  # seconds that a process which has never planned may need on top of the budget to import and compile

SIMULATED_PATIENCE = 60.0  # wall time of planning on a simulated clock [s]; the budget counts iterations


def planned(skill: Skill, request: PlanRequest) -> Generator[str | None, None, PlanResult]:
    """Plan beside the tick; `skill` must declare `PLANNING_FAILURES`.

    On a real clock planning is given up, and its process killed, when the budget and a cold start are over.
    """
    deadline = skill.context.elapsed() + (np.inf if skill.clock.simulated else request.patience + COLD_START)
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
