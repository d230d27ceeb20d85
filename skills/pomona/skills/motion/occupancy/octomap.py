"""The occupancy map as a file of OctoMap (`.bt`), for other tools.

A text header, then the octree (`pomona.executive.values.octree`) of cells that are `resolution` wide.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pomona.executive.values import octree
from pomona.skills.motion.occupancy.occupancy_map import OCCUPIED, UNKNOWN, OccupancyMap


def write_bt(map: OccupancyMap, path: Path) -> None:
    """Write a map. Blocked cells (occupied and hidden) are occupied, free cells free, the rest is unknown.

    OctoMap's cells lie on multiples of the resolution: a map whose origin does not is shifted by up to half a cell.

    Raises:
        OSError: the file cannot be written.
        ValueError: the map lies beyond the 32 768 cells on each side of the origin that the format can hold.
    """
    path.write_bytes(to_bt(map))


def to_bt(map: OccupancyMap) -> bytes:
    """Return the contents of a `.bt` file; see `write_bt`."""
    known = np.argwhere(map.states != UNKNOWN)
    codes = np.where(map.states[tuple(known.T)] >= OCCUPIED, octree.OCCUPIED, octree.FREE).astype(np.uint8)
    data, nodes = octree.octree(known + np.round(map.origin / map.resolution).astype(np.int64), codes)
    header = (
        f"# Octomap OcTree binary file\n# written by Pomona\nid OcTree\nsize {nodes}\nres {map.resolution:.9g}\ndata\n"
    )
    return header.encode() + data
