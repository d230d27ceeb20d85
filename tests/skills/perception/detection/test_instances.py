"""The two vertex orders in use, written out independently."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.skills.perception.detection.close_look import (
    REFERENCE_LENGTH,
    STEM_AXIS,
    label_rotation,
)
from pomona.skills.perception.detection.instances import (
    CuboidConvention,
    FoundFruit,
    cuboid_in_picture,
    cuboid_keypoints,
    pose_covariance,
    pose_of,
)
from pomona.tools.pytorch.pose import solve_pose

MIRRORED = (
    1,
    0,
    3,
    2,
    5,
    4,
    7,
    6,
    8,
)  # keypoint of each in the mirrored picture (CAMERA convention)


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


K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])
APPLE = np.array([0.09756, 0.08539, 0.09590])


def seen(T: np.ndarray, visibility: float = 1.0) -> FoundFruit:
    """Return a perfect close look at a CAD-sized fruit."""
    p = T[:3, 3]
    centre = p[:2] / p[2] * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2])
    size = K[0, 0] * REFERENCE_LENGTH / p[2]
    return FoundFruit(
        p, T[:3, :3] @ STEM_AXIS, centre, size, np.array([1.0, 0.02, 0.1]), 0.9, visibility
    )


def posed(stem: tuple[float, ...], p: tuple[float, ...]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = label_rotation(stem, p), p
    return T


@pytest.mark.slow
@settings(max_examples=30)
@given(
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
        lambda v: np.linalg.norm(v) > 0.2
    ),
    st.tuples(st.floats(-0.15, 0.15), st.floats(-0.1, 0.1), st.floats(0.3, 0.9)),
)
def test_a_perfect_look_gives_the_labels_pose_and_keypoints(
    stem: tuple[float, ...], p: tuple[float, ...]
) -> None:
    T = posed(stem, p)
    assert np.allclose(pose_of(seen(T)), T, atol=1e-9)
    keypoints = cuboid_in_picture(T, APPLE, K)
    corners = cuboid_keypoints(APPLE) @ T[:3, :3].T + T[:3, 3]
    assert np.allclose(
        keypoints,
        corners[:, :2] / corners[:, 2:] * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2]),
        atol=1e-9,
    )
    assert np.allclose(
        solve_pose(keypoints, APPLE, K).T_camera_object, T, atol=1e-3
    )  # another way to the same pose


def test_the_covariance_is_the_scatter_of_the_errors_of_a_look() -> None:
    rng = np.random.default_rng(0)
    T = posed((0.1, -0.7, -0.6), (0.12, -0.08, 0.6))
    truth = seen(T)
    covariance = pose_covariance(truth, K)
    # The scales turn expected errors into deviations: read them off where each acts alone.
    z = truth.p_camera[2]
    only = [pose_covariance(replace(truth, spreads=np.eye(3)[k]), K) for k in range(3)]
    across = np.sqrt(only[0][3, 3]) * K[0, 0] / z
    along = np.sqrt(np.trace(only[1][3:, 3:])) / np.linalg.norm(truth.p_camera)
    places = []
    for _ in range(3000):
        centre = truth.centre + rng.normal(0.0, across * truth.spreads[0], 2)
        far = z * np.exp(rng.normal(0.0, along * truth.spreads[1]))
        places.append(far * np.array([*((centre - K[:2, 2]) / (K[0, 0], K[1, 1])), 1.0]))
    assert np.allclose(covariance[3:, 3:], np.cov(np.array(places).T), rtol=0.12, atol=2e-8)
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
    assert only[2][0, 0] > 0.0


def test_a_hidden_fruit_is_placed_less_surely_than_the_network_says() -> None:
    T = posed((0.0, -1.0, -0.2), (0.0, 0.0, 0.6))
    clear, hidden = (np.diag(pose_covariance(seen(T, visibility), K)) for visibility in (1.0, 0.3))
    assert np.all(hidden[3:] > 2.0 * clear[3:])
