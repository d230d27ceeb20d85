"""The skill OpenFingers on mock devices: it opens where open fingers fit, refuses elsewhere, and gives the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Box, MotionState, Trajectory
from pomona.executive.skill_testing import drive
from pomona.skills.geometry import transform
from pomona.skills.open_fingers import OpenFingers
from tests.skills.picking_scene import OBSERVE, WORKSPACE, PickingScene, a_grasp, seen_map


def a_path() -> Trajectory:
    """From the observe pose straight to the pre-grasp of `a_grasp`."""
    share = np.linspace(0.0, 1.0, 60)[:, None]
    q = OBSERVE + share * (a_grasp().q_pre_grasp[0] - OBSERVE)
    return Trajectory(share[:, 0], q, np.zeros_like(q), np.zeros_like(q))


def scene(width: float = 0.04) -> PickingScene:
    return PickingScene(q=OBSERVE.copy(), width=width)


def test_it_opens_to_the_grasps_width():
    cell = scene()
    outcome = drive(
        OpenFingers(), {"grasp": a_grasp(), "path": a_path()}, cell.devices, clock=cell.clock
    )
    assert outcome.status is Status.SUCCESS, outcome.reason
    assert cell.gripper.state().width == pytest.approx(a_grasp().width, abs=1e-3)
    assert cell.arm.followed == []


def test_fingers_that_are_open_already_are_left():
    cell = scene(a_grasp().width)
    assert (
        drive(
            OpenFingers(), {"grasp": a_grasp(), "path": a_path()}, cell.devices, clock=cell.clock
        ).duration
        == 0.0
    )
    assert cell.gripper.moves == []


def test_where_only_closed_fingers_fit_they_stay_closed():
    beside = a_grasp().T_base_pre_grasp @ transform(None, [0.0, 0.5 * a_grasp().width + 0.02, 0.0])
    post = Box("post", transform(None, beside[:3, 3]), (0.005, 0.005, 0.005))
    cell = PickingScene(
        q=OBSERVE.copy(), width=0.04, workspace=replace(WORKSPACE, obstacles=(post,))
    )
    outcome = drive(
        OpenFingers(), {"grasp": a_grasp(), "path": a_path()}, cell.devices, clock=cell.clock
    )
    assert outcome.status is Status.SUCCESS
    assert "not on the way: with open fingers" in outcome.feedback
    assert cell.gripper.moves == []
    assert cell.gripper.state().width == pytest.approx(0.04)


def test_a_map_that_is_too_old_is_a_reason():
    cell = scene()
    cell.clock.advance(200.0)
    inputs = {"grasp": a_grasp(), "path": a_path(), "map": seen_map()}
    assert drive(OpenFingers(), inputs, cell.devices, clock=cell.clock).reason.code == "MAP_STALE"


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_fingers_that_do_not_move_as_asked_are_a_reason(code):
    cell = scene()
    inputs = {"grasp": a_grasp(), "path": a_path()}
    if code == "REFUSED":
        cell.gripper.refuse_next("drive off")

    def stop(_tick: int) -> None:
        if code == "STOPPED" and cell.gripper.moves:
            cell.gripper.safe_stop("somebody pressed stop")
        elif code == "MOTION_FAILED" and cell.gripper.moves:
            cell.gripper.moves[-1].end(MotionState.FAILED, "the fingers are blocked")

    outcome = drive(OpenFingers(), inputs, cell.devices, clock=cell.clock, each_tick=stop)
    assert outcome.reason.code == code


def test_interrupted_the_fingers_stop():
    cell = scene()
    outcome = drive(
        OpenFingers(),
        {"grasp": a_grasp(), "path": a_path()},
        cell.devices,
        clock=cell.clock,
        interrupt_after=3,
    )
    assert outcome.status is Status.INVALID
    assert 0.04 < cell.gripper.state().width < a_grasp().width - 0.01
