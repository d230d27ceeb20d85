"""Every arm that follows streamed set-points passes them at their times, within its limits, and ends at rest."""

from __future__ import annotations

import time

import numpy as np
import pytest

from pomona.drivers.conformance import ArmBench
from pomona.drivers.errors import BadTrajectory, MotionRefused
from pomona.drivers.interfaces import MotionState, SetPoints, StreamedArm
from tests.drivers.conformance.arms import BENCHES

WATCHDOG = 0.15
TICK = 0.02  # between set-points [s]: of a skill
SWING, PACE = 0.15, 2.0  # of a sine [rad, rad/s]


WHOLE = ("ros2", "reacher")
"""Arms whose controllers take whole paths."""


@pytest.fixture(params=[name for name in BENCHES if name not in WHOLE])
def bench(request: pytest.FixtureRequest) -> ArmBench:
    return BENCHES[request.param]()


def swung(start: np.ndarray, began: float, at: float) -> tuple[np.ndarray, np.ndarray]:
    """Joints and their speeds at a time of the cell's clock; the swing begins from rest."""
    t = max(at - began, 0.0)
    q, qd = start.copy(), np.zeros_like(start)
    q[0] += SWING * (1.0 - np.cos(PACE * t))
    qd[0] += SWING * PACE * np.sin(PACE * t)
    return q, qd


def led(bench: ArmBench, motion: SetPoints, start: np.ndarray, seconds: float) -> list[float]:
    """Lead the arm along the swing; return its distances from it [rad], of the second half."""
    now = bench.clock.now
    began, beside = now() + motion.delay, []
    while now() < began + seconds and not motion.settled:
        at = now() + motion.delay + TICK / 2.0
        motion.aim(*swung(start, began, at), at)
        bench.serve(TICK)
        if now() > began + seconds / 2.0:
            beside.append(float(abs(bench.body.q[0] - swung(start, began, now())[0][0])))
    return beside


def test_an_arm_states_that_it_can_be_streamed_to(bench: ArmBench) -> None:
    assert isinstance(bench.device, StreamedArm)
    assert StreamedArm in bench.device.interfaces


@pytest.mark.parametrize("waits", [0.0, 0.05])
def test_set_points_are_passed_at_their_times_when_they_come_so_early_as_the_delay(
    bench: ArmBench, waits: float
) -> None:
    start, since = bench.body.q, bench.now
    motion = bench.device.stream(WATCHDOG)
    bench.serve(waits)
    assert 0.0 < motion.delay < 0.5
    beside = led(bench, motion, start, 3.0)
    assert (motion.state, motion.problem) == (MotionState.RUNNING, "")
    assert max(beside) < 0.003  # 10 ms at its largest speed
    motion.stop()
    bench.serve(3.0, lambda: motion.settled)
    assert motion.state is MotionState.STOPPED
    bench.device.check()
    bench.keeps_limits("streamed,", since)


def test_without_set_points_the_arm_comes_to_rest_and_the_motion_has_failed(
    bench: ArmBench,
) -> None:
    motion = bench.device.stream(WATCHDOG)
    led(bench, motion, bench.body.q, 1.0)
    bench.serve(3.0, lambda: motion.settled)
    assert motion.state is MotionState.FAILED
    assert "no new set-point came for 150 ms" in motion.problem
    bench.serve(0.1)
    rested = bench.body.q
    bench.serve(0.5)
    assert np.abs(bench.body.q - rested).max() < 1e-3
    bench.device.check()
    assert bench.follow().state is MotionState.RUNNING


def test_a_safe_stop_ends_it_and_nothing_goes_on(bench: ArmBench) -> None:
    motion = bench.device.stream(WATCHDOG)
    led(bench, motion, bench.body.q, 1.0)
    bench.device.safe_stop("by hand")
    for _ in range(100):
        motion.aim(bench.body.q + 0.1)
        bench.serve(TICK)
    assert motion.settled
    assert motion.state is MotionState.STOPPED
    rested = bench.body.q
    bench.serve(0.5)
    assert np.abs(bench.body.q - rested).max() < 1e-3
    with pytest.raises(MotionRefused, match="by hand"):
        bench.device.stream(WATCHDOG)


def test_wrong_set_points_are_refused_at_once(bench: ArmBench) -> None:
    motion = bench.device.stream(WATCHDOG)
    for wrong in (np.full_like(bench.body.q, np.nan), bench.limits.upper + 0.1, bench.body.q[:-1]):
        with pytest.raises(BadTrajectory):
            motion.aim(wrong)
    with pytest.raises(MotionRefused, match="still moves"):
        bench.follow()


@pytest.mark.parametrize("bench", ["motoman", "universal_robots", "xarm"], indirect=True)
def test_a_process_that_stood_still_does_not_start_a_streamed_arm_again(bench: ArmBench) -> None:
    motion = bench.device.stream(WATCHDOG)
    led(bench, motion, bench.body.q, 1.0)
    bench.stand_still(1.0)
    rested = bench.body.q
    bench.serve(2.0, lambda: motion.settled)
    assert motion.settled
    assert motion.state is MotionState.FAILED
    bench.serve(0.5)
    assert np.abs(bench.body.q - rested).max() < 1e-3


def test_a_step_of_the_host_s_clock_changes_nothing(
    bench: ArmBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = bench.body.q
    motion = bench.device.stream(WATCHDOG)
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() - 60.0)
    assert max(led(bench, motion, start, 1.0)) < 0.003
    assert motion.state is MotionState.RUNNING


def test_an_arm_whose_controller_takes_whole_paths_does_not_offer_it() -> None:
    arm = pytest.importorskip(
        "pomona.devices.ros2.arm", reason="the extra ros2 is not installed"
    ).Ros2Arm
    assert StreamedArm not in arm.interfaces
    assert not hasattr(arm, "stream")
