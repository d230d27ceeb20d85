"""Spheres cover the shapes that they stand for: surfaces and interiors of every kind and size."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial import ConvexHull

from pomona.skills.motion.collision.cover import cover, cover_points, fibonacci_sphere
from pomona.skills.motion.robot import Geom, RobotModel

SIA5F = Path(__file__).resolve().parents[4] / "trees" / "robots" / "sia5f_wsg32.xml"

SIZES = {
    "sphere": [(0.05, 0.0, 0.0)],
    "capsule": [(0.05, 0.10, 0.0), (0.06, 0.0, 0.0), (0.02, 0.30, 0.0)],
    "box": [(0.010, 0.005, 0.0475), (0.02, 0.07, 0.0325), (0.1, 0.1, 0.1), (0.3, 0.02, 0.2)],
    "cylinder": [
        (0.034, 0.0205, 0.0),
        (0.032, 0.010, 0.0),
        (0.04, 0.22, 0.0),
        (0.1, 0.004, 0.0),
        (0.075, 0.085, 0.0),
    ],
    "ellipsoid": [(0.05, 0.04, 0.045), (0.02, 0.03, 0.1)],
}
KIND_AND_SIZE = [(kind, size) for kind, sizes in SIZES.items() for size in sizes]


def geom(kind: str, size: tuple[float, float, float], vertices: np.ndarray | None = None) -> Geom:
    return Geom(
        "part",
        0,
        kind,
        np.array(size),
        np.eye(4),
        np.empty((0, 3)) if vertices is None else vertices,
    )


def points_of(
    kind: str, size: tuple[float, float, float], rng: np.random.Generator, count: int = 4000
) -> np.ndarray:
    """Points of the shape's surface and inside, its edges and corners among them."""
    a, b, c = size
    ball = rng.normal(size=(count, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    if kind == "sphere":
        surface = ball * a
    elif kind == "ellipsoid":
        surface = ball * size
    elif kind == "capsule":
        surface = ball * a + np.outer(rng.choice([-b, b, 0.2 * b], count), (0.0, 0.0, 1.0))
    elif kind == "cylinder":
        angle, z = rng.uniform(0.0, 2.0 * np.pi, count), rng.choice([-b, b, 0.3 * b], count)
        radius = a * np.where(np.abs(z) < b, 1.0, rng.choice([1.0, 0.6], count))
        surface = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), z))
    else:
        surface = rng.uniform(-1.0, 1.0, (count, 3))
        # A face, an edge or a corner: one, two or three of the coordinates, any of them, are at their ends.
        rank = rng.random((count, 3)).argsort(axis=1)
        at_end = rank < rng.integers(1, 4, (count, 1))
        surface[at_end] = rng.choice([-1.0, 1.0], at_end.sum())
        surface *= (a, b, c)
    return np.vstack((surface, surface * rng.uniform(0.0, 1.0, (count, 1))))


def uncovered(spheres: np.ndarray, points: np.ndarray) -> float:
    """By how much the worst point lies outside all spheres [m]; negative when all are covered."""
    away = np.linalg.norm(points[:, None] - spheres[None, :, :3], axis=2) - spheres[None, :, 3]
    return float(away.min(axis=1).max())


@pytest.mark.parametrize(("kind", "size"), KIND_AND_SIZE)
def test_spheres_cover_every_kind_of_shape(kind: str, size: tuple[float, float, float]) -> None:
    points = points_of(kind, size, np.random.default_rng(0))
    assert uncovered(cover(geom(kind, size)).spheres, points) <= 1e-12


@pytest.mark.parametrize(("kind", "size"), KIND_AND_SIZE)
def test_support_points_reach_at_least_as_far_as_the_shape(
    kind: str, size: tuple[float, float, float]
) -> None:
    shape = cover(geom(kind, size))
    points = points_of(kind, size, np.random.default_rng(1))
    directions = fibonacci_sphere(300)
    reached = (shape.support @ directions.T).max(axis=0) + shape.rounding
    assert np.all(reached >= (points @ directions.T).max(axis=0) - 1e-12)


@pytest.mark.parametrize(("kind", "size"), KIND_AND_SIZE)
def test_inner_spheres_lie_inside(kind: str, size: tuple[float, float, float]) -> None:
    shape = cover(geom(kind, size))
    directions = fibonacci_sphere(200)
    extent = (points_of(kind, size, np.random.default_rng(2), 20_000) @ directions.T).max(axis=0)
    inner = shape.inner > 0.0
    assert inner.any()
    standing_out = shape.spheres[inner, :3] @ directions.T + shape.inner[inner, None] - extent
    assert standing_out.max() < 2e-3  # the sampled extent is a little short


@pytest.mark.slow
@settings(max_examples=10)
@given(st.integers(0, 10_000))
def test_spheres_cover_random_hulls(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(20, 3)) * rng.uniform(0.01, 0.08, 3) + rng.uniform(-0.1, 0.1, 3)
    weights = rng.dirichlet(np.full(20, 0.15), 4000)
    spheres = cover_points(vertices).spheres
    assert uncovered(spheres, weights @ vertices) <= 1e-12
    assert uncovered(spheres, vertices) <= 1e-12


def test_spheres_of_the_sia5f_stand_out_little() -> None:
    for part in RobotModel.load(SIA5F).geoms:
        shape = cover(part)
        directions = fibonacci_sphere(500)
        extent = (shape.support @ directions.T).max(axis=0) + shape.rounding
        reached = (shape.spheres[:, :3] @ directions.T + shape.spheres[:, 3:]).max(axis=0)
        allowed = 0.0125 if part.kind == "cylinder" else 0.0085
        if part.name.startswith(("finger", "pad")):
            allowed = 0.0021
        assert (reached - extent).max() <= allowed, part.name


def test_a_mesh_is_covered_as_its_hull() -> None:
    vertices = fibonacci_sphere(60) * (0.05, 0.03, 0.02)
    assert ConvexHull(vertices).volume > 0.0
    assert uncovered(cover(geom("mesh", (0, 0, 0), vertices)).spheres, vertices) <= 1e-12
