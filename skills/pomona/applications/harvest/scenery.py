"""Visible objects without contacts: a leaf's shape, the neighbours' foliage behind the wall, the sky."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.applications.harvest.wall import Wall
from pomona.executive import Float64

BEHIND = (0.30, 1.2)
"""How far behind the wall the neighbours' foliage hangs [m]."""
GREENS = ((0.16, 0.30, 0.10, 1.0), (0.22, 0.36, 0.13, 1.0), (0.12, 0.24, 0.09, 1.0))


def leaf_mesh(length: float, width_share: float) -> tuple[Float64, NDArray[np.int32]]:
    """Return a blade along x from 0, folded a little at its midrib and curved down: vertices (n, 3) [m], faces (m, 3).

    Both sides have faces, since a face is seen from its front only.
    """
    along = np.array([0.0, 0.12, 0.35, 0.62, 0.85, 1.0])
    half = 0.5 * width_share * np.array([0.0, 0.55, 1.0, 0.85, 0.42, 0.0])
    rib = np.stack([along, 0.0 * along, -0.10 * along**2], axis=1)
    left = rib + np.stack([0.0 * along, half, 0.22 * half], axis=1)
    right = rib + np.stack([0.0 * along, -half, 0.22 * half], axis=1)
    vertices = length * np.concatenate([rib, left, right])
    n = len(along)
    faces = []
    for k in range(n - 1):
        for edge, flip in ((n, False), (2 * n, True)):
            quad = [(k, k + 1, edge + k + 1), (k, edge + k + 1, edge + k)]
            faces += [(a, c, b) if flip else (a, b, c) for a, b, c in quad]
    front = np.array([f for f in faces if len({tuple(vertices[v]) for v in f}) == 3], np.int32)
    return vertices, np.concatenate([front, front[:, ::-1]])


@dataclass(frozen=True, slots=True)
class Scenery:
    """Foliage of the rows behind, as three meshes of many leaves, and a sky."""

    wall: Wall  # before it
    leaves: int = 2400  # how many

    def add_to(self, mujoco: Any, spec: Any) -> None:
        """Add it to a model; nothing of it collides."""
        rng = np.random.default_rng([self.wall.seed, 16])
        blade, faces = leaf_mesh(0.09, self.wall.numbers.leaf_width)
        shown = {"contype": 0, "conaffinity": 0, "group": 2}
        for k, green in enumerate(GREENS):
            count = self.leaves // len(GREENS)
            if count == 0:
                break
            vertices = np.concatenate(
                [blade @ _any_rotation(rng).T + self._place(rng) for _ in range(count)]
            )
            mesh = spec.add_mesh(name=f"behind_{k}")
            mesh.uservert = vertices.ravel()
            mesh.userface = (
                (faces[None] + len(blade) * np.arange(count)[:, None, None])
                .ravel()
                .astype(np.int32)
            )
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"behind_{k}", rgba=green, **shown
            )
        for x in rng.uniform(-1.6, 1.6, 4):
            y = self.wall.trunk[1] - rng.uniform(*BEHIND)
            post = spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE, rgba=(0.27, 0.21, 0.16, 1.0), **shown
            )
            post.fromto, post.size = (
                [x, y, self.wall.ground, x + 0.1, y, self.wall.ground + 2.05],
                [rng.uniform(0.02, 0.04), 0.0, 0.0],
            )
        sun = spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, castshadow=False
        )
        sun.dir = [rng.uniform(-0.6, 0.6), -0.7, -0.9]
        sun.diffuse = [0.50, 0.48, 0.44]
        spec.visual.headlight.ambient = [0.46, 0.46, 0.48]
        spec.add_texture(
            name="sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=[0.62, 0.72, 0.84],
            rgb2=[0.85, 0.88, 0.90],
            width=64,
            height=384,
        )

    def _place(self, rng: np.random.Generator) -> Float64:
        x, y, _ = self.wall.trunk
        return np.array(
            [
                x + rng.uniform(-1.6, 1.6),
                y - rng.uniform(*BEHIND),
                self.wall.ground + rng.uniform(0.2, 2.1),
            ]
        )


def _any_rotation(rng: np.random.Generator) -> Float64:
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    rotation: Float64 = q * np.sign(np.diag(r))
    upright: Float64 = rotation * np.sign(np.linalg.det(rotation))
    return upright
