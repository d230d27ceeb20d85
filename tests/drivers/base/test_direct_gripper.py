"""Grippers without a wire, and the stops of a gripper that does not obey."""

from __future__ import annotations

import pytest

from pomona.drivers.base.direct_gripper import DirectGripper
from pomona.drivers.base.parallel_gripper import ParallelGripper, SpeedOrder, Stop, Wanted
from pomona.drivers.errors import DeviceFault, MotionRefused, StopFailed
from pomona.drivers.gripper_supervisor import COASTING, allowed_speed
from pomona.drivers.interfaces import GripperLimits, GripperState, MotionState
from pomona.executive.clock import ManualClock

LIMITS = GripperLimits(0.0, 0.1, 0.1, 20.0)
STEP = 0.01


class Direct(DirectGripper):
    """Fingers that are where the test puts them."""

    def __init__(self) -> None:
        self.width = 0.05
        super().__init__("gripper", ManualClock(5.0), LIMITS, acceleration=10.0, watchdog=0.1)

    def state(self) -> GripperState:
        return GripperState(self._clock.now(), self.width, 0.0, False)

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self._clock.advance(STEP)
            self._supervisor.look(self._clock.now(), self.state())


def test_it_is_asked_for_its_state_and_needs_no_connection() -> None:
    gripper = Direct()
    assert gripper.last_seen() == 5.0
    assert gripper.settled()
    gripper.check()
    assert gripper.next_command(Stop(), gripper.state()) is None


@pytest.mark.parametrize(("width", "way"), [(0.054, "opens"), (0.046, "closes")])
def test_fingers_that_move_by_themselves_are_a_fault_which_stays(width: float, way: str) -> None:
    gripper = Direct()
    gripper.wait(COASTING + 0.1)
    gripper.check()
    gripper.width = width
    gripper._clock.advance(STEP)
    for _ in range(2):
        with pytest.raises(DeviceFault, match=f"{way} without a command"):
            gripper.check()
        gripper._clock.advance(STEP)
    with pytest.raises(MotionRefused, match="not ready"):
        gripper.move(0.05, 0.1)
    gripper.acknowledge()
    gripper.check()
    assert gripper.link() == "ok"


def test_a_move_is_settled_when_it_ends_and_a_stop_ends_it() -> None:
    gripper = Direct()
    move = gripper.move(0.08, 0.1, 5.0)
    assert (move.state, move.settled, gripper.settled()) == (MotionState.RUNNING, False, False)
    assert gripper._move is move
    move.stop()
    assert (move.state, move.settled) == (MotionState.STOPPED, True)


class Deaf(ParallelGripper[GripperState, Wanted]):
    """Fingers that go on whatever they are told."""

    def __init__(self) -> None:
        super().__init__("gripper", ManualClock(5.0), LIMITS, acceleration=10.0, watchdog=0.1)
        self.width, self.speed = 0.05, 0.0
        self.told: list[Wanted] = []

    def _serve(self) -> None:
        self._clock.advance(STEP)
        self.width += self.speed * STEP
        self._measured(self._clock.now(), self.width, self.speed)
        self._status = self._state

    def next_command(self, wanted: Wanted, status: GripperState) -> Wanted | None:
        return wanted

    def _send(self, command: Wanted) -> None:
        self.told.append(command)
        if isinstance(command, SpeedOrder):
            self.speed = command.speed

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.step()


@pytest.fixture
def deaf() -> Deaf:
    found = Deaf()
    found.connect()
    found.run(0.4)
    return found


def test_a_stop_that_is_not_obeyed_is_reported_before_any_other_problem(deaf: Deaf) -> None:
    deaf.set_speed(0.005)
    deaf.run(0.05)
    deaf.safe_stop("test")
    stopped = deaf._clock.now()
    while not isinstance(deaf._problem, StopFailed):
        deaf.step()
    late = deaf._clock.now() - stopped
    assert deaf.stopping < late <= deaf.stopping + 3.0 * STEP
    with pytest.raises(StopFailed, match=r"was not measured at rest 500 ms after a stop, at 5\d"):
        deaf.check()
    assert len(deaf.told) > 15  # a stop that is not shown is given again and again
    assert not deaf.settled()


def test_a_speed_that_is_not_renewed_ends_after_the_watchdog(deaf: Deaf) -> None:
    deaf.set_speed(-0.02)
    assert deaf._wanted == SpeedOrder(-0.02)
    deaf.run(0.1)
    assert deaf._wanted == SpeedOrder(-0.02)
    deaf.run(0.02)
    assert deaf._wanted == SpeedOrder(0.0)
    deaf.run(0.02)
    assert deaf.speed == 0.0
    deaf.check()


@pytest.mark.parametrize(
    ("speed", "latched", "allowed"),
    [
        (0.05, False, 0.05), (0.2, False, 0.1), (-0.2, False, -0.1), (0.05, True, 0.0),
        (-0.05, True, -0.05), (float("nan"), False, 0.0), (float("inf"), False, 0.0),
    ],
)  # fmt: skip
def test_a_streamed_speed_is_bounded_and_opens_nothing_while_latched(
    speed: float, latched: bool, allowed: float
) -> None:
    assert allowed_speed(speed, LIMITS, latched) == allowed


@pytest.mark.parametrize(
    ("width", "speed", "force", "problem"),
    [
        (-1e-5, 0.1, 5.0, "lies outside 0.0 … 100.0 mm"),
        (0.10001, 0.1, 5.0, "an opening of 100.0 mm lies outside"),
        (0.05, 0.0, 5.0, "a speed of 0 m/s lies outside"),
        (0.05, 0.1001, 5.0, "a speed of 0.1001 m/s lies outside"),
        (0.05, 0.1, 0.0, "a force of 0 N is too small"),
        (0.0, 0.1, 5.0, ""),
        (0.1, 0.1, 5.0, ""),
        (0.05, 0.1, 50.0, ""),  # bounded by the limit
    ],
)
def test_a_move_is_within_the_limits(
    width: float, speed: float, force: float, problem: str
) -> None:
    gripper = Direct()
    if problem:
        with pytest.raises(MotionRefused, match=problem):
            gripper.move(width, speed, force)
        return
    move = gripper.move(width, speed, force)
    assert (move.width, move.speed, move.force) == (width, speed, min(force, 20.0))
    assert Direct().move(0.05, 0.1).force == 20.0
