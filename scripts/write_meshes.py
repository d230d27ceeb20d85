"""Write the catalogue's own meshes: `python -m scripts.write_meshes`."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from pomona.skills.perception.fruit.catalogue import CATALOGUE
from pomona.tools.training.apple_mesh import apple_mesh, fit_to_cuboid, revolution_faces, stem_mesh

AROUND, RINGS = 64, 40  # corners of a ring, and rings between the poles
LEMON_DIMENSIONS = (
    0.0580,
    0.0820,
    0.0580,
)  # cuboid (d_x, d_y, d_z) of the CAD lemon [m]; d_y runs from neck to nipple

# Outline of a fruit from the stem's pole to the other one: distance from the axis over the largest, and height over the
# half height. Drawn by eye; the size of a real fruit is measured, its proportions are fitted.
OUTLINES = {
    "orange": (
        (0, 0.95), (0.15, 0.97), (0.35, 0.93), (0.7, 0.71), (0.95, 0.3), (1, 0), (0.95, -0.32),
        (0.7, -0.73), (0.4, -0.93), (0.2, -0.99), (0, -1),
    ),
    "peach": (
        (0, 0.72), (0.1, 0.8), (0.25, 0.93), (0.45, 0.97), (0.75, 0.73), (0.96, 0.32), (1, 0.03),
        (0.95, -0.3), (0.72, -0.7), (0.42, -0.92), (0.18, -0.99), (0, -1),
    ),
    "pear": (
        (0, 0.98), (0.15, 0.99), (0.3, 0.9), (0.38, 0.7), (0.44, 0.5), (0.58, 0.22), (0.82, -0.08),
        (0.98, -0.38), (0.98, -0.6), (0.8, -0.85), (0.5, -0.98), (0.2, -0.97), (0, -0.93),
    ),
    "tomato": (
        (0, 0.68), (0.12, 0.76), (0.3, 0.93), (0.5, 0.98), (0.78, 0.78), (0.97, 0.34), (1, 0.02),
        (0.96, -0.35), (0.75, -0.78), (0.45, -0.97), (0.2, -0.99), (0, -0.97),
    ),
}  # fmt: skip
DIMENSIONS = {
    "orange": (0.0800, 0.0800, 0.0800),
    "peach": (0.0700, 0.0660, 0.0700),
    "pear": (0.0650, 0.0950, 0.0650),
    "tomato": (0.0700, 0.0590, 0.0700),
}
"""Cuboids (d_x, d_y, d_z) [m] of a fruit of a usual size; d_y is the height."""


def write_meshes() -> None:
    """Write the meshes (binary PLY) that fruit.yaml files name into the catalogue."""
    meshes = {
        "apple/apple.ply": apple_mesh(),
        "apple/stem.ply": stem_mesh(),
        "lemon/lemon.ply": lemon_mesh(),
    }
    meshes |= {f"{name}/{name}.ply": turned_mesh(name) for name in OUTLINES}
    for name, (vertices, faces) in meshes.items():
        trimesh.Trimesh(vertices, faces, process=False).export(CATALOGUE / name)


def lemon_mesh() -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Build a watertight lemon, stem along -y, centred in its cuboid; vertices (n, 3) [m] and faces (m, 3)."""
    polar = np.linspace(0.0, np.pi, RINGS + 2)
    body = np.sin(polar) ** 1.15
    nipple = 0.16 * np.exp(-(((polar - np.pi) / 0.30) ** 2))
    neck = 0.07 * np.exp(-((polar / 0.22) ** 2))
    height = np.cos(polar) * 0.86 + neck - nipple
    body[[0, -1]] = 0.0
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    x, z = body[1:-1, None] * np.cos(angle), body[1:-1, None] * np.sin(angle)
    y = -np.broadcast_to(height[1:-1, None], x.shape)
    poles = np.array([[0.0, -height[0], 0.0], [0.0, -height[-1], 0.0]])
    vertices = np.vstack([poles[:1], np.stack([x, y, z], axis=-1).reshape(-1, 3), poles[1:]])
    return fit_to_cuboid(vertices, LEMON_DIMENSIONS), revolution_faces(AROUND, RINGS)


def turned_mesh(name: str) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Build a watertight fruit by its outline, stem along -y, in its cuboid; vertices (n, 3) [m] and faces (m, 3)."""
    radius, height = PchipInterpolator(np.arange(len(OUTLINES[name])), OUTLINES[name])(
        np.linspace(0.0, len(OUTLINES[name]) - 1.0, RINGS + 2)
    ).T
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    x, z = radius[1:-1, None] * np.cos(angle), radius[1:-1, None] * np.sin(angle)
    y = -np.broadcast_to(height[1:-1, None], x.shape)
    poles = np.array([[0.0, -height[0], 0.0], [0.0, -height[-1], 0.0]])
    vertices = np.vstack([poles[:1], np.stack([x, y, z], axis=-1).reshape(-1, 3), poles[1:]])
    return fit_to_cuboid(vertices, DIMENSIONS[name]), revolution_faces(AROUND, RINGS)


if __name__ == "__main__":
    write_meshes()
