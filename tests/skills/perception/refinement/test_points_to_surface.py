"""The compiled step of the shape fit, one point at a time: its normal, its distance and how they change."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, strategies as st

from pomona.skills.geometry import rotation_about, transform
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.refinement.form import Form
from pomona.skills.perception.refinement.points_to_surface import PlacedForm, Points, points_to_surface, walk_to_nearest
from pomona.skills.perception.refinement.surface import surface_of

BALL = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
SAMPLES = surface_of(BALL).samples
small = st.floats(-0.06, 0.06)


class Object:
    """A stretched, leaning and posed ball."""

    def __init__(self, ln: np.ndarray, lean: np.ndarray, T: np.ndarray) -> None:
        self.form, self.T = Form.scaled(BALL, 1.0).changed(ln, lean), T

    def placed(self) -> PlacedForm:
        R = np.ascontiguousarray(self.T[:3, :3])
        return PlacedForm(R, self.T[:3, 3].copy(), self.form.stretch, self.form.lean, self.form.radius)

    def moved(self, x: np.ndarray) -> Object:
        """By a step of the fit's parameters, in the order in which the kernel has them."""
        after = Object(np.zeros(3), np.zeros(2), self.T.copy())
        turn = x[[3, 10, 4]]
        angle = float(np.linalg.norm(turn))
        if angle:
            after.T[:3, :3] = after.T[:3, :3] @ rotation_about(turn / angle, angle)
        after.T[:3, 3] += x[:3]
        after.form = self.form.changed(x[5:8], x[8:10])
        return after


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
    np.testing.assert_allclose(H, weight * np.outer(jacobian, jacobian), rtol=1e-9, atol=1e-9 * weight)
    return jacobian, distance, int(index[0])


@given(
    ln=st.tuples(*[st.floats(-0.4, 0.2)] * 3),
    lean=st.tuples(small, small),
    about=st.floats(-3.0, 3.0),
    sample=st.integers(0, len(SAMPLES.points) - 1),
)
def test_a_distance_changes_as_its_jacobian_says(ln, lean, about, sample):
    T = transform(rotation_about(np.array([0.6, 0.0, 0.8]), about), (0.1, -0.2, 0.7))
    thing = Object(np.array(ln), np.array(lean), T)
    on_it = T[:3, :3] @ thing.form.points(SAMPLES.points[sample : sample + 1])[0] + T[:3, 3]
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


@given(ln=st.tuples(*[st.floats(-0.4, 0.2)] * 3), lean=st.tuples(small, small), face=st.integers(0, 20479))
def test_normals_are_those_of_the_deformed_mesh(ln, lean, face):
    thing = Object(np.array(ln), np.array(lean), np.eye(4))
    deformed = trimesh.Trimesh(thing.form.points(BALL.vertices), BALL.faces, process=False)
    normal = np.asarray(deformed.face_normals)[face]
    point = deformed.vertices[BALL.faces[face]].mean(axis=0) + 1e-3 * normal
    assert felt(thing, point, 0)[0][:3] @ normal > np.cos(np.radians(4.0))  # a sample is up to 2 mm beside the point


@pytest.mark.parametrize("name", ["apple", "lemon"])
def test_after_a_step_a_walk_ends_where_a_search_tree_does(name):
    surface = surface_of(load_fruit(name))
    rng = np.random.default_rng(3)
    points = surface.samples.points[rng.integers(0, 4000, 3000)] + rng.normal(0.0, 3e-3, (3000, 3))
    nearest, index = surface.tree.query(points)
    starts = surface.tree.query(points + rng.normal(0.0, 6e-3, points.shape))[1]
    assert np.mean(starts != index) > 0.9
    ends = [walk_to_nearest(surface.samples, *point, start) for point, start in zip(points, starts, strict=True)]
    too_far = np.linalg.norm(surface.samples.points[ends] - points, axis=1) - nearest
    assert np.mean(too_far > 1e-9) < 1e-3


def test_points_that_face_away_or_lie_too_far_do_not_count():
    thing = Object(np.zeros(3), np.zeros(2), transform(translation=(0.0, 0.0, 0.6)))
    points = np.array([[0.0, 0.0, 0.5495], [0.0, 0.0, 0.6505], [0.0, 0.0, 0.53]])  # the front, the back, before it
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
