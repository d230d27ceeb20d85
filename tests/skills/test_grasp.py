from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import GripperLimits, MotionState
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.grasp import NARROWEST, Grasp
from tests.skills.picking_scene import PickingScene, apple_at

STIFFNESS = 2000.0  # of an object between the fingers [N/m]


class Rig:
    """A gripper that closes on an object."""

    def __init__(
        self, width: float | None, *, open_to: float = 0.1, motor: bool = True, hard: bool = False
    ) -> None:
        """
        Args:
            width: of the object [m].
            motor: whether the gripper reports its motor's force.
            hard: the object stops the fingers at once.
        """
        self.scene = PickingScene(width=open_to)
        self.width, self.motor = width, motor
        if hard and width is not None:
            self.scene.gripper.blocked_at = width
        self.scene.clock.each_step.append(self.press)
        self.press()

    def press(self) -> None:
        gripper = self.scene.gripper
        if self.motor:
            touched = self.width is not None and gripper.width < self.width + 1e-6
            gripper.motor_force = (
                (3.0 + STIFFNESS * (self.width - gripper.width)) if touched and self.width else 0.0
            )

    def grasp(
        self, each_tick: Any = None, interrupt_after: int | None = None, **inputs: Any
    ) -> SkillEnd:
        given = {"fruit": apple_at(1, 3), **inputs}
        devices = self.scene.without_sensor
        return drive(
            Grasp(),
            given,
            devices,
            clock=self.scene.clock,
            each_tick=each_tick,
            interrupt_after=interrupt_after,
        )


def test_the_fingers_close_until_the_motor_presses_as_asked_and_stay_there():
    rig = Rig(0.085)
    outcome = rig.grasp(force=9.0)
    assert outcome.status is Status.SUCCESS
    assert rig.scene.gripper.width == pytest.approx(0.082, abs=1e-3)
    assert 9.0 <= rig.scene.gripper.motor_force < 11.0
    assert rig.scene.gripper.moves[0].width == pytest.approx(NARROWEST * 0.081)


def test_a_gripper_that_reports_no_motor_force_holds_what_stops_it():
    rig = Rig(0.085, motor=False, hard=True)
    assert rig.grasp().status is Status.SUCCESS
    assert rig.scene.gripper.width == pytest.approx(0.085)


@pytest.mark.parametrize("motor", [True, False])
def test_fingers_that_reach_their_aim_grip_nothing(motor: bool):
    outcome = Rig(None, motor=motor).grasp()
    assert outcome.reason.code == "NO_CONTACT"
    assert outcome.reason.data["width_m"] == pytest.approx(NARROWEST * 0.081, abs=1e-4)


@pytest.mark.parametrize("inputs", [{"fruit": None}, {"width": 0.01}])
def test_without_a_size_the_fingers_aim_just_above_the_closed_gripper(inputs: dict[str, Any]):
    rig = Rig(None)
    assert rig.grasp(**inputs).reason.code == "NO_CONTACT"
    assert rig.scene.gripper.width == pytest.approx(0.039)


def test_closed_fingers_have_no_way_to_close():
    rig = Rig(None, open_to=0.036)
    assert rig.grasp(fruit=None).reason.code == "NO_CONTACT"
    assert rig.scene.gripper.moves == []


def test_an_object_that_fills_the_opening_is_too_wide():
    assert Rig(0.1, hard=True).grasp().reason.code == "TOO_WIDE"


def test_an_object_wider_than_the_fruit_is_too_wide():
    outcome = Rig(0.099, open_to=0.103, hard=True).grasp()
    assert outcome.reason.code == "TOO_WIDE"
    assert "the fruit measures 89 mm" in outcome.reason.message


def test_a_fruit_that_slips_out_while_the_grip_settles_is_lost():
    rig = Rig(0.085, hard=True, motor=False)

    def slip(tick: int) -> None:
        if tick == 45:  # the fingers have rested since tick 38
            rig.scene.gripper.blocked_at, rig.scene.gripper.width = 0.0, 0.082

    assert rig.grasp(slip).reason.code == "LOST"


@pytest.mark.parametrize(
    ("code", "state"), [("STOPPED", MotionState.STOPPED), ("MOTION_FAILED", MotionState.FAILED)]
)
def test_a_move_that_ends_without_an_object_is_no_grip(code: str, state: MotionState):
    rig = Rig(None)

    def end(tick: int) -> None:
        move = rig.scene.gripper.moves[-1] if rig.scene.gripper.moves else None
        if tick == 10 and move is not None:
            rig.scene.gripper.width = NARROWEST * 0.081 + 1e-3  # at its aim: nothing has stopped it
            move.end(state, "the gripper is too hot")
            move.settled = True

    outcome = rig.grasp(end)
    assert outcome.reason.code == code


def test_a_refused_move_moves_nothing():
    rig = Rig(0.085)
    rig.scene.gripper.refuse_next("not referenced")
    outcome = rig.grasp()
    assert outcome.reason.code == "REFUSED"
    assert rig.scene.gripper.moves == []


def test_interrupted_the_fingers_stop_where_they_are():
    rig = Rig(0.085)
    outcome = rig.grasp(interrupt_after=10)
    assert outcome.status is Status.INVALID
    assert rig.scene.gripper.settled()
    assert 0.09 < rig.scene.gripper.width < 0.1


class FactsOfGripper:
    """Facts of a cell with fingers of this least force [N] and no force sensor."""

    name = "cell"

    def __init__(self, least: float) -> None:
        self.limits = GripperLimits(0.03, 0.1, 0.1, max(least, 20.0), least)

    def known(self, what: type) -> Any:
        return self.limits if what is GripperLimits else None

    def place(self, _interface: type) -> None:
        return None


@pytest.mark.parametrize(
    ("least", "known", "told"),
    [(20.0, {}, "40 N at least, where the fruit bears 23 N and 'force' allows 10 N"),
     (20.0, {"force": 39.0}, "allows 39 N"), (20.0, {"force": 40.0}, ""), (11.0, {}, ""),
     (0.0, {"force": 1.0}, ""), (20.0, {"force": None}, "")],
)  # fmt: skip
def test_a_gripper_that_always_presses_harder_than_allowed_is_refused_with_numbers(
    least: float, known: dict[str, Any], told: str
) -> None:
    errors = [p.message for p in Grasp.judge(known, FactsOfGripper(least)) if not p.warning]
    assert len(errors) == bool(told)
    assert all(told in error for error in errors)


@pytest.mark.parametrize(("force", "told"), [(40.0, True), (23.0, False)])
def test_a_force_that_bruises_every_apple_is_told(force: float, told: bool) -> None:
    said = [p.message for p in Grasp.judge({"force": force}, FactsOfGripper(5.0)) if p.warning]
    assert (f"{force:g} N bruise an apple, which bears 23 N at most" in said) is told


@pytest.mark.parametrize(("least", "refused"), [(6.0, False), (12.0, True)])
def test_a_hand_presses_with_its_least_force_where_the_measured_fruit_bears_it(
    least: float, refused: bool
) -> None:
    rig = Rig(0.085)
    gripper = rig.scene.gripper
    gripper.limits = replace(gripper.limits, force_min=least)
    outcome = rig.grasp(force=10.0)
    assert ("REFUSED" in str(outcome.reason)) is refused
    if not refused:
        assert gripper.moves[0].force == least


def test_the_width_at_which_the_fingers_stopped_is_recorded_with_the_measured_fruit():
    rig = Rig(0.085)
    outcome = rig.grasp(force=9.0)
    touches = dict(outcome.published)["touches"]
    assert touches.left is None
    assert touches.right is None
    assert touches.closed.width == pytest.approx(0.082, abs=1e-3)
    assert touches.closed.force >= 9.0
    np.testing.assert_allclose(touches.dimensions, apple_at(1, 3).dimensions)


def test_fingers_that_grip_nothing_record_no_touch():
    assert "touches" not in dict(Rig(None).grasp().published)


@pytest.mark.parametrize(("step", "held"), [(0.22e-3, True), (0.0, False)])
def test_fingers_that_move_in_steps_hold_a_small_fruit_that_keeps_them_off_their_aim_by_less_than_2_mm(
    step, held
):
    rig = Rig(0.0578, motor=False, hard=True)
    gripper = rig.scene.gripper
    gripper.limits = GripperLimits(0.053, 0.103, 0.15, 20.0, 20.0, step)
    rig.scene.gripper.width = 0.085
    outcome = rig.grasp(fruit=apple_at(5, 2), force=40.0)
    assert (outcome.status is Status.SUCCESS) == held


def test_a_gripper_that_presses_harder_than_the_fruit_bears_is_refused_before_it_moves():
    rig = Rig(0.085)
    rig.scene.gripper.limits = replace(rig.scene.gripper.limits, force_min=10.0)
    outcome = rig.grasp(force=10.0)
    assert outcome.reason.code == "REFUSED"
    assert (
        "20 N at least, where the fruit bears 18 N and 'force' allows 10 N"
        in outcome.reason.message
    )
    assert rig.scene.gripper.moves == []
    assert rig.grasp(force=20.0).status is Status.SUCCESS
