"""The form of a fruit: its maps against numbers and against a mesh that was really deformed."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pomona.skills.perception.refinement.form import Form

BALL = trimesh.creation.icosphere(subdivisions=5, radius=0.05)


def test_lean_derivative_is_that_of_the_points():
    points, step = BALL.vertices[::50], 1e-6
    form = Form.scaled(BALL, 0.8).changed(np.array([0.1, -0.1, 0.0]), np.array([0.03, -0.02]))
    for axis in range(2):
        change = form.changed(np.zeros(3), step * np.eye(2)[axis]).points(points) - form.points(points)
        np.testing.assert_allclose(change[:, 1] / step, form.lean_derivative(points)[:, axis], atol=1e-9)
        np.testing.assert_allclose(change[:, [0, 2]], 0.0)


def test_cuboid_of_a_leaning_fruit_is_higher():
    upright = Form.scaled(BALL, 1.0)
    leaning = upright.changed(np.zeros(3), np.array([0.05, 0.0]))
    assert upright.cuboid(BALL)[1] == pytest.approx([0.1, 0.1, 0.1], rel=1e-3)
    assert leaning.cuboid(BALL)[1][1] > 0.1


def test_nearly_round_models_are_known(apple):
    assert Form.scaled(apple, 1.0).nearly_round
    assert not Form.scaled(trimesh.creation.box((0.1, 0.05, 0.08)), 1.0).nearly_round
