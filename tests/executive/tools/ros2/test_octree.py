"""An octree, read back by a reader of its own, has the cells that were written."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.tools.ros2.octree import FREE, OCCUPIED, octree

LEVELS = 16


def read(data: bytes) -> tuple[int, dict[tuple[int, int, int], int]]:
    """Return the number of nodes, and the code of each finest cell by its index from the origin."""
    cells: dict[tuple[int, int, int], int] = {}
    stream = iter(data)

    def node(x: int, y: int, z: int, size: int) -> int:
        """Read an inner node whose lower corner and edge are in finest cells; return how many nodes are in it."""
        bits = next(stream) | next(stream) << 8
        nodes, half = 1, size // 2
        for child in range(8):
            kind = bits >> 2 * child & 3
            corner = (
                x + half * (child & 1),
                y + half * (child >> 1 & 1),
                z + half * (child >> 2 & 1),
            )
            if kind == 3:
                nodes += node(*corner, half)
            elif kind:
                nodes += 1
                block = np.indices((half, half, half)).reshape(3, -1).T + corner
                cells.update({tuple(cell): kind for cell in block.tolist()})
        return nodes

    least = -(2 ** (LEVELS - 1))
    nodes = node(least, least, least, 2**LEVELS) if data else 0
    assert next(stream, None) is None, "nothing is left over"
    return nodes, cells


def written(cells: np.ndarray, codes: np.ndarray) -> tuple[bytes, int]:
    return octree(np.asarray(cells, np.int64), np.asarray(codes, np.uint8))


def test_every_cell_comes_back() -> None:
    rng = np.random.default_rng(0)
    states = rng.choice([0, FREE, OCCUPIED], (13, 9, 7), p=[0.3, 0.5, 0.2])
    states[:8, :8, :4] = FREE  # some of it can be merged
    known = np.argwhere(states)
    first = np.array([-3, 1, -5])
    data, nodes = written(known + first, states[tuple(known.T)])
    counted, cells = read(data)
    assert counted == nodes
    assert cells == {tuple((cell + first).tolist()): states[tuple(cell)] for cell in known}


def test_eight_equal_cells_are_one_node() -> None:
    data, _ = written(np.argwhere(np.ones((2, 2, 2))), np.full(8, FREE))
    nodes, cells = read(data)
    assert nodes == LEVELS, "the root and one node on each level down to the merged one"
    assert len(cells) == 8


def test_one_cell_byte_by_byte() -> None:
    """The cell that touches the origin from above is, level by level, child 7 and then child 0 of its parent."""
    data, _ = written(np.zeros((1, 3)), np.array([OCCUPIED]))
    levels = [3 << 14, *(14 * [3]), 2]
    assert data == b"".join(bits.to_bytes(2, "little") for bits in levels)


def test_no_cell_is_an_empty_tree() -> None:
    assert written(np.zeros((0, 3)), np.zeros(0)) == (b"", 0)


@pytest.mark.parametrize("cell", [[0, 0, 2**15], [-(2**15) - 1, 0, 0]])
def test_a_cell_too_far_away_is_refused(cell: list[int]) -> None:
    with pytest.raises(ValueError, match="more than OctoMap can number"):
        written(np.array([cell]), np.array([OCCUPIED]))


@pytest.mark.parametrize("cell", [[0, 0, 2**15 - 1], [-(2**15), 0, 0]])
def test_the_farthest_cells_come_back(cell: list[int]) -> None:
    data, _ = written(np.array([cell]), np.array([OCCUPIED]))
    assert read(data)[1] == {tuple(cell): OCCUPIED}
