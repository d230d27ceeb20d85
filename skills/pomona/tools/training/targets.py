"""Targets of the finder: a peak in the middle of each fruit, and its box."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64

SPREAD = 0.1  # standard deviation of a fruit's peak, as a ratio of the box's sides
LEAST_SPREAD = 0.6  # its lower bound [cells]
NEAR = 0.1  # the box is asked for where the peak is higher than this

PEAK = 0
HEAT = 1
WEIGHT = 2
BOX_WEIGHT = 3
REACHES = slice(4, 8)
"""Rows of the finder's targets: 1 in the cell of each fruit's middle, the peaks, where the heat counts, how much the
box counts, and the box's reaches left, up, right and down of the cell's middle [cells]."""

ROWS = 8


def finder_targets(boxes: Float64, taught: NDArray[np.bool_], height: int, width: int) -> Float32:
    """Return the finder's target maps, (8, height, width), of boxes x, y, w, h, (n, 4) [cells], around visible parts.

    Where `taught` (n,) is False, the box's inside is neither fruit nor background.
    """
    maps = np.zeros((ROWS, height, width), np.float32)
    maps[WEIGHT] = 1.0
    for x, y, w, h in boxes[~taught]:
        rows = slice(max(0, int(np.floor(y))), int(np.ceil(y + h)))
        maps[WEIGHT, rows, max(0, int(np.floor(x))) : int(np.ceil(x + w))] = 0.0
    fruit = boxes[taught]
    u = np.arange(width) + 0.5
    v = np.arange(height) + 0.5
    # Small boxes are drawn last: where boxes overlap, the nearer to its own middle is mostly the smaller one.
    for x, y, w, h in fruit[np.argsort(-fruit[:, 2:].prod(axis=1), kind="stable")]:
        column = min(width - 1, int(x + 0.5 * w))
        row = min(height - 1, int(y + 0.5 * h))
        across = np.exp(-0.5 * ((u - column - 0.5) / max(LEAST_SPREAD, SPREAD * w)) ** 2)
        down = np.exp(-0.5 * ((v - row - 0.5) / max(LEAST_SPREAD, SPREAD * h)) ** 2)
        spot = (down[:, None] * across[None, :]).astype(np.float32)
        np.maximum(maps[HEAT], spot, out=maps[HEAT])
        maps[PEAK, row, column] = 1.0
        sides = np.broadcast_arrays(
            u[None, :] - x, v[:, None] - y, x + w - u[None, :], y + h - v[:, None]
        )
        here = (spot > NEAR) & (np.min(sides, axis=0) > 0.0)
        maps[BOX_WEIGHT][here] = spot[here]
        maps[REACHES, here] = np.stack([side[here] for side in sides])
    maps[WEIGHT] = np.maximum(maps[WEIGHT], maps[HEAT] > NEAR)
    return maps
