"""Whether a covariance is true is counted: errors drawn from it lie inside its ellipsoids as often as they should."""

import numpy as np
import pytest

from pomona.skills.geometry import transform
from pomona.skills.perception.detection.close_look import label_rotation, look_at, minimal_rotation
from pomona.skills.perception.detection.instances import Instance
from pomona.tools.training.annotations import AnnotatedObject
from pomona.tools.training.pose_calibration import (
    FREEDOM,
    PoseErrors,
    coverage,
    pose_calibration_table,
    pose_errors,
    seen_as_cad_sized,
)

K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])
POINTS = np.zeros((9, 2))
T = transform(label_rotation((0.1, -0.9, -0.3), (0.1, -0.05, 0.5)), (0.1, -0.05, 0.5))
COVARIANCE = np.diag([0.01, 0.01, 0.01, 4e-6, 2e-6, 9e-5]) + np.pad(np.full((3, 3), 1e-6), (3, 0))


def drawn(seed: int, wider: float = 1.0) -> list[PoseErrors]:
    """Return errors of poses whose truth is scattered by the covariance, or `wider` times as much."""
    rng = np.random.default_rng(seed)
    errors = []
    for off in rng.multivariate_normal(np.zeros(6), wider**2 * COVARIANCE, 800):
        angle = float(np.linalg.norm(off[:3]))
        axis = off[:3] / angle
        skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turn = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
        truth = AnnotatedObject(
            "apple", 1.0, transform(turn @ T[:3, :3], T[:3, 3] + off[3:]), POINTS
        )
        found = pose_errors(Instance(POINTS, 0.9, 1.0, T, COVARIANCE), truth)
        assert found is not None
        errors.append(found)
    return errors


def test_errors_of_the_covariance_lie_inside_as_often_as_they_should() -> None:
    errors = drawn(0)
    for key in FREEDOM:
        for level in (0.5, 0.9):
            assert coverage(errors, key, level) == pytest.approx(level, abs=0.04)
    assert "| drawn | 800 | 0." in pose_calibration_table({"drawn": errors})


def test_a_covariance_that_is_too_small_is_found() -> None:
    errors = drawn(1, wider=2.0)
    for key in FREEDOM:
        assert coverage(errors, key, 0.9) < 0.75


@pytest.mark.parametrize("scale", [0.8, 1.0, 1.3])
def test_a_fruit_of_another_size_is_expected_where_a_perfect_look_puts_a_cad_sized_one(
    scale: float,
) -> None:
    truth = AnnotatedObject("apple", 1.0, T, POINTS, scale)
    look = look_at(K, T[:2, 3] / T[2, 3] * 610.6 + K[:2, 2], 100.0)
    p_camera, _ = look.place(look.label(T, scale))
    assert seen_as_cad_sized(truth) == pytest.approx(p_camera, abs=1e-9)


def test_an_axis_upside_down_lies_outside_and_a_find_without_pose_is_not_counted() -> None:
    flipped = transform(minimal_rotation((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)) @ T[:3, :3], T[:3, 3])
    truth = AnnotatedObject("apple", 1.0, flipped, POINTS)
    errors = pose_errors(Instance(POINTS, 0.9, 1.0, T, COVARIANCE), truth)
    assert errors is not None
    assert errors.place == pytest.approx(0.0, abs=1e-12)
    assert errors.axis > 100.0
    assert pose_errors(Instance(POINTS, 0.9, 1.0, None, None, "no pose"), truth) is None
    assert np.isnan(coverage([], "axis", 0.9))
