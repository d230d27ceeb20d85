"""Set-points from moment to moment: the way to them stays within the limits, and without them all comes to rest."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.drivers.errors import BadTrajectory
from pomona.drivers.interfaces import ArmLimits, MotionState, SetPoints
from pomona.drivers.streamed_motion import StreamedMotion

LIMITS = ArmLimits(
    np.array([-2.0, -1.0, -3.0]), np.array([2.0, 1.0, 3.0]), np.array([3.0, 2.0, 1.0]), np.array([8.0, 10.0, 20.0]),
    np.array([80.0, 100.0, 250.0]),
)  # fmt: skip
PERIOD = 0.002


def streamed(q: tuple[float, ...] = (0.0, 0.5, -1.0), watchdog: float = 0.3) -> StreamedMotion:
    return StreamedMotion(np.array(q), LIMITS, PERIOD, watchdog)


def steps(motion: StreamedMotion, count: int, aim: object = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the arm's set-points at each step, positions and velocities."""
    told = []
    for _ in range(count):
        if aim is not None:
            motion.aim(aim)
        told.append(motion.step())
    return np.array([q for q, _ in told]), np.array([qd for _, qd in told])


def within_limits(q: np.ndarray) -> None:
    rates = [np.diff(q, k, axis=0) / PERIOD**k for k in (1, 2, 3)]
    for rate, limit in zip(rates, (LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk), strict=True):
        assert (np.abs(rate).max(axis=0) <= limit * 1.001 + 1e-6).all()
    assert ((q >= LIMITS.lower) & (q <= LIMITS.upper)).all()


def test_it_goes_to_its_set_point_and_rests_there() -> None:
    motion, goal = streamed(), np.array([1.0, -0.9, 0.0])
    assert isinstance(motion, SetPoints)
    q, _ = steps(motion, 1200, goal)
    within_limits(q)
    assert np.array_equal(q[-1], goal)
    assert motion.set_point_rests
    assert motion.state is MotionState.RUNNING
    beyond = (q - goal) * np.sign(goal - q[0])
    assert beyond.max() <= 1e-6  # not past it


def test_a_stream_that_is_not_stepped_has_not_arrived_at_a_target_elsewhere() -> None:
    motion = streamed()
    assert motion.set_point_arrived
    motion.aim(np.array([1.0, -0.9, 0.0]))
    assert motion.set_point_rests
    assert not motion.set_point_arrived
    steps(motion, 1200, np.array([1.0, -0.9, 0.0]))
    assert motion.set_point_arrived


def test_whatever_comes_the_limits_are_kept() -> None:
    motion, rng = streamed(), np.random.default_rng(4)
    told = [
        steps(motion, int(rng.integers(1, 60)), rng.uniform(LIMITS.lower, LIMITS.upper))[0]
        for _ in range(60)
    ]
    within_limits(np.concatenate(told))


def test_without_set_points_it_comes_to_rest_within_its_limits_and_has_failed() -> None:
    motion = streamed()
    moving, qd = steps(motion, 150, np.array([2.0, -1.0, 3.0]))
    assert np.abs(qd[-1]).max() > 0.5
    rest, qd = steps(motion, 1000)
    within_limits(np.concatenate([moving, rest]))
    assert not qd[-1].any()
    motion.look(True, 0.0, 0.0)
    assert (motion.state, motion.settled) == (MotionState.FAILED, True)
    assert motion.problem == "no new set-point came for 300 ms"


@pytest.mark.parametrize(
    ("aim", "words"),
    [
        ([np.nan, 0.0, 0.0], "finite numbers"),
        ([np.inf, 0.0, 0.0], "finite numbers"),
        ([0.0, 0.0], "3 finite numbers"),
        ([0.0, 1.2, 0.0], r"joint 2 would be at 68\.8°, its limits are -57\.3° and 57\.3°"),
    ],
)
def test_a_set_point_that_no_arm_may_go_to_is_not_taken_and_renews_nothing(
    aim: list[float], words: str
) -> None:
    motion, goal = streamed(watchdog=0.1), np.array([0.5, 0.0, 0.0])
    motion.aim(goal)
    for _ in range(60):
        with pytest.raises(BadTrajectory, match=words):
            motion.aim(np.array(aim))
        motion.step()
    assert "no new set-point" in motion.problem


def test_stopped_and_paused_it_rests_and_goes_on_only_with_new_set_points() -> None:
    motion, goal = streamed(), np.array([2.0, -1.0, 3.0])
    first, _ = steps(motion, 150, goal)
    motion.pause()
    paused, _ = steps(motion, 800)
    assert motion.at_rest
    assert motion.problem == ""
    motion.resume()
    assert np.array_equal(steps(motion, 10)[0][-1], paused[-1])
    again, _ = steps(motion, 150, goal)
    motion.stop()
    rest, _ = steps(motion, 800)
    within_limits(np.concatenate([first, paused, np.tile(paused[-1], (10, 1)), again, rest]))
    motion.look(True, 0.0, 0.0)
    assert (motion.state, motion.settled) == (MotionState.STOPPED, True)


def test_abandoned_it_stands_at_once() -> None:
    motion = streamed()
    steps(motion, 150, np.array([2.0, -1.0, 3.0]))
    motion.abandon("the arm does not follow")
    assert motion.state is MotionState.FAILED
    assert motion.set_point_rests


def test_a_share_of_the_speed_is_kept_also_while_it_moves() -> None:
    motion = StreamedMotion(np.zeros(3), LIMITS, PERIOD, 10.0, 0.5)
    motion.aim(np.array([1.9, -0.9, 1.0]))
    rates = [np.abs(motion.step()[1]) for _ in range(round(0.4 / PERIOD))]
    assert np.max(rates, axis=0) == pytest.approx(0.5 * LIMITS.velocity, rel=0.02)
    motion.set_speed(0.1)
    rates = [np.abs(motion.step()[1]) for _ in range(round(1.0 / PERIOD))]
    assert np.all(rates[-1] < 0.101 * LIMITS.velocity)
    change = np.abs(np.diff(rates, axis=0)).max(axis=0) / PERIOD
    assert np.all(change < 1.01 * LIMITS.acceleration)


class Stream:
    """A motion on a clock, fed every 20 ms with a moving target, as early as it asks for."""

    def __init__(self) -> None:
        self.steps = 0
        self.motion = StreamedMotion(
            np.array([0.0, 0.5, -1.0]), LIMITS, PERIOD, 0.3, now=lambda: self.steps * PERIOD
        )

    def follow(self, target, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`target(t)` gives joints and velocities; return times, the arm's joints and the target's at those times."""
        rows = []
        for k in range(round(duration / PERIOD)):
            if k % 10 == 0:
                at = self.steps * PERIOD + self.motion.delay + 0.01
                passed, velocity = target(at)
                self.motion.aim(passed, velocity, at)
            q = self.motion.step()[0].copy()
            self.steps += 1
            rows.append((self.steps * PERIOD, q, target(self.steps * PERIOD)[0]))
        t, q, wanted = zip(*rows, strict=True)
        return np.array(t), np.array(q), np.array(wanted)


def test_a_target_that_moves_on_is_passed_in_time_and_not_from_behind() -> None:
    start, speed = np.array([0.1, 0.4, -0.9]), np.array([0.8, -0.5, 0.6])
    t, q, wanted = Stream().follow(lambda t: (start + speed * t, speed), 1.5)
    within_limits(q)
    assert np.abs(q - wanted)[t > 0.9].max() < 1e-6


def test_a_target_that_curves_is_followed_to_a_fraction_of_a_millimetre() -> None:
    def swing(t: float) -> tuple[np.ndarray, np.ndarray]:
        middle, way, w = np.array([0.0, 0.4, -1.0]), np.array([0.1, 0.1, 0.1]), 5.0
        return middle + way * np.sin(w * t), way * w * np.cos(w * t)

    t, q, wanted = Stream().follow(swing, 3.0)
    within_limits(q)
    # the mean over 0.2 s flattens a swing of 0.1 rad at 5 rad/s by 4 %
    assert np.abs(q - wanted)[t > 1.0].max() < 6e-3


def test_a_target_that_accelerates_too_much_is_followed_from_behind_and_never_by_an_overshoot() -> (
    None
):
    """A swing of 1.3 times the acceleration: set-points that aim ahead by a braking distance overshoot it by far."""
    w = np.sqrt(1.3 * LIMITS.acceleration[0] / 0.1)

    def swing(t: float) -> tuple[np.ndarray, np.ndarray]:
        out = np.array([0.1 * np.sin(w * t), 0.0, 0.0])
        return np.array([0.0, 0.5, -1.0]) + out, np.array([0.1 * w * np.cos(w * t), 0.0, 0.0])

    _, q, _ = Stream().follow(swing, 4.0)
    within_limits(q)
    assert np.abs(q[:, 0]).max() < 0.11


def test_a_target_that_leaves_the_joints_limits_is_left_in_time_to_brake() -> None:
    speed = np.array([0.0, 1.5, 0.0])
    stream, told = Stream(), []
    for k in range(400):
        if k % 10 == 0:
            at = stream.steps * PERIOD + stream.motion.delay
            q = np.array([0.0, 0.5, -1.0]) + speed * (at - 0.1)
            stream.motion.aim(np.minimum(q, LIMITS.upper), speed, at)
        told.append(stream.motion.step()[0].copy())
        stream.steps += 1
    within_limits(np.array(told))
    assert told[-1][1] == pytest.approx(LIMITS.upper[1], abs=1e-3)


def test_any_moving_targets_keep_the_limits() -> None:
    stream, rng, told = Stream(), np.random.default_rng(8), []
    for _ in range(80):
        q, qd = (
            rng.uniform(LIMITS.lower, LIMITS.upper),
            rng.uniform(-LIMITS.velocity, LIMITS.velocity),
        )
        stream.motion.aim(q, qd, stream.steps * PERIOD + rng.uniform(-0.2, 0.3))
        for _ in range(int(rng.integers(1, 60))):
            told.append(stream.motion.step()[0].copy())
            stream.steps += 1
    within_limits(np.array(told))


def test_a_velocity_that_no_joint_may_have_is_refused() -> None:
    with pytest.raises(BadTrajectory, match=r"joint 2 would move at 120°/s, its limit is 115°/s"):
        Stream().motion.aim(np.zeros(3), np.array([0.0, 2.1, 0.0]), 0.1)
    with pytest.raises(BadTrajectory, match="finite"):
        Stream().motion.aim(np.zeros(3), np.zeros(3), np.nan)
