"""Touches of a pick in the record: the pads' first touches beside the fruit as the camera measured it."""

from __future__ import annotations

from collections.abc import Sequence

from pomona.drivers.interfaces import Arm, Gripper, Workspace
from pomona.executive.skill import Skill
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import apply, inverse
from pomona.skills.grip.closing import PadTouch, PickTouches, skin_along
from pomona.skills.motion.collision import fruit_points
from pomona.skills.motion.grasps.gripper_shape import gripper_shape
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.frame_check import frame_view
from pomona.skills.perception.measured_fruit import MeasuredFruit

TOPIC = "touches"


def record_touches(
    skill: Skill,
    fruit: MeasuredFruit | None,
    pads: Sequence[PadTouch | None],
    closed: PadTouch | None = None,
    landed: Float64 | None = None,
    carried: Float64 | float = 0.0,
) -> None:
    """Publish the touches of a pick; without a measured fruit, an arm or a touch there is nothing to compare.

    Args:
        skill: has Arm and Workspace among its optional devices.
        fruit: as the camera measured it.
        pads: first touches of the left and the right pad.
        closed: where a plain gripper has stopped on the fruit.
        landed: see `PickTouches`; carried: way of the fruit on a belt since it was measured, shape (3,) [m].
    """
    arm, (left, right) = skill.optional_device(Arm), pads
    if fruit is None or arm is None or (left is None and right is None and closed is None):
        return
    workspace = skill.optional_device(Workspace)
    seen = None if workspace is None else frame_view(fruit.frame, fruit.T_base_camera, workspace)
    T_base_tcp = RobotModel.load(arm.description).tcp(arm.state().q)
    T_base_tcp[:3, 3] -= carried
    camera = fruit.T_base_camera, fruit.frame.T_mount_camera, fruit.frame.q is not None
    shape = (
        fruit.dimensions,
        skin_along(fruit_points(fruit), T_base_tcp),
        None if seen is None else seen.planes,
    )
    name = fruit.fruit.name
    T_base_fruit = fruit.T_base_fruit
    skill.publish(
        TOPIC,
        PickTouches(name, left, right, closed, T_base_tcp, T_base_fruit, *camera, *shape, landed),
    )


def record_landing(skill: Skill, fruit: MeasuredFruit, finger: str, force: float) -> None:
    """Publish where a finger, left or right, met a fruit on the approach: the fruit is not where it was measured."""
    arm = skill.device(Arm)
    width = skill.device(Gripper).state().width
    robot = RobotModel.load(arm.description)
    T_base_tcp = robot.tcp(arm.state().q)
    way = gripper_shape(robot).way_to(
        apply(inverse(T_base_tcp), fruit_points(fruit)), width, finger
    )
    pads = (PadTouch(skill.clock.now(), width, force), None)
    record_touches(
        skill, fruit, pads if finger == "left" else pads[::-1], landed=T_base_tcp[:3, :3] @ way
    )
