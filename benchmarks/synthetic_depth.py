"""Fruit on a table as a stereo depth camera sees it: for the tests and the benchmark of Refine, where truth is known.

The errors are those of a D435i-like camera. Per pixel the noise is z² 0.08 px / (f b) with a baseline b of 50 mm, and
neighbours share it, since they share most of their matching window. Disparity comes in steps of 1/32 px. The outlines
of things waver by half a pixel. There is no depth where a surface is seen at a grazing angle, and where the second
imager's view is blocked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import inverse, rot_x, rot_z, transform
from pomona.skills.perception.refinement.render import (
    DepthImage,
    ImageBox,
    Triangles,
    render_with_zbuffer,
)

D435I = Intrinsics(610.6, 610.6, 322.3, 241.9, 640, 480)

_STANDING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Base axes from object axes of an upright fruit: the stem axis -y points up."""


@dataclass(frozen=True, slots=True, eq=False)
class StandingFruit:
    """A fruit on the table z = 0.

    Attributes:
        vertices, faces: of its mesh in the object frame [m].
        dimensions: true (d_x, d_y, d_z) [m].
        T_base_object: pose of its cuboid.
    """

    vertices: Float64
    faces: NDArray[np.int32]
    dimensions: Float64
    T_base_object: Float64


def standing(
    mesh: Triangles,
    dimensions: Sequence[float] | Float64,
    spot: tuple[float, float] = (0.0, 0.0),
    tilt: float = 0.0,
    azimuth: float = 0.0,
    dents: float = 0.0,
    lean: tuple[float, float] = (0.0, 0.0),
    rng: np.random.Generator | None = None,
) -> StandingFruit:
    """Stretch a model to true dimensions and stand it on the table.

    Args:
        mesh: the CAD model, in the object frame.
        dimensions: true (d_x, d_y, d_z) [m].
        spot: where its centre is in the base frame, x and y [m].
        tilt: angle of the stem axis from the vertical [rad]; it leans towards `azimuth` [rad].
        dents: amplitude of smooth random deviations from the model's shape, relative to the radius.
        lean: by how much it is higher at its sides, towards x and z, relative.
        rng: draws the dents.
    """
    vertices = mesh.vertices.copy()
    if dents > 0.0:
        rng = rng or np.random.default_rng(0)
        direction = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
        wave = sum(
            np.sin(direction @ rng.normal(0.0, 2.0, 3) + rng.uniform(0.0, 2.0 * np.pi))
            * rng.normal()
            for _ in range(4)
        )
        vertices *= 1.0 + dents * np.asarray(wave)[:, None] / 2.0
    vertices[:, 1] *= 1.0 + (
        vertices[:, [0, 2]] / np.abs(vertices[:, [0, 2]]).max(axis=0)
    ) @ np.asarray(lean)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    true = np.asarray(dimensions, dtype=np.float64)
    vertices = (vertices - 0.5 * (low + high)) * (true / (high - low))
    R = rot_z(azimuth) @ rot_x(tilt) @ _STANDING
    height = -float((vertices @ R[2]).min())
    return StandingFruit(vertices, mesh.faces, true, transform(R, (*spot, height)))


def looking_at(
    target: Sequence[float] | Float64, distance: float, elevation: float, azimuth: float = 0.0
) -> Float64:
    """T_base_camera (4, 4) of a camera that looks at a point from `elevation` above the horizon [m, rad], upright."""
    towards = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    forward = -towards
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return transform(
        np.column_stack([right, np.cross(forward, right), forward]),
        np.asarray(target) + distance * towards,
    )


def true_depth(
    things: Sequence[StandingFruit],
    T_base_camera: Float64,
    intrinsics: Intrinsics = D435I,
    table: bool = True,
) -> Float64:
    """Return the z-depth without error, shape (h, w) [m]: the table z = 0 and objects on it; 0 without a surface."""
    u, v = np.meshgrid(np.arange(intrinsics.width), np.arange(intrinsics.height))
    rays = np.stack(
        [
            (u - intrinsics.cx) / intrinsics.fx,
            (v - intrinsics.cy) / intrinsics.fy,
            np.ones(u.shape),
        ],
        -1,
    )
    downwards = rays @ T_base_camera[2, :3]
    depth = np.where(downwards < -1e-6, -T_base_camera[2, 3] / np.minimum(downwards, -1e-6), 0.0)
    if not table:
        depth[:] = 0.0
    whole = ImageBox(0, 0, intrinsics.width, intrinsics.height)
    for thing in things:
        seen = render_with_zbuffer(
            thing, inverse(T_base_camera) @ thing.T_base_object, intrinsics, whole
        )
        depth = np.where((seen > 0.0) & ((depth == 0.0) | (seen < depth)), seen, depth)
    return depth


def as_d435i(
    depth: Float64, rng: np.random.Generator, intrinsics: Intrinsics = D435I, baseline: float = 0.05
) -> DepthImage:
    """Return the camera's report of a true depth image: float32 [m], 0 without a measurement."""
    shape, focal = depth.shape, intrinsics.fx
    rows, columns = np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij")
    waver = [gaussian_filter(rng.normal(0.0, 1.0, shape), 1.5) for _ in range(2)]
    shifted = [grid + 0.5 * w / w.std() for grid, w in zip((rows, columns), waver, strict=True)]
    hidden = _hidden_or_grazing(depth, intrinsics, baseline, rng)
    seen = map_coordinates(np.where(hidden, 0.0, depth), shifted, order=0, mode="nearest")
    noise = gaussian_filter(rng.normal(0.0, 1.0, shape), 1.0)
    disparity = focal * baseline / np.maximum(seen, 1e-3) + 0.08 * noise / noise.std()
    disparity = np.maximum(np.round(disparity * 32.0) / 32.0, 1e-3)
    measured: DepthImage = np.where(seen <= 0.0, 0.0, focal * baseline / disparity).astype(
        np.float32
    )
    return measured


def _hidden_or_grazing(
    depth: Float64, intrinsics: Intrinsics, baseline: float, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Pixels without a measurement."""
    z = np.maximum(depth, 1e-3)
    slope_v, slope_u = np.gradient(z)
    # A surface z(u, v) is seen at the angle whose tangent is |grad z| f / z, nearly.
    tangent = np.hypot(slope_u * intrinsics.fx, slope_v * intrinsics.fy) / z
    grazing = np.degrees(np.arctan(tangent)) > rng.uniform(74.0, 84.0, depth.shape)
    in_second_imager = np.arange(depth.shape[1]) - intrinsics.fx * baseline / z
    in_front = np.minimum.accumulate(in_second_imager[:, ::-1], axis=1)[:, ::-1]
    hidden: NDArray[np.bool_] = grazing | (in_second_imager > in_front + 1.0)
    return hidden
