"""Implausible frames: the wrong statement, with numbers and a remedy."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pomona.drivers.interfaces import Box, Frame, Workspace
from pomona.skills.geometry import rot_x, rot_y, rot_z, transform
from pomona.skills.perception.frame_check import (
    DEPTH_MISMATCH,
    POSE_MISMATCH,
    _beside,
    _directions,
    depth_points,
    frame_problem,
)
from tests.skills.perception.test_depth_registration import leaves
from tests.skills.perception.test_table_view import (
    T_BASE_CAMERA,
    TABLE_Z,
    WORKSPACE,
    a_frame,
    noisy,
    plane_depth,
)


def looked(depth: np.ndarray) -> Frame:
    return a_frame(noisy(depth))


def test_a_true_frame_has_no_problem() -> None:
    assert (
        frame_problem(looked(plane_depth(T_BASE_CAMERA, TABLE_Z)), T_BASE_CAMERA, WORKSPACE) is None
    )


def test_a_table_elsewhere_is_the_poses_or_the_cell_files_error_with_the_remedy() -> None:
    problem = frame_problem(
        looked(plane_depth(T_BASE_CAMERA, TABLE_Z - 0.018)), T_BASE_CAMERA, WORKSPACE
    )
    assert problem is not None
    assert problem.code == POSE_MISMATCH
    assert "18 mm below" in problem.message
    assert "depth that is 3.0 % too long does the same" in problem.message
    assert "`pomona calibrate hand-eye` or `pomona calibrate depth`" in problem.message
    assert problem.data["height_m"] == pytest.approx(-0.018, abs=5e-4)
    turned = T_BASE_CAMERA @ transform(rot_y(np.radians(3.0)))
    problem = frame_problem(looked(plane_depth(T_BASE_CAMERA, TABLE_Z)), turned, WORKSPACE)
    assert problem is not None
    assert problem.code == POSE_MISMATCH
    assert "does the same" not in problem.message


@pytest.mark.parametrize(
    ("flip", "turn", "words"),
    [
        ((slice(None), slice(None, None, -1)), rot_y, "mirrored left to right"),
        ((slice(None, None, -1), slice(None)), rot_x, "mirrored top to bottom"),
    ],
)
def test_mirrored_depth_is_named(flip, turn, words: str) -> None:
    tilted = T_BASE_CAMERA @ transform(turn(np.radians(6.0)))
    problem = frame_problem(looked(plane_depth(tilted, TABLE_Z)[flip]), tilted, WORKSPACE)
    assert problem is not None
    assert problem.code == DEPTH_MISMATCH
    assert words in problem.message


def test_depth_of_an_earlier_pose_is_named_with_its_age() -> None:
    before = transform(None, (0.0, 0.0, 0.1)) @ T_BASE_CAMERA @ transform(rot_x(0.1))
    frame = replace(looked(plane_depth(before, TABLE_Z)), stamp=7.0)
    other = transform(None, (0.0, 0.0, 0.3)) @ T_BASE_CAMERA
    problem = frame_problem(frame, T_BASE_CAMERA, WORKSPACE, [(6.0, other), (6.6, before)])
    assert problem is not None
    assert problem.code == DEPTH_MISMATCH
    assert "depth is 0.40 s old" in problem.message
    alone = frame_problem(frame, T_BASE_CAMERA, WORKSPACE, [(6.0, other)])
    assert alone is not None
    assert alone.code == POSE_MISMATCH


@pytest.mark.parametrize("scale", [1.3, 1.5, 2.0])
def test_a_table_far_below_its_height_is_depth_that_is_too_long(scale: float) -> None:
    problem = frame_problem(
        looked(scale * plane_depth(T_BASE_CAMERA, TABLE_Z)), T_BASE_CAMERA, WORKSPACE
    )
    assert problem is not None
    assert problem.code == DEPTH_MISMATCH
    assert (
        f"depth is {scale:.2f} times as long as the table's height and the camera's pose make it"
        in problem.message
    )


@pytest.mark.parametrize("scale", [0.5, 0.67])
def test_a_plane_far_above_the_table_may_be_a_thing_on_it(scale: float) -> None:
    frame = looked(scale * plane_depth(T_BASE_CAMERA, TABLE_Z))
    assert frame_problem(frame, T_BASE_CAMERA, WORKSPACE) is None


def test_a_table_that_is_missing_is_only_named_where_another_pose_explains_it() -> None:
    near = transform(None, (0.0, 0.0, -0.2)) @ T_BASE_CAMERA
    frame = replace(looked(plane_depth(near, TABLE_Z)), stamp=7.0)
    assert frame_problem(frame, T_BASE_CAMERA, WORKSPACE) is None
    problem = frame_problem(frame, T_BASE_CAMERA, WORKSPACE, [(6.0, near)])
    assert problem is not None
    assert "does not show the table" in problem.message


def test_depth_that_is_not_its_colours_is_named_where_no_table_is_known() -> None:
    frame = leaves(3)
    nowhere = replace(WORKSPACE, table_z=None)
    assert frame_problem(frame, T_BASE_CAMERA, nowhere) is None
    assert frame.depth is not None
    mirrored = replace(frame, depth=np.ascontiguousarray(frame.depth[:, ::-1]))
    problem = frame_problem(mirrored, T_BASE_CAMERA, nowhere)
    assert problem is not None
    assert problem.code == DEPTH_MISMATCH
    assert "mirrored left to right against colour" in problem.message


@pytest.mark.parametrize(
    ("at", "beside"),
    [
        ((0.119, 0.0, 0.0), False),
        ((0.121, 0.0, 0.0), True),
        ((0.0, -0.069, 0.0), False),
        ((0.0, -0.071, 0.0), True),
        ((0.0, 0.0, 9.0), False),  # above it
        ((0.0, 0.0, -0.049), False),
        ((0.0, 0.0, -0.051), True),
    ],
)
def test_points_near_or_above_a_fixed_thing_are_not_the_tables(
    at: tuple[float, float, float], beside: bool
) -> None:
    middle = np.array([0.3, -0.2, 0.1])
    T = transform(rot_z(0.5), middle)
    box = Box("post", T, (0.1, 0.05, 0.03))
    corners = np.array(
        [[x, y, z] for x in (-0.1, 0.1) for y in (-0.05, 0.05) for z in (-0.03, 0.03)]
    )
    hull = SimpleNamespace(points=corners + middle)
    far = Box("far", transform(None, (9.0, 0.0, 0.0)), (0.1, 0.1, 0.1))
    lower, upper = np.full(3, -1.0), np.full(3, 1.0)
    turned = np.array([T[:3, :3] @ at + T[:3, 3]])
    for obstacles in ((box,), (box, far), (far, box)):
        assert _beside(turned, Workspace(0.0, lower, upper, obstacles=obstacles)) == [beside]
    cell: Any = replace(Workspace(0.0, lower, upper), hulls=(hull,))
    assert _beside(np.array([at]) + middle, cell) == [beside]


def test_points_are_those_of_eighty_columns_with_depth_up_to_two_metres() -> None:
    frame = looked(plane_depth(T_BASE_CAMERA, TABLE_Z))
    lens, depth = frame.intrinsics, np.zeros((480, 640), np.float32)
    lens = replace(lens, width=640, height=480)
    depth[8, 16], depth[16, 8], depth[7, 16], depth[24, 24] = 1.0, 1.999, 1.0, 2.0
    expected = [
        [(16 - lens.cx) / lens.fx, (8 - lens.cy) / lens.fy, 1.0],
        [(8 - lens.cx) / lens.fx * 1.999, (16 - lens.cy) / lens.fy * 1.999, 1.999],
    ]
    np.testing.assert_allclose(depth_points(depth, lens), expected, rtol=1e-6)


def test_directions_are_of_twice_the_angle_and_shorter_where_it_is_faint() -> None:
    x, y = np.array([3.0, -3.0, 0.0, 1.0]), np.array([0.0, 0.0, 2.0, 1.0])
    found = _directions(x, y, 1.0)
    np.testing.assert_allclose(found, [0.9, 0.9, -0.8, 2j / 3.0], atol=1e-6)
