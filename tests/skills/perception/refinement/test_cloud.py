"""The plane that a fruit stands on, known and seen."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.synthetic_depth import looking_at
from pomona.skills.geometry import apply, inverse, rotation_about
from pomona.skills.perception.refinement.cloud import (
    Plane,
    connected_to,
    horizontal_plane,
    seen_elsewhere,
    seen_near,
)

T_BASE_CAMERA = looking_at((0.0, 0.0, 0.0), 0.6, np.radians(55.0))


def table_points(count: int, noise: float = 1e-3, others: int = 0, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    flat = np.column_stack([rng.uniform(-0.1, 0.1, (count, 2)), rng.normal(0.0, noise, count)])
    above = np.column_stack([rng.uniform(-0.1, 0.1, (others, 2)), rng.uniform(0.01, 0.1, others)])
    return apply(inverse(T_BASE_CAMERA), np.concatenate([flat, above]))


def assert_is_the_table(plane: Plane | None) -> None:
    assert plane is not None
    true = horizontal_plane(T_BASE_CAMERA, 0.0)
    assert plane.normal @ true.normal > np.cos(np.radians(1.0))
    corners = apply(
        inverse(T_BASE_CAMERA), [[x, y, 0.0] for x in (-0.05, 0.05) for y in (-0.05, 0.05)]
    )
    assert np.abs(plane.height(corners)).max() < 1e-3


def test_horizontal_plane_has_its_height_in_the_base_frame():
    plane = horizontal_plane(T_BASE_CAMERA, 0.1)
    points = apply(inverse(T_BASE_CAMERA), [[0.3, -0.2, 0.1], [0.0, 0.0, 0.15], [0.1, 0.1, 0.0]])
    np.testing.assert_allclose(plane.height(points), [0.0, 0.05, -0.1], atol=1e-12)


@pytest.mark.parametrize("shift", [-0.01, 0.0, 0.01])
def test_a_known_plane_moves_to_where_it_is_seen(shift):
    assert_is_the_table(
        seen_near(horizontal_plane(T_BASE_CAMERA, shift), table_points(400, others=100))
    )


def test_a_plane_far_from_the_known_one_is_another_one():
    assert seen_near(horizontal_plane(T_BASE_CAMERA, 0.05), table_points(400)) is None
    tilted = horizontal_plane(T_BASE_CAMERA, 0.0)
    turned = Plane(rotation_about((1.0, 0.0, 0.0), np.radians(8.0)) @ tilted.normal, tilted.offset)
    assert seen_near(turned, table_points(400)) is None
    assert seen_near(horizontal_plane(T_BASE_CAMERA, 0.0), table_points(30)) is None


@pytest.mark.parametrize(
    ("height", "tilt", "told"),
    [
        (0.0, 0.0, False),
        (0.008, 2.0, False),
        (0.02, 0.0, True),
        (-0.03, 3.0, True),
        (0.0, 9.0, True),
        (0.2, 0.0, False),
    ],
)
def test_a_plane_away_from_its_stated_place_is_reported(
    height: float, tilt: float, told: bool
) -> None:
    known = Plane(np.array([0.0, -0.6, -0.8]), 0.5)
    turned = rotation_about(np.array([1.0, 0.0, 0.0]), np.radians(tilt)) @ known.normal
    rng = np.random.default_rng(0)
    middle = -(known.offset - height) * known.normal  # a point of the plane that is seen
    across = np.cross(turned, [1.0, 0.0, 0.0])
    u, v = rng.uniform(-0.1, 0.1, (2, 800))
    points = middle + np.outer(u, [1.0, 0.0, 0.0]) + np.outer(v, across)
    points = np.vstack(
        [points + 1e-3 * rng.normal(size=points.shape), middle + rng.uniform(-0.1, 0.1, (100, 3))]
    )
    found = seen_elsewhere(known, points)
    assert (found is not None) is told
    if found is not None:
        assert found[0] == pytest.approx(height, abs=4e-3)
        assert np.degrees(found[1]) == pytest.approx(tilt, abs=1.0)


SHAPE = (60, 60)


def scene():
    """A fruit-like bump in the middle, a leaf 30 mm nearer over its left third, the ground behind."""
    v, u = np.indices(SHAPE)
    apart = np.hypot(u - 30, v - 30)
    bump = apart < 20
    depth = np.where(bump, 0.60 + 2e-5 * apart**2, 0.70)
    leaf = (u > 2) & (u < 22) & (v > 20) & (v < 40)
    return np.where(leaf, 0.57, depth), bump, leaf


def test_agreeing_points_are_kept_and_the_leaf_is_cut_off():
    depth, bump, leaf = scene()
    agreeing = bump & ~leaf
    agreeing[20:24, 20:24] = True  # a few pixels of the leaf agree by chance
    chosen = connected_to(agreeing, depth, covered=bump)
    assert not chosen[leaf].any()
    assert not chosen[~bump].any()
    assert chosen[bump & ~leaf].mean() > 0.85


def test_things_in_front_keep_their_outline():
    depth, bump, leaf = scene()
    chosen = connected_to(leaf & bump, depth, covered=bump)
    assert np.array_equal(chosen, leaf)


def test_holes_part_surfaces():
    depth, bump, _ = scene()
    depth = np.where(bump, depth, 0.0)
    depth[:, 30] = np.nan
    right_half = bump & (np.indices(SHAPE)[1] > 30)
    chosen = connected_to(right_half, depth, covered=bump)
    assert np.array_equal(chosen, right_half)


def test_nothing_agrees():
    depth, bump, _ = scene()
    assert not connected_to(np.zeros(SHAPE, bool), depth, covered=bump).any()
