"""What is compiled before a run's clock starts is tried with a robot, once for each."""

import numpy as np
import pytest

from pomona.skills.shared.warm_motion import _Empty, warm_checks
from tests.skills.picking_scene import ROBOT_MODEL, PickingScene


@pytest.mark.slow
def test_checks_are_tried_in_the_middle_of_the_joints_once_for_each_robot() -> None:
    description = PickingScene().arm.description
    robot, q, space, limits = warm_checks(description)
    assert warm_checks(description) is warm_checks(description)
    np.testing.assert_allclose(q, (ROBOT_MODEL.lower + ROBOT_MODEL.upper) / 2.0)
    assert (space.width, robot.dof) == (ROBOT_MODEL.width_max, ROBOT_MODEL.dof)
    assert space.world.table_z is None
    np.testing.assert_array_equal(limits.velocity, np.ones(robot.dof))
    np.testing.assert_array_equal(limits.acceleration, 10.0 * limits.velocity)
    np.testing.assert_array_equal(limits.jerk, 100.0 * limits.velocity)
    np.testing.assert_array_equal(limits.lower, robot.lower)
    np.testing.assert_array_equal(limits.upper, robot.upper)


def test_the_space_of_the_planner_that_is_tried_has_no_obstacles() -> None:
    space = _Empty(ROBOT_MODEL)
    a, b = ROBOT_MODEL.lower, ROBOT_MODEL.upper
    assert space.free(a)
    assert space.free_between(a, b)
    assert space.first_blocked(np.array([a, b])) is None
    way, used = space.connect(a, b[None], 10, 0)
    assert used == 1
    np.testing.assert_array_equal(way, [a, b])
