"""Meshes that enclose no volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import trimesh

from pomona.skills.perception.refinement.errors import BadMesh
from pomona.skills.perception.refinement.render import extents


@dataclass(frozen=True, eq=False)
class Shape:
    vertices: np.ndarray
    faces: np.ndarray


BALL = trimesh.creation.icosphere(subdivisions=1, radius=0.04)


def test_size_of_the_cuboid(apple):
    np.testing.assert_allclose(extents(apple), apple.dimensions, atol=1e-6)


def test_vertices_that_appear_twice_leave_no_gap():
    """As in files that keep a vertex per face corner."""
    separate = Shape(
        BALL.vertices[BALL.faces].reshape(-1, 3), np.arange(3 * len(BALL.faces)).reshape(-1, 3)
    )
    np.testing.assert_allclose(extents(separate), np.ptp(BALL.vertices, axis=0))


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        (Shape(BALL.vertices * [1.0, 0.0, 1.0], BALL.faces), "size in all three"),
        (Shape(0.0 * BALL.vertices, BALL.faces), "size in all three"),
        (Shape(BALL.vertices * np.nan, BALL.faces), "not finite"),
        (Shape(BALL.vertices, BALL.faces + 5), "do not exist"),
        (Shape(BALL.vertices, np.empty((0, 3), int)), "at least one face"),
        (Shape(np.empty((0, 3)), np.empty((0, 3), int)), "at least one face"),
        (Shape(BALL.vertices[:, :2], BALL.faces), r"\(n, 3\)"),
    ],
)
def test_bad_meshes_are_named(shape, reason):
    with pytest.raises(BadMesh, match=reason):
        extents(shape)
