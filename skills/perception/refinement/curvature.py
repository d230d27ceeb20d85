"""Is what is seen there curved as the fruit is? A wall, a post or the edge of a box agrees with a part of any model.

Inverse depth is linear over the image of a plane, whatever its tilt, so the second derivatives of inverse depth measure
curvature alone. They are fitted to the same pixels of the measured and of the rendered depth.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from executive.values.arrays import Float64
from skills.perception.refinement.depth_image import DepthImage
from skills.perception.refinement.segment import connected_to

_INNER = 0.75
"""Share of the silhouette's pixels that are looked at, the innermost: at the outline proportions count, and mixed
pixels."""

_LEAST_PIXELS = 60
_TRIMMED = 3.0
"""Pixels farther from the fitted surface than so many standard deviations are left out once: holes' edges, stems."""

_CLEARLY_CURVED = 0.1
"""A model with less curvature in one direction than this share of that in the other one tells nothing there: at 0.3
seven of 50 half-hidden apples were not judged, at 0.1 two."""


class Curvature(NamedTuple):
    """How curved a surface is that agrees with a model in part.

    Attributes:
        least: its curvature over the model's, in the direction in which that is least.
        deviation: standard deviation of it.
        explained: share of the surface that a surface of one curvature explains within the band.
        agreeing: share of the surface that the model explains.
    """

    least: float
    deviation: float
    explained: float
    agreeing: float


def least_curvature(
    depth: DepthImage, virtual_depth: DepthImage, inliers: NDArray[np.bool_], band: float, alike: float
) -> Curvature | None:
    """How curved the surface is that agrees with a model, in the direction in which it is least so.

    Args:
        depth, virtual_depth: measured and of the refined model, shape (h, w) [m]; 0 where there is none.
        inliers: pixels that agree, shape (h, w).
        alike: so many neighbouring pixels err alike.

    Returns:
        0 for a wall, 1 for the model, 0 also where most of the surface on which these pixels lie does not agree; None
        where too little is seen, or the model itself is flat.
    """
    covered = virtual_depth > 0.0
    inside = ndimage.distance_transform_edt(np.pad(covered, 1))[1:-1, 1:-1]
    inner = inside > np.quantile(inside[covered], 1.0 - _INNER)
    connected = connected_to(inliers, depth, covered)
    if not connected.any():
        return None
    seen = inner & connected & np.isfinite(depth) & (depth > 0.0)
    rows, columns = np.nonzero(seen)
    if len(rows) < _LEAST_PIXELS:
        return None
    u, v = columns - columns.mean(), rows - rows.mean()
    scale = max(float(u.std()), float(v.std()))
    u, v = u / scale, v / scale
    terms = np.column_stack([np.ones_like(u), u, v, 0.5 * u * u, u * v, 0.5 * v * v])
    measured, modelled = 1.0 / depth[seen].astype(np.float64), 1.0 / virtual_depth[seen].astype(np.float64)
    bent, keep = _fitted(terms, measured)
    model = np.linalg.lstsq(terms[keep], modelled[keep], rcond=None)[0]
    expected = _second_derivatives(model)
    strength, directions = np.linalg.eigh(expected)
    if not (strength < 0.0).all() or strength.max() > _CLEARLY_CURVED * strength.min():
        return None
    whiten = directions / np.sqrt(-strength)
    ratios, ways = np.linalg.eigh(-whiten.T @ _second_derivatives(bent) @ whiten)
    way = whiten @ ways[:, 0]
    row = np.array([0.0, 0.0, 0.0, way[0] ** 2, 2.0 * way[0] * way[1], way[1] ** 2])
    left = measured[keep] - terms[keep] @ bent
    normal = np.linalg.inv(terms[keep].T @ terms[keep])
    deviation = np.sqrt(alike * float(np.mean(left**2)) * float(row @ normal @ row))
    explained = np.abs(1.0 / (terms @ bent) - depth[seen]) <= band
    return Curvature(float(ratios[0]), float(deviation), float(explained.mean()), float(inliers[seen].mean()))


def _fitted(terms: Float64, values: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """Coefficients by least squares, a second time without what lies far off, and what was kept."""
    keep = np.ones(len(values), np.bool_)
    for _ in range(2):
        found = np.linalg.lstsq(terms[keep], values[keep], rcond=None)[0]
        off = np.abs(values - terms @ found)
        keep = off <= _TRIMMED * np.sqrt(np.mean(off[keep] ** 2))
    coefficients: Float64 = np.asarray(np.linalg.lstsq(terms[keep], values[keep], rcond=None)[0], np.float64)
    return coefficients, keep


def _second_derivatives(coefficients: Float64) -> Float64:
    _, _, _, uu, uv, vv = coefficients
    return np.array([[uu, uv], [uv, vv]])
