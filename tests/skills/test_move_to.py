from pathlib import Path

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Arm, Carrier, Gripper, Workspace
from pomona.executive.cell.connect import load_cell
from pomona.executive.skill_testing import drive
from pomona.skills.motion.collision import CollisionWorld, Convex
from pomona.skills.move_to import MoveTo
from pomona.skills.shared.moving import named_pose
from tests.skills.overhead import BeltBeside, comes_near, watched
from tests.skills.picking_scene import (
    HOME,
    OBSERVE,
    ROBOT_MODEL,
    WORKSPACE,
    PickingScene,
    a_grasp,
    apple_at,
    scene_with_pose,
)


def test_it_moves_to_the_named_pose():
    scene = PickingScene()
    outcome = drive(MoveTo(), {"pose": "home"}, scene.devices, clock=scene.clock)
    assert outcome.status is Status.SUCCESS
    np.testing.assert_allclose(scene.arm.q, HOME, atol=1e-6)


def test_an_arm_that_a_branch_holds_beside_its_set_point_moves_on():
    cell = load_cell(Path(__file__).resolve().parents[2] / "trees" / "cells" / "sim.yaml", seed=1)
    world = cell.devices["world"]
    devices = {kind: cell.device(kind) for kind in (Arm, Gripper)} | {Workspace: cell.workspace}
    stood = cell.device(Arm).state().q[5]
    world.state.qfrc_applied[world.model.jnt_dofadr[world.arm_joints][5]] = (
        9.0  # N·m, from a branch at the hand
    )
    cell.clock.advance(0.5)
    assert 0.1 < np.degrees(abs(cell.device(Arm).state().q[5] - stood)) < 0.3
    moved = []

    def let_go(tick):
        moved.append(cell.device(Arm).state().moving)
        if sum(moved) > 10:
            world.state.qfrc_applied[:] = 0.0

    outcome = drive(MoveTo(), {"pose": "observe"}, devices, clock=cell.clock, each_tick=let_go)
    assert outcome.status is Status.SUCCESS, outcome.reason
    cell.close()


def test_at_the_pose_nothing_moves():
    scene = PickingScene()
    assert (
        drive(MoveTo(), {"pose": "observe"}, scene.devices, clock=scene.clock).status
        is Status.SUCCESS
    )
    assert scene.arm.followed == []


def test_variations_go_round():
    poses = {"observe": np.zeros(2), "observe_2": np.ones(2), "home": np.full(2, 5.0)}
    assert [named_pose(poses, "observe", k)[0] for k in (1, 2, 3)] == [0.0, 1.0, 0.0]
    assert named_pose(poses, "home", 7)[0] == 5.0
    with pytest.raises(KeyError):
        named_pose(poses, "crate")


def test_an_unknown_pose_is_named_with_those_that_exist():
    scene = PickingScene()
    outcome = drive(MoveTo(), {"pose": "hoem"}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "UNKNOWN_POSE"
    assert "observe, observe_2, home" in outcome.reason.message


def test_a_start_inside_the_table_names_the_link():
    scene = PickingScene(q=np.array([-1.36, 1.6, -0.264, -0.234, 0.065, -1.294, 0.048]))
    outcome = drive(MoveTo(), {"pose": "home"}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "START_IN_COLLISION"
    assert outcome.reason.data["obstacle"] in ("table", "pedestal")


def test_interrupted_it_stops():
    scene = PickingScene(q=HOME.copy())
    outcome = drive(
        MoveTo(), {"pose": "observe"}, scene.devices, clock=scene.clock, interrupt_after=9
    )
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    assert np.abs(scene.arm.q - OBSERVE).max() > 0.05


def test_a_held_fruit_is_avoided_for_and_moved_gently():
    grasp = a_grasp(1, 3)
    scene = PickingScene(q=grasp.q_pre_grasp[0].copy(), width=0.085)
    outcome = drive(
        MoveTo(), {"pose": "observe", "carrying": grasp}, scene.devices, clock=scene.clock
    )
    assert outcome.status is Status.SUCCESS
    path = scene.arm.followed[0]
    p = np.array([ROBOT_MODEL.tcp(q)[:3, 3] for q in path.q])
    acceleration = np.gradient(np.gradient(p, path.t, axis=0), path.t, axis=0)
    assert 1.5 < np.linalg.norm(acceleration, axis=1).max() <= 2.0 + 1e-3


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason(code):
    scene = PickingScene()
    outcome = drive(
        MoveTo(),
        {"pose": "home"},
        scene.devices,
        clock=scene.clock,
        each_tick=scene.arm_trouble(code),
    )
    assert outcome.reason.code == code
    assert scene.arm.settled()


@pytest.mark.parametrize(
    "code", ["GOAL_UNREACHABLE", "GOAL_IN_COLLISION", "NO_PATH", "TIMEOUT", "MAP_STALE"]
)
def test_a_pose_that_cannot_be_reached_is_a_reason_and_nothing_moves(code):
    scene, given = scene_with_pose(code)
    inputs = {"pose": "there", "budget": 0.05, **given["inputs"]}
    outcome = drive(MoveTo(), inputs, scene.devices, clock=scene.clock, **given["settings"])
    assert outcome.reason.code == code
    assert outcome.cancelled == (code == "TIMEOUT")
    assert scene.arm.followed == []


def test_a_fruit_that_the_map_leaves_out_is_avoided():
    scene = PickingScene(q=HOME.copy())
    apple = apple_at(1, 3)
    apple.T_base_fruit[:3, 3] = ROBOT_MODEL.tcp((HOME + OBSERVE) / 2.0)[:3, 3]
    outcome = drive(
        MoveTo(), {"pose": "observe", "avoiding": apple}, scene.devices, clock=scene.clock
    )
    assert outcome.status is Status.SUCCESS
    world = CollisionWorld.build(ROBOT_MODEL, WORKSPACE, obstacles=(Convex.of_fruit(apple),))
    path = scene.arm.followed[0]
    assert world.check_trajectory(path, scene.width) is None
    assert world.check_path(np.array([HOME, OBSERVE]), scene.width) is not None


def test_an_approaching_object_in_view_stops_the_arm_and_in_the_same_moment_a_belt():
    scene = PickingScene()
    devices, camera = watched(scene)
    belt = devices[Carrier] = BeltBeside(scene.arm)
    come = comes_near(scene, camera)
    outcome = drive(MoveTo(), {"pose": "home"}, devices, clock=scene.clock, each_tick=come)
    assert outcome.reason.code == "PATH_BLOCKED"
    assert scene.arm.settled()
    assert belt.stopped == [False]


@pytest.mark.parametrize("code", ["POSE_MISMATCH", "DEPTH_MISMATCH"])
def test_a_camera_that_shows_the_table_elsewhere_starts_no_motion(code):
    scene = PickingScene()
    devices, camera = watched(scene)
    camera.untrue = code
    outcome = drive(MoveTo(), {"pose": "home"}, devices, clock=scene.clock)
    assert outcome.reason.code == code
    assert outcome.reason.data["tilt_rad"] > 0.08
    assert "above: " in outcome.reason.message
    assert scene.arm.followed == []
