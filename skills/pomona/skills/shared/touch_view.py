"""Touches of a pick in the record: the pads' first touches beside the fruit as the camera measured it."""

from __future__ import annotations

from collections.abc import Sequence

from pomona.drivers.interfaces import Arm, Workspace
from pomona.executive.skill import Skill
from pomona.skills.grip.closing import PadTouch, PickTouches, skin_along
from pomona.skills.motion.collision import fruit_points
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.frame_check import frame_view
from pomona.skills.perception.measured_fruit import MeasuredFruit

TOPIC = "touches"


def record_touches(
    skill: Skill, fruit: MeasuredFruit | None, pads: Sequence[PadTouch | None], closed: PadTouch | None = None
) -> None:
    """Publish the touches of a pick; without a measured fruit, an arm or a touch there is nothing to compare.

    Args:
        skill: has Arm and Workspace among its optional devices.
        fruit: as the camera measured it.
        pads: first touches of the left and the right pad.
        closed: where a plain gripper has stopped on the fruit.
    """
    arm = skill.optional_device(Arm)
    left, right = pads
    if fruit is None or arm is None or (left is None and right is None and closed is None):
        return
    workspace = skill.optional_device(Workspace)
    seen = None if workspace is None else frame_view(fruit.frame, fruit.T_base_camera, workspace)
    T_base_tcp = RobotModel.load(arm.description).tcp(arm.state().q)
    camera = fruit.T_base_camera, fruit.frame.T_mount_camera, fruit.frame.q is not None
    shape = fruit.dimensions, skin_along(fruit_points(fruit), T_base_tcp), None if seen is None else seen.planes
    name, T_base_fruit = fruit.fruit.name, fruit.T_base_fruit
    skill.publish(TOPIC, PickTouches(name, left, right, closed, T_base_tcp, T_base_fruit, *camera, *shape))
