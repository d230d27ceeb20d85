"""How a motion along a path ends: arrived, stopped, or held up."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.drivers.interfaces import ArmLimits, MotionState, Trajectory
from pomona.drivers.path_motion import HELD_UP, PathMotion

PERIOD = 0.01


@pytest.fixture
def motion() -> PathMotion:
    """Half a second along one joint."""
    times = np.linspace(0.0, 0.5, 51)
    q = 0.1 * (1.0 - np.cos(np.pi * times / 0.5))[:, None]
    qd = 0.1 * np.pi / 0.5 * np.sin(np.pi * times / 0.5)[:, None]
    qdd = 0.1 * (np.pi / 0.5) ** 2 * np.cos(np.pi * times / 0.5)[:, None]
    limits = ArmLimits(
        np.array([-3.0]), np.array([3.0]), *(np.array([v]) for v in (2.0, 20.0, 500.0))
    )
    return PathMotion(Trajectory(times, q, qd, qdd), limits, PERIOD)


def run_out(motion: PathMotion) -> None:
    while not motion.set_point_rests:
        motion.step()


def test_joints_that_rest_at_the_end_are_done(motion: PathMotion) -> None:
    run_out(motion)
    motion.look(resting=False, beside=1e-3, now=0.0)
    assert motion.state is MotionState.RUNNING
    motion.look(resting=True, beside=1e-3, now=0.01)
    assert motion.state is MotionState.DONE
    assert motion.settled


def test_an_arm_that_is_stopped_against_something_is_stopped_although_it_rests_beside_its_set_point(
    motion: PathMotion,
) -> None:
    motion.step()
    motion.stop()
    run_out(motion)
    motion.look(resting=False, beside=0.05, now=0.0)
    assert not motion.settled
    motion.look(resting=True, beside=0.05, now=0.1)
    assert motion.state is MotionState.STOPPED
    assert motion.settled


def test_the_rest_of_a_pause_does_not_count_as_being_held_up(motion: PathMotion) -> None:
    motion.step()
    motion.pause()
    run_out(motion)
    motion.look(resting=True, beside=1e-3, now=0.0)
    motion.resume()
    motion.step()
    run_out(motion)
    motion.look(resting=True, beside=5e-3, now=10.0 * HELD_UP)  # almost there
    assert motion.state is MotionState.RUNNING
    motion.look(resting=True, beside=1e-3, now=10.1 * HELD_UP)
    assert motion.state is MotionState.DONE


def test_an_arm_that_is_held_up_before_its_end_reports_a_failure(motion: PathMotion) -> None:
    run_out(motion)
    for k in range(3):
        motion.look(resting=True, beside=0.05, now=0.45 * HELD_UP * k)
    assert motion.state is MotionState.RUNNING
    motion.look(
        resting=False, beside=0.04, now=1.3 * HELD_UP
    )  # it gave way a little: the time starts afresh
    motion.look(resting=True, beside=0.04, now=1.4 * HELD_UP)
    assert motion.state is MotionState.RUNNING
    motion.look(resting=True, beside=0.04, now=2.5 * HELD_UP)
    motion.look(resting=True, beside=0.04, now=2.51 * HELD_UP)
    assert motion.state is MotionState.FAILED
    assert motion.settled
    assert "2.3° off the end" in motion.problem
