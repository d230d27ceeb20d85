"""The compiled step behind `fit_shape`: measured points against the stretched model, as normal equations."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64

PARAMETERS = 11  # move 3, tilt about x and z, ln stretch 3, lean 2, turn about y


class Points(NamedTuple):
    """Measured points for the kernel: a `Cloud`, arrays of shape (n, 3) or (n,) [m]."""

    points: Float64
    rays: Float64
    deviation: Float64
    beside: Float64


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


class PlacedForm(NamedTuple):
    """The present object: rotation (3, 3) and place (3,) in the camera's frame; see `Form` for the rest."""

    R: Float64
    t: Float64
    stretch: Float64
    lean: Float64
    radius: Float64


@njit(cache=True, nogil=True, error_model="numpy")
def start_of_walk(samples: Samples, x: float, y: float, z: float) -> int:
    """Return the sample that is nearest to the grid's cell of a point of the model's frame."""
    last = len(samples.near) - 1
    i = min(max(int((x - samples.corner[0]) / samples.edges[0]), 0), last)
    j = min(max(int((y - samples.corner[1]) / samples.edges[1]), 0), last)
    k = min(max(int((z - samples.corner[2]) / samples.edges[2]), 0), last)
    start: int = samples.near[i, j, k]
    return start


@njit(cache=True, nogil=True, error_model="numpy")
def walk_to_nearest(samples: Samples, x: float, y: float, z: float, start: int) -> int:
    """From neighbour to neighbour while that is nearer to a point of the model's frame."""
    points, neighbours = samples.points, samples.neighbours
    best = start
    near = (x - points[best, 0]) ** 2 + (y - points[best, 1]) ** 2 + (z - points[best, 2]) ** 2
    while True:
        here = best
        for k in range(neighbours.shape[1]):
            j = neighbours[here, k]
            square = (x - points[j, 0]) ** 2 + (y - points[j, 1]) ** 2 + (z - points[j, 2]) ** 2
            if square < near:
                near, best = square, j
        if best == here:
            return best


@njit(cache=True, nogil=True, error_model="numpy")
def points_to_surface(
    measured: Points,
    samples: Samples,
    placed: PlacedForm,
    nearest: NDArray[np.int64],
    reach: float,
    texture: float,
    patches: float,
) -> tuple[Float64, Float64, float]:
    """Return the normal equations of point-to-plane distances, with Tukey's weights and each point's uncertainty.

    They are H, shape (11, 11), b, shape (11,), and the ratio of the points that count.

    Args:
        nearest: the previous nearest sample of each point, start of the search, shape (n,), -1 where there is none;
            changed in place.
        reach: points farther from the surface do not count [m].
        texture: standard deviation of the surface against the model [m].
        patches: number of independently deviating parts of the visible surface.
    """
    points, rays, deviation, beside = measured.points, measured.rays, measured.deviation, measured.beside
    on_model, normals = samples.points, samples.normals
    R, t = placed.R, placed.t
    sx, sy, sz = placed.stretch
    lx, lz = placed.lean / placed.radius
    count = len(points)
    # derivatives of one point's distance, and the distance itself
    terms = np.empty((count, PARAMETERS + 1))
    slant, counts = np.empty(count), np.zeros(count, np.bool_)
    counted = 0
    for i in range(count):
        px, py, pz = points[i, 0] - t[0], points[i, 1] - t[1], points[i, 2] - t[2]
        u = R[0, 0] * px + R[1, 0] * py + R[2, 0] * pz
        v = R[0, 1] * px + R[1, 1] * py + R[2, 1] * pz
        w = R[0, 2] * px + R[1, 2] * py + R[2, 2] * pz
        x, z = u / sx, w / sz
        y = v / (sy * (1.0 + lx * x + lz * z))
        j = nearest[i]
        if j < 0:
            j = start_of_walk(samples, x, y, z)
        j = walk_to_nearest(samples, x, y, z, j)
        nearest[i] = j
        mx, my, mz = on_model[j, 0], on_model[j, 1], on_model[j, 2]
        higher = 1.0 + lx * mx + lz * mz
        qx, qy, qz = sx * mx, sy * my * higher, sz * mz
        up = normals[j, 1] / higher
        a, b, c = (normals[j, 0] - up * my * lx) / sx, up / sy, (normals[j, 2] - up * my * lz) / sz
        shorter = 1.0 / math.sqrt(a * a + b * b + c * c)
        a, b, c = a * shorter, b * shorter, c * shorter
        distance = a * (u - qx) + b * (v - qy) + c * (w - qz)
        slant[i] = 0.0
        for axis in range(3):
            terms[i, axis] = R[axis, 0] * a + R[axis, 1] * b + R[axis, 2] * c
            slant[i] += terms[i, axis] * rays[i, axis]
        # cosine between a normal and the ray from which a surface faces away: it is the far side of the model
        counts[i] = abs(distance) < reach and slant[i] < 0.1
        counted += counts[i]
        terms[i, 3], terms[i, 4], terms[i, 10] = qy * c - qz * b, qx * b - qy * a, qz * a - qx * c
        terms[i, 5], terms[i, 6], terms[i, 7] = a * qx, b * qy, c * qz
        raised = b * sy * my
        terms[i, 8], terms[i, 9] = raised * mx / placed.radius[0], raised * mz / placed.radius[1]
        terms[i, PARAMETERS] = distance
    patch = texture**2 * max(1.0, counted / patches)
    sums = np.zeros((PARAMETERS, PARAMETERS + 1))
    for i in range(count):
        if not counts[i]:
            continue
        aside = beside[i] ** 2 * max(1.0 - slant[i] ** 2, 0.0)
        variance = deviation[i] ** 2 + aside + patch
        weight = (1.0 - (terms[i, PARAMETERS] / reach) ** 2) ** 2 / variance
        for row in range(PARAMETERS):
            scaled = weight * terms[i, row]
            for column in range(PARAMETERS + 1):
                sums[row, column] += scaled * terms[i, column]
    return sums[:, :PARAMETERS].copy(), sums[:, PARAMETERS].copy(), counted / max(count, 1)
