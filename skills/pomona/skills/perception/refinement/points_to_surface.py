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
    """The model's surface: points and outward normals, shape (m, 3), and the neighbours of each, shape (m, k)."""

    points: Float64
    normals: Float64
    neighbours: NDArray[np.int32]


class PlacedForm(NamedTuple):
    """The present object: rotation (3, 3) and place (3,) in the camera's frame; see `Form` for the rest."""

    R: Float64
    t: Float64
    stretch: Float64
    lean: Float64
    radius: Float64


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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
        nearest: the previous nearest sample of each point, start of the search, shape (n,); changed in place.
        reach: points farther from the surface do not count [m].
        texture: standard deviation of the surface against the model [m].
        patches: number of independently deviating parts of the visible surface.
    """
    count = len(measured.points)
    jacobian = np.empty((count, PARAMETERS))
    distance, slant = np.empty(count), np.empty(count)
    counts = np.zeros(count, np.bool_)
    R, stretch, lean, radius = placed.R, placed.stretch, placed.lean, placed.radius
    local, normal = np.empty(3), np.empty(3)
    counted = 0
    for i in range(count):
        for axis in range(3):
            local[axis] = 0.0
            for k in range(3):
                local[axis] += R[k, axis] * (measured.points[i, k] - placed.t[k])
        x, z = local[0] / stretch[0], local[2] / stretch[2]
        y = local[1] / stretch[1] / (1.0 + lean[0] * x / radius[0] + lean[1] * z / radius[1])
        nearest[i] = walk_to_nearest(samples, x, y, z, nearest[i])
        m, n = samples.points[nearest[i]], samples.normals[nearest[i]]
        higher = 1.0 + lean[0] * m[0] / radius[0] + lean[1] * m[2] / radius[1]
        q = (stretch[0] * m[0], stretch[1] * m[1] * higher, stretch[2] * m[2])
        up = n[1] / higher
        a = (n[0] - up * m[1] * lean[0] / radius[0]) / stretch[0]
        b = up / stretch[1]
        c = (n[2] - up * m[1] * lean[1] / radius[1]) / stretch[2]
        length = math.sqrt(a * a + b * b + c * c)
        a, b, c = a / length, b / length, c / length
        distance[i], slant[i] = -(a * q[0] + b * q[1] + c * q[2]), 0.0
        for axis in range(3):
            normal[axis] = R[axis, 0] * a + R[axis, 1] * b + R[axis, 2] * c
            jacobian[i, axis] = normal[axis]
            distance[i] += normal[axis] * (measured.points[i, axis] - placed.t[axis])
            slant[i] += normal[axis] * measured.rays[i, axis]
        jacobian[i, 3] = q[1] * c - q[2] * b
        jacobian[i, 4] = q[0] * b - q[1] * a
        jacobian[i, 5], jacobian[i, 6], jacobian[i, 7] = a * q[0], b * q[1], c * q[2]
        jacobian[i, 8] = b * stretch[1] * m[1] * m[0] / radius[0]
        jacobian[i, 9] = b * stretch[1] * m[1] * m[2] / radius[1]
        jacobian[i, 10] = q[2] * a - q[0] * c
        # cosine between a normal and the ray from which a surface faces away: it is the far side of the model
        counts[i] = abs(distance[i]) < reach and slant[i] < 0.1
        counted += counts[i]
    shared = math.sqrt(max(1.0, counted / patches))
    H, right = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
    for i in range(count):
        if not counts[i]:
            continue
        aside = measured.beside[i] * math.sqrt(max(1.0 - slant[i] ** 2, 0.0))
        variance = (measured.deviation[i] * slant[i]) ** 2 + aside**2 + (texture * shared) ** 2
        weight = (1.0 - (distance[i] / reach) ** 2) ** 2 / variance
        for row in range(PARAMETERS):
            scaled = weight * jacobian[i, row]
            right[row] += scaled * distance[i]
            for column in range(row, PARAMETERS):
                H[row, column] += scaled * jacobian[i, column]
    for row in range(PARAMETERS):
        for column in range(row):
            H[row, column] = H[column, row]
    return H, right, counted / max(count, 1)
