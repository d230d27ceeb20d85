"""DOPE's belief and affinity maps to keypoints, with the constants of its post-processing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.dope_config import DecodeThresholds
from pomona.skills.perception.detection.errors import BadMaps

OFFSET_DUE_TO_UPSAMPLING = 0.4395  # where a peak lies within its cell, in DOPE's convention [cells]
WINDOW = 5  # half width of the window whose weighted mean locates a peak [cells]
# peaks kept per map, strongest first: adversarial maps must not cost unbounded time
MOST_PEAKS = 200


@dataclass(frozen=True, slots=True, eq=False)
class DecodedObject:
    """One object: keypoints (9, 2) [px of the network's input], NaN where not found; belief of the centroid."""

    keypoints: Float64
    score: float


def decode_maps(
    belief: ArrayLike,
    affinity: ArrayLike,
    thresholds: DecodeThresholds | None = None,
    stride: int = 8,
) -> list[DecodedObject]:
    """Find objects in DOPE's maps.

    Args:
        belief: (9, h, w), corners 0..7 and centroid.
        affinity: (16, h, w), directions from corners to the centroid.
        thresholds: DOPE's constants.
        stride: input pixels per cell.

    Returns:
        One entry per centroid, in the order of the map's rows. Cells that are not finite count as zero.

    Raises BadMaps: another number of maps, or sizes that differ.
    """
    thresholds = thresholds or DecodeThresholds()
    beliefs, affinities = _checked(belief, affinity)
    peaks = [_peaks(one, thresholds) for one in beliefs]
    centroids = peaks[8][peaks[8][:, 2] > thresholds.thresh_points]
    objects = [np.full((9, 2), np.nan) for _ in centroids]
    for points, centroid in zip(objects, centroids, strict=True):
        points[8] = centroid[:2] * stride
    if len(centroids) == 0:
        return []
    for k in range(8):
        corners = peaks[k][peaks[k][:, 2] >= thresholds.thresh_points]
        _join(
            corners,
            centroids[:, :2],
            affinities[2 * k : 2 * k + 2],
            thresholds.thresh_angle,
            objects,
            k,
            stride,
        )
    return [
        DecodedObject(points, float(c[2])) for points, c in zip(objects, centroids, strict=True)
    ]


def _checked(belief: ArrayLike, affinity: ArrayLike) -> tuple[Float64, Float64]:
    beliefs = np.asarray(belief, np.float64)
    affinities = np.asarray(affinity, np.float64)
    shapes_fit = (
        beliefs.ndim == 3 and affinities.ndim == 3 and beliefs.shape[1:] == affinities.shape[1:]
    )
    if not shapes_fit or len(beliefs) != 9 or len(affinities) != 16 or min(beliefs.shape) < 2:
        raise BadMaps(
            "belief (9, h, w) and affinity (16, h, w)", f"{beliefs.shape} and {affinities.shape}"
        )
    return (np.nan_to_num(m, nan=0.0, posinf=0.0, neginf=0.0) for m in (beliefs, affinities))  # type: ignore[return-value]


def _peaks(belief: Float64, thresholds: DecodeThresholds) -> Float64:
    """Peaks (n, 3) as u, v [cells] and belief, in row order."""
    # DOPE's maps are float32, and ties between neighbours must fall as they fall there.
    smooth = gaussian_filter(belief.astype(np.float32), sigma=thresholds.sigma)
    around = np.pad(smooth, 1)
    highest = smooth > thresholds.thresh_map
    for rows, columns in ((slice(0, -2), slice(1, -1)), (slice(2, None), slice(1, -1))):
        highest &= (smooth >= around[rows, columns]) & (smooth >= around[columns, rows])
    v, u = np.nonzero(highest)
    if len(u) > MOST_PEAKS:
        strongest = np.sort(np.argsort(-belief[v, u], kind="stable")[:MOST_PEAKS])
        v = v[strongest]
        u = u[strongest]
    located = [_weighted_mean(belief, int(a), int(b)) for a, b in zip(u, v, strict=True)]
    return np.array(
        [(a, b, belief[y, x]) for (a, b), x, y in zip(located, u, v, strict=True)]
    ).reshape(-1, 3)


def _weighted_mean(belief: Float64, u: int, v: int) -> tuple[float, float]:
    left = max(0, u - WINDOW)
    top = max(0, v - WINDOW)
    weights = belief[top : v + WINDOW + 1, left : u + WINDOW + 1]
    total = weights.sum()
    if total == 0.0:
        return u + OFFSET_DUE_TO_UPSAMPLING, v + OFFSET_DUE_TO_UPSAMPLING
    mean_u = weights.sum(axis=0) @ np.arange(left, left + weights.shape[1]) / total
    mean_v = weights.sum(axis=1) @ np.arange(top, top + weights.shape[0]) / total
    return mean_u + OFFSET_DUE_TO_UPSAMPLING, mean_v + OFFSET_DUE_TO_UPSAMPLING


def _join(
    corners: Float64,
    centroids: Float64,
    affinity: Float64,
    thresh_angle: float,
    objects: list[Float64],
    k: int,
    stride: int,
) -> None:
    """Give each corner to the nearest centroid that its affinity points to; of several corners the nearest stays."""
    if len(corners) == 0:
        return
    height, width = affinity.shape[1:]
    cell_u = np.clip(corners[:, 0].astype(int), 0, width - 1)
    cell_v = np.clip(corners[:, 1].astype(int), 0, height - 1)
    directions = _units(affinity[:, cell_v, cell_u].T)
    towards = centroids[None] - corners[:, None, :2]
    distance = np.linalg.norm(towards, axis=2)
    agrees = np.linalg.norm(_units(towards) - directions[:, None], axis=2) < thresh_angle
    reach = np.where(agrees, distance, np.inf)
    chosen = reach.argmin(axis=1)
    best = np.full(len(centroids), np.inf)
    for corner, owner in enumerate(chosen):
        if reach[corner, owner] < best[owner]:
            best[owner] = reach[corner, owner]
            objects[owner][k] = corners[corner, :2] * stride


def _units(vectors: Float64) -> Float64:
    """Unit vectors; NaN, which agrees with nothing, where a vector has no direction."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    units: Float64 = np.divide(
        vectors, length, out=np.full_like(vectors, np.nan), where=length > 0.0
    )
    return units
