"""Inverse kinematics undoes forward kinematics, in closed form and by descent, for two very different arms."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.skills.motion.robot import BadJoints, RobotModel, inverse_kinematics, nearest_solution
from pomona.skills.motion.robot.inverse_kinematics import descend, spread_starts
from pomona.skills.motion.robot.spherical_arm import as_spherical_arm

SIA5F = Path(__file__).resolve().parents[4] / "trees" / "robots" / "sia5f_wsg32.xml"
SIX_AXIS = Path(__file__).parent / "six_axis.urdf"

shares = st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7)


def posture(robot: RobotModel, share: list[float]) -> np.ndarray:
    return robot.lower + np.array(share[: robot.dof]) * (robot.upper - robot.lower)


def worst_error(robot: RobotModel, solutions: np.ndarray, T: np.ndarray) -> float:
    return max((float(np.abs(robot.tcp(q) - T).max()) for q in solutions), default=0.0)


def test_only_the_sia5f_has_the_closed_form() -> None:
    assert as_spherical_arm(RobotModel.load(SIA5F)) is not None
    assert as_spherical_arm(RobotModel.load(SIX_AXIS)) is None


@pytest.mark.slow
def test_an_arm_with_a_shifted_wrist_is_not_mistaken_for_the_family(tmp_path: Path) -> None:
    file = shutil.copytree(SIA5F.parent, tmp_path / "robots") / SIA5F.name
    file.write_text(
        SIA5F.read_text().replace(
            '<body name="link_t" pos="0.134 0 0"', '<body name="link_t" pos="0.134 0.01 0"'
        )
    )
    robot = RobotModel.load(file)
    assert as_spherical_arm(robot) is None
    q = np.array([0.3, 0.5, -0.4, 0.6, 0.2, -0.7, 0.1])
    solutions = inverse_kinematics(robot, robot.tcp(q), near=q)
    assert len(solutions) > 1
    assert worst_error(robot, solutions, robot.tcp(q)) < 1e-9


@settings(max_examples=60)
@given(shares)
def test_closed_form_solutions_reach_the_pose_within_the_limits(share: list[float]) -> None:
    robot = RobotModel.load(SIA5F)
    T = robot.tcp(posture(robot, share))
    solutions = inverse_kinematics(robot, T, arm_angles=12)
    assert worst_error(robot, solutions, T) < 1e-9
    assert np.all(solutions >= robot.lower)
    assert np.all(solutions <= robot.upper)


@settings(max_examples=60)
@given(shares)
def test_near_a_posture_the_closed_form_finds_that_posture(share: list[float]) -> None:
    robot = RobotModel.load(SIA5F)
    q = posture(robot, [0.05 + 0.9 * s for s in share])
    found = inverse_kinematics(robot, robot.tcp(q), arm_angles=4, near=q)
    wrist_sees_two_axes = abs(np.sin(q[5])) > 1e-3 and abs(np.sin(q[1])) > 1e-3
    if (
        wrist_sees_two_axes
    ):  # otherwise two joints turn about one line, and only their sum is determined
        assert np.abs(found[0] - q).max() < 1e-5
    assert worst_error(robot, found, robot.tcp(q)) < 1e-9


def test_every_reachable_pose_is_solved_in_closed_form() -> None:
    robot = RobotModel.load(SIA5F)
    rng = np.random.default_rng(3)
    for _ in range(300):
        T = robot.tcp(rng.uniform(robot.lower, robot.upper))
        assert len(inverse_kinematics(robot, T, arm_angles=72)) > 0


@settings(max_examples=25)
@given(shares)
def test_descent_solutions_of_another_arm_reach_the_pose_within_the_limits(
    share: list[float],
) -> None:
    robot = RobotModel.load(SIX_AXIS)
    T = robot.tcp(posture(robot, share))
    solutions = inverse_kinematics(robot, T)
    assert worst_error(robot, solutions, T) < 1e-9
    assert np.all(solutions >= robot.lower)
    assert np.all(solutions <= robot.upper)


def test_descent_solves_nearly_all_reachable_poses_of_another_arm() -> None:
    robot = RobotModel.load(SIX_AXIS)
    rng = np.random.default_rng(4)
    found = [
        len(inverse_kinematics(robot, robot.tcp(rng.uniform(robot.lower, robot.upper))))
        for _ in range(100)
    ]
    assert np.count_nonzero(found) >= 99
    assert np.median(found) >= 4  # several of the eight postures, and whole turns of joints


def test_closed_form_and_descent_agree_on_the_same_arm() -> None:
    robot = RobotModel.load(SIA5F)
    arm = as_spherical_arm(robot)
    assert arm is not None
    q = np.array([0.4, 0.7, -0.5, 0.9, -0.6, 0.8, 0.3])
    T = robot.tcp(q)
    for found in descend(robot, T, spread_starts(robot, 40)):  # some of them lie on a limit
        family = arm.solve(
            T, np.array([arm.arm_angle(found, T)]), robot.lower - 1e-6, robot.upper + 1e-6
        )
        turned = (
            np.remainder(family - found + np.pi, 2.0 * np.pi) - np.pi
        )  # -180° and 180° are one posture
        assert np.abs(turned).max(axis=1).min() < 1e-6


def test_a_pose_out_of_reach_has_no_solution() -> None:
    for path in (SIA5F, SIX_AXIS):
        robot = RobotModel.load(path)
        T = robot.tcp(np.full(robot.dof, 0.3))
        T[:3, 3] = [0.0, 2.0, 0.5]
        assert inverse_kinematics(robot, T).shape == (0, robot.dof)
        assert nearest_solution(robot, T, np.zeros(robot.dof)) is None


@pytest.mark.parametrize("path", [SIA5F, SIX_AXIS], ids=["sia5f", "six_axis"])
def test_following_a_line_is_continuous(path: Path) -> None:
    robot = RobotModel.load(path)
    q = np.array([0.3, -0.6, 0.5, 0.9, 0.4, -0.9, 0.2])[: robot.dof]
    T = robot.tcp(q)
    for _ in range(40):
        T = T.copy()
        T[:3, 3] -= 0.002 * T[:3, 2]  # back along the approach
        following = nearest_solution(robot, T, q)
        assert following is not None
        assert np.abs(robot.tcp(following) - T).max() < 1e-9
        assert np.abs(following - q).max() < 0.05
        q = following


def test_solutions_are_sorted_by_distance_and_take_whole_turns_towards_the_reference() -> None:
    robot = RobotModel.load(SIX_AXIS)
    q = np.array([4.0, -1.0, 1.2, -4.5, 1.1, 5.0])
    solutions = inverse_kinematics(robot, robot.tcp(q), near=q)
    distances = np.linalg.norm(solutions - q, axis=1)
    assert distances[0] < 1e-6
    assert np.all(np.diff(distances) >= 0.0)


@pytest.mark.parametrize(
    "towards", [*np.eye(3), *-np.eye(3)], ids=["x", "y", "z", "-x", "-y", "-z"]
)
def test_at_the_limit_of_a_joint_the_other_joints_of_a_redundant_arm_go_on(
    towards: np.ndarray,
) -> None:
    robot = RobotModel.load(SIA5F)
    q = np.array([0.93, robot.lower[1], -0.22, 0.27, 1.99, -0.30, 0.27])
    T = robot.tcp(q)
    T[:3, 3] += 1e-3 * towards
    found = nearest_solution(robot, T, q)
    assert found is not None
    assert np.abs(found - q).max() < 0.05


def test_a_bad_reference_posture_is_refused() -> None:
    robot = RobotModel.load(SIA5F)
    with pytest.raises(BadJoints):
        inverse_kinematics(robot, np.eye(4), near=np.zeros(6))
