"""Data of a refinement: a mesh, a depth image, the result and its limits; and the checks of mesh, image and pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import is_pose
from pomona.skills.perception.refinement.errors import BadDepth, BadMesh, BadPose

DepthImage = NDArray[np.float32]
RendererName = Literal["pyrender", "zbuffer"]

NEAR = 0.01  # nothing nearer to the camera than this is rendered [m]


class Triangles(Protocol):
    """A triangle mesh, such as a `FruitModel`: vertices (n, 3) float64 [m], faces (m, 3) integer."""

    @property
    def vertices(self) -> Float64:
        """Shape (n, 3) [m]."""

    @property
    def faces(self) -> NDArray[np.int32]:
        """Indices of vertices, shape (m, 3)."""

    def __hash__(self) -> int: ...


@dataclass(frozen=True, slots=True)
class ImageBox:
    """A rectangle of whole pixels: columns `left` to `right - 1`, rows `top` to `bottom - 1`."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)"""
        return self.bottom - self.top, self.right - self.left

    @property
    def slices(self) -> tuple[slice, slice]:
        """The box's part of an image: `image[box.slices]`."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def grown(self, margin: int, intrinsics: Intrinsics) -> ImageBox:
        """Return the box with a margin [px], cut to the image."""
        return ImageBox(
            max(self.left - margin, 0),
            max(self.top - margin, 0),
            min(self.right + margin, intrinsics.width),
            min(self.bottom + margin, intrinsics.height),
        )


class DepthRenderer(Protocol):
    """Renders z-depth through the pixel centres of a box."""

    def __call__(self, mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox) -> DepthImage:
        """Return the depth of shape `box.shape`, float32 [m]; 0 where the mesh is not seen."""


Method = Literal["shape", "uniform", "paper"]


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of accepted measurements."""

    # half-width of the band in which depth agrees with the model [m], where the camera's noise is less
    inlier_band: float = 4e-3
    min_inliers: float = 0.3  # minimum ratio of agreeing measured pixels
    size: tuple[float, float] = (0.4, 1.6)  # least and largest size relative to the model


@dataclass(frozen=True, slots=True, eq=False)
class RefineResult:
    """A fruit's refined pose and size, in the camera frame."""

    T_camera_object: Float64  # pose of the refined shape's cuboid
    dimensions: Float64  # (d_x, d_y, d_z) [m], shape (3,)
    mu: float  # mu, sigma: scale factor and displacement [m] of the uniform fit (the paper's)
    sigma: float
    covariance: Float64  # of (position in the camera frame, dimensions), shape (6, 6) [m²]
    inlier_ratio: float  # ratio of the refined model's measured pixels with agreeing depth
    residual: float  # root mean square of the inliers' depth residuals [m]
    box: ImageBox  # part of the image that the next two cover
    inliers: NDArray[np.bool_]  # pixels that agree, bool, shape `box.shape`
    virtual_depth: DepthImage  # the refined model's z-depth, float32, shape `box.shape` [m]; 0 outside it
    method: str  # the formulation that gave the result: paper, uniform, shape, shape+plane; `+views` with other looks


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
