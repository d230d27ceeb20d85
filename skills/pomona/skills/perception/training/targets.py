"""What the finder is asked to draw: belief maps, offsets, and where neither counts."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64
from pomona.skills.perception.detection.close_look import keypoint_size
from pomona.skills.perception.detection.outputs import OFFSET_UNIT

SIGMA = 1.5
"""Standard deviation of a belief's Gaussian [cells]."""

OFFSET_RADIUS = 2.0
"""Offsets count this close to a centroid [cells]."""

LEAST_VISIBILITY = 0.3
"""Fruit of which less is seen is neither asked for nor punished."""

BOX_SPREAD = 0.1
"""Standard deviation of what a box's reaches are learnt from, in parts of its sides."""


@dataclass(frozen=True, slots=True, eq=False)
class FinderTargets:
    """What the finder is asked to draw for one picture, and where it counts.

    Attributes:
        belief: (9, h, w), Gaussians about the corners and the centroid.
        weight: of the belief, (1, h, w); 0 where nothing is said.
        offsets: (17, h, w), from a cell to the corners and log of their mean distance, in units of `OFFSET_UNIT` cells.
        offset_weight: (1, h, w), 1 near centroids.
        cornered: (1, 1, 1), 0 where only centres, sizes and boxes are known.
        unlabelled: (1, h, w), 1 where fruit may be that nobody labelled.
        peak: (1, h, w), 1 in the cell of each centroid.
        reaches: (4, h, w), how far the box of what is seen reaches left, up, right and down [cells].
        reach_weight: (1, h, w), 1 in all for each fruit whose box is known.
    """

    belief: Float32
    weight: Float32
    offsets: Float32
    offset_weight: Float32
    cornered: Float32
    unlabelled: Float32
    peak: Float32
    reaches: Float32
    reach_weight: Float32

    @property
    def parts(self) -> tuple[Float32, ...]:
        """All of them in this order, as batches hold them, (maps, h, w) each."""
        return tuple(getattr(self, field.name) for field in fields(self))


def _blank(height: int, width: int) -> FinderTargets:
    def maps(count: int) -> Float32:
        return np.zeros((count, height, width), np.float32)

    return FinderTargets(
        maps(9),
        np.ones((1, height, width), np.float32),
        maps(17),
        maps(1),
        np.ones((1, 1, 1), np.float32),
        maps(1),
        maps(1),
        maps(4),
        maps(1),
    )


def finder_targets(
    keypoints: Float64,
    visibility: Float64,
    height: int,
    width: int,
    boxes: Float64 | None = None,
) -> FinderTargets:
    """Maps for one rendered picture.

    Args:
        keypoints: (n, 9, 2) in cells.
        visibility: (n,), 0..1; less than `LEAST_VISIBILITY` is neither asked for nor punished.
        height, width: of the maps [cells].
        boxes: around what is seen, x, y, w, h (n, 4), from the map's corner [cells]; NaN or without extent: not known.
    """
    maps = _blank(height, width)
    nearest = np.full((height, width), np.inf)
    for k, (points, seen) in enumerate(zip(keypoints, visibility, strict=True)):
        if seen < LEAST_VISIBILITY:
            spread = float(np.abs(points[:8] - points[8]).max())
            rows, columns = _window(points[8], 0.6 * spread + 1.0, height, width)
            maps.weight[0, rows, columns] = 0.0
            continue
        centre = np.clip(points[8], 0.0, (width - 1.0, height - 1.0))
        for corner in range(8):
            _draw_spot(maps.belief[corner], points[corner])
        rows, columns, here = _draw_centre(maps, centre, nearest)
        du, dv = np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop)
        for corner in range(8):
            across, down = (points[corner, 0] - du)[None, :] + 0.0 * dv[:, None], (points[corner, 1] - dv)[:, None]
            maps.offsets[2 * corner, rows, columns][here] = across[here] / OFFSET_UNIT
            maps.offsets[2 * corner + 1, rows, columns][here] = (down + 0.0 * du[None, :])[here] / OFFSET_UNIT
        maps.offsets[16, rows, columns][here] = np.log(max(keypoint_size(points), 0.5) / OFFSET_UNIT)
        maps.offset_weight[0, rows, columns][here] = 1.0
        if boxes is not None:
            _draw_box(maps, centre, boxes[k])
    # A half-hidden neighbour's blank must not wipe out what is asked for beside it.
    maps.weight[0] = np.maximum(maps.weight[0], maps.belief.max(axis=0))
    return maps


def box_targets(
    centres: Float64,
    sizes: Float64,
    boxes: Float64,
    counted: NDArray[np.bool_],
    height: int,
    width: int,
) -> FinderTargets:
    """Maps for a photograph, where boxes are all that is known: the centroid's belief, the size and the box.

    Args:
        centres: of the fruit (n, 2) [cells]; one outside of the map is asked for at its border.
        sizes: mean distances of corners from centroid, (n,) [cells]; NaN where a box does not tell.
        boxes: x, y, w, h (n, 4), from the map's corner [cells].
        counted: whether a box is fruit; nothing is said inside of one that is not, (n,).
        height, width: of the maps [cells].
    """
    maps = _blank(height, width)
    maps.cornered[:] = 0.0
    maps.unlabelled[:] = 1.0
    for box, fruit in zip(boxes, counted, strict=True):
        inside = (slice(*_cells(box[1], box[3], height)), slice(*_cells(box[0], box[2], width)))
        maps.unlabelled[0][inside] = 0.0
        if not fruit:
            maps.weight[0][inside] = 0.0
    nearest = np.full((height, width), np.inf)
    for centre, size, box in zip(centres[counted], sizes[counted], boxes[counted], strict=True):
        centre = np.clip(centre, 0.0, (width - 1.0, height - 1.0))
        rows, columns, here = _draw_centre(maps, centre, nearest)
        if np.isfinite(size):
            maps.offsets[16, rows, columns][here] = np.log(max(float(size), 0.5) / OFFSET_UNIT)
            maps.offset_weight[0, rows, columns][here] = 1.0
        _draw_box(maps, centre, box)
    maps.weight[0] = np.maximum(maps.weight[0], maps.belief[8])
    return maps


def _draw_spot(belief: Float32, point: Float64) -> None:
    rows, columns = _window(point, 3.5 * SIGMA, *belief.shape)
    du, dv = np.arange(columns.start, columns.stop) - point[0], np.arange(rows.start, rows.stop) - point[1]
    spot = np.exp(-(dv[:, None] ** 2 + du[None, :] ** 2) / (2.0 * SIGMA**2))
    np.maximum(belief[rows, columns], spot, out=belief[rows, columns])


def _draw_centre(maps: FinderTargets, centre: Float64, nearest: Float64) -> tuple[slice, slice, NDArray[np.bool_]]:
    """The centroid's belief and peak; returns the window about it and which of its cells are nearest to this fruit."""
    height, width = nearest.shape
    _draw_spot(maps.belief[8], centre)
    u, v = np.round(centre).astype(int)
    maps.peak[0, v, u] = 1.0
    rows, columns = _window(centre, OFFSET_RADIUS, height, width)
    du, dv = np.arange(columns.start, columns.stop) - centre[0], np.arange(rows.start, rows.stop) - centre[1]
    distance = np.hypot(dv[:, None], du[None, :])
    here = (distance <= OFFSET_RADIUS) & (distance < nearest[rows, columns])
    nearest[rows, columns][here] = distance[here]
    return rows, columns, here


def _draw_box(maps: FinderTargets, centre: Float64, box: Float64) -> None:
    """The box's reaches about its fruit's centre, weighted by a Gaussian as wide as the box, one in all."""
    if not (box[2:] > 0.0).all():
        return
    _, height, width = maps.reaches.shape
    spread = np.maximum(BOX_SPREAD * box[2:], 0.5)
    rows, columns = _window(centre, float(2.0 * spread.max()), height, width)
    u, v = np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop)
    share = np.exp(
        -0.5 * (((v - centre[1]) / spread[1]) ** 2)[:, None] - 0.5 * (((u - centre[0]) / spread[0]) ** 2)[None, :]
    )
    share /= share.sum()
    here = share > maps.reach_weight[0, rows, columns]
    flat, upright = 0.0 * v[:, None], 0.0 * u[None, :]
    sides = (
        (u + 0.5 - box[0])[None, :] + flat,
        (v + 0.5 - box[1])[:, None] + upright,
        (box[0] + box[2] - u - 0.5)[None, :] + flat,
        (box[1] + box[3] - v - 0.5)[:, None] + upright,
    )
    here &= np.min(sides, axis=0) > -0.5
    for k, side in enumerate(sides):
        maps.reaches[k, rows, columns][here] = np.maximum(side, 0.02)[here]
    maps.reach_weight[0, rows, columns][here] = share[here]


def _cells(start: float, extent: float, limit: int) -> tuple[int, int]:
    """The cells that a stretch touches."""
    return max(0, min(limit, math.floor(start))), max(0, min(limit, math.ceil(start + extent)))


def dope_targets(
    keypoints: NDArray[np.float64],
    visibility: NDArray[np.float64],
    height: int,
    width: int,
    sigma: float = 0.5,
    radius: float = 1.0,
) -> tuple[Float32, Float32]:
    """DOPE's own maps for one picture: belief (9, h, w), and affinity (16, h, w) as unit vectors to the centroid.

    Args:
        keypoints: (n, 9, 2) in cells.
        visibility: (n,), 0..1; below 0.1 fruit is left out, as DOPE's tools do.
        height, width: of the maps [cells].
        sigma: of the belief's Gaussians [cells].
        radius: of the discs on which affinities are drawn [cells].
    """
    belief, affinity = np.zeros((9, height, width), np.float32), np.zeros((16, height, width), np.float32)
    for points, seen in zip(keypoints, visibility, strict=True):
        if seen < 0.1:
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
