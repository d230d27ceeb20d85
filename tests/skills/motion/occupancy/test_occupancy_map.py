"""`.bt` files: read back by a reader of their own, written from OctoMap's description, and byte by byte."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pomona.skills.motion.occupancy import FREE, HIDDEN, OCCUPIED, OccupancyMap
from pomona.skills.motion.occupancy.occupancy_map import to_bt, write_bt


def read_bt(content: bytes) -> tuple[float, int, dict[tuple[int, int, int], bool]]:
    """Resolution, number of nodes, and whether each finest cell is occupied, by its index from the origin."""
    header, data = content.split(b"data\n", 1)
    assert header.startswith(b"# Octomap OcTree binary file\n")
    entries = dict(
        line.split(" ", 1) for line in header.decode().splitlines() if not line.startswith("#")
    )
    assert entries["id"] == "OcTree"
    cells: dict[tuple[int, int, int], bool] = {}
    stream = iter(data)

    def node(x: int, y: int, z: int, size: int) -> int:
        """Read an inner node whose lower corner and edge are in finest cells; how many nodes there are in it."""
        bits, nodes, half = next(stream) | next(stream) << 8, 1, size // 2
        kinds = [bits >> 2 * c & 3 for c in range(8)]
        for c, kind in enumerate(kinds):
            corner = (x + half * (c & 1), y + half * (c >> 1 & 1), z + half * (c >> 2 & 1))
            if kind == 3:
                nodes += node(*corner, half)
            elif kind:
                nodes += 1
                block = np.indices((half, half, half)).reshape(3, -1).T + corner
                cells.update({tuple(cell): kind == 2 for cell in block.tolist()})
        return nodes

    nodes = node(-(2**15), -(2**15), -(2**15), 2**16) if data else 0
    assert next(stream, None) is None  # nothing is left over
    assert nodes == int(entries["size"])
    return float(entries["res"]), nodes, cells


def a_map(
    states: np.ndarray, origin: tuple[float, float, float], resolution: float
) -> OccupancyMap:
    return OccupancyMap(
        np.array(origin),
        resolution,
        states.astype(np.uint8),
        np.zeros(states.shape, np.int16),
        (0.0,),
    )


def test_every_cell_comes_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    states = rng.choice([0, FREE, OCCUPIED, HIDDEN], (13, 9, 7), p=[0.3, 0.5, 0.1, 0.1])
    states[:8, :8, :4] = FREE  # some of it can be merged
    write_bt(a_map(states, (-0.06, 0.02, -0.10), 0.02), tmp_path / "map.bt")
    resolution, _, cells = read_bt((tmp_path / "map.bt").read_bytes())
    assert resolution == 0.02
    first = np.array([-3, 1, -5])
    known = {
        tuple((cell + first).tolist()): states[tuple(cell)] >= OCCUPIED
        for cell in np.argwhere(states)
    }
    assert cells == known


def test_eight_equal_cells_are_one_node() -> None:
    one = read_bt(to_bt(a_map(np.full((2, 2, 2), FREE), (0.0, 0.0, 0.0), 0.1)))
    assert one[1] == 16  # the root and one node on each level down to the merged one
    assert len(one[2]) == 8


def test_one_cell_byte_by_byte() -> None:
    """The cell that touches the origin from above is, level by level, child 7 and then child 0 of its parent."""
    content = to_bt(a_map(np.full((1, 1, 1), OCCUPIED), (0.0, 0.0, 0.0), 0.05))
    data = content.split(b"data\n", 1)[1]
    assert data == (3 << 14).to_bytes(2, "little") + 14 * (3).to_bytes(2, "little") + (2).to_bytes(
        2, "little"
    )


def test_a_map_that_has_seen_nothing_is_an_empty_tree() -> None:
    content = to_bt(OccupancyMap.empty(np.zeros(3), np.ones(3), 0.1))
    assert content.endswith(b"size 0\nres 0.1\ndata\n")


def test_a_map_too_far_away_is_refused() -> None:
    far = a_map(np.full((1, 1, 1), OCCUPIED), (0.0, 0.0, 400.0), 0.01)
    with pytest.raises(ValueError, match="more than OctoMap can number"):
        to_bt(far)
    assert to_bt(replace(far, resolution=0.1))
