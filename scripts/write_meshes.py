"""Write the catalogue's own meshes: `python -m scripts.write_meshes`."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray

from pomona.skills.perception.fruit.catalogue import CATALOGUE
from pomona.tools.training.apple_mesh import apple_mesh, fit_to_cuboid, revolution_faces, stem_mesh

AROUND, RINGS = 64, 40  # corners of a ring, and rings between the poles
LEMON_DIMENSIONS = (0.0580, 0.0820, 0.0580)  # cuboid (d_x, d_y, d_z) of the CAD lemon [m]; d_y runs from neck to nipple


def write_meshes() -> None:
    """Write the meshes (binary PLY) that fruit.yaml files name into the catalogue."""
    meshes = {"apple/apple.ply": apple_mesh(), "apple/stem.ply": stem_mesh(), "lemon/lemon.ply": lemon_mesh()}
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


if __name__ == "__main__":
    write_meshes()
