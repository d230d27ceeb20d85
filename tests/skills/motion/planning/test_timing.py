import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.drivers.interfaces import ArmLimits, Trajectory
from pomona.skills.motion.planning.timing import time_curve, time_polyline

LIMITS = ArmLimits(
    lower=np.full(7, -3.0),
    upper=np.full(7, 3.0),
    velocity=np.radians([200, 200, 200, 200, 200, 230, 350.0]),
    acceleration=np.array([8, 8, 10, 10, 12, 14, 20.0]),
    jerk=np.array([80, 80, 100, 100, 150, 180, 250.0]),
)


def shares(trajectory: Trajectory, limits: ArmLimits) -> tuple[float, float, float]:
    """Largest velocity, acceleration and jerk as shares of the limits, by finite differences of the positions."""
    h = trajectory.t[1]
    v = np.diff(trajectory.q, axis=0) / h
    a = np.diff(v, axis=0) / h
    j = np.diff(a, axis=0) / h
    return tuple(
        float((np.abs(x) / limit).max())
        for x, limit in zip(
            (v, a, j), (limits.velocity, limits.acceleration, limits.jerk), strict=True
        )
    )


def distance_to_polyline(q: np.ndarray, waypoints: np.ndarray) -> float:
    best = np.inf
    for a, b in itertools.pairwise(waypoints):
        d = b - a
        s = np.clip((q - a) @ d / (d @ d), 0.0, 1.0)
        best = min(best, float(np.linalg.norm(q - a - s * d)))
    return best


@settings(max_examples=40)
@given(
    seed=st.integers(0, 10_000), n=st.integers(2, 7), scale=st.sampled_from([1e-3, 0.05, 0.4, 2.0])
)
def test_a_polyline_is_driven_within_all_limits_from_rest_to_rest(seed, n, scale):
    waypoints = np.random.default_rng(seed).uniform(-scale, scale, (n, 7))
    trajectory = time_polyline(waypoints, LIMITS, period=0.002)
    velocity, acceleration, jerk = shares(trajectory, LIMITS)
    assert velocity <= 1.0 + 1e-6
    assert acceleration <= 1.0 + 1e-4
    assert (
        jerk <= 1.0 + 1e-2
    )  # finite differences of positions of size 1 at 2 ms resolve jerk to about 1e-7 / 8e-9
    np.testing.assert_allclose(trajectory.q[[0, -1]], waypoints[[0, -1]])
    np.testing.assert_array_equal(trajectory.qd[[0, -1]], 0.0)


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_velocity_and_acceleration_are_the_derivatives_of_position(seed):
    waypoints = np.random.default_rng(seed).uniform(-1.5, 1.5, (4, 7))
    trajectory = time_polyline(waypoints, LIMITS, period=0.001)
    integral = trajectory.q[0] + np.concatenate(
        [
            np.zeros((1, 7)),
            np.cumsum(
                (trajectory.qd[1:] + trajectory.qd[:-1]) / 2.0 * np.diff(trajectory.t)[:, None],
                axis=0,
            ),
        ]
    )
    np.testing.assert_allclose(integral, trajectory.q, atol=2e-5)
    velocity = np.concatenate(
        [
            np.zeros((1, 7)),
            np.cumsum(
                (trajectory.qdd[1:] + trajectory.qdd[:-1]) / 2.0 * np.diff(trajectory.t)[:, None],
                axis=0,
            ),
        ]
    )
    np.testing.assert_allclose(velocity, trajectory.qd, atol=2e-4)


def test_a_straight_segment_stays_straight():
    waypoints = np.array(
        [[0.1, -0.2, 0.3, 0.0, 0.0, 0.0, 0.0], [1.0, 0.5, -0.7, 0.2, 0.0, 1.0, -2.0]]
    )
    trajectory = time_polyline(waypoints, LIMITS)
    assert max(distance_to_polyline(q, waypoints) for q in trajectory.q) < 1e-9


def test_dwelling_everywhere_follows_the_polyline_exactly():
    waypoints = np.random.default_rng(3).uniform(-1.0, 1.0, (5, 7))
    rounded = time_polyline(waypoints, LIMITS)
    exact = time_polyline(waypoints, LIMITS, dwells=np.ones(5))
    assert max(distance_to_polyline(q, waypoints) for q in exact.q) < 1e-9
    assert max(distance_to_polyline(q, waypoints) for q in rounded.q) > 1e-3
    assert exact.duration > rounded.duration


def test_a_single_joint_move_takes_at_most_a_sixth_longer_than_the_least_time():
    """The least time of a rest-to-rest move that reaches all three limits is d/v + v/a + a/j."""
    d, v, a, j = 3.0, LIMITS.velocity[0], LIMITS.acceleration[0], LIMITS.jerk[0]
    trajectory = time_polyline(np.array([[-1.5] + [0.0] * 6, [1.5] + [0.0] * 6]), LIMITS)
    least = d / v + v / a + a / j
    assert least - 1e-3 <= trajectory.duration <= least * 7.0 / 6.0


def test_repeated_waypoints_are_dropped_and_no_length_means_standing_still():
    q = np.full(7, 0.3)
    still = time_polyline(np.array([q, q, q]), LIMITS)
    np.testing.assert_array_equal(still.q, np.array([q, q]))
    np.testing.assert_array_equal(still.qd, 0.0)


def test_a_smooth_curve_is_followed_with_the_wanted_speed():
    s = np.linspace(0.0, 1.0, 40)[:, None]
    points = np.hstack([0.3 * np.sin(s), 0.2 * s, 0.1 * s**2, s * 0.0, s * 0.0, 0.2 * np.cos(s), s])
    trajectory = time_curve(
        points, 0.12, LIMITS, speed=0.1, acceleration=0.5, jerk=5.0, period=0.004
    )
    assert trajectory.duration == pytest.approx(0.12 / 0.1 + 0.1 / 0.5 + 0.5 / 5.0, rel=0.1)
    np.testing.assert_allclose(trajectory.q[[0, -1]], points[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(
        np.gradient(trajectory.q, trajectory.t, axis=0)[1:-1], trajectory.qd[1:-1], atol=2e-3
    )


SLOW = 0.02


def slow_between(first: float, last: float) -> np.ndarray:
    """The speed that is allowed along a curve of 120 mm: slow between two places [m]."""
    along = np.linspace(0.0, 0.12, 121)
    return np.where((along >= first) & (along <= last), SLOW, np.inf)


@pytest.mark.parametrize("slow", [(0.06, 0.07), (0.06, 0.12), (0.09, 0.1)])
@pytest.mark.parametrize("acceleration", [1.0, 2.0])
def test_a_curve_is_slow_where_it_must_be_and_keeps_to_its_acceleration(
    slow: tuple[float, float], acceleration: float
) -> None:
    points = np.hstack([0.2 * np.linspace(0.0, 1.0, 40)[:, None]] * 7)
    how = {
        "limits": LIMITS,
        "speed": 0.25,
        "acceleration": acceleration,
        "jerk": 10.0 * acceleration,
    }
    plain = time_curve(points, 0.12, **how)
    trajectory = time_curve(points, 0.12, **how, most=slow_between(*slow))
    along, rate, gain = (
        0.12 / 0.2 * of[:, 0] for of in (trajectory.q, trajectory.qd, trajectory.qdd)
    )
    lag = SLOW * 0.1 / 2.0  # the speed follows half a window later
    inside = (along >= slow[0] + lag) & (along <= slow[1] - lag)
    assert inside.sum() > 10
    assert rate[inside].max() <= SLOW * 1.1
    assert rate.max() > 0.15
    assert rate.min() >= -1e-9
    assert np.abs(gain).max() <= acceleration * 1.01
    assert (
        np.abs(np.diff(gain) / np.diff(trajectory.t)).max() <= 20.0 * acceleration * 1.02
    )  # brakes, then speeds up
    np.testing.assert_allclose(trajectory.q[[0, -1]], points[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(
        np.gradient(trajectory.q, trajectory.t, axis=0)[1:-1], trajectory.qd[1:-1], atol=2e-3
    )
    assert plain.duration < trajectory.duration < plain.duration + (slow[1] - slow[0]) / SLOW + 0.5


@pytest.mark.parametrize("braking", [0.5, 2.5])
def test_a_curve_brakes_with_its_own_deceleration(braking: float):
    points = np.hstack([0.2 * np.linspace(0.0, 1.0, 40)[:, None]] * 7)
    how = {"limits": LIMITS, "speed": 0.4, "acceleration": 0.8, "jerk": 8.0}
    trajectory = time_curve(points, 0.15, **how, deceleration=braking)
    rate, gain = (0.15 / 0.2 * of[:, 0] for of in (trajectory.qd, trajectory.qdd))
    assert gain.max() == pytest.approx(0.8, rel=0.02)
    assert -gain.min() == pytest.approx(braking, rel=0.05)
    assert rate.min() >= -1e-9
    assert np.abs(np.diff(gain) / np.diff(trajectory.t)).max() <= 10.0 * max(0.8, braking) * 1.02
    np.testing.assert_allclose(trajectory.q[[0, -1]], points[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(
        np.gradient(trajectory.q, trajectory.t, axis=0)[1:-1], trajectory.qd[1:-1], atol=5e-3
    )
    assert (trajectory.duration < time_curve(points, 0.15, **how).duration) == (braking > 0.8)


def test_a_curve_that_is_slow_from_its_beginning_has_one_speed():
    points = np.hstack([0.2 * np.linspace(0.0, 1.0, 40)[:, None]] * 7)
    trajectory = time_curve(points, 0.12, LIMITS, 0.25, 2.0, 20.0, most=np.full(3, 0.08))
    assert (0.6 * trajectory.qd[:, 0]).max() == pytest.approx(0.08, rel=0.02)


def test_a_curve_that_is_too_quick_for_a_joint_is_slowed_down():
    s = np.linspace(0.0, 1.0, 40)[:, None]
    points = np.hstack([1.5 * np.sin(s), s, s, s, s, s, -2.0 * s])
    trajectory = time_curve(
        points, 0.12, LIMITS, speed=1.0, acceleration=20.0, jerk=500.0, period=0.002
    )
    velocity, acceleration, jerk = shares(trajectory, LIMITS)
    assert velocity <= 1.0
    assert acceleration <= 1.0 + 1e-3
    assert jerk <= 1.0 + 1e-2
    assert max(velocity, acceleration, jerk) > 0.8
