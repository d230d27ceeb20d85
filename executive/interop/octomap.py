"""Occupied cells as a message of octomap_msgs: an octree of 16 levels, depth first, two bytes an inner node.

The format is OctoMap's `writeBinaryNode`: two bits for each of the eight children, the first in the lowest bits: 0
unknown, 1 free, 2 occupied, 3 an inner node that follows. Child c has the larger half of x, y, z where bit 0, 1, 2 of c
is set.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

LEVELS = 16
_OCCUPIED, _INNER = 2, 3


def octomap(points: Any, resolution: float) -> Mapping[str, Any]:
    """The fields of octomap_msgs/Octomap but its header. What is not occupied is unknown.

    Args:
        points: centres of occupied cells, shape (n, 3) [m].
        resolution: a cell's edge [m].

    Raises:
        ValueError: a point lies beyond the 32 768 cells on each side of the origin that the format can hold.
    """
    keys = np.floor(np.asarray(points, float).reshape(-1, 3) / resolution).astype(np.int64) + 2 ** (LEVELS - 1)
    if len(keys) and (keys.min() < 0 or keys.max() >= 2**LEVELS):
        raise ValueError(f"cells of {resolution} m are more than OctoMap can number")
    cells = np.unique(keys, axis=0)
    written = bytearray()
    if len(cells):
        _node(cells, LEVELS - 1, written)
    data = np.frombuffer(bytes(written), np.int8)
    return {"binary": True, "id": "OcTree", "resolution": resolution, "data": data}


def _node(cells: Any, level: int, written: bytearray) -> None:
    """An inner node over `cells`, all below it; `level` is the bit of the keys that tells its children apart."""
    which = (cells >> level & 1) @ np.array([1, 2, 4])
    below = {int(child): cells[which == child] for child in np.unique(which)}
    full = {child for child, inside in below.items() if len(inside) == 8**level}
    code = sum((_OCCUPIED if child in full else _INNER) << (2 * child) for child in below)
    written += code.to_bytes(2, "little")
    for child in sorted(below.keys() - full):
        _node(below[child], level - 1, written)
