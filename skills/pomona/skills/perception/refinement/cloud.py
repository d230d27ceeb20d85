"""Points for the fit of a fruit's shape: measured ones, and samples of the model.

Measured points are from all looks, of one connected surface, without its support.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.later import Later
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.geometry import apply, inverse
from pomona.skills.perception.refinement.errors import RenderFailed, TooFewInliers
from pomona.skills.perception.refinement.render import (
    DepthImage,
    DepthLook,
    ImageBox,
    RefineResult,
    Triangles,
    winding,
)

spatial: Any = Later("scipy.spatial")

ndimage: Any = Later("scipy.ndimage")

_BAND = 4e-3
_LEAST_SHARE = 0.3
_LEAST_POINTS = 60
_MAX_SHIFT = 0.015
_MAX_TURN = np.cos(np.radians(5.0))
_ELSEWHERE = 0.06
_MOST_OF_THEM = 0.5
_ABOUT_PARALLEL = np.cos(np.radians(20.0))


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Points p with normal · p + offset = 0; the normal, shape (3,), is a unit vector towards the free side."""

    normal: Float64
    offset: float
    # standard deviation of its height [m]; 0 if the same look measured the plane
    deviation: float = 0.0

    def height(self, points: Float64) -> Float64:
        """Signed distance of points (n, 3) from the plane, positive on the free side [m]."""
        height: Float64 = points @ self.normal + self.offset
        return height


def horizontal_plane(T_base_camera: Float64, z: float) -> Plane:
    """Return the plane at height z of the base frame [m], in the camera frame, with 5 mm for calibration errors."""
    return Plane(T_base_camera[2, :3].copy(), float(T_base_camera[2, 3] - z), 5e-3)


def seen_near(known: Plane, points: Float64) -> Plane | None:
    """Return a plane near a known one, as the camera measures it; None if none lies within 15 mm and 5 degrees.

    A fruit and its support in one image share the errors of depth and of the camera's pose.
    """
    near = np.abs(known.height(points)) <= _MAX_SHIFT
    if np.count_nonzero(near) < _LEAST_POINTS or near.mean() < _LEAST_SHARE:
        return None
    offset = float(np.median(known.height(points[near])))
    seen = _least_squares(points, np.abs(known.height(points) - offset) <= 2.0 * _BAND)
    if seen is None or seen.normal @ known.normal < _MAX_TURN:
        return None
    return seen


def seen_elsewhere(known: Plane, points: Float64) -> tuple[float, float] | None:
    """Return height above [m] and tilt against [rad] a known plane of another one in its place; None if there is none.

    Then the plane's height, the camera's pose or its focal length is wrong, or the fruit lies on another object. The
    other plane is about parallel and less than 60 mm away.
    """
    near = np.abs(known.height(points)) <= _ELSEWHERE
    if seen_near(known, points) is not None or np.count_nonzero(near) < _LEAST_POINTS:
        return None
    offset = float(np.median(known.height(points[near])))
    seen = _least_squares(points, near & (np.abs(known.height(points) - offset) <= _MAX_SHIFT))
    if seen is None or float(np.mean(np.abs(seen.height(points)) <= _BAND)) < _MOST_OF_THEM:
        return None
    on_it = points[np.abs(seen.height(points)) <= _BAND].mean(axis=0)
    height = float(known.height(on_it[None])[0])
    cosine = min(float(seen.normal @ known.normal), 1.0)
    return (height, float(np.arccos(cosine))) if cosine > _ABOUT_PARALLEL else None


def _least_squares(points: Float64, chosen: NDArray[np.bool_]) -> Plane | None:
    """Return the plane through the chosen points, and then through those near it."""
    plane = None
    for _ in range(4):
        if np.count_nonzero(chosen) < _LEAST_POINTS:
            return None
        centre = points[chosen].mean(axis=0)
        spread = points[chosen] - centre
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        normal = -normal if normal @ centre > 0.0 else normal
        plane = Plane(normal, -float(normal @ centre))
        chosen = np.abs(plane.height(points)) <= _BAND
    return plane


_STEP = 6e-3  # step between neighbouring pixels that parts two things, at `_STEP_DEPTH` [m]; grows with depth²

_STEP_DEPTH = 0.6
_LEAST_SUPPORTED = 0.3
_LEAST_PIXELS = 20


def connected_to(
    agreeing: NDArray[np.bool_], depth: DepthImage, covered: NDArray[np.bool_], stride: int = 1
) -> NDArray[np.bool_]:
    """Return the surfaces that mostly agree with a model where the model is, shapes (h, w).

    A leaf or a finger in front of a fruit is cut off by the step in depth around it, even where its depth agrees.

    Args:
        depth: z-depth [m]; 0 or not finite where there is none.
        stride: distance of these pixels in the image; steps in depth are higher by this factor.
    """
    z = np.ascontiguousarray(depth, dtype=np.float32)
    supporting = np.ascontiguousarray(agreeing & covered)
    connected: NDArray[np.bool_] = _flood(
        z, supporting, np.ascontiguousarray(covered), stride * _STEP, _LEAST_PIXELS / stride**2
    )
    return connected


@kernel(nogil=True)
def _flood(
    depth: DepthImage,
    supporting: NDArray[np.bool_],
    covered: NDArray[np.bool_],
    step: float,
    least: float,
) -> NDArray[np.bool_]:
    """Spread from each supporting pixel over its surface; keep surfaces that are supported enough."""
    rows, columns = depth.shape
    smooth = np.zeros((rows, columns), np.bool_)
    chosen = np.zeros((rows, columns), np.bool_)
    for i in range(rows):
        for j in range(columns):
            z = depth[i, j]
            if not 0.0 < z < np.inf:
                continue
            nearest = z
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, columns)):
                    if 0.0 < depth[k, m] < nearest:
                        nearest = depth[k, m]
            # Of two pixels at a step the far one is dropped: the front object keeps its outline.
            smooth[i, j] = z - nearest <= step * max(1.0, (nearest / _STEP_DEPTH) ** 2)
    reached = np.empty((rows * columns, 2), np.int32)
    for i in range(rows):
        for j in range(columns):
            if not (supporting[i, j] and smooth[i, j]):
                continue
            smooth[i, j] = False
            reached[0, 0], reached[0, 1] = i, j
            first = 0
            count = 1
            inside = 0
            support = 0
            while first < count:
                row = reached[first, 0]
                column = reached[first, 1]
                first += 1
                inside += covered[row, column]
                support += supporting[row, column]
                for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                    k = row + down
                    m = column + right
                    if 0 <= k < rows and 0 <= m < columns and smooth[k, m]:
                        smooth[k, m] = False
                        reached[count, 0], reached[count, 1] = k, m
                        count += 1
            if support >= least and support >= _LEAST_SUPPORTED * inside:
                for n in range(count):
                    chosen[reached[n, 0], reached[n, 1]] = True
    return chosen


def without_edge(surface: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """Return a surface of shape (h, w) without its outermost pixels: these mix foreground and background."""
    inner: NDArray[np.bool_] = ndimage.binary_erosion(surface, iterations=pixels, border_value=1)
    return inner


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points that a depth camera measured."""

    points: Float64  # shape (n, 3) [m]
    rays: Float64  # unit vectors from the camera to them, shape (n, 3)
    # standard deviation along the camera's z axis, shape (n,) [m], enlarged for the common error of neighbours
    deviation: Float64
    beside: Float64  # standard deviation across the ray, of the pixel's ray, shape (n,) [m], enlarged as well
    alike: float  # number of neighbours with a common error, by which both are enlarged
    looks: int = 1  # number of looks that the points are from

    def chosen(self, mask: NDArray[np.bool_]) -> Cloud:
        """Return the part of the points that a mask picks."""
        return replace(
            self,
            points=self.points[mask],
            rays=self.rays[mask],
            deviation=self.deviation[mask],
            beside=self.beside[mask],
        )

    def moved(self, T_a_b: Float64) -> Cloud:
        """Return the same points in another frame."""
        return replace(self, points=apply(T_a_b, self.points), rays=self.rays @ T_a_b[:3, :3].T)

    def thinned(self, at_most: int) -> Cloud:
        """Return every k-th point; the common error of neighbours is then smaller."""
        step = -(-len(self.points) // at_most) if len(self.points) else 1
        gain = np.sqrt(max(1.0, self.alike / step) / self.alike)
        few = slice(None, None, step)
        deviation = self.deviation[few] * gain
        beside = self.beside[few] * gain
        return replace(
            self, points=self.points[few], rays=self.rays[few], deviation=deviation, beside=beside
        )


def cloud(look: DepthLook, box: ImageBox, mask: NDArray[np.bool_] | None = None) -> Cloud:
    """Return the measured points of a box, or of those pixels of it in `mask`, in the frame of the look's camera."""
    intrinsics = look.intrinsics
    model = look.depth_model
    z = look.depth[box.slices].astype(np.float64)
    taken = np.isfinite(z) & (z > 0.0)
    if mask is not None:
        taken &= mask
    rows, columns = np.nonzero(taken)
    z = z[taken]
    points = np.column_stack(
        [
            (columns + box.left - intrinsics.cx) / intrinsics.fx * z,
            (rows + box.top - intrinsics.cy) / intrinsics.fy * z,
            z,
        ]
    )
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    shared = np.sqrt(model.alike)
    deviation = model.deviation(z, intrinsics.fx)
    beside = model.beside(z, intrinsics.fx)
    return Cloud(points, rays, shared * deviation, shared * beside, model.alike)


def together(clouds: list[Cloud]) -> Cloud:
    """Return all points of several clouds that are in one frame."""
    return Cloud(
        np.concatenate([c.points for c in clouds]),
        np.concatenate([c.rays for c in clouds]),
        np.concatenate([c.deviation for c in clouds]),
        np.concatenate([c.beside for c in clouds]),
        max(c.alike for c in clouds),
        sum(c.looks for c in clouds),
    )


_MARGIN = 0.15
_AROUND = 16
_ABOVE_PLANE = 4e-3
_LEAST_ABOVE = 0.5
_BEYOND_MODEL = 0.02


def plane_below(look: DepthLook, scaled: RefineResult, known: Plane) -> Plane:
    """Return the plane that a scaled fruit stands on as the camera sees it, else the expected one, camera frame."""
    return seen_near(known, points_around(look, scaled.box, scaled.virtual_depth)) or known


def gather(look: DepthLook, scaled: RefineResult, plane: Plane | None) -> Cloud:
    """Return the points of a look around a scaled fruit, without the plane that it stands on.

    Raises TooFewInliers: the points that agree with the model lie on the plane.
    """
    points = _connected(look, scaled.box, scaled.virtual_depth, scaled.inliers)
    if plane is None:
        return points
    above = float(
        np.mean(plane.height(cloud(look, scaled.box, scaled.inliers).points) > _ABOVE_PLANE)
    )
    if above < _LEAST_ABOVE:
        raise TooFewInliers(above, _LEAST_ABOVE)  # the detected fruit is the table itself
    return points.chosen(plane.height(points.points) > _ABOVE_PLANE)


def points_around(look: DepthLook, box: ImageBox, virtual_depth: DepthImage) -> Float64:
    """Return every fourth measured point beside a fruit in a box of the image, shape (n, 3) [m]."""
    around = box.grown(_AROUND, look.intrinsics)
    outside = np.zeros(around.shape, dtype=np.bool_)
    outside[::2, ::2] = True
    top = box.top - around.top
    left = box.left - around.left
    outside[top : top + box.shape[0], left : left + box.shape[1]] &= virtual_depth <= 0.0
    return cloud(look, around, outside).points


def gather_others(
    looks: Sequence[DepthLook],
    mesh: Triangles,
    T_camera_mesh: Float64,
    plane: Plane | None,
    band: float,
) -> list[Cloud]:
    """Return the points of other looks that agree with the scaled model, in the frame of the first look.

    Looks that miss the fruit, or show something else in its place, give none.
    """
    clouds = []
    for look in looks:
        try:
            virtual_depth, box = look.render(mesh, inverse(look.T_camera_look) @ T_camera_mesh)
        except RenderFailed:
            continue  # the fruit is not in this picture
        # another look agrees with the model of the first within this many bands: the model is not right yet
        near = np.abs(look.depth[box.slices] - virtual_depth) <= 2.0 * band
        points = _connected(look, box, virtual_depth, near).moved(look.T_camera_look)
        if plane is not None:
            points = points.chosen(plane.height(points.points) > _ABOVE_PLANE)
        if len(points.points):
            clouds.append(points)
    return clouds


def _connected(
    look: DepthLook, box: ImageBox, virtual_depth: DepthImage, inliers: NDArray[np.bool_]
) -> Cloud:
    """Return the points in and around a box that are connected to the pixels that agree with a model."""
    wide = box.grown(int(_MARGIN * max(box.shape)) + 2, look.intrinsics)
    top = box.top - wide.top
    left = box.left - wide.left
    covered = np.zeros(wide.shape, dtype=np.bool_)
    agreeing = np.zeros(wide.shape, dtype=np.bool_)
    part = slice(top, top + box.shape[0]), slice(left, left + box.shape[1])
    covered[part], agreeing[part] = virtual_depth > 0.0, inliers
    connected = connected_to(agreeing, look.depth[wide.slices], covered)
    if look.depth_model.edge:
        connected = without_edge(connected, look.depth_model.edge)
    return cloud(look, wide, connected)


def near_model(clouds: list[Cloud], centre: Float64, radius: float) -> Cloud:
    """Return all points that are not farther from the scaled model's centre, shape (3,), than it could reach [m]."""
    points = clouds[0] if len(clouds) == 1 else together(clouds)
    away = points.points - centre
    return points.chosen(np.einsum("ij,ij->i", away, away) < (1.2 * radius + _BEYOND_MODEL) ** 2)


class Samples(NamedTuple):
    """The model's surface: points and outward normals, shape (m, 3), and the neighbours of each, shape (m, k) [m].

    `near` holds the sample that is nearest to each cell of a grid over the model, shape (k, k, k): a cell's index is
    (p - corner) / edges, cut to the grid.
    """

    points: Float64
    normals: Float64
    neighbours: NDArray[np.int32]
    near: NDArray[np.int32]
    corner: Float64
    edges: Float64
    vertices: Float64  # of the mesh, shape (l, 3)


_SAMPLES = 4000
_NEIGHBOURS = 16
"""Number of neighbours of a sample that are tried for one that is nearer to a point. After a step of up to 10 mm a
search from neighbour to neighbour ends beside the nearest sample for 1 of 10 000 points about the shipped fruit (12: 1
of 1 000)."""
_CELLS = 24
_BESIDE = 0.1
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
    tree = spatial.cKDTree(points)
    neighbours = np.ascontiguousarray(tree.query(points, _NEIGHBOURS + 1)[1][:, 1:], dtype=np.int32)
    low = points.min(axis=0)
    high = points.max(axis=0)
    corner = low - _BESIDE * (high - low)
    edges = (1.0 + 2.0 * _BESIDE) * (high - low) / _CELLS
    middles = corner + edges * (np.indices((_CELLS, _CELLS, _CELLS)).transpose(1, 2, 3, 0) + 0.5)
    near = tree.query(middles)[1].astype(np.int32)
    vertices = np.array(mesh.vertices, dtype=np.float64)
    return Samples(
        points, normals[face] / area[face, None], neighbours, near, corner, edges, vertices
    )
