"""Every arm that follows streamed set-points passes them at their times, within its limits, and ends at rest."""

from __future__ import annotations

import time

import numpy as np
import pytest

from pomona.drivers.errors import BadTrajectory, MotionRefused
from pomona.drivers.interfaces import MotionState, SetPoints, StreamedArm
from tests.drivers.devices.arm_rigs import RIGS, Rig

WATCHDOG = 0.15
TICK = 0.02  # between set-points [s]: of a skill
SWING, PACE = 0.15, 2.0  # of a sine [rad, rad/s]


@pytest.fixture(
    params=[name for name in RIGS if name != "ros2"]
)  # its controller takes whole paths
def rig(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Rig:
    return RIGS[request.param](monkeypatch)


def swung(start: np.ndarray, began: float, at: float) -> tuple[np.ndarray, np.ndarray]:
    """Joints and their speeds at a time of the cell's clock; the swing begins from rest."""
    t = max(at - began, 0.0)
    q, qd = start.copy(), np.zeros_like(start)
    q[0] += SWING * (1.0 - np.cos(PACE * t))
    qd[0] += SWING * PACE * np.sin(PACE * t)
    return q, qd


def led(rig: Rig, motion: SetPoints, start: np.ndarray, seconds: float) -> list[float]:
    """Lead the arm along the swing; return its distances from it [rad], of the second half."""
    now = rig.arm._clock.now if hasattr(rig.arm, "_clock") else rig.cell.clock.now  # type: ignore[attr-defined]
    began, beside = now() + motion.delay, []
    while now() < began + seconds and not motion.settled:
        at = now() + motion.delay + TICK / 2.0
        motion.aim(*swung(start, began, at), at)
        rig.serve(TICK)
        if now() > began + seconds / 2.0:
            beside.append(float(abs(rig.q[0] - swung(start, began, now())[0][0])))
    return beside


def test_an_arm_states_that_it_can_be_streamed_to(rig: Rig) -> None:
    assert isinstance(rig.arm, StreamedArm)
    assert StreamedArm in rig.arm.interfaces


@pytest.mark.parametrize("waits", [0.0, 0.05])
def test_set_points_are_passed_at_their_times_when_they_come_so_early_as_the_delay(
    rig: Rig, waits: float
) -> None:
    start = rig.q
    motion = rig.arm.stream(WATCHDOG)
    rig.serve(waits)
    assert 0.0 < motion.delay < 0.5
    beside = led(rig, motion, start, 3.0)
    assert (motion.state, motion.problem) == (MotionState.RUNNING, "")
    assert max(beside) < 0.003  # 10 ms at its largest speed
    motion.stop()
    rig.serve(3.0, lambda: motion.settled)
    assert motion.state is MotionState.STOPPED
    rig.arm.check()
    assert (np.array(rig.worst())[:2] <= np.array(rig.shares)[:2]).all()


def test_without_set_points_the_arm_comes_to_rest_and_the_motion_has_failed(rig: Rig) -> None:
    motion = rig.arm.stream(WATCHDOG)
    led(rig, motion, rig.q, 1.0)
    rig.serve(3.0, lambda: motion.settled)
    assert motion.state is MotionState.FAILED
    assert "no new set-point came for 150 ms" in motion.problem
    rig.serve(0.1)
    rested = rig.q
    rig.serve(0.5)
    assert np.abs(rig.q - rested).max() < 1e-3
    rig.arm.check()
    assert rig.arm.follow(rig.to(0.1 * np.ones_like(rested))).state is MotionState.RUNNING


def test_a_safe_stop_ends_it_and_nothing_goes_on(rig: Rig) -> None:
    motion = rig.arm.stream(WATCHDOG)
    led(rig, motion, rig.q, 1.0)
    rig.arm.safe_stop("by hand")
    for _ in range(100):
        motion.aim(rig.q + 0.1)
        rig.serve(TICK)
    assert motion.settled
    assert motion.state is MotionState.STOPPED
    rested = rig.q
    rig.serve(0.5)
    assert np.abs(rig.q - rested).max() < 1e-3
    with pytest.raises(MotionRefused, match="by hand"):
        rig.arm.stream(WATCHDOG)


def test_wrong_set_points_are_refused_at_once(rig: Rig) -> None:
    motion = rig.arm.stream(WATCHDOG)
    for wrong in (np.full_like(rig.q, np.nan), rig.limits.upper + 0.1, rig.q[:-1]):
        with pytest.raises(BadTrajectory):
            motion.aim(wrong)
    with pytest.raises(MotionRefused, match="still moves"):
        rig.arm.follow(rig.path())


@pytest.mark.parametrize(
    "rig", [name for name, of in RIGS.items() if of.holds_up and name != "ros2"], indirect=True
)
def test_a_process_that_stood_still_does_not_start_a_streamed_arm_again(rig: Rig) -> None:
    motion = rig.arm.stream(WATCHDOG)
    led(rig, motion, rig.q, 1.0)
    rig.hold_up(1.0)
    rested = rig.q
    rig.serve(2.0, lambda: motion.settled)
    assert motion.settled
    assert motion.state is MotionState.FAILED
    rig.serve(0.5)
    assert np.abs(rig.q - rested).max() < 1e-3


def test_a_step_of_the_host_s_clock_changes_nothing(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = rig.q
    motion = rig.arm.stream(WATCHDOG)
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() - 60.0)
    rig.step_clocks(-60.0, 0.0)
    assert max(led(rig, motion, start, 1.0)) < 0.003
    assert motion.state is MotionState.RUNNING


def test_an_arm_whose_controller_takes_whole_paths_does_not_offer_it() -> None:
    arm = pytest.importorskip(
        "pomona.devices.ros2.arm", reason="the extra ros2 is not installed"
    ).Ros2Arm
    assert StreamedArm not in arm.interfaces
    assert not hasattr(arm, "stream")
