"""The common base of grippers, with a driver of a few lines at fingers that the test moves."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pomona.drivers.base.parallel_gripper import (
    RECONNECT,
    ParallelGripper,
    SpeedOrder,
    Stop,
    Wanted,
    WidthOrder,
)
from pomona.drivers.errors import DeviceError, DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.interfaces import Gripper, GripperLimits, GripperState, MotionState
from pomona.executive.clock import ManualClock

LIMITS = GripperLimits(0.0, 0.1, 0.1, 20.0)
STEP = 0.005


class Fingers(ParallelGripper[GripperState, Wanted]):
    """Fingers that follow their commands at once, and the commands that they got."""

    def __init__(self) -> None:
        super().__init__("gripper", ManualClock(5.0), LIMITS, acceleration=10.0, watchdog=0.1)
        self.width, self.speed, self.aim, self.obstacle = 0.06, 0.0, 0.06, 0.0
        self.silent, self.broken = False, ""
        self.commands: list[str] = []

    def _serve(self) -> None:
        self._clock.advance(STEP)
        way = self.speed * STEP
        before = self.width
        self.width = max(min(max(self.aim, before - way), before + way), min(self.obstacle, before))
        if self.broken:
            raise ConnectionResetError(self.broken)
        if self.silent:
            self._lose(DeviceLost(self.name, "does not answer"))
        else:
            self._measured(self._clock.now(), self.width, (self.width - before) / STEP)
            self._status = self._state

    def next_command(self, wanted: Wanted, status: GripperState) -> Wanted | None:
        return wanted

    def _send(self, command: Wanted) -> None:
        if self.broken:
            raise BrokenPipeError(self.broken)
        match command:
            case WidthOrder(width, speed):
                self.commands.append("move")
                self.aim, self.speed = width, speed
            case SpeedOrder(speed):
                self.commands.append(f"speed {speed:g}")
                self.aim, self.speed = (1.0 if speed > 0.0 else -1.0), abs(speed)
            case Stop():
                self.commands.append("rest")
                self.speed = 0.0


@pytest.fixture
def fingers() -> Fingers:
    found = Fingers()
    found.connect()
    serve(found, 0.1)
    return found


def serve(fingers: Fingers, seconds: float, each: Callable[[], None] = lambda: None) -> None:
    for _ in range(round(seconds / STEP)):
        each()
        try:
            fingers.step()
        except Exception as error:
            fingers._failed(error)  # as its owner's thread does


def test_nothing_is_commanded_before_the_first_request(fingers: Fingers) -> None:
    assert isinstance(fingers, Gripper)
    assert fingers.commands == []
    assert fingers.settled()
    fingers.check()


def test_without_a_state_it_is_not_connected() -> None:
    silent = Fingers()
    silent.silent = True
    with pytest.raises(DeviceLost, match="does not answer"):
        silent.connect()
    with pytest.raises(DeviceLost, match="does not answer"):
        silent.state()


def test_the_state_names_the_aim_of_a_move_and_none_after_a_streamed_speed(
    fingers: Fingers,
) -> None:
    motion = fingers.move(0.04, 0.1)
    serve(fingers, 0.5)
    assert (motion.state, motion.settled, fingers.state().aim) == (MotionState.DONE, True, 0.04)
    fingers.set_speed(-0.01)
    serve(fingers, 2.0 * STEP)
    assert fingers.state().aim is None


def test_a_second_move_ends_the_first(fingers: Fingers) -> None:
    first = fingers.move(0.02, 0.02)
    serve(fingers, 0.2)
    second = fingers.move(0.08, 0.1)
    serve(fingers, 1.0)
    assert (first.state, first.settled) == (MotionState.STOPPED, True)
    assert second.state is MotionState.DONE


def test_fingers_are_not_settled_between_the_request_and_the_end_of_a_move(
    fingers: Fingers,
) -> None:
    motion = fingers.move(0.02, 0.05)
    while not motion.settled:
        assert not fingers.settled()
        serve(fingers, STEP)
    assert fingers.settled()


def test_a_safe_stop_commands_rest_and_lets_nothing_open(fingers: Fingers) -> None:
    motion = fingers.move(0.02, 0.05)
    serve(fingers, 0.2)
    fingers.safe_stop("first")
    fingers.safe_stop("second")
    assert motion.state is MotionState.STOPPED
    serve(fingers, STEP)
    assert fingers.commands[-1] == "rest"
    with pytest.raises(MotionRefused, match=r"latched in the safe state \(first\)"):
        fingers.move(0.05, 0.1)
    stood = fingers.width
    serve(fingers, 0.2, lambda: fingers.set_speed(0.05))
    assert fingers.width == stood
    serve(fingers, 0.2, lambda: fingers.set_speed(-0.05))
    assert fingers.width < stood - 0.005


def test_a_fault_fails_the_move_and_stays_until_it_is_acknowledged(fingers: Fingers) -> None:
    motion = fingers.move(0.02, 0.05)
    serve(fingers, 0.1)
    fingers.width = 0.09
    serve(fingers, 0.2)
    assert motion.state is MotionState.FAILED
    with pytest.raises(DeviceFault, match="gripper: opens without a command"):
        fingers.check()
    with pytest.raises(MotionRefused, match="not ready"):
        fingers.move(0.05, 0.1)
    fingers.acknowledge()
    fingers.check()
    assert fingers.move(0.05, 0.1).state is MotionState.RUNNING


def test_a_width_that_is_no_number_is_a_fault_and_no_state(fingers: Fingers) -> None:
    fingers.width = float("nan")
    serve(fingers, STEP)
    assert fingers.state().width == 0.06
    with pytest.raises(DeviceFault, match="nan mm"):
        fingers.check()


@pytest.mark.parametrize("how", ["silent", "broken"])
def test_after_a_loss_nothing_moves_until_it_is_acknowledged(fingers: Fingers, how: str) -> None:
    motion = fingers.move(0.02, 0.05)
    serve(fingers, 0.1)
    setattr(fingers, how, "cut")
    serve(fingers, 0.1)
    assert motion.state is MotionState.FAILED
    for call in (
        fingers.check,
        fingers.state,
        fingers.acknowledge,
        lambda: fingers.set_speed(-0.01),
    ):
        with pytest.raises(DeviceError, match=r"does not answer|the wire failed: cut"):
            call()
    setattr(fingers, how, "")
    serve(fingers, RECONNECT + 0.1)  # a stop reaches it
    stood = fingers.width
    sent = len(fingers.commands)
    widths: list[float] = []
    serve(fingers, 0.1, lambda: widths.append(fingers.width))
    with pytest.raises(DeviceLost, match="acknowledge the loss before it moves"):
        fingers.set_speed(-0.01)
    with pytest.raises(MotionRefused, match="acknowledge the loss before it moves"):
        fingers.move(0.05, 0.1)
    serve(fingers, 0.1, lambda: widths.append(fingers.width))
    fingers.acknowledge()
    serve(fingers, 0.1, lambda: widths.append(fingers.width))
    assert set(widths) == {stood}
    assert set(fingers.commands[sent:]) <= {"rest"}
    assert fingers.move(0.05, 0.1).state is MotionState.RUNNING


def test_a_lost_move_is_settled_when_its_last_command_must_have_ended(fingers: Fingers) -> None:
    motion = fingers.move(0.02, 0.02)  # 2 s
    serve(fingers, 0.1)
    fingers.silent = True
    serve(fingers, 1.0)
    assert (motion.state, motion.settled, fingers.settled()) == (MotionState.FAILED, False, False)
    serve(fingers, 4.0)
    assert (motion.settled, fingers.settled()) == (True, True)


def test_a_wire_that_is_cut_does_not_end_the_stop(fingers: Fingers) -> None:
    motion = fingers.move(0.02, 0.05)
    serve(fingers, 0.1)
    fingers.broken = "cut"
    fingers.safe_stop("test")
    assert motion.state is MotionState.STOPPED
    serve(fingers, STEP)
    with pytest.raises(DeviceLost, match="the wire failed: cut"):
        fingers.check()
    fingers.broken = ""
    serve(fingers, 0.1)
    assert fingers.commands[-1] == "rest"


def test_a_paused_move_goes_on(fingers: Fingers) -> None:
    motion = fingers.move(0.02, 0.05)
    serve(fingers, 0.2)
    fingers.pause()
    serve(fingers, 0.5)
    assert (motion.state, fingers.settled()) == (MotionState.PAUSED, True)
    fingers.resume()
    serve(fingers, 1.5)
    assert motion.state is MotionState.DONE
    fingers.check()


def test_a_move_that_a_fault_ended_in_a_pause_does_not_resume(fingers: Fingers) -> None:
    motion = fingers.move(0.02, 0.05)
    serve(fingers, 0.1)
    fingers.pause()
    fingers.safe_stop("test")
    serve(fingers, 0.1)
    stood = fingers.width
    fingers.resume()
    widths: list[float] = []
    serve(fingers, 0.5, lambda: widths.append(fingers.width))
    assert motion.state is MotionState.STOPPED
    assert widths == [stood] * len(widths)
    assert stood > 0.05


def test_a_blocked_move_ends_where_the_fingers_rest(fingers: Fingers) -> None:
    fingers.obstacle = 0.05
    motion = fingers.move(0.02, 0.05)
    serve(fingers, 1.0)
    assert motion.problem == "the fingers are blocked at 50.0 mm"
    fingers.check()


def test_closed_it_takes_no_command(fingers: Fingers) -> None:
    fingers.close()
    for call in (fingers.check, fingers.state, lambda: fingers.set_speed(0.01)):
        with pytest.raises(DeviceLost, match="is closed"):
            call()
    with pytest.raises(MotionRefused):
        fingers.move(0.05, 0.1)


@pytest.mark.parametrize("wanted", [None, Stop(), SpeedOrder(-0.01)])
def test_the_first_misbehaviour_is_a_fault_and_a_stop_whatever_is_wanted(
    fingers: Fingers, wanted: Wanted | None
) -> None:
    fingers._wanted = wanted
    fingers._fail("opens without a command")
    assert isinstance(fingers._wanted, Stop)
    with pytest.raises(DeviceFault, match="opens without a command"):
        fingers.check()


def test_fingers_that_misbehave_again_are_stopped_again_and_the_first_reason_stays(
    fingers: Fingers,
) -> None:
    fingers._fail("opens without a command")
    stop = fingers._wanted
    due = fingers._stop_by
    fingers._clock.advance(0.1)
    fingers._fail("closes without a command")  # while it is being stopped
    assert fingers._wanted is stop
    assert fingers._stop_by == due
    fingers._wanted = SpeedOrder(-0.01)  # force control goes on
    fingers._fail("closes without a command")
    assert isinstance(fingers._wanted, Stop)
    with pytest.raises(DeviceFault, match="opens without a command"):
        fingers.check()
