"""Implausible frames: the wrong statement, with numbers and a remedy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pomona.drivers.interfaces import Frame
from pomona.skills.geometry import rot_x, rot_y, transform
from pomona.skills.perception.frame_check import DEPTH_MISMATCH, POSE_MISMATCH, frame_problem
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
