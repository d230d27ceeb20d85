"""The compiled steps of the shape fit: moves of the object, and its contact with a support."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st
from scipy.spatial import cKDTree

from pomona.skills.geometry import rotation_about, transform
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.refinement.shape_fit import (
    RIGID,
    Form,
    PlacedForm,
    Points,
    Priors,
    Support,
    _expected,
    _solve,
    _unlikeness,
    contact,
    move,
    points_to_surface,
    start_of_walk,
    step_until_still,
    surface_of,
    walk_to_nearest,
)

APPLE = load_fruit("apple")
DOWN = Support(np.array([0.0, -0.6, -0.8]), 0.55, 1e-3)


def on_fruit(form: Form, model: np.ndarray) -> np.ndarray:
    """Where points of the model are on the fruit, shape (n, 3) [m], as the text of `Form` defines it."""
    leaned = model.copy()
    leaned[:, 1] *= 1.0 + (model[:, [0, 2]] / form.radius) @ form.lean
    return leaned * form.stretch


def placed_apple(about: float, lean: tuple[float, float]) -> PlacedForm:
    R = rotation_about(np.array([0.6, 0.0, 0.8]), about)
    form = Form.scaled(APPLE, 0.9)
    return PlacedForm(
        R, np.array([0.1, -0.2, 0.7]), form.stretch * [1.1, 0.9, 1.0], np.array(lean), form.radius
    )


FEW = np.ascontiguousarray(APPLE.vertices[::40])


@pytest.mark.parametrize(
    ("about", "lean"), [(-2.0, (0.05, -0.04)), (0.4, (0.0, 0.06)), (1.9, (-0.03, 0.01))]
)
def test_the_gap_to_a_support_is_that_of_the_lowest_vertex_and_changes_as_its_row_says(about, lean):
    placed = placed_apple(about, lean)
    form = Form(placed.stretch, placed.lean, placed.radius)
    heights = (on_fruit(form, FEW) @ placed.R.T + placed.t) @ DOWN.normal + DOWN.offset
    gap, row = contact(FEW, placed, DOWN)
    assert gap == pytest.approx(heights.min(), abs=1e-12)
    step = 1e-7
    for k in range(11):
        after = PlacedForm(*(part.copy() for part in placed))
        move(after, step * np.eye(11)[k])
        assert (contact(FEW, after, DOWN)[0] - gap) / step == pytest.approx(row[k], abs=1e-5)


def test_a_step_comes_nearer_to_the_priors_by_its_part_in_their_directions():
    """The directions stand as a matrix and as logarithms and axes: both are one prior."""
    start = placed_apple(0.7, (0.02, -0.03))
    priors = Priors(0.02, 0.1, 0.2, 0.05, 0.3, 0.4, 0.5, 0.6, texture=1e-3)
    expected = _expected(start, Form(start.stretch, start.lean, start.radius), priors)
    deviations = [0.02] * 3 + [0.5, 0.5, 0.1, 0.2, 0.3, 0.4, 0.4, RIGID.turn]
    directions = expected.weighted * np.square(deviations)[:, None]
    np.testing.assert_allclose(expected.likeness, directions.T @ expected.weighted)
    before = _unlikeness(expected, start)
    round_ratio = -np.log(start.radius[0] / start.radius[1])
    at_start = [0.0] * 5 + [0.0, 0.05, round_ratio, -0.02, 0.03, 0.0]
    np.testing.assert_allclose(before, at_start, atol=1e-12)
    for k in range(11):
        after = PlacedForm(*(part.copy() for part in start))
        move(after, 1e-6 * np.eye(11)[k])
        came = (before - _unlikeness(expected, after)) / 1e-6
        np.testing.assert_allclose(came, directions[:, k], atol=1e-5)


@pytest.mark.parametrize(
    ("sizes", "priors", "turn", "roundness"),
    [
        ((0.1, 0.05, 0.08), Priors(), 0.35, 0.0),
        ((0.1, 0.05, 0.104), Priors(), 1e-4, np.log(1.04)),
        ((0.1, 0.05, 0.104), RIGID, 1e-4, 0.0),
    ],
)
def test_a_turn_is_free_and_roundness_the_models_own_where_it_is_not_round(
    sizes, priors, turn, roundness
):
    form = Form.scaled(trimesh.creation.box(sizes), 1.0)
    start = PlacedForm(np.eye(3), np.zeros(3), form.stretch, form.lean, form.radius)
    expected = _expected(start, form, priors)
    assert expected.likeness[10, 10] == pytest.approx(turn**-2)
    assert expected.roundness == pytest.approx(roundness)
    assert (expected.proportion, expected.texture) == (0.0, 5e-4)


def test_the_normal_equations_are_solved():
    part = np.random.default_rng(2).normal(size=(15, 11))
    H, b = part.T @ part, part[0]
    np.testing.assert_allclose(_solve(H, b), np.linalg.solve(H, b), rtol=1e-9)


def test_a_step_weighs_points_priors_and_support():
    thing = Object(np.array([0.02, -0.03, 0.01]), np.array([0.01, -0.02]), transform())
    points = on_fruit(thing.form, SAMPLES.points[::200])
    deviation = np.full(len(points), 1e-3)
    measured = Points(points, np.zeros((len(points), 3)), deviation, deviation)
    form = Form.scaled(BALL, 1.0)
    start = PlacedForm(np.eye(3), np.zeros(3), form.stretch, form.lean, form.radius)
    placed, stepped = (PlacedForm(*(part.copy() for part in start)) for _ in range(2))
    expected = _expected(start, form, Priors(place=2e-3, size=0.02, proportion=0.01))
    few = SAMPLES._replace(vertices=np.ascontiguousarray(BALL.vertices[::20]))
    support = Support(np.array([0.0, -1.0, 0.0]), 0.052, 2e-3)
    nowhere = np.full(len(points), -1)
    H, b, share = points_to_surface(measured, few, start, nowhere.copy(), 0.01, 5e-4, 80.0)
    gap, row = contact(few.vertices, start, support)
    whole = H + expected.likeness + np.outer(row, row) / 2e-3**2
    pull = b + _unlikeness(expected, start) @ expected.weighted - gap * row / 2e-3**2
    move(stepped, np.linalg.solve(whole, pull))
    found = step_until_still(measured, few, placed, nowhere, expected, support, np.full(1, 0.01))
    np.testing.assert_allclose(found[0], whole, rtol=1e-9)
    assert found[1] == share == 1.0
    for now, calculated in zip(placed, stepped, strict=True):
        np.testing.assert_allclose(now, calculated, rtol=1e-7, atol=1e-12)


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


BALL = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
SAMPLES = surface_of(BALL)
small = st.floats(-0.06, 0.06)


class Object:
    """A stretched, leaning and posed ball."""

    def __init__(self, ln: np.ndarray, lean: np.ndarray, T: np.ndarray) -> None:
        self.form, self.T = replace(Form.scaled(BALL, 1.0), stretch=np.exp(ln), lean=lean), T

    def placed(self) -> PlacedForm:
        R = np.ascontiguousarray(self.T[:3, :3])
        return PlacedForm(
            R,
            self.T[:3, 3].copy(),
            self.form.stretch.copy(),
            self.form.lean.copy(),
            self.form.radius,
        )

    def moved(self, x: np.ndarray) -> Object:
        """By a step of the fit's parameters, in the order in which the kernel has them."""
        placed = self.placed()
        move(placed, x)
        return Object(np.log(placed.stretch), placed.lean, transform(placed.R, placed.t))


def felt(thing: Object, point: np.ndarray, nearest: int) -> tuple[np.ndarray, float, int]:
    """Jacobian (11,) and distance [m] of one point outside of the surface, taken from its normal equations."""
    ray = -thing.T[:3, :3] @ np.array([0.0, 1.0, 0.0])
    ray = np.where(point @ ray > 0, 1.0, -1.0) * ray
    one = Points(point[None], np.zeros((1, 3)), np.array([1e-3]), np.array([1e-3]))
    index = np.array([nearest])
    H, b, share = points_to_surface(one, SAMPLES, thing.placed(), index, 0.01, 5e-4, 80.0)
    assert share == 1.0
    weight = H[0, 0] + H[1, 1] + H[2, 2]  # the first three of a Jacobian are a unit normal
    distance = float(np.linalg.norm(b[:3]) / weight)
    jacobian = b / (weight * distance)
    np.testing.assert_allclose(
        H, weight * np.outer(jacobian, jacobian), rtol=1e-9, atol=1e-9 * weight
    )
    return jacobian, distance, int(index[0])


@settings(max_examples=8)
@given(
    ln=st.tuples(*[st.floats(-0.4, 0.2)] * 3),
    lean=st.tuples(small, small),
    about=st.floats(-3.0, 3.0),
    sample=st.integers(0, len(SAMPLES.points) - 1),
)
def test_a_distance_changes_as_its_jacobian_says(ln, lean, about, sample):
    T = transform(rotation_about(np.array([0.6, 0.0, 0.8]), about), (0.1, -0.2, 0.7))
    thing = Object(np.array(ln), np.array(lean), T)
    on_it = T[:3, :3] @ on_fruit(thing.form, SAMPLES.points[sample : sample + 1])[0] + T[:3, 3]
    away = on_it - T[:3, 3]
    start = on_it + 1e-4 * away / np.linalg.norm(away)
    normal = felt(thing, start, sample)[0][:3]
    point = on_it + 1e-4 * normal
    jacobian, distance, nearest = felt(thing, point, sample)
    assert nearest == sample
    assert distance == pytest.approx(1e-4, rel=1e-6)
    step = 1e-7
    for k, by in enumerate(jacobian):
        after = felt(thing.moved(step * np.eye(11)[k]), point, sample)[1]
        assert (distance - after) / step == pytest.approx(by, abs=2e-4)


@settings(max_examples=10)
@given(
    ln=st.tuples(*[st.floats(-0.4, 0.2)] * 3),
    lean=st.tuples(small, small),
    face=st.integers(0, 20479),
)
def test_normals_are_those_of_the_deformed_mesh(ln, lean, face):
    thing = Object(np.array(ln), np.array(lean), np.eye(4))
    deformed = trimesh.Trimesh(on_fruit(thing.form, BALL.vertices), BALL.faces, process=False)
    normal = np.asarray(deformed.face_normals)[face]
    point = deformed.vertices[BALL.faces[face]].mean(axis=0) + 1e-3 * normal
    assert felt(thing, point, 0)[0][:3] @ normal > np.cos(
        np.radians(4.0)
    )  # a sample is up to 2 mm beside the point


@pytest.mark.parametrize("name", ["apple", "lemon"])
def test_after_a_step_or_from_the_grid_a_walk_ends_where_a_search_tree_does(name):
    samples = surface_of(load_fruit(name))
    rng = np.random.default_rng(3)
    points = samples.points[rng.integers(0, 4000, 3000)] + rng.normal(0.0, 3e-3, (3000, 3))
    tree = cKDTree(samples.points)
    nearest, index = tree.query(points)
    after_step = tree.query(points + rng.normal(0.0, 6e-3, points.shape))[1]
    assert np.mean(after_step != index) > 0.9
    for starts in (after_step, [start_of_walk(samples, *point) for point in points]):
        ends = [
            walk_to_nearest(samples, *point, start)
            for point, start in zip(points, starts, strict=True)
        ]
        too_far = np.linalg.norm(samples.points[ends] - points, axis=1) - nearest
        assert np.mean(too_far > 1e-9) < 1e-3


def test_a_walk_starts_beside_points_far_from_the_model():
    far = np.array([[9.0, 0.0, 0.0], [0.0, -9.0, 0.0], [0.0, 0.0, 9.0]])
    starts = [start_of_walk(SAMPLES, *point) for point in far]
    cosines = np.sum(SAMPLES.points[starts] * far, axis=1) / (0.05 * 9.0)
    assert np.all(cosines > 0.95)


def test_a_point_weighs_the_same_where_the_surface_is_slanted():
    """A grazed surface seems exact along its normal, and which of its points was measured is as unsure as the depth."""
    thing = Object(np.zeros(3), np.zeros(2), transform(translation=(0.0, 0.0, 0.6)))
    along = np.array([[0.0, 0.0, 1.0]])
    deviation = np.full(1, 5e-3)
    for beside in (0.0, 6e-3):
        for slant in (0.0, 0.5, 1.3):
            point = np.array([[0.05 * np.sin(slant), 0.0, 0.6 - 0.05 * np.cos(slant)]])
            one = Points(point, along, deviation, np.full(1, beside))
            H, _, share = points_to_surface(
                one, SAMPLES, thing.placed(), np.full(1, -1), 4e-3, 5e-4, 80.0
            )
            assert share == 1.0
            variance = deviation[0] ** 2 + 5e-4**2 + (beside * np.sin(slant)) ** 2
            assert np.trace(H[:3, :3]) == pytest.approx(1.0 / variance, rel=0.05)


def test_points_that_face_away_or_lie_too_far_do_not_count():
    thing = Object(np.zeros(3), np.zeros(2), transform(translation=(0.0, 0.0, 0.6)))
    points = np.array(
        [[0.0, 0.0, 0.5495], [0.0, 0.0, 0.6505], [0.0, 0.0, 0.53]]
    )  # the front, the back, before it
    rays = np.tile([0.0, 0.0, 1.0], (3, 1))
    deviation = np.full(3, 1e-3)
    H, b, share = points_to_surface(
        Points(points, rays, deviation, 0.0 * deviation),
        SAMPLES,
        thing.placed(),
        np.zeros(3, np.int64),
        4e-3,
        5e-4,
        80.0,
    )
    assert share == pytest.approx(1 / 3)
    assert H[2, 2] > 0.0
    assert b[2] < 0.0  # it lies before the surface, so the object comes towards the camera
