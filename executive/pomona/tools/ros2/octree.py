"""OctoMap's binary octree: cells of a grid as bytes.

The format (OctoMap's `OcTreeBaseImpl::writeBinaryNode`): the tree depth first. An inner node is two bytes, two bits for
each of its eight children, the first child in the lowest bits: 0 unknown, 1 free, 2 occupied, 3 an inner node that
follows. Child c has the larger half of x, y, z where bit 0, 1, 2 of c is set. The tree has 16 levels below its root;
its finest cells have a corner in the origin.
"""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Int64, UInt8

LEVELS = 16
FREE = 1
OCCUPIED = 2
INNER = 3


def octree(cells: Int64, codes: UInt8) -> tuple[bytes, int]:
    """Encode known cells as an octree; return its bytes and its number of nodes.

    Args:
        cells: which cells of the grid are known, counted from the origin, each once, shape (n, 3).
        codes: FREE or OCCUPIED, shape (n,).

    Raises ValueError: a cell lies beyond the 32 768 on each side of the origin that the format can hold.
    """
    keys = cells + 2 ** (LEVELS - 1)
    if len(keys) and (keys.min() < 0 or keys.max() >= 2**LEVELS):
        raise ValueError(
            f"cells beyond {2 ** (LEVELS - 1)} from the origin are more than OctoMap can number"
        )
    levels: list[tuple[Int64, UInt8]] = []
    for _ in range(LEVELS if len(keys) else 0):
        parents, children = _parents(keys, codes)
        inner = ~(
            (children == children[:, :1]).all(axis=1)
            & (children[:, 0] != INNER)
            & (children[:, 0] != 0)
        )
        levels.append((parents[inner], children[inner]))
        keys = parents
        codes = np.where(inner, INNER, children[:, 0]).astype(np.uint8)
    nodes = int(bool(len(keys))) + sum(int(np.count_nonzero(children)) for _, children in levels)
    return _depth_first(levels[::-1]), nodes


def _parents(keys: Int64, codes: UInt8) -> tuple[Int64, UInt8]:
    """Return the keys one level up, shape (n, 3), and the state of their eight children, shape (n, 8)."""
    parents, which = np.unique(keys >> 1, axis=0, return_inverse=True)
    children = np.zeros((len(parents), 8), np.uint8)
    children[which.ravel(), (keys & 1) @ [1, 2, 4]] = codes
    return parents, children


def _depth_first(levels: list[tuple[Int64, UInt8]]) -> bytes:
    """Return the inner nodes in the file's order; levels from the root down."""
    if not levels:
        return b""
    rows = [{tuple(key): row for row, key in enumerate(keys.tolist())} for keys, _ in levels]
    packed = [
        (children.astype(np.uint16) << (2 * np.arange(8, dtype=np.uint16))).sum(axis=1)
        for _, children in levels
    ]
    written = bytearray()
    stack = [(0, (0, 0, 0))]
    while stack:
        depth, key = stack.pop()
        row = rows[depth][key]
        written += int(packed[depth][row]).to_bytes(2, "little")
        for c in np.flatnonzero(levels[depth][1][row] == INNER)[::-1].tolist():
            stack.append(
                (
                    depth + 1,
                    (2 * key[0] + (c & 1), 2 * key[1] + (c >> 1 & 1), 2 * key[2] + (c >> 2)),
                )
            )
    return bytes(written)
