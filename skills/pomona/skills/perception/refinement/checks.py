"""Is this a depth image, a pose, a mesh?"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import is_pose
from pomona.skills.perception.refinement.depth_image import Triangles
from pomona.skills.perception.refinement.errors import BadDepth, BadMesh, BadPose


def check_depth(depth: object, intrinsics: Intrinsics) -> None:
    """Raises BadDepth: not an array of real numbers with the shape of the camera's image."""
    expected = (intrinsics.height, intrinsics.width)
    if not isinstance(depth, np.ndarray) or depth.dtype.kind not in "fiu":
        raise BadDepth("the depth must be an array of real numbers [m]; this camera may be colour only")
    if depth.shape != expected:
        raise BadDepth(f"the depth's shape is {depth.shape}, the intrinsics are of an image of shape {expected}")


def check_pose(T_camera_object: Float64) -> None:
    """Raises BadPose: not a finite rigid transform."""
    if not is_pose(np.asarray(T_camera_object)):
        raise BadPose(f"not a rigid transform: {np.asarray(T_camera_object).tolist()}")


@lru_cache(maxsize=32)
def extents(mesh: Triangles) -> Float64:
    """Return the size of a mesh's cuboid (d_x, d_y, d_z) [m], shape (3,); remembered per mesh object.

    Raises BadMesh: empty, not finite, or of zero size in some direction. A mesh with holes is valid.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if vertices.ndim != 2 or vertices.shape[1:] != (3,) or faces.ndim != 2 or faces.shape[1:] != (3,) or not len(faces):
        raise BadMesh("a mesh needs vertices of shape (n, 3) and at least one face of shape (m, 3)")
    if not np.isfinite(vertices).all():
        raise BadMesh("the mesh has vertices that are not finite")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise BadMesh(f"the mesh's faces name vertices that do not exist (it has {len(vertices)})")
    size: Float64 = np.ptp(vertices[np.unique(faces)], axis=0).astype(np.float64)
    if size.min() <= 0.0:
        raise BadMesh(f"the mesh measures {size.tolist()} m: it must have a size in all three directions")
    size.flags.writeable = False
    return size


@lru_cache(maxsize=32)
def farthest(mesh: Triangles) -> float:
    """Return the greatest distance of a vertex from the mesh's origin [m]; remembered per mesh object."""
    return float(np.linalg.norm(mesh.vertices, axis=1).max())


@lru_cache(maxsize=32)
def winding(mesh: Triangles) -> int:
    """1: the mesh encloses a volume and its faces look outwards; -1: they look inwards; 0: it is not watertight."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    _, welded = np.unique(vertices, axis=0, return_inverse=True)
    corners = welded.reshape(-1)[faces]
    directed = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    there, times = np.unique(directed, axis=0, return_counts=True)
    back = np.unique(directed[:, ::-1], axis=0)
    if not np.array_equal(there, back) or times.max() > 1:
        return 0
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return int(np.sign(np.sum(np.cross(a, b) * c)))
