"""Sizes of fruit in photographs beside those that the search finds."""

from __future__ import annotations

import numpy as np

from pomona.skills.perception import search_sides
from pomona.tools.photographs.sizes_found import at_edge, findable_sizes


def test_sizes_at_the_edges_of_the_range_are_counted() -> None:
    sides = search_sides(1280, 960)
    assert findable_sizes(sides, 1280, 960) == (24.0, 1280.0)
    assert at_edge(np.array([25.0, 31.0, 33.0, 1200.0]), sides, 1280, 960) == (2, 0)
    assert findable_sizes((640,), 1280, 960) == (48.0, 260.0)
    assert at_edge(np.array([50.0, 100.0, 230.0, 250.0]), (640,), 1280, 960) == (1, 2)
