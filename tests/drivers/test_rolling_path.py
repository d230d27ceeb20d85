"""Messages of a trajectory controller: set-points until the lead, then a stop."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.drivers.interfaces import ArmLimits, Trajectory
from pomona.drivers.path_motion import PathMotion
from pomona.drivers.rolling_path import POINT_PERIOD, OutOfSetPointsError, RollingPath
from pomona.executive.clock import ManualClock

LIMITS = ArmLimits(
    np.array([-2.0]), np.array([2.0]), np.array([2.0]), np.array([20.0]), np.array([500.0])
)
LEAD = 0.045  # between two points


class Rolling:
    """A path of half a second and 0.2 rad, and the set-points that it gave."""

    def __init__(self) -> None:
        t = np.linspace(0.0, 0.5, 51)
        x, rate = np.pi * t / 0.5, np.pi / 0.5
        columns = 0.1 * (1.0 - np.cos(x)), 0.1 * rate * np.sin(x), 0.1 * rate**2 * np.cos(x)
        trajectory = Trajectory(t, *(column[:, None] for column in columns))
        self.clock = ManualClock(4.0)
        self.motion = PathMotion(trajectory, LIMITS, POINT_PERIOD)
        self.told: list[tuple[float, float]] = []
        self.path = RollingPath(
            "arm",
            self.motion,
            np.zeros(1),
            self.clock,
            LEAD,
            lambda due, q: self.told.append((due, float(q[0]))),
        )

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / POINT_PERIOD)):
            self.path.go_on()
            self.clock.advance(POINT_PERIOD)


def where(seconds: float) -> float:
    return 0.1 * (1.0 - float(np.cos(np.pi * seconds / 0.5)))


@pytest.fixture
def rolling() -> Rolling:
    return Rolling()


def test_set_points_are_fixed_until_the_lead_and_no_further(rolling: Rolling) -> None:
    assert not rolling.path.played
    rolling.path.go_on()
    assert [due for due, _ in rolling.told] == pytest.approx([4.01, 4.02, 4.03, 4.04, 4.05])
    assert [q for _, q in rolling.told] == pytest.approx([where(0.01 * k) for k in range(1, 6)])
    assert rolling.path.sent == 5
    assert rolling.path.q_last[0] == rolling.told[-1][1]
    rolling.path.go_on()
    assert rolling.path.sent == 5
    rolling.clock.advance(0.011)
    rolling.path.go_on()
    assert 6 <= rolling.path.sent <= 7
    assert not rolling.path.braking_now


def test_a_path_is_played_when_its_last_set_point_is_passed(rolling: Rolling) -> None:
    rolling.run(0.46)
    assert rolling.motion.set_point_rests
    assert rolling.told[-1] == (pytest.approx(4.5), pytest.approx(0.2))
    assert not rolling.path.played
    rolling.clock.advance(4.495 - rolling.clock.now())
    assert not rolling.path.played
    rolling.clock.advance(0.0051)
    assert rolling.path.played
    sent = rolling.path.sent
    rolling.path.go_on()
    assert [due for due, _ in rolling.told[sent:]] == [rolling.clock.now()]  # it stands, dated anew


def test_set_points_that_ran_out_while_the_arm_moved_are_an_error(rolling: Rolling) -> None:
    rolling.run(0.2)
    rolling.clock.advance(4.24 + 0.12 - rolling.clock.now())
    with pytest.raises(OutOfSetPointsError, match=r"arm: ran out of set-points for 120 ms"):
        rolling.path.go_on()


def test_a_path_that_begins_late_begins_then(rolling: Rolling) -> None:
    rolling.clock.advance(0.3)
    rolling.path.go_on()
    assert rolling.told[0] == (pytest.approx(4.3), 0.0)
    assert rolling.told[1] == (pytest.approx(4.31), pytest.approx(where(0.01)))
    assert rolling.told[-1][0] == pytest.approx(4.35)


def test_a_window_begins_now_and_ends_at_rest(rolling: Rolling) -> None:
    rolling.run(0.2)
    rolling.path.go_on()
    points = rolling.path.window()
    # The first two of the promised ones are kept for the velocity of the one that is passed now.
    assert 4.19 - 1e-9 <= points[0].due <= 4.21 + 1e-9
    assert np.diff([point.due for point in points]) == pytest.approx(POINT_PERIOD)
    assert points[-1].qd.tolist() == [0.0]
    assert points[-1].q[0] > rolling.path.q_last[0]
    assert points[-1].q[0] < 0.2
    for before, here, after in zip(points, points[1:], points[2:], strict=False):
        # to the second order in the period: cubics through both do not swing
        assert here.qd[0] == pytest.approx(
            (after.q[0] - before.q[0]) / 0.02, abs=LIMITS.jerk[0] * POINT_PERIOD**2
        )
    assert rolling.path.sent == len(rolling.told)  # a look at it promises nothing


@pytest.mark.parametrize("passed", [0.0, 0.004])
def test_a_brake_begins_at_the_present_set_point_and_not_after_the_lead(
    rolling: Rolling, passed: float
) -> None:
    rolling.run(0.2)
    rolling.path.go_on()
    rolling.clock.advance(passed)
    now = rolling.clock.now()
    slow = rolling.path.window()[-1].q[0]
    told = len(rolling.told)
    rolling.path.brake()
    assert rolling.path.braking_now
    due, q = rolling.told[told]
    assert now < due <= now + 2.0 * POINT_PERIOD
    assert q == pytest.approx(where(due - 4.0), abs=2e-3)
    while not rolling.path.played:
        rolling.clock.advance(POINT_PERIOD)
        rolling.path.go_on()
    assert where(now - 4.0) < rolling.path.q_last[0] < slow
    assert rolling.motion.phase.value == "braking"


def test_a_brake_after_the_set_points_ran_out_adds_none(rolling: Rolling) -> None:
    rolling.run(0.2)
    rolling.clock.advance(0.2)
    sent = rolling.path.sent
    rolling.path.brake()
    assert rolling.path.sent == sent
    assert rolling.path.braking_now
