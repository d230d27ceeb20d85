"""Every arm comes to rest on its path within its limits, whatever its joints report and whatever a clock does."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from pomona.drivers.errors import DeviceError
from pomona.drivers.interfaces import Motion, MotionState
from tests.drivers.devices.arm_rigs import RIGS, Rig, Says

LIES: dict[str, Callable[[np.ndarray], Says]] = {
    "nan": lambda _now: lambda q: q * np.nan,
    "frozen": lambda now: lambda _q: now,
    "joint 1 frozen": lambda now: lambda q: np.concatenate([now[:1], q[1:]]),
    "joint 2 jumps": lambda _now: lambda q: q + 0.6 * (np.arange(q.size) == 1),
    "joints 1 and 2 exchanged": lambda _now: lambda q: np.concatenate([q[1::-1], q[2:]]),
}
"""Maps the joints at the beginning of a fault to the reported ones."""


PHASES = ("motion", "pause", "halt")


@pytest.fixture(params=RIGS)
def rig(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Rig:
    return RIGS[request.param](monkeypatch)


def begun(rig: Rig, phase: str) -> Motion:
    """Return a motion on its way, paused at rest, or braking for a safe stop."""
    motion: Motion = rig.arm.follow(rig.path())
    rig.serve(0.35)
    if phase == "pause":
        rig.arm.pause()
        rig.serve(1.0)
        assert rig.arm.settled()
    elif phase == "halt":
        rig.arm.safe_stop("by hand")
        rig.serve(0.01)
    assert not motion.settled
    return motion


def assert_rests(
    rig: Rig, motion: Motion, start: np.ndarray, end: np.ndarray, eased: bool = True
) -> None:
    """The set-points keep the limits, end on the path, and nothing moves any more.

    `eased`: the jerk is limited, too. A stop that comes while the arm speeds up again does not wait for that.
    """
    rig.serve(5.0, lambda: motion.settled)
    assert motion.settled
    rig.serve(0.1)
    rested = rig.q
    rig.serve(0.5)
    assert np.abs(rig.q - rested).max() < 1e-3
    assert (np.array(rig.worst()) <= (*rig.shares[:2], rig.shares[2] if eased else np.inf)).all(), (
        rig.worst()
    )
    done = (rested - start) / (end - start)
    assert done.min() > -0.01
    assert done.max() < 1.01
    assert np.ptp(done) < 0.05


def assert_reported(rig: Rig, motion: Motion) -> None:
    assert motion.state in (MotionState.FAILED, MotionState.STOPPED)
    if not motion.problem:
        with pytest.raises(DeviceError):
            rig.arm.check()


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("lie", LIES)
def test_joints_that_report_what_is_not_true_move_the_arm_nowhere(
    rig: Rig, lie: str, phase: str
) -> None:
    path = rig.path()
    motion = begun(rig, phase)
    rig.lie(LIES[lie](rig.q))
    rig.serve(0.3)
    if phase == "pause":  # joints that rest are as they were: a frozen one shows when it is to move
        rig.arm.resume()
    assert_rests(rig, motion, path.q[0], path.q[-1], eased=phase != "pause")
    if (
        phase != "halt" or "frozen" not in lie
    ):  # a short way to the stop may be within the tolerance
        assert_reported(rig, motion)


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize(
    ("rig", "seconds"),
    [
        (name, s)
        for name, of in RIGS.items()
        for s in ((0.5, -0.5, 5.0, -5.0, 60.0, -60.0) if of.stamps else (-60.0,))
    ],
    indirect=["rig"],
)
def test_a_step_of_the_host_s_clock_stops_an_arm_that_depends_on_it_and_no_other(
    rig: Rig, seconds: float, phase: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = rig.path()
    motion = begun(rig, phase)
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + seconds)
    rig.step_clocks(seconds, 0.0)
    rig.serve(0.05)
    if phase == "pause":
        rig.arm.resume()
    assert_rests(rig, motion, path.q[0], path.q[-1])
    if rig.stamps:
        assert_reported(rig, motion)
        assert motion.progress < 0.95
    else:
        assert motion.state is (MotionState.STOPPED if phase == "halt" else MotionState.DONE)
        rig.arm.check()


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("seconds", [0.5, 5.0])
@pytest.mark.parametrize("rig", [name for name, of in RIGS.items() if of.holds_up], indirect=True)
def test_a_process_that_stood_still_does_not_start_the_arm_again(
    rig: Rig, seconds: float, phase: str
) -> None:
    path = rig.path()
    motion = begun(rig, phase)
    rig.hold_up(seconds)
    rested = rig.q
    rig.serve(0.5)
    if phase == "pause":
        assert np.abs(rig.q - rested).max() < 1e-3
        rig.arm.resume()
    assert_rests(rig, motion, path.q[0], path.q[-1])
    if phase != "pause":
        assert np.abs(rig.q - rested).max() < 1e-3


def problem(rig: Rig) -> str:
    try:
        rig.arm.check()
    except DeviceError as error:
        return str(error)
    return ""


def broken(finding: str, *names: str) -> list[object]:
    """Return all rigs; those with these names do not hold a claim yet."""
    mark = pytest.mark.xfail(strict=True, reason=f"finding {finding}")
    return [pytest.param(name, marks=mark if name in names else ()) for name in RIGS]


UNORDERED = 5e-3
"""Motion of resting joints that must be noticed [rad]."""
SOON = 0.1
"""Time after it within which it must be noticed [s]."""


@pytest.mark.parametrize("rate", [np.inf, 1.0, 0.05])
@pytest.mark.parametrize("has_moved", [False, True])
def test_a_motion_from_rest_that_nobody_ordered_is_noticed_at_once_and_named(
    rig: Rig, rate: float, has_moved: bool
) -> None:
    rig.serve(0.5)
    if has_moved:
        motion = rig.arm.follow(rig.path())
        rig.serve(5.0, lambda: motion.settled)
        rig.serve(0.2)
    moved = 0.0

    def says(q: np.ndarray) -> np.ndarray:
        return q + moved * np.eye(q.size)[1]

    rig.lie(says)
    seconds, since = 0.0, np.inf
    while seconds < 2.0 and not problem(rig):
        moved = min(0.04, rate * seconds) if seconds else 0.0
        since = min(since, seconds) if moved > UNORDERED else np.inf
        rig.serve(0.005)
        seconds += 0.005
    assert "without a command of this run" in problem(rig)
    assert seconds - since <= SOON + 0.005


def test_a_second_master_in_a_motion_is_noticed_and_named(rig: Rig) -> None:
    rig.serve(0.3)
    rig.arm.follow(rig.path())
    rig.serve(0.35)
    for _ in range(5):
        rig.foreign()
        rig.serve(0.02)
    rig.serve(0.2)
    assert "another program" in problem(rig)


@pytest.mark.parametrize("rate", [0.7, 0.5])
def test_an_arm_whose_controller_goes_slower_than_the_computer_is_settled_when_it_rests(
    rig: Rig, rate: float
) -> None:
    rig.slow_down(rate)
    rig.serve(0.5)
    motion = rig.arm.follow(rig.path())
    rig.serve(0.35)
    rig.arm.pause()
    rig.serve(3.0, rig.arm.settled)
    rested = rig.q
    rig.serve(0.3)
    assert np.abs(rig.q - rested).max() < 1e-3
    rig.arm.resume()
    rig.serve(5.0, lambda: motion.settled)
    worst = rig.worst()
    assert (np.array(worst[:2]) <= rig.shares[:2]).all(), worst


@pytest.mark.parametrize("wait", [0.0, 0.005, 0.05])
def test_a_motion_that_goes_on_as_soon_as_the_arm_is_settled_keeps_the_limits(
    rig: Rig, wait: float
) -> None:
    motion = rig.arm.follow(rig.path())
    rig.serve(0.35)
    rig.arm.pause()
    rig.serve(3.0, rig.arm.settled)
    rested = rig.q
    rig.serve(wait)
    assert np.abs(rig.q - rested).max() < 1e-3
    rig.arm.resume()
    rig.serve(5.0, lambda: motion.settled)
    assert (motion.state, problem(rig)) == (MotionState.DONE, "")
    assert (np.array(rig.worst()) <= (1.01, 1.1, 3.0)).all(), rig.worst()


def test_a_motoman_whose_state_is_late_has_no_fault_and_is_settled_when_it_rests(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(RIGS["motoman"], "late", ("state", 0.03))
    rig = RIGS["motoman"](monkeypatch)
    motion = rig.arm.follow(rig.path())
    rig.serve(5.0, lambda: motion.settled)
    assert (motion.state, problem(rig)) == (MotionState.DONE, "")
    rested = rig.q
    rig.serve(1.0)
    assert np.abs(rig.q - rested).max() < 1e-3
