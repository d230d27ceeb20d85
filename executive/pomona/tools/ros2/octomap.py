"""Occupied cells as a message of octomap_msgs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pomona.tools.ros2.octree import OCCUPIED, octree


def octomap(points: Any, resolution: float) -> Mapping[str, Any]:
    """Return the fields of octomap_msgs/Octomap without its header. Cells that are not occupied are unknown.

    Args:
        points: centres of occupied cells, shape (n, 3) [m].
        resolution: a cell's edge [m].

    Raises ValueError: a point lies beyond the 32 768 cells on each side of the origin that the format can hold.
    """
    cells = np.unique(
        np.floor(np.asarray(points, float).reshape(-1, 3) / resolution).astype(np.int64), axis=0
    )
    written, _ = octree(cells, np.full(len(cells), OCCUPIED, np.uint8))
    return {
        "binary": True,
        "id": "OcTree",
        "resolution": resolution,
        "data": np.frombuffer(written, np.int8),
    }
