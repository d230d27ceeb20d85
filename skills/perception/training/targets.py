"""What the finder is asked to draw: belief maps, offsets, and where neither counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skills.perception.detection.close_look import keypoint_size
from skills.perception.detection.outputs import OFFSET_UNIT

F32 = NDArray[np.float32]


def finder_targets(
    keypoints: NDArray[np.float64],
    visibility: NDArray[np.float64],
    height: int,
    width: int,
    sigma: float = 1.5,
    offset_radius: float = 2.0,
    least_visibility: float = 0.3,
) -> tuple[F32, F32, F32, F32, F32, F32]:
    """Maps for one picture.

    Args:
        keypoints: (n, 9, 2) in cells.
        visibility: (n,), 0..1.
        height, width: of the maps [cells].
        sigma: of the belief's Gaussians [cells].
        offset_radius: offsets count this close to a centroid [cells].
        least_visibility: fruit less visible than this is neither asked for nor punished.

    Returns:
        belief (9, h, w), its weight (1, h, w), offsets (17, h, w), their weight (1, h, w); whether corners are known
        (1, 1, 1), one; where fruit may be that nobody labelled (1, h, w), zero.
    """
    belief, weight = np.zeros((9, height, width), np.float32), np.ones((1, height, width), np.float32)
    offsets, offset_weight = np.zeros((17, height, width), np.float32), np.zeros((1, height, width), np.float32)
    nearest = np.full((height, width), np.inf)
    for points, seen in zip(keypoints, visibility, strict=True):
        centre = points[8]
        spread = float(np.abs(points[:8] - centre).max())
        if seen < least_visibility:
            rows, columns = _window(centre, 0.6 * spread + 1.0, height, width)
            weight[0, rows, columns] = 0.0
            continue
        for k, (u, v) in enumerate(points):
            rows, columns = _window((u, v), 3.5 * sigma, height, width)
            du = np.arange(columns.start, columns.stop) - u
            dv = np.arange(rows.start, rows.stop) - v
            spot = np.exp(-(dv[:, None] ** 2 + du[None, :] ** 2) / (2.0 * sigma**2))
            np.maximum(belief[k, rows, columns], spot, out=belief[k, rows, columns])
        rows, columns = _window(centre, offset_radius, height, width)
        du = np.arange(columns.start, columns.stop)
        dv = np.arange(rows.start, rows.stop)
        distance = np.hypot(dv[:, None] - centre[1], du[None, :] - centre[0])
        here = (distance <= offset_radius) & (distance < nearest[rows, columns])
        nearest[rows, columns][here] = distance[here]
        for k in range(8):
            offsets[2 * k, rows, columns][here] = ((points[k, 0] - du)[None, :] + 0.0 * dv[:, None])[here] / OFFSET_UNIT
            offsets[2 * k + 1, rows, columns][here] = ((points[k, 1] - dv)[:, None] + 0.0 * du[None, :])[
                here
            ] / OFFSET_UNIT
        offsets[16, rows, columns][here] = np.log(max(keypoint_size(points), 0.5) / OFFSET_UNIT)
        offset_weight[0, rows, columns][here] = 1.0
    # A half-hidden neighbour's blank must not wipe out what is asked for beside it.
    weight[0] = np.maximum(weight[0], belief.max(axis=0))
    return belief, weight, offsets, offset_weight, np.ones((1, 1, 1), np.float32), np.zeros_like(weight)


def box_targets(
    centres: NDArray[np.float64],
    sizes: NDArray[np.float64],
    boxes: NDArray[np.float64],
    counted: NDArray[np.bool_],
    height: int,
    width: int,
    sigma: float = 1.5,
    offset_radius: float = 2.0,
) -> tuple[F32, F32, F32, F32, F32, F32]:
    """Maps for a photograph, where boxes are all that is known.

    Args:
        centres: of the fruit (n, 2) [cells].
        sizes: mean distances of corners from centroid, (n,) [cells]; NaN where a box does not tell.
        boxes: x, y, w, h (n, 4) [cells].
        counted: whether a box is fruit; nothing is said inside of one that is not, (n,).
        height, width: of the maps [cells].
        sigma, offset_radius: as in `finder_targets`.

    Returns:
        What `finder_targets` returns, with the centroid's belief and the size alone; whether corners are known,
        (1, 1, 1), zero; and where fruit may be that nobody labelled, (1, h, w): everywhere outside the boxes.
    """
    belief, weight = np.zeros((9, height, width), np.float32), np.ones((1, height, width), np.float32)
    offsets, offset_weight = np.zeros((17, height, width), np.float32), np.zeros((1, height, width), np.float32)
    unlabelled = np.ones((1, height, width), np.float32)
    for box, fruit in zip(boxes, counted, strict=True):
        inside = (slice(*_cells(box[1], box[3], height)), slice(*_cells(box[0], box[2], width)))
        unlabelled[0][inside] = 0.0
        if not fruit:
            weight[0][inside] = 0.0
    nearest = np.full((height, width), np.inf)
    for centre, size in zip(centres[counted], sizes[counted], strict=True):
        rows, columns = _window(centre, 3.5 * sigma, height, width)
        du, dv = np.arange(columns.start, columns.stop) - centre[0], np.arange(rows.start, rows.stop) - centre[1]
        distance = np.hypot(dv[:, None], du[None, :])
        spot = np.exp(-(distance**2) / (2.0 * sigma**2))
        np.maximum(belief[8, rows, columns], spot, out=belief[8, rows, columns])
        here = (distance <= offset_radius) & (distance < nearest[rows, columns]) & np.isfinite(size)
        nearest[rows, columns][here] = distance[here]
        if np.isfinite(size):
            offsets[16, rows, columns][here] = np.log(max(float(size), 0.5) / OFFSET_UNIT)
            offset_weight[0, rows, columns][here] = 1.0
    weight[0] = np.maximum(weight[0], belief[8])
    return belief, weight, offsets, offset_weight, np.zeros((1, 1, 1), np.float32), unlabelled


def _cells(start: float, extent: float, limit: int) -> tuple[int, int]:
    return max(0, round(start)), max(0, min(limit, round(start + extent) + 1))


def dope_targets(
    keypoints: NDArray[np.float64],
    visibility: NDArray[np.float64],
    height: int,
    width: int,
    sigma: float = 0.5,
    radius: float = 1.0,
    least_visibility: float = 0.1,
) -> tuple[F32, F32]:
    """DOPE's own maps for one picture: belief (9, h, w), and affinity (16, h, w) as unit vectors to the centroid.

    Args:
        keypoints: (n, 9, 2) in cells.
        visibility: (n,), 0..1; less visible fruit is left out, as DOPE's tools do.
        height, width: of the maps [cells].
        sigma: of the belief's Gaussians [cells].
        radius: of the discs on which affinities are drawn [cells].
        least_visibility: least visible part that counts.
    """
    belief, affinity = np.zeros((9, height, width), np.float32), np.zeros((16, height, width), np.float32)
    for points, seen in zip(keypoints, visibility, strict=True):
        if seen < least_visibility:
            continue
        for k, (u, v) in enumerate(points):
            rows, columns = _window((u, v), max(4.0 * sigma, radius) + 1.0, height, width)
            distance = np.hypot(
                np.arange(rows.start, rows.stop)[:, None] - v, np.arange(columns.start, columns.stop)[None, :] - u
            )
            spot = np.exp(-(distance**2) / (2.0 * sigma**2))
            np.maximum(belief[k, rows, columns], spot, out=belief[k, rows, columns])
            if k < 8:
                towards = (points[8] - points[k]) / max(float(np.linalg.norm(points[8] - points[k])), 1e-6)
                affinity[2 * k, rows, columns][distance <= radius] = towards[0]
                affinity[2 * k + 1, rows, columns][distance <= radius] = towards[1]
    return belief, affinity


def _window(
    centre: tuple[float, float] | NDArray[np.float64], reach: float, height: int, width: int
) -> tuple[slice, slice]:
    u, v = float(centre[0]), float(centre[1])
    columns = slice(min(width, max(0, int(np.ceil(u - reach)))), max(0, min(width, int(np.floor(u + reach)) + 1)))
    rows = slice(min(height, max(0, int(np.ceil(v - reach)))), max(0, min(height, int(np.floor(v + reach)) + 1)))
    return rows, columns
