"""The compiled steps of the shape fit: moves of the object, and its contact with a support."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.skills.geometry import rotation_about
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.refinement.form import Form
from pomona.skills.perception.refinement.points_to_surface import PlacedForm
from pomona.skills.perception.refinement.shape_steps import Support, contact, move

APPLE = load_fruit("apple")
DOWN = Support(np.array([0.0, -0.6, -0.8]), 0.55, 1e-3)


def placed_apple(about: float, lean: tuple[float, float]) -> PlacedForm:
    R = rotation_about(np.array([0.6, 0.0, 0.8]), about)
    form = Form.scaled(APPLE, 0.9)
    return PlacedForm(R, np.array([0.1, -0.2, 0.7]), form.stretch * [1.1, 0.9, 1.0], np.array(lean), form.radius)


@given(st.floats(-3.0, 3.0), st.tuples(*[st.floats(-0.06, 0.06)] * 2))
def test_the_gap_to_a_support_is_that_of_the_lowest_vertex_and_changes_as_its_row_says(about, lean):
    placed = placed_apple(about, lean)
    form = Form(placed.stretch, placed.lean, placed.radius)
    heights = (form.points(APPLE.vertices) @ placed.R.T + placed.t) @ DOWN.normal + DOWN.offset
    gap, row = contact(APPLE.vertices, placed, DOWN)
    assert gap == pytest.approx(heights.min(), abs=1e-12)
    step = 1e-7
    for k in range(11):
        after = PlacedForm(*(part.copy() for part in placed))
        move(after, step * np.eye(11)[k])
        assert (contact(APPLE.vertices, after, DOWN)[0] - gap) / step == pytest.approx(row[k], abs=1e-5)


def test_a_step_turns_about_the_objects_axes_and_is_limited():
    placed = placed_apple(0.7, (0.01, 0.0))
    before = PlacedForm(*(part.copy() for part in placed))
    step = np.array([1e-3, 0.0, 0.0, 0.1, -0.2, 0.05, -0.05, 0.0, 0.01, 0.0, 0.05])
    move(placed, step)
    turn = step[[3, 10, 4]]
    angle = float(np.linalg.norm(turn))
    np.testing.assert_allclose(placed.R, before.R @ rotation_about(turn / angle, angle), atol=1e-12)
    np.testing.assert_allclose(placed.stretch, before.stretch * np.exp([0.05, -0.05, 0.0]))
    move(placed, 100.0 * step)
    np.testing.assert_allclose(placed.stretch, before.stretch * np.exp([0.25, -0.25, 0.0]))
    np.testing.assert_allclose(placed.lean, [0.07, 0.0])
    now = before.R @ rotation_about(turn / angle, angle) @ rotation_about(turn / angle, 0.3)
    np.testing.assert_allclose(placed.R, now, atol=1e-12)
