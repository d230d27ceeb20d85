"""The one judgement of trajectories: drivers, planner and collision check agree because they ask the same."""

from dataclasses import replace

import numpy as np
import pytest

from pomona.drivers.errors import BadTrajectory, MotionRefused
from pomona.drivers.interfaces import ArmLimits, Trajectory, Workspace
from pomona.drivers.trajectory import REST, SHARE, check_trajectory
from pomona.skills.motion.collision import CollisionWorld
from pomona.skills.motion.planning.timing import time_polyline
from pomona.skills.motion.robot import RobotModel
from pomona.tools.mock import MockArm, MockClock
from pomona.tools.mock.arm import ROBOT, SIA5F_LIMITS

LIMITS = ArmLimits(
    np.full(2, -2.0), np.full(2, 2.0), np.full(2, 3.0), np.full(2, 10.0), np.full(2, 200.0)
)
GOOD = time_polyline(np.array([[-1.0, 0.0], [0.0, 1.0], [1.0, 0.0]]), LIMITS)


def changed(name: str, sample: int, value: float) -> Trajectory:
    array = getattr(GOOD, name).copy()
    array[sample] = value
    return replace(GOOD, **{name: array})


def test_a_timed_polyline_passes():
    check_trajectory(GOOD, LIMITS)


@pytest.mark.parametrize(
    ("trajectory", "says"),
    [
        (changed("q", 3, np.nan), "position of sample 3 is not a finite number"),
        (changed("qdd", 3, np.inf), "acceleration of sample 3 is not"),
        (changed("q", 3, 2.5), "joint 1 would be at 143.2°"),
        (changed("qd", 3, 3.5), "velocity of joint 1 would be 3.50 rad/s"),
        (changed("qdd", 3, -10.5), "acceleration of joint 1 would be 10.50"),
        (changed("qdd", 3, 9.0), "jerk of joint"),
        (changed("qd", 0, 0.1), "does not start and end at rest: joint 1 starts with 0.1000 rad/s"),
        (changed("qd", -1, 2.0 * REST), "joint 1 ends with 0.0020 rad/s"),
        (changed("q", 20, 1.0), "velocities do not belong to its positions: joint"),
        (changed("t", 0, 0.001), "time does not increase from 0"),
        (changed("t", 5, 0.0), "time does not increase"),
        (replace(GOOD, qd=GOOD.qd[:-1]), "do not hold two or more samples"),
        (replace(GOOD, q=GOOD.q[:, :1]), "of 2 joints"),
    ],
)
def test_forbidden_code_is_refused_with_a_sentence(trajectory, says):
    with pytest.raises(BadTrajectory, match=says):
        check_trajectory(trajectory, LIMITS)


def test_a_rate_may_exceed_its_limit_by_rounding_and_by_no_more():
    fastest = np.abs(GOOD.qd).max()
    for share, refused in ((0.9 * SHARE, False), (1.1 * SHARE, True)):
        limits = replace(LIMITS, velocity=np.full(2, fastest / (1.0 + share)))
        if refused:
            with pytest.raises(BadTrajectory, match="velocity"):
                check_trajectory(GOOD, limits)
        else:
            check_trajectory(GOOD, limits)


def test_a_start_away_from_the_arm_is_refused_and_so_is_an_arm_that_does_not_know_where_it_stands():
    check_trajectory(GOOD, LIMITS, GOOD.q[0] + 1.9e-3)
    with pytest.raises(BadTrajectory, match=r"0\.12° away from the arm at joint 1"):
        check_trajectory(GOOD, LIMITS, GOOD.q[0] + (2.1e-3, 0.0))
    with pytest.raises(BadTrajectory, match="is unknown"):
        check_trajectory(GOOD, LIMITS, np.array([np.nan, 0.0]))


@pytest.mark.parametrize(("end_speed", "good"), [(0.0, True), (5e-4, True), (2e-3, False)])
def test_driver_and_collision_check_agree_about_an_end_speed(end_speed, good):
    path = time_polyline(np.array([np.zeros(7), np.full(7, 0.1)]), SIA5F_LIMITS)
    qd = path.qd.copy()
    qd[-1, 0] = end_speed
    path = replace(path, qd=qd)
    world = CollisionWorld.build(
        RobotModel.load(ROBOT), Workspace(None, np.full(3, -1.0), np.full(3, 1.0))
    )
    judgements = (
        (lambda: check_trajectory(path, SIA5F_LIMITS), BadTrajectory),
        (lambda: world.check_trajectory(path, 0.05), BadTrajectory),
        (lambda: MockArm(MockClock()).follow(path), MotionRefused),
    )
    for judge, refusal in judgements:
        if good:
            judge()
        else:
            with pytest.raises(refusal, match=r"joint 1 ends with 0\.0020 rad/s"):
                judge()
