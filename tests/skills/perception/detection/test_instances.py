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
    SIZE_OF_BOX,
    CuboidConvention,
    FoundFruit,
    Instance,
    cuboid_in_picture,
    cuboid_keypoints,
    inside,
    instance_of,
    pose_covariance,
    pose_of,
    rank,
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


# ------------------------------------------------------------------------------ boxes, deviations and choices


@pytest.mark.parametrize(
    ("box", "part"),
    [
        ((10.0, 20.0, 30.0, 40.0), (10.0, 20.0, 30.0, 40.0)),
        ((-5.0, -7.0, 30.0, 40.0), (0.0, 0.0, 25.0, 33.0)),
        ((90.0, 50.0, 30.0, 40.0), (90.0, 50.0, 10.0, 10.0)),
        ((-40.0, 70.0, 30.0, 40.0), (0.0, 60.0, 0.0, 0.0)),
    ],
)
def test_of_a_box_the_part_in_the_picture_counts(
    box: tuple[float, ...], part: tuple[float, ...]
) -> None:
    np.testing.assert_allclose(inside(np.array(box), 100, 60), part)


def test_without_a_box_the_outline_is_that_of_a_whole_fruit_around_the_centre() -> None:
    found = seen(posed((0.0, 1.0, 0.0), (0.0, 0.0, 0.6)))
    x, y, w, h = found.outline(640, 480)
    assert (w, h) == pytest.approx((found.size / SIZE_OF_BOX,) * 2)
    # a pixel's centre lies at a whole number, its border half a pixel beside
    np.testing.assert_allclose((x + 0.5 * w, y + 0.5 * h), found.centre + 0.5)
    box = np.array([1.0, 2.0, 3.0, 4.0])
    assert replace(found, box=box).outline(640, 480) is box
    edge = replace(found, centre=np.array([0.0, 479.0])).outline(640, 480)
    np.testing.assert_allclose(edge[[0, 1]], [0.0, 479.5 - 0.5 * h])
    np.testing.assert_allclose(edge[[2, 3]], [0.5 + 0.5 * w, 0.5 + 0.5 * h])


@pytest.mark.parametrize(
    ("spreads", "visibility"), [((1.0, 0.02, 0.1), 1.0), ((2.5, 0.05, 0.4), 0.6)]
)
def test_deviations_follow_from_the_expected_errors_and_the_hidden_part(
    spreads: tuple[float, ...], visibility: float
) -> None:
    p = np.array([0.1, -0.05, 0.7])
    found = replace(seen(posed((0.0, 1.0, 0.0), tuple(p)), visibility), spreads=np.array(spreads))
    skewed = K * np.array([[1.0, 1.0, 1.0], [1.0, 1.3, 1.0], [1.0, 1.0, 1.0]])
    covariance = pose_covariance(found, skewed)
    hidden = np.exp(2.8 * (1.0 - visibility))
    across = 0.97 * spreads[0] * hidden * 0.7  # a deviation in the picture, at this depth
    along = 1.25 * spreads[1] * hidden * p
    axis = 1.99 * spreads[2] ** 1.43
    expected = np.diag([(across / K[0, 0]) ** 2, (across / (1.3 * K[1, 1])) ** 2, 0.0])
    np.testing.assert_allclose(covariance[3:, 3:], expected + np.outer(along, along))
    np.testing.assert_allclose(covariance[:3, :3], np.eye(3) * axis**2)
    assert not covariance[:3, 3:].any()
    assert not covariance[3:, :3].any()


def test_no_axis_is_known_better_than_a_thousandth() -> None:
    found = replace(
        seen(posed((0.0, 1.0, 0.0), (0.0, 0.0, 0.6))), spreads=np.array([1.0, 0.1, 0.0])
    )
    np.testing.assert_allclose(pose_covariance(found, K)[:3, :3], np.eye(3) * 1e-6)


def test_keypoints_are_the_corners_as_the_lens_shows_them() -> None:
    T = posed((0.2, 1.0, 0.3), (0.05, -0.02, 0.6))
    lens = np.array([[600.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
    shown = cuboid_in_picture(T, APPLE, lens)
    for corner, (u, v) in zip(cuboid_keypoints(APPLE), shown, strict=True):
        x, y, z = T[:3, :3] @ corner + T[:3, 3]
        assert (u, v) == pytest.approx((600.0 * x / z + 320.0, 500.0 * y / z + 240.0))


def test_corners_behind_the_camera_are_shown_as_if_a_tenth_of_the_depth_before_it() -> None:
    near = np.eye(4)
    near[2, 3] = 0.02
    shown = cuboid_in_picture(near, APPLE, K)
    corners = cuboid_keypoints(APPLE)
    behind = corners[:, 2] < -0.018
    assert behind.sum() == 4
    expected = corners[behind, :2] / 0.002 * 610.6 + (317.7, 238.1)
    np.testing.assert_allclose(shown[behind], expected)


def test_a_detection_becomes_an_instance_with_its_pose() -> None:
    T = posed((0.2, 1.0, 0.3), (0.05, -0.02, 0.6))
    found = replace(seen(T, 0.8), box=np.array([1.0, 2.0, 3.0, 4.0]))
    instance = instance_of(found, K, APPLE)
    np.testing.assert_allclose(instance.T_camera_object, T, atol=1e-9)
    np.testing.assert_allclose(instance.keypoints, cuboid_in_picture(T, APPLE, K))
    np.testing.assert_allclose(instance.covariance, pose_covariance(found, K))
    assert (instance.score, instance.visibility, instance.problem) == (0.9, 0.8, "")
    assert instance.box is found.box


def of(distance: float, score: float, visibility: float, size: float) -> Instance:
    T = np.eye(4)
    T[:3, 3] = 0.0, 0.6 * distance, 0.8 * distance
    keypoints = size * np.vstack([np.tile([[1.0, 0.0]], (8, 1)), [[0.0, 0.0]]])
    return Instance(keypoints, score, visibility, T, np.eye(6))


def test_a_policy_puts_the_instances_into_its_order() -> None:
    there = [
        of(0.6, 0.9, 0.52, 50.0),
        of(0.5, 0.7, 0.95, 60.0),
        of(0.7, 0.8, 0.48, 40.0),
        of(0.6, 0.9, 0.3, 60.0),
    ]
    assert rank(there, "nearest") == [1, 0, 3, 2]
    assert rank(there, "surest") == [0, 3, 2, 1]
    assert rank(there, "largest") == [1, 3, 0, 2]
    assert rank(there, "most_visible") == [1, 0, 2, 3]  # 0.52 and 0.48 are the same to a tenth
    unposed = replace(there[1], T_camera_object=None)
    assert rank([unposed, *there], "nearest") == [2, 1, 4, 3, 0]
