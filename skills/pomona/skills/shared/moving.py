"""Moving to a named pose, for the skills that do so."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from pomona.drivers.interfaces import Arm, Trajectory, Workspace
from pomona.drivers.path_motion import stretched
from pomona.executive.skill import CellFacts
from pomona.executive.values.arrays import Float64
from pomona.executive.values.kinds import choose
from pomona.executive.values.sections import Problem
from pomona.skills.motion.collision import Convex
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.planning.plan import PlanRequest
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.following import MovingSkill, Watching
from pomona.skills.shared.live_watch import KnownAround, prepare_watch
from pomona.skills.shared.planning import PLANNING_FAILURES, patience, planned, space_around
from pomona.skills.shared.warm_motion import prepare_planning

CARRIED_ACCELERATION = 2.0
"""Usual largest acceleration of a held fruit [m/s²]: every bit of it must be held by friction."""

POSE_FAILURES = (*PLANNING_FAILURES, "UNKNOWN_POSE", "MAP_STALE")
"""Codes of every skill that moves to a named pose."""


class PoseSkill(MovingSkill):
    """A skill that moves to a named pose of the cell: the pose is checked before the run, and offered to editors."""

    pose_port: ClassVar[str] = "pose"

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """Check that the named pose is one of the cell's."""
        workspace = None if cell is None else cell.known(Workspace)
        name = known.get(cls.pose_port)
        if (
            cell is not None
            and workspace is not None
            and name is not None
            and name not in workspace.poses
        ):
            message = f"the cell '{cell.name}' has no pose '{name}'"
            yield Problem(cls.pose_port, message, choose(name, sorted(workspace.poses)))

    @classmethod
    def offers(cls, port: str, cell: CellFacts | None) -> tuple[str, ...]:
        """Return the cell's named poses."""
        workspace = None if cell is None or port != cls.pose_port else cell.known(Workspace)
        return () if workspace is None else tuple(sorted(workspace.poses))

    def prepare(self) -> None:
        prepare_planning(self)
        prepare_watch(self)


def move_to_pose(
    skill: MovingSkill,
    pose: str,
    variation: int = 1,
    map: OccupancyMap | None = None,
    carrying: Grasp | None = None,
    clearance: float = 1e-2,
    budget: float = 0.5,
    avoiding: Iterable[MeasuredFruit] = (),
    speed: float = 1.0,
    carried_acceleration: float = CARRIED_ACCELERATION,
) -> Watching:
    """Plan to a named pose of the cell file and move there.

    Args:
        skill: it must have Arm, Gripper and Workspace among its devices, and `POSE_FAILURES`.
        map, carrying: obstacles besides the fixed surroundings, and the grasp by which a fruit is held.
        clearance: kept by the arm's links [m], as in `arm_space`.
        avoiding: fruit that is not in the map and must be avoided.
        speed: ratio of the speed that the limits allow, above 0 to 1.
        carried_acceleration: largest acceleration of a held fruit [m/s²].
    """
    arm = skill.device(Arm)
    workspace = skill.device(Workspace)
    try:
        q_goal = named_pose(workspace.poses, pose, variation)
    except KeyError:
        known = ", ".join(workspace.poses) or "none"
        raise skill.failure(
            "UNKNOWN_POSE", f"the cell file has no pose '{pose}'; it has {known}"
        ) from None
    q = arm.state().q
    # an arm this near to the pose in every joint is there [rad]
    if np.abs(q_goal - q).max() < 1e-3:
        return
    space = space_around(skill, map, clearance, held=carrying)
    fruit = tuple(avoiding)
    if fruit:
        shapes = (Convex.of_fruit(each, "fruit") for each in fruit)
        space = replace(space, world=space.world.with_obstacles(*shapes))
    request = PlanRequest(
        space,
        q,
        q_goal[None],
        arm.limits,
        improve="InformedRRTstar",
        budget=budget,
        seed=skill.context.seed(skill.path),
        patience=patience(skill, budget),
    )
    result = yield from planned(skill, request)
    path = (
        result.path
        if carrying is None
        else gently(RobotModel.load(arm.description), result.path, carried_acceleration)
    )
    around = KnownAround(map, fruit, carrying)
    yield from skill.travel(
        path if speed >= 1.0 else stretched(path, 1.0 / speed), around=around, carrying=carrying
    )


def named_pose(poses: Mapping[str, Float64], name: str, variation: int = 1) -> Float64:
    """Return the joints of a pose, shape (dof,) [rad]: `name`, or its variation `name_2`, `name_3` … and over again.

    Raises KeyError: there is no such pose.
    """
    variations = [poses[name]]
    while (other := f"{name}_{len(variations) + 1}") in poses:
        variations.append(poses[other])
    return variations[(variation - 1) % len(variations)]


def gently(robot: RobotModel, path: Trajectory, most: float) -> Trajectory:
    """Return a path slowed down until the TCP is nowhere accelerated by more than `most` [m/s²]."""
    p = np.array([robot.tcp(q)[:3, 3] for q in path.q])
    rate = np.gradient(p, path.t, axis=0)
    largest = float(np.linalg.norm(np.gradient(rate, path.t, axis=0), axis=1).max())
    return stretched(path, max(1.0, float(np.sqrt(largest / most))))
