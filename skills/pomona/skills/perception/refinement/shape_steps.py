"""The compiled Gauss-Newton steps behind `fit_shape`: points, priors and the contact with a support."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.refinement.points_to_surface import (
    PARAMETERS,
    PlacedForm,
    Points,
    Samples,
    points_to_surface,
)

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
