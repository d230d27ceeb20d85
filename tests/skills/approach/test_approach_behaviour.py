import numpy as np
import pytest
from py_trees.common import Status

from executive.skill_testing import drive
from skills.approach.behaviour import Approach
from tests.skills.picking_scene import Bench, a_grasp

GRASP = a_grasp(theta=np.pi / 12.0)


def at_pre_grasp() -> Bench:
    return Bench(q=GRASP.q_pre_grasp[0].copy(), width=0.06)


def touch_after(bench: Bench, time: float, force: float) -> None:
    """The right finger meets something from a time on."""

    def feel(now: float) -> np.ndarray:
        wrenches = np.full((2, 6), 0.1)
        wrenches[1, 0] -= force if now > time else 0.0
        return wrenches

    bench.fingers.feel = feel


def test_it_opens_first_and_then_goes_straight_to_the_grasp():
    bench = at_pre_grasp()
    opened_at = []
    outcome = drive(
        Approach(), {"grasp": GRASP}, bench.devices, clock=bench.clock,
        each_tick=lambda _tick: opened_at.append(bench.gripper.width) if not bench.arm.followed else None,
    )  # fmt: skip
    assert outcome.status is Status.SUCCESS
    assert opened_at[-1] == pytest.approx(GRASP.width, abs=1e-3)
    np.testing.assert_allclose(bench.tcp, GRASP.T_base_grasp, atol=1e-6)
    assert outcome.duration < 1.5


def test_a_touch_stops_the_arm_and_says_where():
    bench = at_pre_grasp()
    touch_after(bench, 0.7, 2.0)
    outcome = drive(Approach(), {"grasp": GRASP}, bench.devices, clock=bench.clock)
    assert outcome.reason.code == "CONTACT"
    assert outcome.reason.data["finger"] == "right"
    assert 0.02 < outcome.reason.data["before_grasp_m"] < 0.11
    assert bench.arm.settled()
    left = np.linalg.norm(bench.tcp[:3, 3] - GRASP.T_base_grasp[:3, 3])
    assert outcome.reason.data["before_grasp_m"] - 0.06 < left < outcome.reason.data["before_grasp_m"]


def test_an_offset_of_the_sensor_and_a_single_spike_are_no_touch():
    bench = at_pre_grasp()

    def feel(now: float) -> np.ndarray:
        wrenches = np.full((2, 6), 0.5)
        wrenches[0, 1] += 5.0 if 0.5 < now < 0.503 else 0.0
        return wrenches

    bench.fingers.feel = feel
    bench.clock.advance(0.01)
    outcome = drive(Approach(), {"grasp": GRASP}, bench.devices, clock=bench.clock)
    assert outcome.status is Status.SUCCESS


def test_fingers_that_feel_nothing_any_more_stop_the_arm():
    bench = at_pre_grasp()

    def lose(tick: int) -> None:
        if bench.arm.followed and tick % 10 == 0:
            bench.fingers.lose(10.0)

    outcome = drive(Approach(), {"grasp": GRASP}, bench.devices, clock=bench.clock, each_tick=lose)
    assert outcome.reason.code == "SENSOR_STALE"
    assert bench.arm.settled()


def test_it_does_not_start_from_anywhere_else():
    bench = Bench()
    outcome = drive(Approach(), {"grasp": GRASP}, bench.devices, clock=bench.clock)
    assert outcome.reason.code == "NOT_AT_PRE_GRASP"
    assert bench.arm.followed == []
    assert bench.gripper.moves == []


def test_interrupted_it_stops_on_the_line():
    bench = at_pre_grasp()
    outcome = drive(Approach(), {"grasp": GRASP}, bench.devices, clock=bench.clock, interrupt_after=35)
    assert outcome.status is Status.INVALID
    assert bench.arm.settled()
    offset = bench.tcp[:3, 3] - GRASP.T_base_pre_grasp[:3, 3]
    approach = GRASP.T_base_grasp[:3, 2]
    assert 0.005 < offset @ approach < 0.115
    np.testing.assert_allclose(offset, (offset @ approach) * approach, atol=1e-4)
