"""The set-point of a detaching hand: how far it follows its commands, and when it counts as out of reach."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.applications.harvest import set_point
from pomona.applications.harvest.detaching import DetachCommand
from pomona.applications.harvest.set_point import CRAWL, HandAim
from pomona.skills.motion.robot import RobotModel
from pomona.tools.mock.arm import ROBOT

DT = 0.02
OUTWARDS = DetachCommand(np.array([0.0, 0.04, 0.0]), 0.0, 0.0, np.zeros(3))
Q = np.array([-1.36, -0.9, -0.26, -0.4, 0.06, -0.9, 0.05])


@pytest.mark.parametrize("speed", [1.0, 0.1])
@pytest.mark.parametrize(("times", "crawls"), [(0.5, False), (0.5 / CRAWL, False), (2.0 / CRAWL, True)])
def test_a_hand_that_the_joints_leave_next_to_no_speed_reaches_no_further(
    times: float, crawls: bool, speed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Near a singular posture each step moved less than the one before, and the hand was on its way for ever."""
    robot, most = RobotModel.load(ROBOT), np.full(7, 0.1)
    aim = HandAim(robot, Q)

    def solve(_robot: RobotModel, T: np.ndarray, q: np.ndarray) -> np.ndarray:
        share = float(np.linalg.norm(T[:3, 3] - aim.T[:3, 3])) / (DT * 0.04)
        return q + share * times * DT * most

    monkeypatch.setattr(set_point, "nearest_solution", solve)
    shares = [aim.follow(OUTWARDS, DT, most, speed) for _ in range(10)]
    assert aim.beyond == pytest.approx(10 * DT if crawls else 0.0)
    assert crawls or shares == pytest.approx([min(speed / times, 1.0)] * 10)


@pytest.mark.parametrize(("distance", "goes"), [(0.05, True), (0.01, False), (-0.01, False)])
def test_the_hand_goes_no_nearer_to_a_fixed_obstacle_than_its_margin(distance: float, goes: bool) -> None:
    """An elbow came to the pedestal while the hand moved back, and the next motion was refused."""
    robot = RobotModel.load(ROBOT)
    wall = robot.tcp(Q)[1, 3] + distance
    aim = HandAim(robot, Q, lambda q: wall - float(robot.tcp(q)[1, 3]))
    for _ in range(40):
        aim.follow(OUTWARDS, DT, np.full(7, 3.0))
    assert aim.T[1, 3] <= max(wall, robot.tcp(Q)[1, 3]) + 1e-9
    assert (aim.beyond == 0.0) is goes
    back = HandAim(robot, Q, lambda q: wall - float(robot.tcp(q)[1, 3]))
    back.follow(DetachCommand(-OUTWARDS.velocity, 0.0, 0.0, np.zeros(3)), DT, np.full(7, 3.0))
    assert back.beyond == 0.0
