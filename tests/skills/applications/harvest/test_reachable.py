import numpy as np
import pytest

from pomona.applications.harvest.reachable import (
    ROLLED,
    SPARE,
    GraspSearch,
    grasp_pose,
    rolled_poses,
)
from pomona.executive.cell.connect import load_cell
from pomona.tools.simulation import FINGERS

from .test_world import BARE, CELL


@pytest.fixture(scope="module")
def world():
    cell = load_cell(CELL, seed=3, overrides=BARE)
    yield cell.devices["world"]
    cell.close()


def rolled(T, way):
    """Angle about the approach by which the last pose is turned [rad], and its shift [m]."""
    last = list(rolled_poses(T, way))[-1]
    R = T[:3, :3].T @ last[:3, :3]
    assert R[2, 2] == pytest.approx(1.0)
    return np.arctan2(R[1, 0], R[0, 0]), last[:3, 3] - T[:3, 3]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_motion_rolls_about_the_approach_and_draws_the_fruit_to_the_robot(way):
    angle, shift = rolled(grasp_pose(np.array([0.1, -0.6, 0.4]), 0.3, 0.2, 0.1), way)
    assert angle == pytest.approx(way * np.radians(ROLLED))
    assert np.linalg.norm(shift) == pytest.approx(0.06, rel=0.01)
    assert shift[1] > 0.0 < shift[2]


def test_solutions_reach_the_pose_with_the_elbow_in_many_places(world):
    search = GraspSearch(world.built, world.description)
    T = grasp_pose(np.array([0.05, -0.6, 0.4]), 0.0, 0.0, 0.0)
    found = list(search.solutions(T))
    assert len(found) > 8
    for q in found:
        search._arm_data.qpos[search._q] = q
        search._mujoco.mj_kinematics(search._arm, search._arm_data)
        assert search._arm_data.site("tcp").xpos == pytest.approx(T[:3, 3], abs=2e-3)
    assert np.ptp([q[2] for q in found]) > 0.5


def test_the_hand_alone_touches_the_same_cells_as_the_whole_robot(world):
    """Where the whole robot is free, the hand is; a finger in the trunk is not."""
    search = GraspSearch(world.built, world.description)
    grasp = next(search.grasps(0))
    assert search._hand_free(grasp[0])
    x, y, _ = world.built.wall.trunk
    opening = 2.0 * world.built.wall.fruits[0].radius + SPARE
    assert not search._hand_free(grasp_pose(np.array([x + opening / 2.0, y, 0.45]), 0.0, 0.0, 0.0))


def test_a_grasp_without_the_roll_is_not_reachable(world):
    search = GraspSearch(world.built, world.description)
    assert search.reaches(0)
    _, q = next(search.grasps(0))
    search._range = np.stack([q - 0.2, q + 0.2], axis=1)
    search._starts = [q]
    assert any(True for _ in search.grasps(0))
    assert not search.reaches(0)


def test_a_fruit_beyond_the_arm_has_no_grasp(world):
    search = GraspSearch(world.built, world.description)
    assert (
        next(search.solutions(grasp_pose(np.array([0.0, -1.9, 0.4]), 0.0, 0.0, 0.0)), None) is None
    )


def test_a_hand_that_has_closed_reaches_the_same_fruit(world):
    """A resting gripper narrows its joints' range: after a run 0 of 15 fruit counted as reachable (wall 365)."""
    ranges = world.model.jnt_range.copy()
    for finger in FINGERS:
        ranges[world.model.joint(finger).id] = (0.0, 1e-3)
    before = next(GraspSearch(world.built, world.description).grasps(0))[0]
    kept = world.model.jnt_range.copy()
    world.model.jnt_range[:] = ranges
    after = next(GraspSearch(world.built, world.description).grasps(0))[0]
    world.model.jnt_range[:] = kept
    assert np.array_equal(before, after)
