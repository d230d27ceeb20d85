import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.applications.crates.crate_place import (
    Crate,
    crate_named,
    find_crate,
    rim_points,
    share_in_view,
)
from pomona.drivers.interfaces import Box, Intrinsics
from pomona.skills.geometry import rot_x, rot_z, transform

CRATE = Crate(transform(None, [-0.02, -0.37, 0.0]), np.array([0.2, 0.15]), 0.008)
LENS = Intrinsics(610.6, 610.6, 317.7, 238.1, 640, 480)
ABOVE = transform(rot_x(np.pi), [-0.02, -0.37, 0.5])
"""A camera that looks straight down, 0.5 m over the walls."""


def rendered(
    shift: tuple[float, float] = (0.0, 0.0), turn: float = 0.0, there: bool = True, seed: int = 0
):
    """A depth image from above: walls at 0.5 m, with a stereo camera's noise; inside and beside it 0.61 m."""
    v, u = np.indices((LENS.height, LENS.width))
    x, y = (
        (u - LENS.cx) / LENS.fx * 0.5,
        -(v - LENS.cy) / LENS.fy * 0.5,
    )  # the camera's y axis is the base's -y
    p = np.stack((x - shift[0], y - shift[1]), axis=-1) @ rot_z(turn)[:2, :2]
    outside = (np.abs(p) <= CRATE.half).all(axis=-1)
    inside = (np.abs(p) <= CRATE.half - CRATE.wall).all(axis=-1)
    depth = np.where(outside & ~inside & there, 0.5, 0.61)
    return depth + np.random.default_rng(seed).normal(0.0, 1e-3, depth.shape)


def seen(depth: np.ndarray):
    return find_crate(rim_points(depth, LENS, ABOVE, CRATE), CRATE)


@settings(max_examples=10, deadline=None)
@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.087, 0.087), st.integers(0, 99))
def test_a_crate_that_was_moved_by_20_mm_and_5_degrees_is_found_within_2_mm_and_half_a_degree(
    x, y, turn, seed
):
    found = seen(rendered((x, y), turn, seed=seed))
    assert found is not None
    np.testing.assert_allclose(found.shift, [x, y], atol=2e-3)
    assert found.turn == pytest.approx(turn, abs=np.radians(0.5))


def test_a_crate_at_40_mm_is_seen_as_farther_than_20_mm_or_not_at_all():
    found = seen(rendered((0.04, 0.0)))
    assert found is None or found.farthest > 0.03


def test_no_crate_is_found_on_an_empty_table():
    assert seen(rendered(there=False)) is None


def test_a_crate_without_depth_is_not_found():
    assert seen(np.zeros((480, 640))) is None


def test_one_wall_alone_shows_no_crate():
    depth = rendered()
    depth[:, 120:] = 0.61
    depth[:100], depth[380:] = 0.61, 0.61
    assert seen(depth) is None


def test_a_plate_at_the_walls_height_is_no_crate():
    assert seen(np.full((480, 640), 0.5)) is None


def test_a_crate_of_the_cell_file_is_its_walls_upper_edge():
    floor = Box("source", transform(None, [0.1, 0.2, -0.116]), (0.2, 0.15, 0.004))
    walls = [
        Box("source", transform(None, [0.1, 0.2 + y, -0.06]), (0.2, 0.004, 0.06))
        for y in (-0.146, 0.146)
    ]
    crate = crate_named("source", [floor, *walls])
    assert crate is not None
    np.testing.assert_allclose(crate.T_base_crate[:3, 3], [0.1, 0.2, 0.0], atol=1e-9)
    assert crate.wall == pytest.approx(0.008)
    assert crate_named("source", [floor]) is None
    assert crate_named("tray", [floor, *walls]) is None


def test_the_share_in_view_is_all_from_above_and_none_from_behind():
    assert share_in_view(LENS, ABOVE, CRATE) > 0.95
    assert share_in_view(LENS, transform(None, [-0.02, -0.37, 0.5]), CRATE) == 0.0
