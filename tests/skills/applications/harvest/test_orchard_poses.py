"""The poses of the cells before the fruit wall: nine looks in a row, and places over the bin for held apples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pomona.applications.harvest.numbers import read_numbers
from pomona.applications.harvest.wall import draw_wall
from pomona.executive.cell.cell_file import read_cell_file
from pomona.skills.geometry import apply, inverse
from pomona.skills.motion.collision import CollisionWorld, Margins, RobotShape
from pomona.skills.motion.collision.cover import fibonacci_sphere
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.robot import RobotModel

TREES = Path(__file__).resolve().parents[4] / "trees"
CELLS = ("orchard", "orchard_ur5e")


def opened(name):
    """Cell file, robot, and joint space with 10 mm of clearance and open fingers."""
    file = read_cell_file(TREES / "cells" / f"{name}.yaml")
    robot = RobotModel.load(file.section.world.values.robot)
    world = CollisionWorld.build(
        robot, file.workspace, margins=Margins().scaled(0.010 / Margins().arm)
    )
    return file, robot, ArmSpace(world, robot.width_max)


def rows(file, pose, count):
    """Joints of a pose and its variations, shape (count, dof) [rad]."""
    return np.array(
        [file.workspace.poses[pose if i == 1 else f"{pose}_{i}"] for i in range(1, count + 1)]
    )


@pytest.mark.parametrize("name", CELLS)
def test_the_nine_looks_are_free_and_reached_one_after_the_other(name):
    file, _, space = opened(name)
    looks = rows(file, "observe", 9)
    assert space.free(file.workspace.poses["home"])
    for here, there in zip(looks, np.roll(looks, -1, axis=0), strict=True):
        assert space.free(there), space.explain(there)[0]
        assert (
            space.free_between(here, there)
            or space.connect(here, there[None], 2000, 0)[0] is not None
        )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "least"), [("orchard", 0.90), ("orchard_ur5e", 0.97)])
def test_the_nine_looks_have_most_apples_in_their_pictures(name, least):
    file, robot, _ = opened(name)
    said, camera = file.section.world.values, file.section.devices["camera"].values
    numbers, _ = read_numbers(said.numbers)
    walls = [
        draw_wall(numbers, seed, said.distance, leaves=0.0).seen_from(0.0, said.height)
        for seed in range(1, 13)
    ]
    p_base = np.array([fruit.T_base_fruit[:3, 3] for wall in walls for fruit in wall.fruits])
    seen = np.zeros(len(p_base), bool)
    for q in rows(file, "observe", 9):
        x, y, z = apply(inverse(robot.fk(q) @ robot.frame("camera")), p_base).T
        of = camera.intrinsics
        u, v = of.fx * x / z + of.cx, of.fy * y / z + of.cy
        seen |= (
            (z > 0.25)
            & (abs(u - of.width / 2) < of.width / 2 - 25)
            & (abs(v - of.height / 2) < of.height / 2 - 25)
        )
    assert seen.mean() > least


@pytest.mark.parametrize(("name", "radius"), [("orchard", 0.040), ("orchard_ur5e", 0.045)])
def test_an_apple_goes_straight_down_at_each_place_over_the_bin(name, radius):
    file, robot, _ = opened(name)
    shape = RobotShape.of(robot).holding(radius * fibonacci_sphere(40))
    world = CollisionWorld.build(
        shape, file.workspace, margins=Margins().scaled(0.005 / Margins().arm)
    )
    space, centres = ArmSpace(world, 2.0 * radius), []
    for number, q in enumerate(rows(file, "place", 18)):
        T = robot.tcp(q)
        centres.append(T[:2, 3].copy())
        T[2, 3] -= 0.115 if number < 12 else 0.09
        way = straight_line(robot, q, T)
        assert not way.reason, (number, way.reason)
        assert space.first_blocked(way.q) is None, (number, space.explain(way.q[-1])[0])
    apart = np.linalg.norm(np.array(centres)[:12, None] - np.array(centres)[None, :12], axis=2)
    assert apart[~np.eye(12, dtype=bool)].min() > 0.08
