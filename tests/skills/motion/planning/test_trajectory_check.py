from dataclasses import replace

import numpy as np
import pytest

from drivers.interfaces import Trajectory
from skills.motion.planning.errors import BadTrajectory
from skills.motion.planning.timing import time_polyline
from skills.motion.planning.trajectory_check import check_trajectory
from tests.skills.motion.planning.disc_world import LIMITS

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
        (changed("qd", 0, 0.1), "start and end at rest"),
        (changed("t", 0, 0.001), "time does not increase from 0"),
        (changed("t", 5, 0.0), "time does not increase"),
        (replace(GOOD, qd=GOOD.qd[:-1]), "do not hold two or more samples"),
        (replace(GOOD, q=GOOD.q[:, :1]), "of 2 joints"),
    ],
)
def test_what_must_not_be_executed_is_refused_with_a_sentence(trajectory, says):
    with pytest.raises(BadTrajectory, match=says):
        check_trajectory(trajectory, LIMITS)
