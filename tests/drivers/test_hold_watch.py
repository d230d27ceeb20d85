"""Contact between the fingers when they press, hardly press, open and close."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault, DeviceLost
from pomona.drivers.hold_watch import HELD_FORCE, STOOD, HandMemory, HandRecord, HoldWatch, may_hold
from pomona.drivers.interfaces import GripperLimits, GripperState
from pomona.drivers.plain_hand import GIVE, MOTOR_FORCE, NO_ROOM
from pomona.tools.mock import MockClock, MockForceSensor, MockGripper

HELD_AT = 0.087
SURE, NOTHING = "something is between the fingers", ""
HARDLY = "the grip force fell below 0.2 N: the fruit may have been lost"
Feel = Callable[[float, float], str | None]


def lose() -> GripperState:
    raise DeviceLost("gripper", "does not answer")


@pytest.fixture
def clock() -> MockClock:
    return MockClock()


@pytest.fixture
def gripper(clock: MockClock) -> MockGripper:
    return MockGripper(clock, HELD_AT)


@pytest.fixture
def fingers(clock: MockClock) -> MockForceSensor:
    return MockForceSensor(clock)


@pytest.fixture
def felt(clock: MockClock, gripper: MockGripper, fingers: MockForceSensor) -> Feel:
    watch = HoldWatch(None, fingers, gripper)

    def feel(force: float, width: float) -> str | None:
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -force
        fingers.feel = lambda _now: wrenches
        gripper.width = width
        clock.advance(0.01)
        return watch.in_hand()

    return feel


def test_fingers_that_never_pressed_hold_nothing_however_wide_they_are_open(felt: Feel) -> None:
    assert [felt(0.0, HELD_AT), felt(0.4, HELD_AT), felt(0.0, 0.1)] == [NOTHING] * 3


def test_a_fruit_whose_friction_is_measured_with_little_force_still_counts_as_present(
    felt: Feel,
) -> None:
    said = [
        felt(3.0, HELD_AT),
        felt(0.3, HELD_AT + 2e-3),
        felt(0.1, HELD_AT + 3e-3),
        felt(0.3, HELD_AT),
    ]
    assert said == [SURE, SURE, HARDLY, HARDLY]
    assert felt(2.0, HELD_AT) == SURE


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_fingers_that_opened_or_closed_from_where_they_held_it_hold_it_no_more(
    felt: Feel, way: float
) -> None:
    assert [felt(3.0, HELD_AT), felt(0.0, HELD_AT + 1.1 * way * GIVE)] == [SURE, NOTHING]
    assert felt(0.0, HELD_AT) == NOTHING


def test_fingers_that_close_and_press_again_hold_something_where_they_are_now(felt: Feel) -> None:
    said = [
        felt(3.0, HELD_AT),
        felt(0.0, 0.103),
        felt(2.0, 0.06),
        felt(0.0, 0.06),
        felt(0.0, HELD_AT),
    ]
    assert said == [SURE, NOTHING, SURE, HARDLY, NOTHING]


def test_without_a_gripper_that_answers_only_the_force_decides(
    clock: MockClock, gripper: MockGripper, felt: Feel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gripper, "state", lose)
    assert [felt(3.0, HELD_AT), felt(0.1, HELD_AT)] == [SURE, NOTHING]


def test_a_hand_that_has_sent_nothing_yet_is_unknown_and_not_called_empty(
    clock: MockClock, gripper: MockGripper, monkeypatch: pytest.MonkeyPatch
) -> None:
    fingers = MockForceSensor(clock)
    watch = HoldWatch(None, fingers, gripper)
    assert (
        watch.in_hand()
        == "the force sensor has sent nothing yet, so the state of the hand is unknown"
    )
    clock.advance(0.01)
    assert watch.in_hand() == NOTHING
    monkeypatch.setattr(gripper, "state", lose)
    silent = HoldWatch(None, None, gripper, HandMemory(None, HandRecord()))
    assert (
        silent.in_hand() == "the gripper has sent nothing yet, so the state of the hand is unknown"
    )


def test_a_cell_without_a_hand_has_no_state_of_it() -> None:
    assert HoldWatch(None, None, None).in_hand() is None


# --------------------------------------------------------------------- from one connection to the next

LIMITS = GripperLimits(width_min=0.035, width_max=0.103, speed_max=0.2, force_max=20.0)
LATER = "and stood at 80.0 mm when the hand was last known"
EMPTY, HELD = HandRecord("", 0.08), HandRecord(SURE, 0.08)
EMPTY_ANYWHERE = HandRecord()


def doubt(width: float, last: HandRecord | None, force: float | None = 0.0, **state: object) -> str:
    return may_hold(GripperState(0.0, width, 0.0, False, **state), LIMITS, last, force)  # type: ignore[arg-type]


@pytest.mark.parametrize("force", [0.0, None, 0.9 * HELD_FORCE])
def test_fingers_that_stand_where_they_were_known_to_be_empty_hold_nothing(
    force: float | None,
) -> None:
    assert doubt(0.08 + 0.9 * STOOD, EMPTY, force) == ""
    assert doubt(0.05, HandRecord("", None), force) == ""  # the hand of a new simulated world


@pytest.mark.parametrize("width", [0.035, 0.035 + NO_ROOM, 0.103 - NO_ROOM, 0.103])
def test_fingers_at_an_end_of_their_travel_hold_nothing_whatever_was_known_and_is_felt(
    width: float,
) -> None:
    assert [doubt(width, last, 9.0) for last in (None, EMPTY, HELD)] == ["", "", ""]


@pytest.mark.parametrize(
    ("why", "words"),
    [
        (doubt(0.08, None), "the fingers stand at 80.0 mm, and the last state of the hand is unknown"),
        (doubt(0.08, HELD), "the fingers stand at 80.0 mm, where they may hold something"),
        (doubt(0.08 + 0.9 * GIVE, HELD), "the fingers stand at 89.0 mm, where they may hold something"),
        (doubt(0.08 + 1.1 * GIVE, HELD), f"the fingers stand at 91.0 mm, {LATER}"),
        (doubt(0.07, EMPTY), f"the fingers stand at 70.0 mm, {LATER}"),
        (doubt(float("nan"), EMPTY), f"the fingers stand at nan mm, {LATER}"),
        (doubt(0.08, EMPTY, 1.4), "each finger presses with 1.4 N or more, measured from the last bias"),
        (doubt(0.08, EMPTY, motor_force=1.1 * MOTOR_FORCE), "the gripper's motor presses with 1.1 N"),
        (doubt(0.103, EMPTY, motor_force=3.0), "the gripper's motor presses with 3.0 N"),
        (doubt(0.035, EMPTY, referenced=False), "the gripper has no reference, so its opening is unknown"),
    ],
)  # fmt: skip
def test_a_doubt_about_the_hand_names_its_cause(why: str, words: str) -> None:
    assert why == words


def connect(
    clock: MockClock, memory: HandMemory, width: float, force: float
) -> tuple[HoldWatch, MockGripper, MockForceSensor]:
    gripper, fingers = MockGripper(clock, width), MockForceSensor(clock)
    wrenches = np.zeros((2, 6))
    wrenches[:, 2] = -force
    fingers.feel = lambda _now: wrenches
    clock.advance(0.01)
    return HoldWatch(None, fingers, gripper, memory), gripper, fingers


def test_a_fruit_that_was_tared_away_still_counts_as_possibly_held_until_the_fingers_open(
    clock: MockClock,
) -> None:
    memory = HandMemory(None, HELD)
    watch, gripper, _ = connect(clock, memory, 0.079, 0.0)
    words = "something may be between the fingers: the fingers stand at 79.0 mm, where they may hold something"
    assert [watch.in_hand(), watch.in_hand()] == [words, words]
    again, _, _ = connect(clock, memory, 0.079, 0.0)
    assert again.in_hand() == words
    gripper.width = 0.095
    assert watch.in_hand() == NOTHING
    last, _, _ = connect(clock, memory, 0.095, 0.0)
    assert last.in_hand() == NOTHING


def test_the_state_of_the_hand_is_kept_when_it_changes_and_when_the_fingers_stand_elsewhere(
    clock: MockClock,
) -> None:
    memory = HandMemory(None, HandRecord("", 0.1))
    watch, gripper, fingers = connect(clock, memory, 0.1, 0.0)
    assert watch.in_hand() == NOTHING
    motion = gripper.move(0.08, 0.1)
    clock.advance(0.05)
    watch.in_hand()
    assert not motion.settled
    assert memory.record == HandRecord(
        "", 0.1
    )  # a process that is killed now leaves the hand unknown
    clock.advance(1.0)
    watch.in_hand()
    assert memory.record == HandRecord("", pytest.approx(0.08))
    pressed = np.zeros((2, 6))
    pressed[:, 2] = -1.4
    fingers.feel = lambda _now: pressed
    clock.advance(0.01)
    assert watch.in_hand() == SURE
    assert memory.record == HandRecord(SURE, pytest.approx(0.08))


def test_a_hand_that_is_not_remembered_is_judged_by_force_alone_at_first(clock: MockClock) -> None:
    gripper, fingers = MockGripper(clock, 0.08), MockForceSensor(clock)
    clock.advance(0.01)
    assert HoldWatch(None, fingers, gripper).in_hand() == NOTHING


# ------------------------------------------------------------------------------------ without a force sensor

STOPPED = "the fingers stopped at 80.0 mm on their way to 50.0 mm"


class Plain:
    """A hand without force sensor; `close` meets an object of 80 mm."""

    def __init__(
        self, clock: MockClock, width: float = 0.1, last: HandRecord | None = EMPTY_ANYWHERE
    ) -> None:
        self.clock, self.gripper, self.memory = (
            clock,
            MockGripper(clock, width),
            HandMemory(None, last),
        )
        self.watch = self.connected()

    def connected(self) -> HoldWatch:
        return HoldWatch(None, None, self.gripper, self.memory)

    def move(self, width: float, blocked_at: float = 0.0, for_: float = 1.0) -> str | None:
        self.gripper.blocked_at = blocked_at
        self.gripper.move(width, 0.1)
        self.clock.advance(for_)
        return self.watch.in_hand()

    def at(self, width: float) -> str | None:
        self.gripper.width = width
        self.clock.advance(0.01)
        return self.watch.in_hand()


@pytest.fixture
def plain(clock: MockClock) -> Plain:
    return Plain(clock)


def test_plain_fingers_that_reach_the_width_of_their_move_hold_nothing(plain: Plain) -> None:
    assert [plain.move(0.08), plain.move(0.06), plain.move(0.1), plain.move(0.035)] == [NOTHING] * 4


def test_plain_fingers_that_were_stopped_before_the_width_of_their_move_hold_something(
    plain: Plain,
) -> None:
    assert [plain.watch.in_hand(), plain.move(0.05, blocked_at=0.08)] == [NOTHING, STOPPED]
    assert plain.memory.record == HandRecord(STOPPED, pytest.approx(0.08))
    assert plain.connected().in_hand() == (
        "something may be between the fingers: the fingers stand at 80.0 mm, where they may hold something"
    )


def test_a_move_that_is_stopped_on_its_way_leaves_the_hand_unknown_until_the_fingers_open(
    plain: Plain,
) -> None:
    motion = plain.gripper.move(0.05, 0.1)
    plain.clock.advance(0.2)
    assert plain.watch.in_hand() == NOTHING
    motion.stop()
    plain.clock.advance(0.1)
    assert plain.watch.in_hand() == STOPPED
    assert plain.move(0.08 + 0.9 * GIVE) == STOPPED
    assert plain.move(0.08 + 1.1 * GIVE) == NOTHING


def test_what_plain_fingers_hold_is_still_there_when_they_close_further_without_a_motor_that_tells(
    plain: Plain,
) -> None:
    assert plain.move(0.05, blocked_at=0.08) == STOPPED
    assert plain.move(0.06) == STOPPED
    assert plain.move(0.035) == NOTHING  # closed


def test_the_motors_force_shows_a_fruit_and_its_end_leaves_a_doubt(plain: Plain) -> None:
    plain.gripper.motor_force = 0.0
    assert plain.move(0.08) == NOTHING
    plain.gripper.motor_force = 1.1 * MOTOR_FORCE
    assert plain.at(0.08) == SURE
    plain.gripper.motor_force = 0.9 * MOTOR_FORCE
    assert plain.at(0.08) == "the gripper's motor presses no more: the fruit may have been lost"
    assert (
        plain.move(0.06) == NOTHING
    )  # the fingers have closed where it was, and the motor presses on nothing


def test_a_fruit_that_the_motor_squeezes_by_more_than_a_release_opens_is_still_held(
    plain: Plain,
) -> None:
    plain.gripper.motor_force = 5.0
    assert plain.move(0.05, blocked_at=0.08) == SURE
    assert plain.move(0.05, blocked_at=0.065) == SURE
    plain.gripper.motor_force = 0.0
    assert plain.move(0.073) == "the gripper's motor presses no more: the fruit may have been lost"
    assert plain.move(0.08) == NOTHING


def test_closed_fingers_press_on_each_other_and_hold_nothing(plain: Plain) -> None:
    plain.gripper.motor_force = 10.0
    assert plain.move(0.035) == NOTHING


@pytest.mark.parametrize(
    ("speed", "said"),
    [(-0.05, "the fingers closed to 75.0 mm, and no move ended there"), (0.02, NOTHING)],
)
def test_fingers_that_closed_by_streamed_speeds_may_hold_something(
    clock: MockClock, speed: float, said: str
) -> None:
    plain = Plain(clock, 0.08)
    assert plain.watch.in_hand() == NOTHING
    plain.gripper.set_speed(speed)
    clock.advance(0.3)
    assert plain.watch.in_hand() == said


def test_a_plain_hand_without_memory_is_unknown(clock: MockClock) -> None:
    hand = Plain(clock, 0.08, None).watch.in_hand()
    assert hand == (
        "something may be between the fingers: the fingers stand at 80.0 mm, and the last state of the hand is unknown"
    )


def test_a_width_that_is_no_number_empties_no_hand(plain: Plain) -> None:
    assert plain.move(0.05, blocked_at=0.08) == STOPPED
    assert plain.at(float("nan")) == STOPPED


@pytest.mark.parametrize(
    ("motor", "width", "now", "why"),
    [
        (
            None,
            0.08 - 1.1 * STOOD,
            None,
            "the fingers moved from 80.0 to 78.9 mm while the run was paused",
        ),
        (
            None,
            0.08 + 1.1 * STOOD,
            None,
            "the fingers moved from 80.0 to 81.1 mm while the run was paused",
        ),
        (
            5.0,
            0.08,
            0.5,
            "the gripper's motor pressed with 5.0 N and presses no more while the run was paused",
        ),
        (5.0, float("nan"), 5.0, "the fingers moved from 80.0 to nan mm while the run was paused"),
    ],
)
def test_a_fruit_that_was_taken_out_in_a_pause_is_noticed_without_a_force_sensor(
    plain: Plain, motor: float | None, width: float, now: float | None, why: str
) -> None:
    plain.gripper.motor_force = motor
    assert plain.move(0.05, blocked_at=0.08)
    plain.watch.note()
    plain.watch.compare()
    plain.gripper.width, plain.gripper.motor_force = width, now
    with pytest.raises(DeviceFault, match=f"gripper: {why}: the fruit may be gone"):
        plain.watch.compare()
    plain.watch.forget()
    plain.watch.compare()


def test_empty_plain_fingers_may_be_moved_in_a_pause(plain: Plain) -> None:
    plain.watch.note()
    plain.gripper.width = 0.05
    plain.watch.compare()


@pytest.mark.parametrize(
    ("started", "aim", "stands", "said"),
    [
        (0.06, 0.1, 0.0601, ""),
        (0.06, 0.1, 0.085, ""),
        (0.06, 0.1, 0.1, ""),
        (0.06, 0.1, 0.055, "stood at 60.0 mm"),
        (0.06, 0.09, 0.095, "stood at 60.0 mm"),
        (0.1, 0.06, 0.085, "stood at 100.0 mm"),
    ],
)
def test_empty_fingers_whose_run_was_killed_while_they_opened_are_no_alarm(
    clock: MockClock, started: float, aim: float, stands: float, said: str
) -> None:
    plain = Plain(clock, started, HandRecord("", started))
    assert plain.watch.in_hand() == NOTHING
    plain.move(aim, for_=0.02)  # the run is killed here, and the gripper goes on
    plain.gripper = MockGripper(clock, stands)
    found = plain.connected().in_hand() or ""
    assert bool(found) == bool(said)
    assert said in found
