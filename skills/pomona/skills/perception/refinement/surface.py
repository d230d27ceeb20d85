"""A model's surface as points with normals, for matching measured points to it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from pomona.skills.perception.refinement.checks import winding
from pomona.skills.perception.refinement.depth_image import Triangles
from pomona.skills.perception.refinement.points_to_surface import Samples

_SAMPLES = 4000
_NEIGHBOURS = 16
"""Number of neighbours of a sample that are tried for one that is nearer to a point. After a step of up to 10 mm a
search from neighbour to neighbour ends beside the nearest sample for 1 of 10 000 points about the shipped fruit (12: 1
of 1 000)."""
_CELLS, _BESIDE = 24, 0.1
"""Number of the grid's cells along each axis, and how far it reaches beyond the model, relative to its size."""


@lru_cache(maxsize=8)
def surface_of(mesh: Triangles) -> Samples:
    """Sample a mesh; the same mesh object gives the same samples.

    Normals look outwards also where faces are wound inwards, or not alike as in scans with holes: there away from the
    middle, as every part of a fruit's skin does.
    """
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    wound = winding(mesh)
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    away = np.einsum("ij,ij->i", normals, corners.mean(axis=1) - middle)
    normals *= wound if wound else np.where(away < 0.0, -1.0, 1.0)[:, None]
    area = np.linalg.norm(normals, axis=1)
    share = np.cumsum(area) / area.sum()
    face = np.minimum(np.searchsorted(share, (np.arange(_SAMPLES) + 0.5) / _SAMPLES), len(area) - 1)
    along, across = np.random.default_rng(0).random((2, _SAMPLES))
    root = np.sqrt(along)
    weights = np.column_stack([1.0 - root, root * (1.0 - across), root * across])
    points = np.einsum("nc,nci->ni", weights, corners[face])
    tree = cKDTree(points)
    neighbours = np.ascontiguousarray(tree.query(points, _NEIGHBOURS + 1)[1][:, 1:], dtype=np.int32)
    low, high = points.min(axis=0), points.max(axis=0)
    corner = low - _BESIDE * (high - low)
    edges = (1.0 + 2.0 * _BESIDE) * (high - low) / _CELLS
    middles = corner + edges * (np.indices((_CELLS, _CELLS, _CELLS)).transpose(1, 2, 3, 0) + 0.5)
    near = tree.query(middles)[1].astype(np.int32)
    vertices = np.array(mesh.vertices, dtype=np.float64)
    return Samples(points, normals[face] / area[face, None], neighbours, near, corner, edges, vertices)
