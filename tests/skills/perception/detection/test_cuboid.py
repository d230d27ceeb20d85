"""The two vertex orders in use, written out independently."""

import numpy as np
import pytest

from pomona.skills.perception.detection.cuboid import CuboidConvention, cuboid_keypoints

MIRRORED = (1, 0, 3, 2, 5, 4, 7, 6, 8)  # keypoint of each in the mirrored picture (CAMERA convention)


def test_camera_convention_has_dopes_vertex_order() -> None:
    corners = cuboid_keypoints((2.0, 4.0, 6.0))
    right, top, front = corners[:, 0] > 0, corners[:, 1] < 0, corners[:, 2] > 0  # y points down
    assert right[:8].tolist() == [True, False, False, True, True, False, False, True]
    assert top[:8].tolist() == [True, True, False, False, True, True, False, False]
    assert front[:8].tolist() == [True, True, True, True, False, False, False, False]
    assert np.array_equal(np.abs(corners[:8]), np.tile([1.0, 2.0, 3.0], (8, 1)))
    assert np.array_equal(corners[8], np.zeros(3))


def test_robot_convention_turns_forward_left_up_into_dopes_axes() -> None:
    corners = cuboid_keypoints((2.0, 4.0, 6.0), CuboidConvention.ROBOT)
    # Vertex 0 is right, top and front in DOPE's axes: forward (+x), right (-y), up (+z) for the mesh.
    assert corners[0].tolist() == [1.0, -2.0, 3.0]
    # Vertex 6 is left, bottom and back.
    assert corners[6].tolist() == [-1.0, 2.0, -3.0]


@pytest.mark.parametrize("convention", list(CuboidConvention))
def test_both_conventions_span_the_same_cuboid(convention: CuboidConvention) -> None:
    corners = cuboid_keypoints((2.0, 4.0, 6.0), convention)[:8]
    assert np.allclose(np.ptp(corners, axis=0), (2.0, 4.0, 6.0))
    assert len({tuple(c) for c in corners.tolist()}) == 8


def test_mirroring_exchanges_left_and_right() -> None:
    corners = cuboid_keypoints((2.0, 4.0, 6.0))
    assert np.array_equal(corners[list(MIRRORED)], corners * (-1.0, 1.0, 1.0))
