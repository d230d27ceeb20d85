"""The compiled kernel beside a readable specification, which judges everything and leaves nothing out early."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from benchmarks.collision_oracle import random_scene
from pomona.skills.motion.collision import CollisionWorld, DistanceField, Margins
from pomona.skills.motion.collision.distance_field import lookup
from pomona.skills.motion.collision.kernel import evaluate_clearances, make_scratch, place
from pomona.skills.motion.robot import RobotModel

ROOT = Path(__file__).resolve().parents[4]
ROBOT = RobotModel.load(ROOT / "trees" / "robots" / "sia5f_wsg32.xml")
WORLDS = []
for seed in range(3):
    scene = random_scene(seed)
    field = DistanceField.of_blocked(scene.cells, scene.origin, 0.02, 0.3)
    WORLDS.append(
        CollisionWorld.build(
            ROBOT, scene.workspace, field, margins=Margins(0.005, 0.004, 0.002, 0.0, 0.001)
        )
    )


def specified_clearances(world: CollisionWorld, q: np.ndarray, width: float) -> np.ndarray:
    """Clearance of each geom from the world, then of each pair of geoms [m]."""
    robot, w = world.shape.arrays, world.arrays
    T = ROBOT.link_poses(q)
    opening = width - robot.closed

    def placed(points: np.ndarray, g: int) -> np.ndarray:
        pose = T[robot.links[g]]
        return (points + opening * robot.slides[g]) @ pose[:3, :3].T + pose[:3, 3]

    def spheres(g: int) -> tuple[np.ndarray, np.ndarray]:
        part = robot.spheres[robot.sphere_start[g] : robot.sphere_start[g + 1]]
        return placed(part[:, :3], g), part[:, 3]

    clearances = []
    for g in range(len(robot.links)):
        centres, radii = spheres(g)
        support = robot.support[robot.support_start[g] : robot.support_start[g + 1]]
        distances = []
        if not w.ignored[0, g]:
            away = [
                lookup(w.field, w.origin, w.resolution, *c) - r
                for c, r in zip(centres, radii, strict=True)
            ]
            distances += list(np.array(away) - w.margins[0, g])
        for k, bound in enumerate(w.bounds):
            if not w.ignored[1 + k, g]:
                planes = w.planes[w.plane_start[k] : w.plane_start[k + 1]]
                outside = np.max(centres @ planes[:, :3].T - planes[:, 3], axis=1)
                from_bound = np.linalg.norm(centres - bound[:3], axis=1) - bound[3]
                distances += list(np.maximum(outside, from_bound) - radii - w.margins[1 + k, g])
        for h, plane in enumerate(w.half_spaces):
            number = 1 + len(w.bounds) + h
            if not w.ignored[number, g]:
                away = placed(support[:, :3], g) @ plane[:3] - plane[3] - support[:, 3]
                distances += list(away - w.margins[number, g])
        clearances.append(min(distances, default=1e9))
    for i, j in robot.pairs:
        (a, r_a), (b, r_b) = spheres(i), spheres(j)
        apart = np.linalg.norm(a[:, None] - b[None], axis=2) - r_a[:, None] - r_b[None]
        clearances.append(apart.min() - w.self_margin)
    return np.array(clearances)


def evaluated(
    world: CollisionWorld, q: np.ndarray, width: float, wanted: float, slack: float
) -> tuple[int, np.ndarray]:
    robot = world.shape.arrays
    numbers = len(robot.links) + len(robot.pairs)
    scratch, found, which = (
        make_scratch(robot),
        np.full(numbers, np.nan),
        np.zeros(numbers, np.int64),
    )
    place(robot, q, width, scratch)
    active = np.ones(numbers, np.bool_)
    worst = evaluate_clearances(
        robot, world.arrays, width, active, np.full(numbers, wanted), slack, scratch, found, which
    )
    return worst, found


@settings(max_examples=25)
@given(st.integers(0, 100_000))
def test_all_clearances_are_those_of_the_specification(seed: int) -> None:
    rng, world = np.random.default_rng(seed), WORLDS[seed % len(WORLDS)]
    q, width = (
        rng.uniform(ROBOT.lower, ROBOT.upper),
        float(rng.uniform(ROBOT.width_min, ROBOT.width_max)),
    )
    expected = specified_clearances(world, q, width)
    worst, found = evaluated(world, q, width, 1e6, slack=np.inf)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert expected[worst] == pytest.approx(expected.min(), abs=1e-6)


@settings(max_examples=25)
@given(st.integers(0, 100_000), st.sampled_from([0.0, 0.02, 0.1]))
def test_the_smallest_clearance_is_exact_below_the_wanted_one(seed: int, wanted: float) -> None:
    rng, world = np.random.default_rng(seed), WORLDS[seed % len(WORLDS)]
    q, width = (
        rng.uniform(ROBOT.lower, ROBOT.upper),
        float(rng.uniform(ROBOT.width_min, ROBOT.width_max)),
    )
    smallest = specified_clearances(world, q, width).min()
    worst, found = evaluated(world, q, width, wanted, slack=0.0)
    if wanted > 0.0 and smallest < wanted:
        assert found[worst] == pytest.approx(smallest, abs=1e-6)
    elif wanted == 0.0:
        assert (found[worst] < 0.0) == (smallest < 0.0) or abs(smallest) < 1e-6
    else:
        assert found[worst] >= wanted - 1e-6
