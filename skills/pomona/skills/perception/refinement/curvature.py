"""Comparison of the measured surface's curvature with the fruit's: a flat wall or a post agrees with a part of any
model.

Inverse depth is linear over the image of a plane, whatever its tilt, so the second derivatives of inverse depth measure
curvature alone. They are fitted to the same pixels of the measured and of the rendered depth.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.perception.refinement.cloud import connected_to
from pomona.skills.perception.refinement.render import DepthImage

_INNER = 0.87  # scale of the silhouette within which pixels are used: mixed pixels at the outline disturb

_LEAST_PIXELS = 60
_TRIMMED = 3.0  # distance of outliers from the fitted surface, in standard deviations; dropped once

_CLEARLY_CURVED = 0.1
"""Ratio of the model's curvatures in its two directions below which the flatter one is not checked: at 0.3 seven of 50
half-hidden apples were not checked, at 0.1 two."""


class Curvature(NamedTuple):
    """How curved a surface is that agrees with a model in part."""

    least: float  # its curvature over the model's, in the direction in which that is least
    deviation: float  # standard deviation of it
    explained: (
        float  # share of the surface that a surface of one curvature explains within the band
    )
    agreeing: float  # share of the surface that the model explains


def least_curvature(
    depth: DepthImage,
    virtual_depth: DepthImage,
    inliers: NDArray[np.bool_],
    band: float,
    alike: float,
) -> Curvature | None:
    """Return the least curvature of the surface that agrees with a model; None if it is small or the model flat.

    Args:
        depth, virtual_depth: measured and of the refined model, shape (h, w) [m]; 0 where there is none.
        inliers, band: pixels that agree, shape (h, w), and half-width of the band in which depth agrees [m].
        alike: number of neighbouring pixels with a common error.
    """
    # of a larger box every second or third pixel of every second or third row is looked at
    step = max(1, math.isqrt(depth.size // 1500))
    depth = depth[::step, ::step]
    virtual_depth = virtual_depth[::step, ::step]
    inliers = inliers[::step, ::step]
    covered = virtual_depth > 0.0
    connected = connected_to(inliers, depth, covered, step)
    rows, columns = np.nonzero(connected & _smaller(covered) & np.isfinite(depth) & (depth > 0.0))
    if len(rows) < _LEAST_PIXELS:
        return None
    z = depth[rows, columns].astype(np.float64)
    z_model = virtual_depth[rows, columns].astype(np.float64)
    u = columns - columns.mean()
    v = rows - rows.mean()
    scale = max(float(u.std()), float(v.std()))
    terms = _terms(u / scale, v / scale)
    normal, right = _normal_equations(terms, 1.0 / z, 1.0 / z_model, np.inf, np.zeros(6))
    bent = np.linalg.solve(normal, right)[:, 0]
    spread = float(np.sqrt(np.mean((1.0 / z - terms @ bent) ** 2)))
    normal, right = _normal_equations(terms, 1.0 / z, 1.0 / z_model, _TRIMMED * spread, bent)
    bent, model = np.linalg.solve(normal, right).T
    strength, directions = np.linalg.eigh(_second_derivatives(model))
    if not (strength < 0.0).all() or strength.max() > _CLEARLY_CURVED * strength.min():
        return None
    whiten = directions / np.sqrt(-strength)
    ratios, ways = np.linalg.eigh(-whiten.T @ _second_derivatives(bent) @ whiten)
    x, y = whiten @ ways[:, 0]
    row = np.array([0.0, 0.0, 0.0, x**2, 2.0 * x * y, y**2])
    left = 1.0 / z - terms @ bent
    variance = float(np.mean(left[np.abs(left) <= _TRIMMED * spread] ** 2))
    deviation = np.sqrt(
        max(alike / step**2, 1.0) * variance * float(row @ np.linalg.solve(normal, row))
    )
    explained = np.abs(1.0 / (terms @ bent) - z) <= band
    agreeing = inliers[rows, columns].mean()
    return Curvature(float(ratios[0]), float(deviation), float(explained.mean()), float(agreeing))


def _smaller(covered: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a silhouette, shape (h, w), smaller about its middle."""
    rows = np.nonzero(covered.any(axis=1))[0]
    columns = np.nonzero(covered.any(axis=0))[0]
    places = []
    for size, seen in zip(covered.shape, (rows, columns), strict=True):
        middle = 0.5 * (seen[0] + seen[-1])
        outer = np.rint(middle + (np.arange(size) - middle) / _INNER).astype(np.int64)
        places.append((np.clip(outer, 0, size - 1), (outer >= 0) & (outer < size)))
    (down, inside_down), (across, inside_across) = places
    smaller: NDArray[np.bool_] = (
        covered[np.ix_(down, across)] & inside_down[:, None] & inside_across
    )
    return smaller


def _terms(u: Float64, v: Float64) -> Float64:
    """Of a quadratic, shape (n, 6)."""
    terms = np.ones((len(u), 6))
    terms[:, 1], terms[:, 2], terms[:, 3], terms[:, 4], terms[:, 5] = (
        u,
        v,
        0.5 * u * u,
        u * v,
        0.5 * v * v,
    )
    return terms


@kernel(nogil=True)
def _normal_equations(
    terms: Float64, measured: Float64, modelled: Float64, reach: float, before: Float64
) -> tuple[Float64, Float64]:
    """Of both quadratics, from the pixels that lie within reach of the one before: shapes (6, 6) and (6, 2)."""
    normal = np.zeros((6, 6))
    right = np.zeros((6, 2))
    for i in range(len(terms)):
        off = measured[i]
        for k in range(6):
            off -= terms[i, k] * before[k]
        if abs(off) > reach:
            continue
        for k in range(6):
            right[k, 0] += terms[i, k] * measured[i]
            right[k, 1] += terms[i, k] * modelled[i]
            for m in range(6):
                normal[k, m] += terms[i, k] * terms[i, m]
    return normal, right


def _second_derivatives(coefficients: Float64) -> Float64:
    _, _, _, uu, uv, vv = coefficients
    return np.array([[uu, uv], [uv, vv]])
