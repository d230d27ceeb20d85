"""Bending a path's time keeps every joint within its limits, whenever and however often it is stopped."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.drivers.interfaces import ArmLimits, Trajectory
from pomona.drivers.path_motion import PathFollower

LIMITS = ArmLimits(
    lower=np.full(3, -10.0),
    upper=np.full(3, 10.0),
    velocity=np.array([3.0, 2.0, 4.0]),
    acceleration=np.array([8.0, 10.0, 6.0]),
    jerk=np.array([80.0, 100.0, 60.0]),
)
PERIOD = 0.002


def sweep(angles, samples=60):
    """A rest-to-rest quintic at the limits."""
    angles = np.asarray(angles)
    x = np.linspace(0.0, 1.0, samples)[:, None]
    duration = max(
        (1.875 * np.abs(angles) / LIMITS.velocity).max(),
        np.sqrt(5.7736 * np.abs(angles) / LIMITS.acceleration).max(),
    )
    return Trajectory(
        x[:, 0] * duration,
        angles * x**3 * (10.0 - 15.0 * x + 6.0 * x**2),
        angles * 30.0 * x**2 * (1.0 - x) ** 2 / duration,
        angles * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / duration**2,
    )


def run(follower, commands, limit=20000):
    """Step it to its end or its rest; at a step's number it gets another speed, or goes on or brakes from then on."""
    points, goes_on = [follower.step()[0]], True
    for step in range(limit):
        command = commands.get(step)
        if isinstance(command, bool):
            goes_on = command
        elif command is not None:
            follower.speed = command
        points.append(follower.step(goes_on)[0])
        if follower.finished or (follower.at_rest and step > max(commands, default=0)):
            break
    return np.array(points)


def test_left_alone_it_is_the_trajectory_itself():
    path = sweep([1.0, -0.5, 0.3])
    follower = PathFollower(path, LIMITS, PERIOD)
    points = run(follower, {})
    t = np.arange(1, len(points) + 1) * PERIOD
    for j in range(3):
        assert np.abs(points[:, j] - np.interp(t, path.t, path.q[:, j])).max() < 1e-3
    assert follower.progress == 1.0
    assert points[-1] == pytest.approx(path.q[-1])


@settings(max_examples=60)
@given(
    st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).filter(lambda a: max(map(abs, a)) > 0.2),
    st.floats(0.0, 1.0),
    st.booleans(),
)
def test_stopping_anywhere_stays_within_acceleration_limits(angles, when, resumes):
    path = sweep(angles)
    follower = PathFollower(path, LIMITS, PERIOD)
    stop = int(when * path.duration / PERIOD)
    commands = {stop: False}
    if resumes:
        commands[stop + 60] = True
    points = run(follower, commands)
    assert len(points) < 15000
    if resumes:
        assert follower.finished
    else:
        assert follower.at_rest
        assert (len(points) - stop) * PERIOD < 1.5
    # On the path: all joints share one path parameter.
    lead = int(np.abs(path.q[-1]).argmax())
    expected = points[:, [lead]] / path.q[-1, lead] * path.q[-1]
    assert np.abs(points - expected).max() < 1e-6
    acceleration = np.abs(np.diff(points, n=2, axis=0)).max(axis=0) / PERIOD**2
    assert np.all(acceleration < 1.1 * LIMITS.acceleration)


def test_stop_and_go_many_times_ends_at_the_end():
    path = sweep([1.5, -1.0, 0.7])
    follower = PathFollower(path, LIMITS, PERIOD)
    commands = {}
    for k in range(10):
        commands[50 + 150 * k] = False
        commands[120 + 150 * k] = True
    points = run(follower, commands)
    assert points[-1] == pytest.approx(path.q[-1])
    acceleration = np.abs(np.diff(points, n=2, axis=0)).max(axis=0) / PERIOD**2
    assert np.all(acceleration < 1.1 * LIMITS.acceleration)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).filter(lambda a: max(map(abs, a)) > 0.2),
    st.lists(st.tuples(st.integers(0, 700), st.floats(0.1, 1.0)), min_size=1, max_size=5),
    st.floats(0.1, 1.0),
)
def test_another_speed_at_any_time_stays_within_the_limits_and_reaches_the_end(
    angles, changes, first
):
    path = sweep(angles)
    follower = PathFollower(path, LIMITS, PERIOD, first)
    commands = dict(changes)
    points = run(follower, commands)
    assert follower.finished
    assert points[-1] == pytest.approx(path.q[-1])
    lead = int(np.abs(path.q[-1]).argmax())
    expected = points[:, [lead]] / path.q[-1, lead] * path.q[-1]
    assert np.abs(points - expected).max() < 1e-6
    qd = np.diff(points, axis=0) / PERIOD
    qdd = np.diff(qd, axis=0) / PERIOD
    assert np.all(np.abs(qd).max(axis=0) < 1.01 * LIMITS.velocity)
    assert np.all(np.abs(qdd).max(axis=0) < 1.1 * LIMITS.acceleration)


def test_a_share_of_the_speed_takes_so_much_longer():
    path = sweep([1.0, -0.5, 0.3])
    whole, half = (len(run(PathFollower(path, LIMITS, PERIOD, speed), {})) for speed in (1.0, 0.5))
    assert half == pytest.approx(2 * whole, abs=3)


def test_the_speed_changes_without_jerks():
    """In the middle of a long sweep, where the path's own jerk is small: back and forth, also within a change."""
    path = sweep([9.0, 3.0, -5.0], samples=2000)
    follower = PathFollower(path, LIMITS, PERIOD)
    middle = int(0.4 * path.duration / PERIOD)
    steps = {0: 0.3, 40: 0.9, 75: 0.2, 400: 1.0, 430: 0.5}
    points = run(
        follower,
        {middle + at: speed for at, speed in steps.items()},
    )
    jerk = np.abs(np.diff(points, n=3, axis=0))[middle - 50 : middle + 800] / PERIOD**3
    assert np.all(jerk.max(axis=0) < 1.1 * LIMITS.jerk), jerk.max(axis=0) / LIMITS.jerk


def test_a_stopped_path_keeps_the_new_speed_for_when_it_goes_on():
    path = sweep([1.0, 0.0, 0.0])
    follower = PathFollower(path, LIMITS, PERIOD)
    follower.step(goes_on=False)
    follower.speed = 0.4
    while not follower.at_rest:
        follower.step(goes_on=False)
    follower.step(goes_on=False)
    assert follower.at_rest
    for _ in range(200):
        follower.step()
    assert follower.rate == pytest.approx(0.4)
    assert follower.time_left == pytest.approx((path.duration - follower.path_time) / 0.4)


@settings(max_examples=60)
@given(
    st.lists(st.floats(-0.1, 0.1), min_size=3, max_size=3),
    st.sampled_from([1e-3, 0.05, 1.0]),
    st.sampled_from([1.0, 0.1]),
)
def test_a_path_begins_at_the_last_set_point_and_comes_to_its_end_without_a_jump(away, way, speed):
    path = sweep(np.multiply([1.0, -0.5, 0.3], way))
    follower = PathFollower(path, LIMITS, PERIOD, speed, path.q[0] + away)
    points = np.vstack([path.q[0] + away, run(follower, {})])
    reached = (
        np.abs(np.diff(points, axis=0)).max(axis=0) / PERIOD,
        np.abs(np.diff(points, 2, axis=0)).max(axis=0) / PERIOD**2,
    )
    assert (reached[0] < 1.11 * LIMITS.velocity).all()
    assert (reached[1] < 1.11 * LIMITS.acceleration).all()
    assert points[-1] == pytest.approx(path.q[-1])


def test_a_distance_to_the_last_set_point_is_taken_up_in_the_first_third_of_a_second():
    path = sweep([1.0, -0.5, 0.3])
    plain, offset = (
        PathFollower(path, LIMITS, PERIOD),
        PathFollower(path, LIMITS, PERIOD, q_from=path.q[0] + 1e-3),
    )
    apart = np.abs(run(plain, {}) - run(offset, {})).max(axis=1)
    assert apart[0] == pytest.approx(1e-3, rel=1e-3)
    assert (np.diff(apart) < 1e-9).all()
    assert apart[round(0.31 / PERIOD) :].max() < 1e-9
