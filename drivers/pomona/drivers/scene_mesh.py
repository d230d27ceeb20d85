"""Meshes of the arm's surroundings, cut into parts whose convex hulls are the obstacles.

A hull contains its part, so a coarse cut keeps the arm too far away, never too near.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from pomona.drivers.errors import UnusableMesh
from pomona.drivers.interfaces import Hull
from pomona.executive.values.arrays import Float64, Int64
from pomona.executive.values.mesh_file import MOST_TRIANGLES, UnreadableMeshError, read_mesh

LARGEST, SMALLEST = 20.0, 0.002  # sizes of anything that an arm may hit [m]; else the unit is another
MOST_PARTS = 400  # each costs every collision check about as much as a box


def read_parts(path: Path, unit: float = 1.0, detail: float | None = None) -> tuple[Hull, ...]:
    """Read the parts of a mesh file (STL, OBJ, PLY), in its own frame; `unit` is that of its numbers [m].

    Its surface is cut by cubes with the edge `detail` [m]; None: each body of the file is one part.

    Raises UnusableMesh: no mesh can be read, it is empty, or its size is impossible in this unit.
    """
    try:
        state = path.stat()
    except OSError as error:
        raise UnusableMesh(f"{path} cannot be read: {error.strerror}") from error
    return _parts(path, state.st_mtime_ns, state.st_size, unit, detail)


@lru_cache(maxsize=16)
def _parts(path: Path, _changed: int, _size: int, unit: float, detail: float | None) -> tuple[Hull, ...]:
    vertices, faces = _triangles(path)
    vertices = vertices * unit
    size = vertices.max(axis=0) - vertices.min(axis=0)
    told = f"{path.name} is {' x '.join(f'{edge:.4g}' for edge in size)} m large"
    if size.max() > LARGEST:
        raise UnusableMesh(f"{told}: if it is in millimetres, write `unit: mm`")
    if size.max() < SMALLEST:
        raise UnusableMesh(f"{told}: if it is in metres, write `unit: m`")
    groups = _bodies(vertices, faces) if detail is None else _cubes(vertices, faces, detail, path.name)
    if len(groups) > MOST_PARTS:
        what = "bodies: join them, or cut it with `detail`" if detail is None else "parts: take a coarser `detail`"
        raise UnusableMesh(f"{path.name} has {len(groups)} {what}; {MOST_PARTS} parts are taken at most")
    return tuple(_hull(path.stem, corners) for corners in groups)


def _triangles(path: Path) -> tuple[Float64, Int64]:
    """Vertices (n, 3) and faces (m, 3) that use them all."""
    try:
        vertices, faces = read_mesh(path)
    except UnreadableMeshError as error:
        raise UnusableMesh(f"{path.name} {error}") from error
    used, numbers = np.unique(faces, return_inverse=True)
    if not np.isfinite(vertices[used]).all():
        raise UnusableMesh(f"{path.name} has vertices that are not finite numbers")
    return vertices[used], numbers.reshape(faces.shape)


def _bodies(vertices: Float64, faces: Int64) -> list[Float64]:
    """Return the triangles (m, 3, 3) of each connected body."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    _same, welded = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)  # STL repeats its corners
    joined = welded.reshape(-1)[faces]
    ends = joined[:, [0, 0]], joined[:, [1, 2]]
    count = int(joined.max()) + 1
    edges = coo_array((np.ones(2 * len(faces)), (ends[0].ravel(), ends[1].ravel())), shape=(count, count))
    label = connected_components(edges, directed=False)[1][joined[:, 0]]
    return [vertices[faces[label == body]] for body in np.unique(label)]


def _cubes(vertices: Float64, faces: Int64, detail: float, name: str) -> list[Float64]:
    """Return triangles (m, 3, 3) of each cube of the surface, cut until none is longer than a cube's edge."""
    triangles = vertices[faces]
    while len(triangles):
        sides = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        long = sides.max(axis=1) > detail
        if not long.any():
            break
        if len(triangles) + long.sum() > MOST_TRIANGLES:
            raise UnusableMesh(f"{name} has too many parts: take a coarser `detail`")
        triangles = np.concatenate((triangles[~long], _halved(triangles[long], sides[long].argmax(axis=1))))
    cube = np.floor(triangles.mean(axis=1) / detail).astype(np.int64)
    _cubes_there, label = np.unique(cube, axis=0, return_inverse=True)
    order = np.argsort(label.reshape(-1), kind="stable")
    return np.split(triangles[order], np.flatnonzero(np.diff(label.reshape(-1)[order])) + 1)


def _halved(triangles: Float64, longest: Int64) -> Float64:
    """Return each triangle (m, 3, 3) as two, cut at the middle of its side from corner `longest` to the next."""
    rows = np.arange(len(triangles))
    a, b, c = (triangles[rows, (longest + k) % 3] for k in range(3))
    middle = (a + b) / 2.0
    return np.concatenate((np.stack((a, middle, c), axis=1), np.stack((middle, b, c), axis=1)))


def _hull(name: str, triangles: Float64) -> Hull:
    """Return the hull of a part: its corners, and the normals of its largest faces."""
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(across, axis=1)
    known = area > 1e-12
    looks, of = np.unique(np.round(across[known] / area[known, None], 3), axis=0, return_inverse=True)
    weight = np.bincount(of.reshape(-1), area[known], len(looks))
    # Maximum number of face directions that define a part's hull, the largest faces first; others round it off
    largest = looks[np.argsort(-weight, kind="stable")[:64]]
    normals = np.concatenate((largest, -largest))  # of a sheet both sides, however it is wound
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Hull(name, np.unique(triangles.reshape(-1, 3), axis=0), normals)
