"""A gripper's states against its commands."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pomona.drivers.gripper_supervisor import COASTING, GripperSupervision, GripperSupervisor
from pomona.drivers.interfaces import GripperLimits, GripperState

PERIOD = 0.01
LIMITS = GripperLimits(0.0, 0.068, 0.4, 50.0)


class Fingers:
    """Ideal fingers that report every 10 ms."""

    def __init__(self) -> None:
        self.now, self.width = 0.0, 0.030
        self.supervisor = GripperSupervisor(LIMITS, 2.0)
        self.supervisor.rest(0.0)
        self.said: list[str] = []

    def run(self, seconds: float, speed: float = 0.0) -> list[str]:
        """Return the reports while the fingers moved with a speed [m/s]."""
        began = len(self.said)
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            self.width += speed * PERIOD
            self.said.append(
                self.supervisor.look(
                    self.now, GripperState(self.now, self.width, speed, speed != 0.0)
                )
            )
        return [words for words in self.said[began:] if words]


@pytest.fixture
def fingers() -> Fingers:
    fingers = Fingers()
    fingers.run(COASTING + 0.1)
    return fingers


def test_how_far_a_gripper_is_believed_is_a_setting(fingers: Fingers) -> None:
    fingers.supervisor = GripperSupervisor(
        LIMITS, 2.0, GripperSupervision(stray=20e-3, margin=1.0, share=0.0)
    )
    fingers.supervisor.rest(fingers.now)
    fingers.run(COASTING + 0.1)
    assert fingers.run(0.15, 0.1) == []  # 15 mm
    fingers.supervisor.move(fingers.now, fingers.width, fingers.width + 0.01, 0.1)
    assert fingers.run(1.1) == []
    assert fingers.run(0.1) != []


def test_fingers_that_follow_their_commands_are_left_alone(fingers: Fingers) -> None:
    fingers.supervisor.move(fingers.now, 0.030, 0.060, 0.1)
    assert fingers.run(0.3, 0.1) == []
    fingers.supervisor.rest(fingers.now)
    assert fingers.run(1.0) == []
    for speed in (0.02, -0.03, 0.0, -0.05):
        fingers.supervisor.stream(fingers.now, speed, 0.1)
        assert fingers.run(0.2, speed) == []
    assert not any(fingers.said)


@pytest.mark.parametrize("speed", [0.06, -0.06])
@pytest.mark.parametrize("after", [0.0, 0.1, 0.29])
def test_a_speed_that_follows_a_move_at_once_is_a_command(
    fingers: Fingers, speed: float, after: float
) -> None:
    """Fingers give way to a push while those of a move may still come to rest."""
    fingers.supervisor.rest(fingers.now)
    assert fingers.run(after) == []
    for _ in range(20):
        fingers.supervisor.stream(fingers.now, speed, 0.1)
        assert fingers.run(0.02, speed) == []


def test_fingers_that_go_on_against_a_speed_that_follows_a_move_at_once_stray(
    fingers: Fingers,
) -> None:
    fingers.supervisor.rest(fingers.now)
    fingers.supervisor.stream(fingers.now, -0.02, 0.1)
    assert "opens without a command" in fingers.run(0.2, 0.03)[0]


def test_fingers_that_something_blocks_for_a_moment_are_left_alone(fingers: Fingers) -> None:
    fingers.supervisor.stream(fingers.now, -0.05, 0.1)
    assert fingers.run(0.25) == []  # 12.5 mm, 5 of them by the lag that is allowed
    fingers.supervisor.stream(fingers.now, 0.02, 0.1)
    assert fingers.run(0.3, 0.02) == []


@pytest.mark.parametrize(("speed", "word"), [(0.05, "open"), (-0.05, "close")])
def test_a_width_that_does_not_follow_ten_millimetres_of_streamed_motion_is_found(
    fingers: Fingers, speed: float, word: str
) -> None:
    rng = np.random.default_rng(3)
    fingers.supervisor.stream(fingers.now, speed, 0.1)
    found: list[str] = []
    for _ in range(40):
        fingers.width = 0.030 + 2e-5 * rng.normal()
        found += fingers.run(PERIOD)
    assert found[0].startswith(
        f"was commanded to {word} by 15 mm more than its width shows, which stays at 30.0 mm"
    )


def test_a_width_that_lags_within_the_tolerance_or_creeps_as_commanded_is_left_alone(
    fingers: Fingers,
) -> None:
    for speed in (0.05, -0.05, 0.05):  # back and forth, each begun 50 ms late
        fingers.supervisor.stream(fingers.now, speed, 0.1)
        assert fingers.run(0.05) == []
        assert fingers.run(0.2, speed) == []
        fingers.supervisor.stream(fingers.now, 0.0, 0.1)
        assert fingers.run(0.05, speed) == []
        assert fingers.run(0.2) == []
    fingers.supervisor.stream(fingers.now, -1e-3, 0.1)
    assert fingers.run(120.0) == []


@pytest.mark.parametrize("speed", [0.02, -0.02])
def test_fingers_that_move_when_they_should_rest_are_found_after_three_millimetres(
    fingers: Fingers, speed: float
) -> None:
    assert fingers.run(0.14, speed) == []
    words = fingers.run(0.1, speed)
    assert words[0].startswith(
        ("opens" if speed > 0.0 else "closes") + " without a command: 30.0 → "
    )
    assert fingers.supervisor.rest_by == math.inf


@pytest.mark.parametrize(("speed", "word"), [(0.03, "opens"), (-0.15, "closes")])
def test_fingers_that_leave_the_way_of_a_move_are_found_before_it_ends(
    fingers: Fingers, speed: float, word: str
) -> None:
    fingers.supervisor.move(fingers.now, 0.030, 0.025, 0.02)
    words = fingers.run(0.15, speed)
    assert words[0].startswith(f"{word} without a command: {30.0 if speed > 0.0 else 25.0:.1f} → ")


def test_fingers_that_open_on_a_closing_command_are_found_after_three_millimetres(
    fingers: Fingers,
) -> None:
    fingers.supervisor.stream(fingers.now, -0.08, 0.1)
    assert fingers.run(0.05, -0.08) == []
    assert fingers.run(0.09, 0.03) == []
    assert fingers.run(0.05, 0.03)[0].startswith("opens without a command: 26.0 → ")


def test_fingers_that_come_to_rest_from_a_move_go_on_by_the_braking_distance_and_no_further(
    fingers: Fingers,
) -> None:
    fingers.supervisor.move(fingers.now, 0.030, 0.060, 0.1)
    assert fingers.run(0.1, 0.1) == []
    fingers.supervisor.rest(fingers.now)
    assert fingers.run(0.05, 0.1) == []
    assert fingers.run(0.2, 0.1)[0].startswith(
        "opens without a command: 52.5 → "
    )  # 40 + 10 + 2.5 mm


def test_fingers_at_rest_are_those_whose_width_stays(fingers: Fingers) -> None:
    assert fingers.supervisor.at_rest
    fingers.run(0.05, 0.05)
    assert not fingers.supervisor.at_rest
    fingers.run(0.02)
    assert not fingers.supervisor.at_rest
    fingers.run(0.03)
    assert fingers.supervisor.at_rest


def test_a_move_is_overdue_after_its_time_and_a_margin(fingers: Fingers) -> None:
    fingers.supervisor.move(fingers.now, 0.030, 0.040, 0.1)  # 0.1 s of way, 0.05 s of braking
    assert fingers.run(0.7, 0.0) == []
    assert fingers.run(0.1, 0.0)[-1] == "has not ended its move to 40.0 mm within the expected time"
    assert fingers.supervisor.rest_by == pytest.approx(0.4 + 0.15 * 1.5 + 0.5)


@pytest.mark.parametrize(
    ("width", "speed", "words"),
    [
        (math.nan, 0.0, "reports a width of nan mm"),
        (0.030, -math.inf, "a speed of -inf mm/s"),
        (0.080, 0.0, "outside its stroke"),
        (-0.02, 0.0, "outside its stroke"),
        (0.030, 2.1, "which it cannot reach"),
    ],
)
def test_an_impossible_state_is_reported(
    fingers: Fingers, width: float, speed: float, words: str
) -> None:
    assert words in fingers.supervisor.look(
        fingers.now + PERIOD, GripperState(fingers.now + PERIOD, width, speed, False)
    )
    assert not fingers.supervisor.at_rest


def test_a_jumping_width_is_reported() -> None:
    supervisor = GripperSupervisor(GripperLimits(0.0, 0.5, 0.1, 50.0), 2.0)
    supervisor.look(0.0, GripperState(0.0, 0.1, 0.0, False))
    assert (
        supervisor.look(0.01, GripperState(0.01, 0.4, 0.0, False))
        == "reports a jump from 100.0 to 400.0 mm at once"
    )


@pytest.mark.parametrize("force", [-130.0, 130.0, math.nan])
def test_a_force_that_the_motor_cannot_have_is_a_fault(fingers: Fingers, force: float) -> None:
    fingers.now += PERIOD
    state = GripperState(fingers.now, fingers.width, 0.0, False, motor_force=force)
    assert "of its motor" in fingers.supervisor.look(fingers.now, state)
