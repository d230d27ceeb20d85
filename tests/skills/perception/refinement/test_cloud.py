"""The plane that a fruit stands on, known and seen."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.ndimage import label, minimum_filter

from benchmarks.synthetic_depth import looking_at
from pomona.drivers.depth_model import DepthModel
from pomona.drivers.interfaces import Intrinsics
from pomona.skills.geometry import apply, inverse, rot_y, rotation_about, transform
from pomona.skills.perception.refinement.cloud import (
    Cloud,
    Plane,
    cloud,
    connected_to,
    gather,
    gather_others,
    horizontal_plane,
    near_model,
    plane_below,
    points_around,
    seen_elsewhere,
    seen_near,
    surface_of,
    together,
)
from pomona.skills.perception.refinement.errors import TooFewInliers
from pomona.skills.perception.refinement.render import DepthLook, ImageBox, RefineResult

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


FLOOR = Plane(np.array([0.0, 0.0, -1.0]), 0.5)  # 0.5 m before the camera


def floor_points(count: int, height: float = 0.0, tilt: float = 0.0) -> np.ndarray:
    """Points of a plane that is turned about x in the middle of the floor, seen without noise."""
    x, y = np.random.default_rng(1).uniform(-0.05, 0.05, (2, count))
    y -= y.mean()
    return np.column_stack([x, y, 0.5 - height + np.tan(np.radians(tilt)) * y])


@pytest.mark.parametrize(
    ("count", "height", "tilt", "others", "found"),
    [
        (60, 0.0, 0.0, 0, True),
        (59, 0.0, 0.0, 0, False),
        (300, 0.0, 0.0, 700, True),
        (300, 0.0, 0.0, 701, False),
        (100, 0.0149, 0.0, 0, True),
        (100, 0.0151, 0.0, 0, False),
        (400, 0.0, 4.9, 0, True),
        (400, 0.0, 5.1, 0, False),
    ],
)
def test_a_plane_is_the_known_one_up_to_its_limits(count, height, tilt, others, found):
    points = np.vstack([floor_points(count, height, tilt), np.full((others, 3), 0.2)])
    seen = seen_near(FLOOR, points)
    assert (seen is not None) is found
    if seen is not None:
        assert seen.normal == pytest.approx(
            [0.0, np.sin(np.radians(tilt)), -np.cos(np.radians(tilt))], abs=1e-9
        )
        assert seen.offset == pytest.approx((0.5 - height) * np.cos(np.radians(tilt)))


@pytest.mark.parametrize(
    ("count", "height", "tilt", "others", "found"),
    [
        (60, 0.03, 0.0, 0, True),
        (59, 0.03, 0.0, 0, False),
        (100, 0.0, 0.0, 0, False),
        (100, 0.0599, 0.0, 0, True),
        (100, 0.0601, 0.0, 0, False),
        (500, 0.0, 19.9, 0, True),
        (500, 0.0, 20.1, 0, False),
        (100, 0.03, 0.0, 100, True),
        (100, 0.03, 0.0, 101, False),
    ],
)
def test_another_plane_is_told_up_to_its_limits(count, height, tilt, others, found):
    points = np.vstack([floor_points(count, height, tilt), np.full((others, 3), 0.2)])
    seen = seen_elsewhere(FLOOR, points)
    assert (seen is not None) is found
    if seen is not None:
        assert seen == pytest.approx((height, np.radians(tilt)), abs=1e-6)


LENS = Intrinsics(50.0, 40.0, 9.5, 7.5, 20, 16)
MODEL = DepthModel(disparity=0.1, baseline=0.05, lateral=0.5, alike=9.0)


def test_points_of_a_look_are_those_of_its_pixels():
    depth = np.full((16, 20), 0.5, np.float32)
    depth[4, 6], depth[5, 7], depth[5, 6] = 0.0, np.nan, 0.4
    look, box = DepthLook(depth, LENS, MODEL), ImageBox(6, 4, 9, 6)
    found = cloud(look, box)
    pixels = np.array([(7, 4, 0.5), (8, 4, 0.5), (6, 5, 0.4), (8, 5, 0.5)])
    u, v, z = pixels.T
    points = np.column_stack([(u - 9.5) / 50.0 * z, (v - 7.5) / 40.0 * z, z])
    np.testing.assert_allclose(found.points, points, rtol=1e-6)
    lengths = np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(found.rays, points / lengths, rtol=1e-6)
    np.testing.assert_allclose(found.deviation, 3.0 * z**2 * 0.1 / (50.0 * 0.05), rtol=1e-6)
    np.testing.assert_allclose(found.beside, 3.0 * 0.5 * z / 50.0, rtol=1e-6)
    assert (found.alike, found.looks) == (9.0, 1)
    mask = np.array([[True, True, False], [False, True, True]])
    assert cloud(look, box, mask).points == pytest.approx(points[[0, 3]], rel=1e-6)


def some(count: int, alike: float = 12.0) -> Cloud:
    x = np.random.default_rng(count).random((4, count, 3))
    return Cloud(x[0], x[1], x[2, :, 0], x[3, :, 0], alike)


def test_clouds_are_chosen_moved_and_joined_point_by_point():
    one, two = some(5), some(3, alike=4.0)
    both = together([one, two, one])
    assert (len(both.points), both.alike, both.looks) == (13, 12.0, 3)
    picked = both.chosen(np.arange(13) == 6)
    T = transform(rot_y(0.3), (0.1, 0.2, 0.3))
    moved = picked.moved(T)
    assert moved.points[0] == pytest.approx(T[:3, :3] @ two.points[1] + T[:3, 3])
    assert moved.rays[0] == pytest.approx(T[:3, :3] @ two.rays[1])
    assert (moved.deviation[0], moved.beside[0]) == (two.deviation[1], two.beside[1])


@pytest.mark.parametrize(
    ("count", "at_most", "step", "gain"),
    [
        (0, 4, 1, 1.0),
        (8, 8, 1, 1.0),
        (9, 8, 2, 0.5**0.5),
        (12, 4, 3, 3**-0.5),
        (90, 5, 18, 12**-0.5),
    ],
)
def test_thinned_points_err_less_alike(count, at_most, step, gain):
    whole = some(count)
    few = whole.thinned(at_most)
    np.testing.assert_array_equal(few.points, whole.points[::step])
    np.testing.assert_array_equal(few.rays, whole.rays[::step])
    np.testing.assert_allclose(few.deviation, gain * whole.deviation[::step])
    np.testing.assert_allclose(few.beside, gain * whole.beside[::step])


def test_points_count_as_far_as_the_model_may_reach():
    line = np.array([0.0, 0.0799, 0.0801])[:, None] * [0.6, 0.0, 0.8] + 1.0
    points = Cloud(line, line, line[:, 0], line[:, 0], 1.0)
    assert len(near_model([points], np.ones(3), 0.05).points) == 2
    two = near_model([points, points], np.ones(3), 0.05)
    assert (len(two.points), two.looks) == (4, 2)


def standing_block(height: float) -> tuple[DepthLook, RefineResult]:
    """A block of 20 x 16 px that rises over the floor in the middle of the picture, and its scaled model."""
    lens = Intrinsics(100.0, 100.0, 39.5, 29.5, 80, 60)
    depth = np.full((60, 80), 0.5, np.float32)
    depth[22:38, 30:50] -= height
    box = ImageBox(28, 20, 52, 40)
    virtual = np.zeros(box.shape, np.float32)
    virtual[2:18, 2:22] = 0.5 - height
    scaled = RefineResult(
        np.eye(4), np.full(3, 0.05), 1.0, 0.0, np.eye(6), 1.0, 0.0,
        box, virtual > 0.0, virtual, "uniform",
    )  # fmt: skip
    return DepthLook(depth, lens, MODEL), scaled


def test_a_fruits_points_are_gathered_without_what_it_stands_on():
    look, scaled = standing_block(0.03)
    found = gather(look, scaled, FLOOR)
    assert found.points[:, 2] == pytest.approx(np.full(320, 0.47))
    assert len(gather(look, scaled, None).points) == 320
    assert len(gather(look, scaled, Plane(FLOOR.normal, 0.475)).points) == 320
    with pytest.raises(TooFewInliers):
        gather(look, scaled, Plane(FLOOR.normal, 0.473))
    mixed = DepthModel(disparity=0.1, edge=2)
    assert len(gather(DepthLook(look.depth, look.intrinsics, mixed), scaled, None).points) == 192


def test_every_fourth_point_around_shows_the_floor():
    look, scaled = standing_block(0.03)
    around = points_around(look, scaled.box, scaled.virtual_depth)
    rows, columns = np.meshgrid(np.arange(4, 56, 2), np.arange(12, 68, 2), indexing="ij")
    beside = ~((rows >= 22) & (rows < 38) & (columns >= 30) & (columns < 50))
    np.testing.assert_allclose(around[:, 0], (columns[beside] - 39.5) / 100.0 * 0.5, rtol=1e-6)
    np.testing.assert_allclose(around[:, 1], (rows[beside] - 29.5) / 100.0 * 0.5, rtol=1e-6)
    lower = plane_below(look, scaled, Plane(FLOOR.normal, 0.49))
    assert lower.offset == pytest.approx(0.5)
    far = Plane(FLOOR.normal, 0.4)
    assert plane_below(look, scaled, far) is far


@pytest.mark.parametrize("order", [1, -1])
def test_a_mesh_is_sampled_evenly_with_normals_to_the_outside(order):
    box = trimesh.creation.box((0.2, 0.1, 0.05))
    mesh = trimesh.Trimesh(box.vertices, box.faces[:, ::order], process=False)
    samples = surface_of(mesh)
    half = np.array([0.1, 0.05, 0.025])
    assert np.abs(samples.points / half).max(axis=1) == pytest.approx(np.ones(4000))
    outwards = np.sum(samples.normals * samples.points / half, axis=1)
    assert outwards == pytest.approx(np.ones(4000))
    areas = np.array([0.05 * 0.1, 0.2 * 0.05, 0.2 * 0.1])
    shares = np.abs(samples.normals).mean(axis=0)
    assert shares == pytest.approx(areas / areas.sum(), abs=1e-3)
    assert np.abs(samples.points.mean(axis=0)).max() < 2e-3
    assert samples.neighbours.shape == (4000, 16)
    assert samples.near.shape == (24, 24, 24)
    apart = np.linalg.norm(samples.points[samples.neighbours[7]] - samples.points[7], axis=1)
    others = np.sort(np.linalg.norm(samples.points - samples.points[7], axis=1))
    assert apart == pytest.approx(others[1:17])
    middle = samples.corner + samples.edges * [3.5, 4.5, 20.5]
    nearest = np.linalg.norm(samples.points - middle, axis=1).argmin()
    assert samples.near[3, 4, 20] == nearest
    low, high = samples.points.min(axis=0), samples.points.max(axis=0)
    assert samples.corner == pytest.approx(low - 0.1 * (high - low))
    assert samples.corner + 24 * samples.edges == pytest.approx(high + 0.1 * (high - low))
    np.testing.assert_array_equal(samples.vertices, mesh.vertices)


def test_other_looks_give_what_agrees_with_the_model_in_the_first_ones_frame():
    box = trimesh.creation.box((0.1, 0.1, 0.06))
    lens = Intrinsics(100.0, 100.0, 39.5, 29.5, 80, 60)
    T_model = transform(translation=(0.0, 0.0, 0.53))
    T_look = transform(translation=(0.02, 0.0, 0.0))
    depth = np.full((60, 80), 0.56, np.float32)
    depth[20:40, 26:46] = 0.5 + 0.0079
    away = transform(translation=(9.0, 0.0, 0.0))
    looks = [DepthLook(depth, lens, MODEL, T, "zbuffer") for T in (T_look, away)]
    (found,) = gather_others(looks, box, T_model, None, 4e-3)
    assert found.points[:, 2] == pytest.approx(np.full(len(found.points), 0.5079))
    assert found.points[:, 0].mean() == pytest.approx((35.5 - 39.5) / 100.0 * 0.5079 + 0.02)
    assert gather_others(looks, box, T_model, None, 3.9e-3) == []
    below = Plane(np.array([0.0, 0.0, -1.0]), 0.511)
    assert gather_others(looks, box, T_model, below, 4e-3) == []
