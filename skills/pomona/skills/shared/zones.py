"""Zones of a cell: every motion is checked against them before it begins, independent of its planner."""

from __future__ import annotations

from dataclasses import replace

from pomona.drivers.interfaces import Arm, Gripper, Trajectory, Workspace
from pomona.executive.skill import Skill
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.motion.robot import RobotModel


def zone_entered(skill: Skill, arm: Arm, trajectory: Trajectory, carrying: Grasp | None = None) -> str:
    """Describe which part of the robot or of a held fruit would enter a zone on a path, and where; empty without one.

    Args:
        skill: that moves; in a cell without a workspace or zones the text is empty.
        trajectory: to be followed.
        carrying: the grasp by which a fruit is held.
    """
    workspace, gripper = skill.optional_device(Workspace), skill.optional_device(Gripper)
    if workspace is None or not workspace.zones:
        return ""
    width = RobotModel.load(arm.description).width_max if gripper is None else gripper.state().width
    only = replace(workspace, table_z=None, obstacles=(), hulls=())
    space = arm_space(arm, only, None, width, 0.0, held=carrying)
    world = space.world.with_margins(replace(space.world.margins, itself=-1.0))
    entered = world.check_path(trajectory.q, width)
    if entered is None:
        return ""
    return f"where the arm stands, {entered}" if entered.at == 0.0 else f"on the way {entered}"
