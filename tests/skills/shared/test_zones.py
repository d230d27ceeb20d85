"""Neither the robot nor a held fruit enters a zone of the cell, under any skill."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Arm, Box, Workspace
from pomona.executive.skill_testing import drive
from pomona.skills.follow import Follow
from pomona.skills.geometry import transform
from pomona.skills.lift import Lift
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.motion.planning.timing import time_polyline
from pomona.skills.move_to import MoveTo
from pomona.skills.release import Release
from pomona.skills.shared.following import zone_entered
from tests.skills.picking_scene import HOME, OBSERVE, ROBOT_MODEL, WORKSPACE, PickingScene, a_grasp
from tests.skills.test_release import over_ground


def zone(centre: np.ndarray, size: float = 0.14) -> Box:
    return Box("zone window", transform(None, centre), (size / 2.0,) * 3)


def with_zone(scene: PickingScene, box: Box) -> Workspace:
    """The scene's cell has a zone from now on."""
    workspace = replace(WORKSPACE, zones=(box,))
    scene.workspace = workspace
    return workspace


FAR = OBSERVE + np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
MIDDLE = ROBOT_MODEL.tcp((FAR + OBSERVE) / 2.0)[:3, 3]


def test_a_planner_goes_around_a_zone() -> None:
    scene = PickingScene(q=FAR.copy())
    workspace = with_zone(scene, zone(MIDDLE))
    outcome = drive(MoveTo(), {"pose": "observe"}, scene.devices, clock=scene.clock)
    assert outcome.status is Status.SUCCESS
    only = replace(workspace, obstacles=(), table_z=None)
    world = arm_space(scene.arm, only, None, scene.width, 0.0).world
    assert world.check_path(np.array([FAR, OBSERVE]), scene.width) is not None
    assert world.check_path(scene.arm.followed[0].q, scene.width) is None


def test_a_path_through_a_zone_is_refused_before_anything_moves() -> None:
    scene = PickingScene()
    with_zone(scene, zone(MIDDLE))
    path = time_polyline(np.array([OBSERVE, FAR]), scene.arm.limits)
    outcome = drive(Follow(), {"path": path}, scene.devices, clock=scene.clock)
    assert outcome.reason is not None
    assert outcome.reason.code == "REFUSED"
    assert "on the way" in outcome.reason.message
    assert "the zone window" in outcome.reason.message
    assert scene.arm.followed == []


def test_an_arm_that_stands_in_a_zone_is_reported_whether_it_plans_or_follows() -> None:
    scene = PickingScene()
    with_zone(scene, zone(ROBOT_MODEL.tcp(OBSERVE)[:3, 3]))
    planned = drive(MoveTo(), {"pose": "home"}, scene.devices, clock=scene.clock).reason
    path = time_polyline(np.array([OBSERVE, HOME]), scene.arm.limits)
    followed = drive(Follow(), {"path": path}, scene.devices, clock=scene.clock).reason
    assert planned is not None
    assert followed is not None
    assert (planned.code, followed.code) == ("START_IN_COLLISION", "REFUSED")
    for reason in (planned, followed):
        assert "the arm's present position" in reason.message
        assert "the zone window" in reason.message
    assert scene.arm.followed == []


def test_a_pose_in_a_zone_is_no_goal() -> None:
    scene = PickingScene(q=FAR.copy())
    with_zone(scene, zone(ROBOT_MODEL.tcp(OBSERVE)[:3, 3]))
    reason = drive(MoveTo(), {"pose": "observe"}, scene.devices, clock=scene.clock).reason
    assert reason is not None
    assert reason.code == "GOAL_IN_COLLISION"
    assert scene.arm.followed == []


def test_a_straight_lift_does_not_enter_a_zone() -> None:
    grasp = a_grasp()
    scene = over_ground(None)
    top = scene.tcp[:3, 3] + [0.0, 0.0, 0.2]
    with_zone(scene, zone(top))
    reason = drive(
        Lift(), {"height": 0.15, "grasp": grasp}, scene.devices, clock=scene.clock
    ).reason
    assert reason is not None
    assert reason.code == "LIFT_BLOCKED"
    assert "zone window" in reason.message
    assert scene.arm.followed == []


@pytest.mark.parametrize("held", [True, False])
def test_a_held_fruit_is_not_lowered_into_a_zone(held: bool) -> None:
    """Below the fruit and narrower than the fingers are apart: only the fruit would enter it."""
    grasp = a_grasp()
    scene = over_ground(None)
    bottom = scene.tcp[:3, 3] - [0.0, 0.0, 0.12]
    with_zone(scene, zone(bottom, 0.02))
    inputs = {"depth": 0.07, "grasp": grasp} if held else {"depth": 0.07}
    reason = drive(Release(), inputs, scene.devices, clock=scene.clock).reason
    assert reason is not None
    assert reason.code == ("REFUSED" if held else "NO_CONTACT")
    assert scene.gripper.moves == []


def test_a_cell_without_zones_is_asked_nothing() -> None:
    scene = PickingScene()
    path = time_polyline(np.array([OBSERVE, HOME]), scene.arm.limits)
    skill = Follow()
    drive(skill, {"path": path}, scene.devices, clock=scene.clock)
    assert zone_entered(skill, scene.devices[Arm], path) == ""  # type: ignore[arg-type]
