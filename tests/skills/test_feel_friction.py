"""The skill FeelFriction on mock devices: its measurement, its effects, and every failure code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.errors import DeviceFault
from pomona.drivers.interfaces import Workspace
from pomona.executive.skill_testing import drive
from pomona.skills.feel_friction import FeelFriction
from pomona.skills.grip.grip import GripPhase
from pomona.skills.grip.hold import Hold, take_over
from pomona.skills.grip.pads import MIRROR
from pomona.skills.slip_avoid_grasp import SlipAvoidGrasp
from pomona.tools.mock.hand import spring_fruit
from tests.skills.finger_pads import finger_pads
from tests.skills.picking_scene import WORKSPACE, PickingScene, a_grasp, q_at_grasp

TOLD = {"mu": 0.6, "mu_uncertainty": 0.15}
PADS = 1500.0
"""Stiffness of a pad along its face [N/m]."""


class Standing(PickingScene):
    """A fruit on a table between the fingers: pads that move along it bend, then rub; a light one comes along.

    With a `linkage` the pads go down by this share of the closing.
    """

    def __init__(self, mu: float = 0.8, weight: float = 2.0, linkage: float = 0.0) -> None:
        super().__init__(q=q_at_grasp().copy(), width=0.085)
        press = spring_fruit(self.gripper, 0.08, 2000.0)
        self.bent = self.risen = 0.0
        self.before = self.tcp[2, 3] + linkage * self.gripper.state().width

        def feel(now: float) -> np.ndarray:
            wrenches = press(now)
            moved = self.tcp[2, 3] + linkage * self.gripper.state().width - self.before
            self.before += moved
            if (
                self.risen > 0.0 and moved < 0.0
            ):  # a fruit that hangs goes down with the fingers until it stands
                down = min(-moved, self.risen)
                self.risen, moved = self.risen - down, moved + down
            most = mu * -wrenches[:, 2]
            self.bent = float(np.clip(self.bent + moved, -most.max() / PADS, most.max() / PADS))
            if 2.0 * PADS * self.bent > weight:
                self.risen += self.bent - 0.5 * weight / PADS
                self.bent = 0.5 * weight / PADS
            wrenches[:, 0] = np.clip(PADS * self.bent, -most, most)
            wrenches[1] *= MIRROR
            return wrenches

        self.fingers.feel = feel

    def grasp(self) -> Hold:
        self.pads = finger_pads(TOLD["mu"], TOLD["mu_uncertainty"])
        outcome = drive(SlipAvoidGrasp(), {}, self.devices, clock=self.clock)
        assert outcome.status is Status.SUCCESS, outcome.reason
        hold = outcome.outputs["hold"]
        assert isinstance(hold, Hold)
        return hold

    def feel_friction(self, hold: Hold, each_tick=None, **inputs):
        return drive(
            FeelFriction(),
            {"hold": hold, **inputs},
            self.devices,
            clock=self.clock,
            each_tick=each_tick,
            limit=10.0,
        )


@pytest.mark.parametrize("mu", [0.4, 0.8, 1.1])
def test_it_feels_the_friction_and_holds_for_it(mu):
    scene = Standing(mu)
    hold = scene.grasp()
    outcome = scene.feel_friction(hold)
    assert outcome.status is Status.SUCCESS, outcome.reason
    assert outcome.outputs["mu"] == pytest.approx(mu, rel=0.04)
    assert outcome.outputs["mu_uncertainty"] <= 0.08
    assert hold.settings.contact.mu == outcome.outputs["mu"]
    assert hold.phase is GripPhase.HOLDING
    assert hold.reading.f_n == pytest.approx(2.2, abs=0.2)
    np.testing.assert_allclose(
        scene.tcp[:3, 3], a_grasp().T_base_grasp[:3, 3] + [0.0, 0.0, 0.001], atol=1e-4
    )
    assert outcome.duration < 1.3


@pytest.mark.parametrize(("linkage", "ways"), [(0.0, 3), (1.0, 4)])
def test_pads_that_a_linkage_moves_down_as_they_close_leave_no_push_on_the_floor(linkage, ways):
    scene = Standing(0.8, weight=4.0, linkage=linkage)
    hold = scene.grasp()
    assert (scene.bent < -1e-4) is (linkage > 0.0)
    assert scene.feel_friction(hold).status is Status.SUCCESS
    assert len(scene.arm.followed) == ways
    assert 2.0 * PADS * scene.bent > 0.5  # [N], towards the lift


def test_the_pads_push_the_fruit_down_with_the_friction_of_a_light_grip_alone():
    """The fingers press with 2.2 N when they have closed."""
    scene = Standing(0.8)
    hold = scene.grasp()
    assert scene.feel_friction(hold).status is Status.SUCCESS
    assert 0.5 < hold.press_below - hold.estimate.f_t < 0.8 * 0.7 * 1.3


def test_an_arm_that_has_arrived_and_whose_joints_stand_still_is_not_believed():
    scene = Standing()
    hold = scene.grasp()
    before = scene.arm.state()
    scene.arm.state = lambda: replace(before, stamp=scene.clock.now())  # type: ignore[method-assign]
    with pytest.raises(DeviceFault, match=r"moved 0\.0 mm of 1\.0 mm"):
        scene.feel_friction(hold)
    assert hold.holds
    assert len(scene.arm.followed) == 1


def test_a_light_fruit_comes_along_and_the_way_down_alone_counts():
    scene = Standing(0.9, weight=0.3)
    hold = scene.grasp()
    outcome = scene.feel_friction(hold)
    assert outcome.status is Status.SUCCESS
    assert outcome.outputs["mu"] == pytest.approx(0.9, rel=0.04)
    assert 0.05 <= outcome.outputs["mu_uncertainty"] < 0.08
    assert "from the way down only" in outcome.feedback
    assert hold.holds


@pytest.mark.parametrize("known", [True, False])
def test_a_fruit_that_is_light_by_its_size_is_pressed_before_it_comes_along(known):
    scene = Standing(0.9, weight=0.8)
    hold = scene.grasp()
    if known:
        settings = hold.settings
        hold._controller.settings = replace(settings, expected_load=0.8 * 1.5)
    pressed: list[float] = []

    def watch(_tick: int) -> None:
        if scene.risen > 0.0 and len(scene.arm.followed) == 3 and not pressed:
            pressed.append(hold.reading.f_n)

    assert scene.feel_friction(hold, watch).status is Status.SUCCESS
    assert (pressed[0] > 1.2) is known


def test_without_room_below_the_pads_do_not_slide_and_the_configured_value_is_kept():
    scene = Standing()
    hold = scene.grasp()
    low = replace(WORKSPACE, table_z=float(scene.tcp[2, 3]) - 0.001)
    outcome = drive(
        FeelFriction(), {"hold": hold}, {**scene.devices, Workspace: low}, clock=scene.clock
    )
    assert outcome.status is Status.SUCCESS
    kept = outcome.outputs["mu"], outcome.outputs["mu_uncertainty"]
    assert kept == pytest.approx((TOLD["mu"], TOLD["mu_uncertainty"]))
    assert "the slide down is blocked" in outcome.feedback
    assert scene.arm.followed == []
    assert hold.reading.f_n == pytest.approx(2.2, abs=0.2)


def test_while_the_pads_slide_the_force_stays_small_and_slipping_is_no_problem():
    scene = Standing()
    hold = scene.grasp()
    seen = []

    def watch(_tick: int) -> None:
        if hold.phase is GripPhase.SLIDING and scene.arm.followed and not scene.arm.settled():
            seen.append((hold.reading.f_n, hold.problem))

    assert scene.feel_friction(hold, watch).status is Status.SUCCESS
    assert len(seen) > 10
    assert max(f_n for f_n, _ in seen) < 2.3
    assert sorted(f_n for f_n, _ in seen)[len(seen) // 2] < 1.1
    assert {problem for _, problem in seen} == {None}


def test_interrupted_the_arm_stops_and_the_grip_holds():
    scene = Standing()
    hold = scene.grasp()
    outcome = drive(
        FeelFriction(), {"hold": hold}, scene.devices, clock=scene.clock, interrupt_after=30
    )
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    assert hold.phase is GripPhase.HOLDING
    scene.clock.advance(0.5)
    assert hold.holds


def test_without_a_fruit_is_not_held():
    scene = Standing()
    hold = scene.grasp()
    take_over(scene.gripper)
    outcome = scene.feel_friction(hold)
    assert outcome.reason.code == "NOT_HELD"
    assert scene.arm.followed == []


def test_beyond_reach_nothing_moves():
    scene = Standing()
    hold = scene.grasp()
    scene.arm.q = scene.arm.limits.upper - 1e-6
    outcome = scene.feel_friction(hold)
    assert outcome.status is Status.SUCCESS
    assert outcome.outputs["mu"] == TOLD["mu"]
    assert "the slide down is blocked" in outcome.feedback
    assert scene.arm.followed == []


@pytest.mark.parametrize("what", ["LOST", "SENSOR_STALE", "SENSOR_SATURATED"])
def test_problems_of_the_grip_are_passed_on(what):
    scene = Standing()
    hold = scene.grasp()

    def go_wrong(tick: int) -> None:
        if tick == 20 and what == "LOST":
            scene.fingers.feel = lambda _now: np.zeros((2, 6))
        elif tick == 20 and what == "SENSOR_STALE":
            scene.fingers.lose(10.0)
        elif tick == 20 and what == "SENSOR_SATURATED":
            scene.fingers.saturated = (True, False)

    outcome = scene.feel_friction(hold, go_wrong)
    assert outcome.reason.code == what
    assert scene.arm.settled()


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason(code):
    scene = Standing()
    hold = scene.grasp()
    outcome = scene.feel_friction(hold, scene.arm_trouble(code))
    assert outcome.reason.code == code
    assert hold.phase is GripPhase.HOLDING
