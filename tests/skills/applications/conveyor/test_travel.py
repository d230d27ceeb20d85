"""The travel of a belt from its encoder, and measurements that cannot be true."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.applications.conveyor.conveyor import ConveyorState
from pomona.applications.conveyor.travel import Travel


def ran(speed: float, until: float = 1.0, step: float = 0.02) -> Travel:
    travel = Travel()
    for k in range(round(until / step) + 1):
        travel.note(ConveyorState(k * step, speed * k * step, speed))
    return travel


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 3.0))
def test_between_and_beyond_measurements_a_steady_belt_is_where_it_is(
    speed: float, t: float
) -> None:
    assert ran(speed).at(t) == pytest.approx(speed * t, abs=1e-9)


def test_a_steady_speed_is_that_of_a_third_of_a_second_and_counts_are_no_change() -> None:
    travel = Travel()
    for k in range(100):
        counted = [1e-4 * int(0.1537 * t / 1e-4) for t in (0.01 * k, 0.01 * k - 0.1)]
        travel.note(ConveyorState(0.01 * k, counted[0], (counted[0] - counted[1]) / 0.1))
    speed, change = travel.steady()
    assert speed == pytest.approx(0.1537, abs=3.4e-4)
    assert change == 4e-3


@given(st.floats(1e-3, 5e-3), st.floats(1.0, 8.0))
def test_a_ripple_of_the_speed_is_no_change_of_it(ripple: float, rate: float) -> None:
    travel = Travel()
    for k in range(200):
        t = 0.01 * k
        v = 0.2 + ripple * np.sin(rate * t)
        travel.note(ConveyorState(t, 0.2 * t - ripple / rate * np.cos(rate * t), v))
    speed, change = travel.steady()
    assert abs(v - speed) < change
    wide = np.ptp(0.2 + ripple * np.sin(rate * 0.01 * np.arange(200)))
    assert change == pytest.approx(min(max(4e-3, 1.5 * wide), 0.02))


def test_without_measurements_a_change_is_as_coarse_as_of_any_encoder() -> None:
    assert Travel().steady() == (0.0, 0.02)


def test_without_an_encoder_nothing_has_travelled() -> None:
    travel = Travel()
    travel.note(None)
    assert (travel.at(3.0), travel.speed) == (0.0, 0.0)


def test_a_measurement_that_came_before_is_ignored() -> None:
    travel = ran(0.1)
    travel.note(ConveyorState(0.5, 7.0, 0.1))
    assert travel.at(0.5) == pytest.approx(0.05)


@given(st.floats(0.0, 0.5), st.floats(0.03, 1.0), st.booleans())
def test_a_position_that_no_belt_reaches_moves_nothing_and_is_described(
    speed: float, jump: float, back: bool
) -> None:
    travel, by = ran(speed), -jump if back else jump
    travel.note(ConveyorState(1.01, speed * 1.01 + by, speed))
    assert travel.at(1.01) == pytest.approx(speed * 1.01, abs=1e-9)
    assert f"jumped by {1e3 * by:.0f} mm within 10 ms" in travel.problem(1.01, 0.6)
    travel.note(ConveyorState(1.02, speed * 1.02, speed))
    assert travel.problem(1.02, 0.6) == ""


@given(st.floats(0.0, 0.5), st.floats(-4.0, 4.0))
def test_a_belt_that_brakes_or_starts_hard_has_not_jumped(
    speed: float, acceleration: float
) -> None:
    travel, position, v = Travel(), 0.0, speed
    speeds = [speed] * 10
    for k in range(60):
        travel.note(ConveyorState(0.01 * k, position, sum(speeds[-10:]) / 10.0))
        v = min(max(v + 0.01 * acceleration, 0.0), 0.5) if k > 20 else v
        position += 0.01 * v
        speeds.append(v)
        assert travel.problem(0.01 * k, 0.6) == ""


@pytest.mark.parametrize(
    ("travel", "now", "words"),
    [
        (Travel(), 1.0, "sent nothing yet"),
        (ran(0.1), 1.5, "sent nothing for 500 ms"),
        (ran(-0.1), 1.0, "counts backwards, at -0.10 m/s"),
        (ran(0.7), 1.0, "runs at 0.70 m/s, the arm can follow up to 0.50 m/s"),
        (ran(0.3), 1.05, ""),
        (ran(0.0), 1.0, ""),
    ],
)
def test_measurements_that_cannot_be_used_are_described(
    travel: Travel, now: float, words: str
) -> None:
    assert words in travel.problem(now, 0.5)
    assert bool(travel.problem(now, 0.5)) == bool(words)
