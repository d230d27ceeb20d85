"""OMPL's planners on joint space, seeded and ended by counting.

OMPL holds the interpreter's lock for a whole solve, so this runs in a process of its own.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from ompl import base, geometric, util

from pomona.executive.values.arrays import Float64
from pomona.skills.motion.planning.space import Effort, Solution, Space

util.setLogLevel(util.LOG_NONE)


RANGE = 0.8
"""Longest step of a tree [rad], tuned on MotionBenchMaker's sets for the UR5: OMPL's default, a fifth of the space's
extent, makes steps that are expensive to check and seldom free."""


class _Validity(base.MotionValidator):  # type: ignore[misc]
    """Checks whole segments in compiled code instead of OMPL's discretised callback."""

    def __init__(self, information: Any, space: Space) -> None:
        super().__init__(information)
        self._space, self._dof = space, len(space.lower)

    def checkMotion(self, a: Any, b: Any, last_valid: Any = None) -> bool:
        return bool(self._space.free_between(_read(a, self._dof), _read(b, self._dof)))


def solve_by_ompl(
    space: Space, q_start: Float64, q_goals: Float64, planner: str, effort: Effort
) -> Solution:
    """Run one planner, a class in `ompl.geometric`; the other arguments are those of `planners.solve`."""
    util.RNG.setSeed(int(effort.seed % 2**31) + 1)
    dof = len(q_start)
    states = base.RealVectorStateSpace(dof)
    bounds = base.RealVectorBounds(dof)
    for joint in range(dof):
        bounds.setLow(joint, float(space.lower[joint]))
        bounds.setHigh(joint, float(space.upper[joint]))
    states.setBounds(bounds)
    information = base.SpaceInformation(states)
    information.setStateValidityChecker(lambda state: bool(space.free(_read(state, dof))))
    validity = _Validity(information, space)
    information.setMotionValidator(validity)
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.addStartState(_write(states.allocState(), q_start))
    goals = base.GoalStates(information)
    for q in q_goals:
        goals.addState(_write(states.allocState(), q))
    problem.setGoal(goals)
    if effort.good_enough is not None:
        objective = base.PathLengthOptimizationObjective(information)
        objective.setCostThreshold(base.Cost(effort.good_enough))
        problem.setOptimizationObjective(objective)
    solver = getattr(geometric, planner)(information)
    solver.setProblemDefinition(problem)
    if hasattr(solver, "setRange"):
        solver.setRange(RANGE)
    solver.setup()
    ending = _Ending(effort.iterations, effort.deadline)
    solver.solve(base.PlannerTerminationCondition(ending))
    if not problem.hasExactSolution():
        return Solution(None, ending.count, ending.out_of_time)
    path = problem.getSolutionPath()
    waypoints = np.array([_read(path.getState(i), dof) for i in range(path.getStateCount())])
    return Solution(waypoints, ending.count, ending.out_of_time)


class _Ending:
    """Termination by counting; OMPL asks once per iteration."""

    def __init__(self, iterations: int, deadline: float) -> None:
        self._iterations = iterations
        self._deadline = deadline
        self.count = 0
        self.out_of_time = False

    def __call__(self) -> bool:
        self.count += 1
        if self.count > self._iterations:
            return True
        self.out_of_time = time.perf_counter() > self._deadline
        return self.out_of_time


def _read(state: Any, dof: int) -> Float64:
    return np.array([state[joint] for joint in range(dof)])  # a slice would read beyond the state


def _write(state: Any, q: Float64) -> Any:
    for joint, value in enumerate(q):
        state[joint] = float(value)
    return state
