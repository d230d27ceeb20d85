"""A sphere from the depth in a box: whole, covered, cut, noisy, and surfaces that are none."""

import numpy as np
import pytest

from pomona.skills.perception.detection.sphere_in_box import NoSphere, sphere_in_box

K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])
RADII = 0.015, 0.08


def ball(centre: np.ndarray, radius: float, behind: float = 0.9) -> np.ndarray:
    """Depth of a sphere before a wall."""
    v, u = np.mgrid[:480, :640]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=2)
    a, b = (rays**2).sum(axis=2), rays @ centre
    inside = b**2 - a * (centre @ centre - radius**2)
    return np.where(inside > 0.0, (b - np.sqrt(np.maximum(inside, 0.0))) / a, behind).astype(np.float32)


def box_of(depth: np.ndarray, behind: float = 0.9) -> np.ndarray:
    v, u = np.nonzero(depth < behind - 1e-3)
    return np.array([u.min(), v.min(), u.max() - u.min() + 1, v.max() - v.min() + 1], float)


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.5), (0.15, -0.1, 0.4), (-0.2, 0.12, 0.7)])
@pytest.mark.parametrize("radius", [0.025, 0.045])
def test_a_sphere_in_sight_is_found_to_a_millimetre(centre: tuple[float, float, float], radius: float) -> None:
    depth = ball(np.array(centre), radius)
    noisy = depth * (1.0 + np.random.default_rng(0).normal(0.0, 2e-3, depth.shape)).astype(np.float32)
    found = sphere_in_box(noisy, K, box_of(depth), RADII)
    assert np.linalg.norm(found.centre - centre) < 2e-3
    assert found.radius == pytest.approx(radius, rel=0.05)
    assert found.seen > 0.8


def test_a_half_covered_sphere_keeps_its_centre(tmp_path: object) -> None:
    centre = np.array([0.05, 0.02, 0.5])
    depth = ball(centre, 0.045)
    x, y, w, h = box_of(depth)
    half = np.array([x, y, 0.5 * w, h])
    depth[:, int(x + 0.5 * w) :] = 0.3  # a leaf before its right half
    found = sphere_in_box(depth, K, half, RADII)
    assert np.linalg.norm(found.centre - centre) < 6e-3
    assert 0.3 < found.seen < 0.6


@pytest.mark.parametrize("missing", [0.0, np.nan])
def test_holes_in_the_depth_are_left_out(missing: float) -> None:
    centre = np.array([0.0, 0.0, 0.5])
    depth = ball(centre, 0.045)
    depth[::2] = missing
    assert np.linalg.norm(sphere_in_box(depth, K, box_of(ball(centre, 0.045)), RADII).centre - centre) < 2e-3


def test_an_implausible_shape_is_refused_with_both_values() -> None:
    box = np.array([280.0, 200.0, 80.0, 80.0])
    with pytest.raises(NoSphere, match=r"depth at 0 pixels of the box, expected at least 40"):
        sphere_in_box(np.zeros((480, 640), np.float32), K, box, RADII)
    steps = np.full((480, 640), 0.5, np.float32)
    steps[:, ::2] = 0.53
    with pytest.raises(NoSphere, match=r"% of the depth in the box is a sphere's, expected 50 %"):
        sphere_in_box(steps, K, box, RADII)
    depth = ball(np.array([0.0, 0.0, 0.5]), 0.045)
    with pytest.raises(NoSphere, match=r"a sphere (89|90|91) mm wide in the box, expected 20 to 60 mm"):
        sphere_in_box(depth, K, box_of(depth), (0.01, 0.03))


def test_a_box_beyond_the_border_has_no_depth() -> None:
    with pytest.raises(NoSphere, match="depth at 0 pixels"):
        sphere_in_box(np.full((480, 640), 0.5, np.float32), K, np.array([700.0, 10.0, 30.0, 30.0]), RADII)
