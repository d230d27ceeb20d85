"""The plane that a fruit stands on, known and seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import label, minimum_filter

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


def connected_by_labels(
    agreeing: np.ndarray, depth: np.ndarray, covered: np.ndarray, stride: int
) -> np.ndarray:
    """The same by the labels of all surfaces: 4-connected pixels that are not far behind a neighbour."""
    valid = np.isfinite(depth) & (depth > 0.0)
    filled = np.where(valid, depth, np.inf)
    nearest = minimum_filter(filled, 3, mode="constant", cval=np.inf)
    with np.errstate(invalid="ignore"):
        step = 6e-3 * stride * np.maximum(1.0, (nearest / 0.6) ** 2)
        smooth = valid & (filled - nearest <= step)
    surfaces, count = label(smooth)
    chosen = np.zeros(depth.shape, bool)
    for surface in range(1, count + 1):
        part = surfaces == surface
        support = np.count_nonzero(part & agreeing & covered)
        if support >= 20 / stride**2 and support >= 0.3 * np.count_nonzero(part & covered):
            chosen |= part
    return chosen


@pytest.mark.parametrize("stride", [1, 2, 3])
@pytest.mark.parametrize("seed", range(8))
def test_surfaces_are_those_that_labels_give(seed: int, stride: int) -> None:
    rng = np.random.default_rng(seed)
    rows, columns = np.indices((18, 23))
    depth = 0.5 + 0.002 * rows + rng.choice([0.0, 0.03, 0.4], (18, 23), p=[0.9, 0.05, 0.05])
    depth[:, 11:] += 0.05 * (seed % 3)
    depth[:, 17:] += 0.4 * (seed % 2)
    depth[rng.random(depth.shape) < 0.05] = rng.choice([0.0, np.nan, np.inf])
    covered = columns > 3
    agreeing = rng.random(depth.shape) < (0.15, 0.3, 0.5)[seed % 3]
    depth = depth.astype(np.float32)
    found = connected_to(agreeing, depth, covered, stride)
    expected = connected_by_labels(agreeing, depth, covered, stride)
    assert np.array_equal(found, expected)


@pytest.mark.parametrize(("support", "kept"), [(19, False), (20, True)])
def test_a_surface_is_kept_from_twenty_pixels_and_three_tenths_of_what_it_covers(
    support: int, kept: bool
) -> None:
    depth = np.full((8, 10), 0.4, np.float32)
    agreeing = np.zeros((8, 10), bool)
    agreeing.flat[:support] = True
    covered = np.zeros((8, 10), bool)
    covered.flat[:67] = True  # 20 of 67 are less than three tenths
    assert connected_to(agreeing, depth, covered).any() is np.False_
    covered.flat[66] = False
    assert connected_to(agreeing, depth, covered).all() == kept
