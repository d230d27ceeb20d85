"""Restarts of a fit: poses with another axis of the stem, and their refinement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.drivers.depth_model import SIMULATED
from pomona.executive.values.rotations import is_rigid
from pomona.skills.geometry import rot_x, rot_y, rotation_about, transform
from pomona.skills.perception.refinement import DepthLook, FruitContext, refine
from pomona.skills.perception.refinement.cloud import Plane
from pomona.skills.perception.refinement.measure import other_starts

angles = st.floats(-np.pi, np.pi)


@given(angles, angles, angles, st.booleans())
def test_every_start_is_a_pose_at_the_same_place_with_a_new_axis(a, b, c, standing):
    T = transform(rot_x(a) @ rot_y(b) @ rot_x(c), [0.1, 0.0, 0.5])
    up = rot_y(c) @ np.array([0.0, -1.0, 0.0])
    starts = other_starts(T, Plane(up, 0.3) if standing else None)
    assert all(is_rigid(start, 1e-6) for start in starts)
    assert all(np.array_equal(start[:3, 3], T[:3, 3]) for start in starts)
    stems = np.array([-start[:3, 1] for start in starts])
    wanted = [up, -up, T[:3, 1]] if standing else [T[:3, 1]]
    for stem in wanted:
        assert np.abs(stems - stem).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("degrees", [45, 90, 136, 180])
@pytest.mark.parametrize("on_table", [True, False])
def test_a_detection_with_a_wrong_axis_is_recovered_from(scene, apple, degrees, on_table):
    errors = []
    for seed, size in enumerate(((93, 73, 93), (62, 47, 62), (89, 81, 89))):
        seen = scene(size, 50, seed)
        T = seen.T_camera_detected.copy()
        T[:3, :3] = T[:3, :3] @ rotation_about(
            (np.sqrt(0.5), 0.0, np.sqrt(0.5)), np.radians(degrees)
        )
        seen = replace(seen, T_camera_detected=T)
        support = seen.table if on_table else None
        look = DepthLook(seen.depth, seen.intrinsics, SIMULATED, renderer="zbuffer")
        result = refine(look, T, apple, known=FruitContext(support=support))
        errors.append(seen.errors(result.T_camera_object, result.dimensions))
    centroid, size = np.median(errors, axis=0)
    assert centroid < (1.5 if on_table else 4.0)
    assert size < (2.0 if on_table else 8.0)
