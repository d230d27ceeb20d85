"""The compiled Gauss-Newton steps behind `fit_shape`: points against the stretched model, priors, the support."""

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


_MAX_TURN = 0.3
_MAX_STRETCH = 0.2
_MAX_LEAN = 0.05
_PATCHES = 80.0  # number of independently deviating parts of the visible surface: a lobe or a dent is some 10 mm wide
_STILL_PLACE, _STILL_FORM = 5e-5, 5e-4  # steps [m], and [rad] or relative, below which the fit has ended


class ShapePriors(NamedTuple):
    """Priors of the kind, of the detection and of the uniform scale."""

    start: PlacedForm
    weighted: Float64  # prior directions over the parameters, over their variances, shape (11, 11)
    likeness: Float64  # their part of the normal equations, shape (11, 11)
    proportion: float  # expected ln(height / mean width), relative to the model's
    roundness: float  # expected ln(d_x / d_z), relative to the model's
    texture: float  # standard deviation of the surface against the model [m]


class Support(NamedTuple):
    """A plane, normal · p + offset = 0, that the fruit stands on within a standard deviation [m]; inf: it does not."""

    normal: Float64
    offset: float
    deviation: float


@njit(cache=True, nogil=True)
def move(placed: PlacedForm, step: Float64) -> None:
    """Turn, move and stretch the object by a step, shape (11,), limited in size."""
    angle = math.sqrt(step[3] ** 2 + step[10] ** 2 + step[4] ** 2)
    if angle > 0.0:
        x, y, z = step[3] / angle, step[10] / angle, step[4] / angle
        sine, versine = math.sin(min(angle, _MAX_TURN)), 1.0 - math.cos(min(angle, _MAX_TURN))
        for i in range(3):
            a, b, c = placed.R[i, 0], placed.R[i, 1], placed.R[i, 2]
            along = versine * (a * x + b * y + c * z)
            placed.R[i, 0] = (1.0 - versine) * a + along * x + sine * (b * z - c * y)
            placed.R[i, 1] = (1.0 - versine) * b + along * y + sine * (c * x - a * z)
            placed.R[i, 2] = (1.0 - versine) * c + along * z + sine * (a * y - b * x)
    for k in range(3):
        placed.t[k] += step[k]
        placed.stretch[k] *= math.exp(min(max(step[5 + k], -_MAX_STRETCH), _MAX_STRETCH))
    for k in range(2):
        placed.lean[k] += min(max(step[8 + k], -_MAX_LEAN), _MAX_LEAN)


@njit(cache=True, nogil=True)
def contact(vertices: Float64, placed: PlacedForm, support: Support) -> tuple[float, Float64]:
    """Return the height of the lowest point over the support [m], and how it changes with the parameters, (11,)."""
    up = np.zeros(3)
    for i in range(3):
        for k in range(3):
            up[k] += placed.R[i, k] * support.normal[i]
    stretch = placed.stretch
    x, y, z = up[0] * stretch[0], up[1] * stretch[1], up[2] * stretch[2]
    a, b = placed.lean[0] / placed.radius[0], placed.lean[1] / placed.radius[1]
    lowest, index = np.inf, 0
    for i in range(len(vertices)):
        height = x * vertices[i, 0] + z * vertices[i, 2]
        height += y * vertices[i, 1] * (1.0 + a * vertices[i, 0] + b * vertices[i, 2])
        if height < lowest:
            lowest, index = height, i
    v = (vertices[index, 0], vertices[index, 1], vertices[index, 2])
    q = (stretch[0] * v[0], stretch[1] * v[1] * (1.0 + a * v[0] + b * v[2]), stretch[2] * v[2])
    row = np.empty(PARAMETERS)
    gap = lowest + support.offset
    for k in range(3):
        row[k], row[5 + k] = support.normal[k], up[k] * q[k]
        gap += support.normal[k] * placed.t[k]
    row[3], row[10], row[4] = q[1] * up[2] - q[2] * up[1], q[2] * up[0] - q[0] * up[2], q[0] * up[1] - q[1] * up[0]
    row[8], row[9] = y * v[1] * v[0] / placed.radius[0], y * v[1] * v[2] / placed.radius[1]
    return gap, row


@njit(cache=True, nogil=True)
def _unlikeness(expected: ShapePriors, placed: PlacedForm) -> Float64:
    """Expected changes along the prior directions, shape (11,)."""
    start, values = expected.start, np.empty(PARAMETERS)
    axis, facing = np.zeros(3), np.zeros(3)  # the detected axes as the present object sees them
    for i in range(3):
        values[i] = start.t[i] - placed.t[i]
        for k in range(3):
            axis[k] += placed.R[i, k] * start.R[i, 1]
            facing[k] += placed.R[i, k] * start.R[i, 0]
    ln_x = math.log(placed.stretch[0] / start.stretch[0])
    ln_y = math.log(placed.stretch[1] / start.stretch[1])
    ln_z = math.log(placed.stretch[2] / start.stretch[2])
    values[3], values[4] = axis[0], axis[2]
    values[5] = -(ln_x + ln_y + ln_z) / 3.0
    values[6] = expected.proportion - ln_y + 0.5 * (ln_x + ln_z)
    values[7] = expected.roundness - (ln_x - ln_z)
    values[8], values[9] = -placed.lean[0], -placed.lean[1]
    values[10] = math.atan2(-facing[2], facing[0])
    return values


@njit(cache=True, nogil=True)
def _solve(H: Float64, b: Float64) -> Float64:
    """x of H x = b for a positive definite H (Cholesky)."""
    size = len(b)
    root, x = np.zeros((size, size)), b.copy()
    for i in range(size):
        for k in range(i + 1):
            left = H[i, k]
            for m in range(k):
                left -= root[i, m] * root[k, m]
            root[i, k] = left / root[k, k] if k < i else math.sqrt(left)
        for m in range(i):
            x[i] -= root[i, m] * x[m]
        x[i] /= root[i, i]
    for i in range(size - 1, -1, -1):
        for m in range(i + 1, size):
            x[i] -= root[m, i] * x[m]
        x[i] /= root[i, i]
    return x


@njit(cache=True, nogil=True)
def step_until_still(
    measured: Points,
    samples: Samples,
    placed: PlacedForm,
    nearest: NDArray[np.int64],
    expected: ShapePriors,
    support: Support,
    bands: Float64,
) -> tuple[Float64, float]:
    """Step until nothing moves; changes `placed` and `nearest`. Return the last matrix H, shape (11, 11), and the ratio
    of points that count.

    Args:
        bands: half-width of the band about the surface in which points count, for each step at most [m]; the last
            value is the final one.
    """
    likeness, weighted = expected.likeness, expected.weighted
    H, share = likeness, 0.0
    for band in bands:
        H, b, share = points_to_surface(measured, samples, placed, nearest, band, expected.texture, _PATCHES)
        values = _unlikeness(expected, placed)
        for i in range(PARAMETERS):
            for k in range(PARAMETERS):
                H[i, k] += likeness[i, k]
                b[k] += values[i] * weighted[i, k]
        if support.deviation < np.inf:
            gap, row = contact(samples.vertices, placed, support)
            for i in range(PARAMETERS):
                certain = row[i] / support.deviation**2
                b[i] -= gap * certain
                for k in range(PARAMETERS):
                    H[i, k] += row[k] * certain
        step = _solve(H, b)
        move(placed, step)
        still = True
        for k in range(PARAMETERS):
            still = still and abs(step[k]) < (_STILL_PLACE if k < 3 else _STILL_FORM)
        if still and band == bands[-1]:
            break
    return H, share
