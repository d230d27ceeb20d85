"""The paper's method finds the optimum that the closed form names."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.skills.perception.refinement import DepthLook, Limits, refine
from pomona.skills.perception.refinement.paper import moved_and_scaled, sigma_bound


def test_sigma_moves_along_the_ray_and_scales_with_the_distance():
    T = np.eye(4)
    T[:3, 3] = [0.1, -0.2, 0.5]
    moved = moved_and_scaled(T, 0.1)
    length = np.linalg.norm(T[:3, 3])
    assert np.linalg.norm(moved[:3, 3]) == pytest.approx(length - 0.1)
    np.testing.assert_allclose(np.cross(moved[:3, 3], T[:3, 3]), 0.0, atol=1e-12)
    np.testing.assert_allclose(moved[:3, :3], np.eye(3) * (length - 0.1) / length)
    assert sigma_bound(T[:3, 3]) == pytest.approx(0.4)


@pytest.mark.parametrize("elevation", [35, 60, 80])
def test_both_methods_agree_on_noisy_depth(scene, apple, elevation):
    """They choose their inliers differently; with the inliers alike, so is the scale."""
    s = scene((89, 81, 89), elevation, 1)
    results = [
        refine(
            DepthLook(s.depth, s.intrinsics, renderer="zbuffer"),
            s.T_camera_detected,
            apple,
            method=method,
            limits=Limits(8e-3),
        )
        for method in ("uniform", "paper")
    ]
    assert results[0].mu == pytest.approx(results[1].mu, abs=4e-3)
    assert np.linalg.norm(results[0].T_camera_object[:3, 3] - results[1].T_camera_object[:3, 3]) < 3e-3
    assert results[1].method == "paper"
