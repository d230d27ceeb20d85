"""A body that its file describes by many spheres is one part of the robot's shape, and judged as its spheres are."""

import numpy as np
import pytest

from pomona.drivers.interfaces import Box, Workspace
from pomona.skills.geometry import transform
from pomona.skills.motion.collision import CollisionWorld, Margins, RobotShape
from pomona.skills.motion.collision.robot_shape import FEW_SPHERES
from pomona.skills.motion.robot import RobotModel

SPHERES = [(0.1 * k, 0.01 * k, 0.02 * k, 0.03 + 0.004 * k) for k in range(FEW_SPHERES + 2)]


def link(name: str, number: int) -> str:
    shapes = "".join(
        f'<collision><origin xyz="{x} {y} {z}"/><geometry><sphere radius="{r}"/></geometry></collision>'
        for x, y, z, r in SPHERES[:number]
    )
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    return f'<link name="{name}">{inertial}{shapes}</link>'


def joint(name: str, parent: str, child: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
        '<origin xyz="0.3 0 0.1"/><limit lower="-3" upper="3" velocity="2" effort="9"/></joint>'
    )


@pytest.fixture
def robot(tmp_path) -> RobotModel:
    links = link("base", 1) + link("many", len(SPHERES)) + link("tool0", FEW_SPHERES)
    joints = joint("one", "base", "many") + joint("two", "many", "tool0")
    file = tmp_path / "spheres.urdf"
    file.write_text(f'<robot name="spheres">{links}{joints}</robot>')
    return RobotModel.load(file)


def test_it_is_one_part_and_few_spheres_stay_apart(robot):
    shape = RobotShape.of(robot)
    assert sorted(shape.geom_bodies) == ["base", "many", *["tool0"] * FEW_SPHERES]
    assert len(shape.arrays.spheres) == 1 + len(SPHERES) + FEW_SPHERES


def test_clearances_are_those_of_the_single_spheres(robot):
    box = Box("box", transform(None, [0.8, 0.3, 0.35]), (0.1, 0.1, 0.1))
    workspace = Workspace(0.05, np.full(3, -2.0), np.full(3, 2.0), (box,))
    world = CollisionWorld.build(robot, workspace, margins=Margins(0.0, 0.0, 0.0, 0.0, 0.0))
    rng = np.random.default_rng(0)
    for q in rng.uniform(robot.lower, robot.upper, (200, 2)):
        moving = RobotShape.of(robot).spheres(q, 0.0)
        moving = moving[
            np.abs(moving[:, :3] - [0.0, 0.0, 0.0]).max(axis=1) > 1e-9
        ]  # the base stands still
        to_box = np.linalg.norm(
            np.maximum(np.abs(moving[:, :3] - box.T_base_box[:3, 3]) - 0.1, 0.0), axis=1
        )
        to_table = moving[:, 2] - 0.05
        nearest = float(min((to_box - moving[:, 3]).min(), (to_table - moving[:, 3]).min()))
        free = bool(world.free(q[None], 0.0)[0])
        if nearest < 0.0:
            assert not free
        elif nearest > 0.02:  # beside edges the distance to a box is a lower bound
            assert free
