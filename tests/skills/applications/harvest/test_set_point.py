"""The set-point of a detaching hand: how far it follows its commands, and when it counts as out of reach."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.applications.harvest import set_point
from pomona.applications.harvest.detaching import DetachCommand
from pomona.applications.harvest.set_point import CRAWL, TRIES, HandAim, inner_robot
from pomona.drivers.motion_supervisor import Supervision
from pomona.skills.motion.robot import RobotModel
from pomona.tools.mock.arm import ROBOT, MockArm
from pomona.tools.mock.hand import MockClock

DT = 0.02
OUTWARDS = DetachCommand(np.array([0.0, 0.04, 0.0]), 0.0, 0.0, np.zeros(3))
Q = np.array([-1.36, -0.9, -0.26, -0.4, 0.06, -0.9, 0.05])


@pytest.mark.parametrize("speed", [1.0, 0.1])
@pytest.mark.parametrize(
    ("times", "crawls"), [(0.5, False), (0.5 / CRAWL, False), (2.0 / CRAWL, True)]
)
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
def test_the_hand_goes_no_nearer_to_a_fixed_obstacle_than_its_margin(
    distance: float, goes: bool
) -> None:
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


@pytest.mark.parametrize(("off", "comes"), [(0.02, True), (0.005, False)])
def test_a_set_point_comes_to_an_arm_that_wood_holds(off: float, comes: bool) -> None:
    """An arm that pressed on a branch 1.2 degrees beside its set-point counted as faulty, which ended the run."""
    aim, held = (
        HandAim(RobotModel.load(ROBOT), Q),
        Q + np.array([0.0, 0.0, 0.0, off, 0.0, 0.0, 0.0]),
    )
    for _ in range(19):
        aim.come_to(held, DT)
        assert np.abs(aim.q - Q).max() == 0.0
    for _ in range(4):
        aim.come_to(held, DT)
    assert np.array_equal(aim.q, held) is comes


def test_a_set_point_comes_to_a_stuck_arm_a_few_times_only() -> None:
    """A stuck arm was found after 46 s, since its set-point came to it again and again."""
    aim, reports = HandAim(RobotModel.load(ROBOT), Q), []
    for _ in range(TRIES + 3):
        aim.q = Q + 0.03
        reports += [aim.come_to(Q, DT) for _ in range(25)]
    assert sum(reports) == 4  # at the last try, and as often as the arm is held afterwards
    assert aim.held == TRIES
    assert np.abs(aim.q - Q).max() == pytest.approx(0.03)


def test_an_arm_that_has_moved_since_it_was_held_is_not_stuck() -> None:
    aim = HandAim(RobotModel.load(ROBOT), Q)
    for place in range(5):
        aim.q = Q + 0.1 * place + 0.03
        for _ in range(25):
            assert not aim.come_to(Q + 0.1 * place, DT)
        assert np.abs(aim.q - Q - 0.1 * place).max() == pytest.approx(0.0)


def test_an_arm_that_follows_late_is_not_held() -> None:
    """Set-points of 40 mm/s pass through the arm 0.3 s later."""
    robot = RobotModel.load(ROBOT)
    aim, passed = HandAim(robot, Q), [Q] * 15
    for _ in range(60):
        aim.follow(OUTWARDS, DT, np.full(7, 3.0))
        passed.append(aim.q)
        assert not aim.come_to(passed[-16], DT)
    assert aim.held == 0
    assert aim.T[1, 3] - robot.tcp(Q)[1, 3] > 0.045


def test_a_set_point_that_creeps_away_from_a_stuck_arm_comes_to_it() -> None:
    aim = HandAim(RobotModel.load(ROBOT), Q)
    for _ in range(150):
        aim.follow(OUTWARDS, DT, np.full(7, 3.0))
        if aim.come_to(Q, DT):
            break
    assert aim.held == TRIES


@pytest.mark.parametrize("rate", [0.6, 0.9, 1.2, 1.57])
@pytest.mark.parametrize("late", [4, 8])
def test_a_set_point_that_rolls_away_from_a_held_arm_comes_back_before_the_supervisor_ends_the_run(
    rate: float, late: int
) -> None:
    """A hand that a branch or a wire held in its roll was 5° behind its set-points of 0.2 s (walls 365 and 367)."""
    supervised, aim, passed = Supervision(), HandAim(RobotModel.load(ROBOT), Q), [Q] * 15
    roll = DetachCommand(np.zeros(3), rate, 0.0, np.zeros(3))
    for _ in range(40):
        aim.follow(roll, DT, np.full(7, 3.0))
        passed.append(aim.q)
        assert not aim.come_to(passed[-1 - late], DT)
    held = passed[-1 - late]
    while aim.held == 0:
        aim.follow(roll, DT, np.full(7, 3.0))
        passed.append(aim.q)
        lagging = passed[-1 - round(supervised.lag / DT) :]
        assert min(np.abs(each - held).max() for each in lagging) < supervised.following_error
        aim.come_to(held, DT)
    assert np.array_equal(aim.q, held)


def test_a_hand_whose_arm_stands_beside_a_joints_limit_moves_away_from_it() -> None:
    """A hand closed on a fruit 0.013 rad before a limit and had no solution for any step (wall 364)."""
    q = np.array([-3.128, -1.571, 1.57, 0.045, -0.006, -0.059, -1.129])
    aim = HandAim(inner_robot(MockArm(MockClock(), q)), q)
    aim.follow(OUTWARDS, DT, np.full(7, 3.0))
    assert aim.beyond == 0.0
    assert aim.q[0] > q[0]
