"""A model's surface as points with normals, for matching measured points to it."""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Evenly spread points of a mesh with outward unit normals and neighbours, and a search tree of them."""

    samples: Samples
    tree: cKDTree


@lru_cache(maxsize=8)
def surface_of(mesh: Triangles) -> Surface:
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
    return Surface(Samples(points, normals[face] / area[face, None], neighbours), tree)
