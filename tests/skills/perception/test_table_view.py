"""The table in a depth image: its height and tilt, and other objects on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pomona.drivers.depth_model import D4XX, DepthModel
from pomona.drivers.interfaces import Box, Frame, Hull, Intrinsics, Workspace
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import rot_x, rot_y, rot_z, transform
from pomona.skills.perception.frame_check import HEIGHT, TILT, frame_view, should_show_table

LENS = Intrinsics(305.0, 305.0, 159.5, 119.5, 320, 240)
TABLE_Z = -0.12
WORKSPACE = Workspace(TABLE_Z, np.array([-0.8, -0.9, -0.2]), np.array([0.8, 0.5, 1.0]))
T_BASE_CAMERA = transform(rot_x(np.radians(160.0)), (0.0, -0.2, 0.48))
"""Looks down at 20° from the plumb line, as the observe poses do."""


def plane_depth(T: Float64, z: float) -> np.ndarray:
    """Depth of a horizontal plane at a height of the base frame, shape (240, 320) [m]."""
    v, u = np.indices((LENS.height, LENS.width))
    rays = np.stack([(u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, np.ones(u.shape)], axis=-1)
    return (T[2, 3] - z) / -(rays @ T[2, :3])


def a_frame(depth: np.ndarray, errs: DepthModel | None = None) -> Frame:
    colour = np.zeros((LENS.height, LENS.width, 3), np.uint8)
    errs = errs or DepthModel(floor=0.5e-3)
    return Frame(0.0, 0, colour, depth.astype(np.float32), LENS, None, T_BASE_CAMERA, "wrist", errs)


def noisy(depth: np.ndarray, deviation: float = 1e-3) -> np.ndarray:
    return depth + np.random.default_rng(0).normal(0.0, deviation, depth.shape)


def test_a_table_at_its_place_is_sound_and_measured_to_a_tenth_of_a_millimetre() -> None:
    view = frame_view(a_frame(noisy(plane_depth(T_BASE_CAMERA, TABLE_Z))), T_BASE_CAMERA, WORKSPACE)
    assert view is not None
    assert view.sound
    assert abs(view.height) < 1e-4
    assert view.tilt < np.radians(0.05)
    assert view.distance == pytest.approx(0.64, abs=0.02)


@pytest.mark.parametrize("turn", [rot_x, rot_y])
@pytest.mark.parametrize("angle", [-10.0, -3.0, -2.0, 2.0, 3.0, 10.0])
def test_a_camera_that_is_turned_shows_the_table_tilted_by_that_angle(turn, angle: float) -> None:
    stated = T_BASE_CAMERA @ transform(turn(np.radians(angle)))
    view = frame_view(a_frame(noisy(plane_depth(T_BASE_CAMERA, TABLE_Z))), stated, WORKSPACE)
    assert view is not None
    assert not view.sound
    assert np.degrees(view.tilt) == pytest.approx(abs(angle), rel=0.08)


@pytest.mark.parametrize("height", [-0.05, -0.015, 0.015, 0.05])
def test_a_table_at_another_height_is_measured_and_unsound(height: float) -> None:
    view = frame_view(
        a_frame(noisy(plane_depth(T_BASE_CAMERA, TABLE_Z + height))), T_BASE_CAMERA, WORKSPACE
    )
    assert view is not None
    assert not view.sound
    assert view.height == pytest.approx(height, abs=3e-4)
    assert f"{1e3 * abs(height):.0f} mm {'above' if height > 0 else 'below'}" in view.sentence
    assert view.height_ratio == pytest.approx(-height / (T_BASE_CAMERA[2, 3] - TABLE_Z), abs=1e-3)


def test_along_the_plane_and_about_its_normal_a_camera_may_be_anywhere() -> None:
    depth = noisy(plane_depth(T_BASE_CAMERA, TABLE_Z))
    moved = transform(rot_z(0.5), (0.1, -0.1, 0.0)) @ T_BASE_CAMERA
    view = frame_view(a_frame(depth), moved, WORKSPACE)
    assert view is not None
    assert view.sound


def test_depth_that_may_be_long_or_short_as_a_whole_has_more_room() -> None:
    depth = noisy(plane_depth(T_BASE_CAMERA, TABLE_Z + HEIGHT + 4e-3))
    for errs, sound in ((DepthModel(floor=1e-3), False), (D4XX, True)):
        view = frame_view(a_frame(depth, errs), T_BASE_CAMERA, WORKSPACE)
        assert view is not None
        assert view.sound is sound


def test_a_tray_beside_the_table_is_no_table_and_one_that_hides_it_is() -> None:
    table, tray = plane_depth(T_BASE_CAMERA, TABLE_Z), plane_depth(T_BASE_CAMERA, TABLE_Z + 0.03)
    beside = np.where(np.arange(LENS.width) < 0.6 * LENS.width, tray, table)
    view = frame_view(a_frame(noisy(beside)), T_BASE_CAMERA, WORKSPACE)
    assert view is not None
    assert view.sound
    hidden = frame_view(a_frame(noisy(tray)), T_BASE_CAMERA, WORKSPACE)
    assert hidden is not None
    assert hidden.height == pytest.approx(0.03, abs=1e-3)


@pytest.mark.parametrize("layer", [0.0, 0.06])
@pytest.mark.parametrize("known_as", ["box", "hull"])
def test_objects_of_the_cell_file_and_fruit_in_them_are_not_compared_with_the_table(
    known_as: str, layer: float
) -> None:
    tray = plane_depth(T_BASE_CAMERA, TABLE_Z + 0.03 + layer)
    corners = np.array(
        [[x, y, z] for x in (-0.7, 0.7) for y in (-0.8, 0.4) for z in (TABLE_Z, TABLE_Z + 0.03)]
    )
    box = Box(
        "tray",
        transform(None, corners.mean(axis=0)),
        tuple((np.ptp(corners, axis=0) / 2.0).tolist()),
    )
    known = (
        {"obstacles": (box,)}
        if known_as == "box"
        else {"hulls": (Hull("tray", corners, np.eye(3)),)}
    )
    workspace = replace(WORKSPACE, **known)  # type: ignore[arg-type]
    assert should_show_table(a_frame(tray), T_BASE_CAMERA, WORKSPACE)
    assert not should_show_table(a_frame(tray), T_BASE_CAMERA, workspace)
    assert frame_view(a_frame(noisy(tray)), T_BASE_CAMERA, workspace) is None


def test_a_pile_and_a_view_elsewhere_make_no_statement() -> None:
    rng = np.random.default_rng(1)
    pile = plane_depth(T_BASE_CAMERA, TABLE_Z) - rng.uniform(0.0, 0.1, (LENS.height, LENS.width))
    assert frame_view(a_frame(pile), T_BASE_CAMERA, WORKSPACE) is None
    assert should_show_table(a_frame(pile), T_BASE_CAMERA, WORKSPACE)
    up = T_BASE_CAMERA @ transform(rot_x(np.pi))
    assert frame_view(a_frame(np.full(pile.shape, 0.5)), up, WORKSPACE) is None
    assert not should_show_table(a_frame(np.full(pile.shape, 0.5)), up, WORKSPACE)


def test_without_depth_table_or_pose_there_is_nothing_to_compare() -> None:
    frame = a_frame(plane_depth(T_BASE_CAMERA, TABLE_Z))
    for other, workspace in (
        (replace(frame, depth=None), WORKSPACE),
        (replace(frame, placed=False), WORKSPACE),
        (frame, replace(WORKSPACE, table_z=None)),
    ):
        assert frame_view(other, T_BASE_CAMERA, workspace) is None
        assert not should_show_table(other, T_BASE_CAMERA, workspace)


def test_the_tolerances_are_those_of_a_calibrated_cell() -> None:
    assert HEIGHT == 0.010
    assert np.degrees(TILT) == pytest.approx(1.5)


def test_both_planes_are_those_of_the_seen_and_of_the_expected_table() -> None:
    view = frame_view(
        a_frame(noisy(plane_depth(T_BASE_CAMERA, TABLE_Z - 0.005))), T_BASE_CAMERA, WORKSPACE
    )
    assert view is not None
    seen, stated = view.planes
    np.testing.assert_allclose(stated, [*T_BASE_CAMERA[2, :3], T_BASE_CAMERA[2, 3] - TABLE_Z])
    assert seen[3] - stated[3] == pytest.approx(0.005, abs=2e-4)
    np.testing.assert_allclose(seen[:3], stated[:3], atol=1e-3)
