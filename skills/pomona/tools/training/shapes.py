"""Shapes for synthetic scenes: fruit relatives, and things that are not fruit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32
from pomona.skills.perception.fruit import FruitModel
from pomona.tools.training.apple_mesh import (
    AppleShape,
    apple_mesh,
    revolution_faces,
    stem_mesh,
)


@dataclass(frozen=True, slots=True, eq=False)
class ShadedMesh:
    """Triangles with attributes for shading: positions (n, 3) [m], normals, faces (m, 3), ambient openness (n,)."""

    vertices: Float32
    normals: Float32
    faces: NDArray[np.int32]
    openness: Float32
    two_sided: bool = False


def make_shape(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], two_sided: bool = False
) -> ShadedMesh:
    """Return a shape with smooth normals and open everywhere."""
    corners = vertices[faces]
    face_normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], face_normals)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
    return ShadedMesh(
        vertices.astype(np.float32),
        normals.astype(np.float32),
        np.ascontiguousarray(faces, np.int32),
        np.ones(len(vertices), np.float32),
        two_sided,
    )


def with_hollows(shape: ShadedMesh) -> ShadedMesh:
    """Darken the stem cavity and the calyx basin by how deep a vertex lies under the rim on its side."""
    x, y, z = shape.vertices.T
    half_height = np.abs(y).max()
    half_width = np.hypot(x, z).max()
    depth = (half_height - np.abs(y)) / half_height
    inside = np.clip(1.0 - np.hypot(x, z) / (0.45 * half_width), 0.0, 1.0)
    openness = 1.0 - np.clip(3.2 * depth * inside, 0.0, 0.85)
    return ShadedMesh(
        shape.vertices, shape.normals, shape.faces, openness.astype(np.float32), shape.two_sided
    )


@lru_cache(maxsize=96)
def apple_relative(index: int) -> ShadedMesh:
    """Apple `index` of the library in the CAD cuboid; 0 is the CAD apple itself."""
    if index == 0:
        return with_hollows(make_shape(*apple_mesh(around=40, rings=28)))
    rng = np.random.default_rng((7, index))
    shape = AppleShape(
        lobes=rng.uniform(0.0, 0.045),
        lobe_phase=rng.uniform(0.0, 2.0 * np.pi),
        cavity=rng.uniform(0.65, 1.3),
        basin=rng.uniform(0.4, 1.9),
        belly=rng.uniform(-0.14, 0.14),
        lean=(rng.uniform(-0.06, 0.06), rng.uniform(-0.06, 0.06)),
    )
    return with_hollows(make_shape(*apple_mesh(shape, around=40, rings=28)))


_RELATIVES: dict[tuple[str, int], ShadedMesh] = {}


def fruit_relative(fruit: FruitModel, index: int) -> ShadedMesh:
    """Return fruit `index` of a kind's library, in the CAD model's cuboid; 0 is the CAD model itself.

    Apples vary by their outline; of any other kind the mesh is bent smoothly.
    """
    if fruit.name == "apple":
        return apple_relative(index)
    key = (fruit.name, index)
    if key not in _RELATIVES:
        rng = np.random.default_rng((9, index))
        vertices = fruit.vertices / (0.5 * fruit.dimensions)
        if index > 0:
            for _ in range(3):
                wave = rng.normal(0.0, 1.2, 3)
                swelling = rng.normal(0.0, 0.03) * np.sin(vertices @ wave + rng.uniform(0.0, 6.28))
                vertices = vertices * (1.0 + swelling)[:, None]
            vertices = vertices + np.outer(
                vertices[:, 1] ** 2, rng.normal(0.0, 0.04, 3) * (1.0, 0.0, 1.0)
            )
        low = vertices.min(axis=0)
        high = vertices.max(axis=0)
        fitted = (vertices - 0.5 * (low + high)) * (fruit.dimensions / (high - low))
        _RELATIVES[key] = make_shape(fitted, fruit.faces)
    return _RELATIVES[key]


@lru_cache(maxsize=16)
def stem(index: int) -> ShadedMesh:
    """Stem `index` of the library, in the CAD apple's frame."""
    rng = np.random.default_rng((11, index))
    return make_shape(
        *stem_mesh(
            length=rng.uniform(0.010, 0.034),
            radius=rng.uniform(0.0010, 0.0024),
            bend=rng.uniform(0.0, 0.7),
            azimuth=rng.uniform(0.0, 2.0 * np.pi),
        )
    )


def revolved(outline: NDArray[np.float64], around: int = 28) -> ShadedMesh:
    """Return a body of revolution about y from points (radius, y); first and last lie on the axis."""
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    inner = outline[1:-1]
    ring = np.stack(
        [
            inner[:, :1] * np.cos(angle),
            np.broadcast_to(inner[:, 1:], (len(inner), around)),
            inner[:, :1] * np.sin(angle),
        ],
        axis=-1,
    )
    vertices = np.vstack(
        [[[0.0, outline[0, 1], 0.0]], ring.reshape(-1, 3), [[0.0, outline[-1, 1], 0.0]]]
    )
    return make_shape(vertices, revolution_faces(around, len(inner)))


@lru_cache(maxsize=1)
def ball() -> ShadedMesh:
    """Return a unit sphere."""
    polar = np.linspace(0.0, np.pi, 20)
    return revolved(np.stack([np.sin(polar), -np.cos(polar)], axis=1))


@lru_cache(maxsize=1)
def box() -> ShadedMesh:
    """Return a cube from -1 to 1 with sharp edges."""
    vertices: list[NDArray[np.float64]] = []
    normals: list[NDArray[np.float64]] = []
    faces: list[list[int]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = np.zeros(3)
            right = np.zeros(3)
            normal[axis] = sign
            right[(axis + 1) % 3] = 1.0
            up = np.cross(normal, right)
            start = len(vertices)
            vertices += [
                normal + a * right + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
            ]
            normals += [normal] * 4
            faces += [[start, start + 1, start + 2], [start, start + 2, start + 3]]
    return ShadedMesh(
        np.array(vertices, np.float32),
        np.array(normals, np.float32),
        np.array(faces, np.int32),
        np.ones(24, np.float32),
    )


@lru_cache(maxsize=32)
def leaf(index: int) -> ShadedMesh:
    """Return a bent, pointed leaf of unit length."""
    rng = np.random.default_rng((13, index))
    t = np.linspace(0.0, 1.0, 9)
    half_width = rng.uniform(0.2, 0.36) * np.sin(np.pi * t**0.8) ** 0.9
    fold = rng.uniform(0.0, 0.5)
    curl = rng.uniform(-0.5, 0.9)
    rows = []
    for side in (-1.0, 0.0, 1.0):
        rows.append(
            np.stack(
                [side * half_width, -fold * half_width * abs(side) + curl * t**2 * 0.4, t], axis=1
            )
        )
    vertices = np.stack(rows, axis=1).reshape(-1, 3)
    faces = []
    for i in range(8):
        for j in range(2):
            a = 3 * i + j
            faces += [[a, a + 1, a + 3], [a + 1, a + 4, a + 3]]
    return make_shape(vertices, np.array(faces, np.int32), two_sided=True)


def capsule(length: float, radius: float) -> ShadedMesh:
    """Return a cylinder of `length` about y with half spheres of `radius` at its ends [m]."""
    polar = np.linspace(0.0, 0.5 * np.pi, 8)
    cap = np.stack([np.sin(polar), -np.cos(polar)], axis=1) * radius
    end = np.array([0.0, 0.5 * length])
    low = cap - end
    high = cap[::-1] * np.array([1.0, -1.0]) + end
    return revolved(np.vstack([low, high]))


def turned_body(rng: np.random.Generator) -> ShadedMesh:
    """Return a random smooth vessel, bulb or pear of about unit radius."""
    polar = np.linspace(0.0, np.pi, 22)
    wave = sum(
        rng.normal(0.0, 0.22 / k) * np.cos(k * polar + rng.uniform(0.0, 6.28)) for k in (1, 2, 3)
    )
    radius = np.sin(polar) * np.exp(wave)
    return revolved(np.stack([radius, -np.cos(polar) * rng.uniform(0.7, 2.2)], axis=1))


def cylinder() -> ShadedMesh:
    """Return a unit cylinder about y with nearly sharp rims."""
    outline = [
        (0.0, -1.0),
        (0.5, -1.0),
        (0.97, -1.0),
        (1.0, -0.97),
        (1.0, 0.0),
        (1.0, 0.97),
        (0.97, 1.0),
        (0.5, 1.0),
        (0.0, 1.0),
    ]
    return revolved(np.array(outline))
