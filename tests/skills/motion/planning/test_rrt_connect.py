"""This project's RRT-Connect among real shapes: its paths are free and end at a goal; failures are reported."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pomona.drivers.interfaces import Box
from pomona.skills.geometry import transform
from pomona.skills.motion.collision import CollisionWorld, Convex, Margins
from pomona.skills.motion.collision.segment import SLACK
from pomona.skills.motion.planning import rrt_connect
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.planning.plan import solve
from pomona.skills.motion.planning.space import Effort
from pomona.skills.motion.robot import RobotModel
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL, WORKSPACE

MARGINS = Margins(0.005, 0.005, 0.002, 0.0, 0.002)
WIDTH = 0.07


def cluttered(seed: int) -> tuple[ArmSpace, np.ndarray, np.ndarray]:
    """A table with boxes that hang over it, the observe pose, and free goals to which no straight motion leads."""
    rng = np.random.default_rng(seed)
    while True:
        boxes = tuple(
            Convex.of_box(
                Box(
                    f"box {k}",
                    transform(None, rng.uniform([-0.5, -0.6, 0.0], [0.5, 0.2, 0.5])),
                    size,
                )
            )
            for k, size in enumerate(rng.uniform(0.03, 0.09, (5, 3)).tolist())
        )
        space = ArmSpace(
            CollisionWorld.build(ROBOT_MODEL, WORKSPACE, obstacles=boxes, margins=MARGINS), WIDTH
        )
        q = rng.uniform(ROBOT_MODEL.lower, ROBOT_MODEL.upper, (40, ROBOT_MODEL.dof))
        goals = q[space.world.free(q, WIDTH)]
        behind = np.array([g for g in goals if not space.free_between(OBSERVE, g)]).reshape(
            -1, ROBOT_MODEL.dof
        )
        if space.free(OBSERVE) and len(behind) >= 3:
            return space, OBSERVE, behind[:3]


@pytest.mark.parametrize("seed", range(6))
def test_a_path_begins_at_the_start_ends_at_a_goal_and_keeps_the_margins_at_every_fine_sample(
    seed: int,
) -> None:
    space, start, goals = cluttered(seed)
    found = solve(space, start, goals, "RRTConnect", Effort(20_000, seed, np.inf))
    assert found.waypoints is not None
    path = found.waypoints
    np.testing.assert_array_equal(path[0], start)
    assert np.abs(goals - path[-1]).max(axis=1).min() == 0.0
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert steps.max() <= rrt_connect.MAX_STEP + 1e-9
    for a, b in pairwise(path):
        between = a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a)
        assert space.clearances(between).min() >= -SLACK


def test_the_same_seed_gives_the_same_path_and_another_one_another() -> None:
    space, start, goals = cluttered(1)
    one, two, other = (space.connect(start, goals, 20_000, seed)[0] for seed in (5, 5, 6))
    assert one is not None
    assert two is not None
    assert other is not None
    np.testing.assert_array_equal(one, two)
    assert one.shape != other.shape or not np.array_equal(one, other)


CARRIAGE = """<robot name="carriage">
  <link name="base"/><link name="rail"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool0"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="x" type="prismatic"><parent link="base"/><child link="rail"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="y" type="prismatic"><parent link="rail"/><child link="tool0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>"""
"""A ball on two rails, for which it is plain whether there is a way."""


@pytest.mark.parametrize(
    ("gap", "passes"), [(0.04, False), (0.09, False), (0.13, True), (0.3, True)]
)
def test_a_ball_of_10_cm_passes_a_gap_that_is_wider_and_no_other(
    tmp_path: Path, gap: float, passes: bool
) -> None:
    file = tmp_path / "carriage.urdf"
    file.write_text(CARRIAGE)
    robot = RobotModel.load(file)
    half = (2.0 - gap) / 2.0
    walls = tuple(
        Convex.of_box(
            Box(
                f"wall {side}",
                transform(None, [0.0, side * (gap / 2.0 + half), 0.0]),
                (0.01, half, 0.1),
            )
        )
        for side in (-1, 1)
    )
    world = CollisionWorld.build(robot, obstacles=walls, margins=Margins(0.0, 0.0, 0.0, 0.0, 0.0))
    space = ArmSpace(world, robot.width_max)
    found = solve(
        space, np.array([-0.8, 0.6]), np.array([[0.8, 0.6]]), "RRTConnect", Effort(1200, 0, np.inf)
    )
    assert (found.waypoints is not None) == passes
    assert not found.out_of_time
    if found.waypoints is None:
        assert found.iterations == 1200
    else:
        a, b = next((a, b) for a, b in pairwise(found.waypoints) if a[0] <= 0.0 <= b[0])
        assert abs(a[1] + (b[1] - a[1]) * -a[0] / (b[0] - a[0])) <= gap / 2.0 - 0.05 + SLACK


def test_the_wall_clock_is_the_last_resort() -> None:
    space, start, goals = cluttered(0)
    found = solve(space, start, goals, "RRTConnect", Effort(20_000, 0, -np.inf))
    assert found.out_of_time
    assert found.iterations == 0


def test_where_two_trees_meet_their_common_posture_stands_once() -> None:
    trees = rrt_connect.room(np.zeros(2), np.array([[9.0, 9.0], [2.0, 2.0]]), 4)
    trees.q[0, 1], trees.parent[0, 1] = [1.0, 1.0], 0
    trees.q[1, 2], trees.parent[1, 2] = [1.0, 1.0], 1
    np.testing.assert_array_equal(
        rrt_connect.path_between(trees, 1, 2), [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]
    )
