"""Compilation before the run: collision checks, straight lines, the planner."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from pomona.drivers.interfaces import Arm, ArmLimits
from pomona.executive.skill import Skill
from pomona.executive.values.arrays import Float64
from pomona.skills.compiled_code import begin_first
from pomona.skills.geometry import angle_between, rot_z, transform
from pomona.skills.motion.collision import CollisionWorld
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.planning.plan import PlanRequest, plan
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.motion.robot import RobotModel


@lru_cache(maxsize=8)
def warm_checks(description: Path) -> tuple[RobotModel, Float64, ArmSpace, ArmLimits]:
    """Compile what skills compute in this process; once for each robot. Return what it was tried with: joints (dof,)."""
    robot = RobotModel.load(description)
    q = (robot.lower + robot.upper) / 2.0
    space = ArmSpace(CollisionWorld.build(robot), robot.width_max)
    space.free(q)
    space.clearances(q[None])
    space.free_between(q, q)
    space.first_blocked(q[None])
    T_base_goal = robot.tcp(q) @ transform(rot_z(1e-3), [0.0, 0.0, 1e-3])
    line = straight_line(robot, q, T_base_goal)
    angle_between(robot.tcp(q)[:3, :3], T_base_goal[:3, :3])
    unit = np.ones(robot.dof)
    limits = ArmLimits(robot.lower, robot.upper, unit, 10.0 * unit, 100.0 * unit)
    time_curve(np.tile(line.q[:1], (4, 1)), 1e-3, limits, 0.1, 1.0, 10.0)
    return robot, q, space, limits


@lru_cache(maxsize=8)
def warm_planner(description: Path) -> None:
    """The same, and OMPL, for the process that plans: it plans once where nothing is in the way."""
    robot, q, space, limits = warm_checks(description)
    space.connect(q, q[None] + 0.1, 1, 0)
    plan(PlanRequest(_Empty(robot), q, q[None] + 0.1, limits, direct=False, budget=0.01))


class _Empty:
    """A space without obstacles."""

    def __init__(self, robot: RobotModel) -> None:
        self.lower = robot.lower
        self.upper = robot.upper
        self.endless = robot.endless

    def free(self, q: np.ndarray) -> bool:
        return True

    def free_between(self, q_a: np.ndarray, q_b: np.ndarray) -> bool:
        return True

    def first_blocked(self, path: np.ndarray) -> int | None:
        return None

    def connect(
        self, q_start: np.ndarray, q_goals: np.ndarray, iterations: int, seed: int
    ) -> tuple[np.ndarray | None, int]:
        return np.array([q_start, q_goals[0]]), 1

    def explain(self, q: np.ndarray) -> tuple[str, dict[str, object]]:
        return "everything is free", {}


def prepare_moving(skill: Skill) -> None:
    """For `prepare` of a skill that checks collisions; without an arm nothing is."""
    arm = skill.optional_device(Arm)
    if arm is not None:
        begin_first(arm.description)
        warm_checks(arm.description)


def prepare_planning(skill: Skill) -> None:
    """For `prepare` of a skill that plans: this process, and the one that will plan."""
    description = skill.device(Arm).description
    begin_first(description)
    warm_checks(description)
    skill.context.compute(skill.path, warm_planner, description, isolated=True).result()
