"""A model's surface as points with normals, for matching measured points to it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from executive.values.arrays import Float64
from skills.perception.refinement.depth_image import Triangles

_SAMPLES = 4000


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Evenly spread points of a mesh, shape (n, 3) [m], with outward unit normals, shape (n, 3), and a search tree."""

    points: Float64
    normals: Float64
    tree: cKDTree


@lru_cache(maxsize=8)
def surface_of(mesh: Triangles) -> Surface:
    """Sample a mesh; the same mesh object gives the same samples."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    share = np.cumsum(area) / area.sum()
    face = np.minimum(np.searchsorted(share, (np.arange(_SAMPLES) + 0.5) / _SAMPLES), len(area) - 1)
    along, across = np.random.default_rng(0).random((2, _SAMPLES))
    root = np.sqrt(along)
    weights = np.column_stack([1.0 - root, root * (1.0 - across), root * across])
    points = np.einsum("nc,nci->ni", weights, corners[face])
    return Surface(points, normals[face] / area[face, None], cKDTree(points))
