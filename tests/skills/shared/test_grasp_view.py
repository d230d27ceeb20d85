"""The fruit of a view has the measured size, place and outline."""

from __future__ import annotations

import numpy as np

from pomona.skills.motion.collision.distance_field import fruit_points
from pomona.skills.shared.grasp_view import fruit_mesh
from tests.skills.picking_scene import apple_at


def test_a_measured_apple_is_drawn_with_its_size_its_cavity_and_its_stem() -> None:
    fruit = apple_at(3, 2, yaw=0.4)
    mesh = fruit_mesh(fruit)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    volume = abs(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0
    x, y, z = fruit.dimensions
    assert (
        0.75 * np.pi / 6.0 * x * y * z < volume < 1.2 * np.pi / 6.0 * x * y * z
    )  # closed, all faces outwards
    points = fruit_points(fruit)
    assert np.abs(mesh.vertices.min(axis=0) - points.min(axis=0)).max() < 4e-3
    assert np.abs(mesh.vertices.max(axis=0)[:2] - points.max(axis=0)[:2]).max() < 4e-3
    assert mesh.vertices[:, 2].max() > points[:, 2].max() + 2e-3  # the stem
    assert len(mesh.vertices) < 600
    axis = np.hypot(*(mesh.vertices[:, :2] - fruit.T_base_fruit[:2, 3]).T) < 0.09 * x
    assert (
        mesh.vertices[axis, 2].min() > points[:, 2].min() + 2e-3
    )  # the basin below, which a convex hull would close
