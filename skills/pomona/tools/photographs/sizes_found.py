"""Sizes of the fruit found in photographs, beside the sizes that the search can find."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.executive import Float64
from pomona.skills.perception import LARGEST_SIDE, search_sides
from pomona.skills.perception.detection.places import (
    LARGEST_FRUIT,
    LARGEST_WHOLE,
    SMALLEST_FRUIT,
    SURE_LARGEST,
)

# sizes of pictures whose search is announced: a folder may hold as many sizes as pictures
MOST_ANNOUNCED = 5

AT_FIRST = f"; above {LARGEST_WHOLE} px only where a smaller width is sure of a fruit"

# from this ratio of sizes at an edge of the range on, fruit beyond it is probably missed
CUT = 0.25


EDGE_SMALLEST = 32.0  # a median longer side below this in the largest input means that smaller fruit is missed [px]


def findable_sizes(sides: Sequence[int], width: int, height: int) -> tuple[float, float]:
    """Return the smallest and largest longer side of fruit in a picture that a search at these sides can find [px]."""
    longer = max(width, height)
    return SMALLEST_FRUIT * longer / max(sides), min(longer, LARGEST_FRUIT * longer / min(sides))


def at_edge(sizes: Float64, sides: Sequence[int], width: int, height: int) -> tuple[int, int]:
    """Return how many longer sides of fruit (n,) [px] lie at the lower, and at the upper edge of the findable range."""
    low, high = findable_sizes(sides, width, height)
    lower = sizes < low * EDGE_SMALLEST / SMALLEST_FRUIT
    upper = sizes > high * SURE_LARGEST / LARGEST_FRUIT
    return int(lower.sum()), int(upper.sum()) if high < max(width, height) else 0


class SizesFound:
    """Collects the longer sides of boxes, picture by picture.

    Args:
        width: the one width at which pictures are searched [px]; None for several.
        range_known: False for a detector of unknown origin, whose sizes have no known range.
    """

    def __init__(self, width: int | None, range_known: bool = True) -> None:
        self._width = width
        self._range_known = range_known
        self._known: set[tuple[int, int]] = set()
        self._sizes: list[Float64] = []
        self._lower = self._upper = self._widest = 0

    def announce(self, width: int, height: int) -> str:
        """Return the widths of the search and the sizes that it finds, once for each size of picture; else nothing."""
        if (
            not self._range_known
            or (width, height) in self._known
            or len(self._known) > MOST_ANNOUNCED
        ):
            return ""
        self._known.add((width, height))
        if len(self._known) > MOST_ANNOUNCED:
            return "pictures of further sizes: searched in the same way"
        sides = self._sides(width, height)
        low, high = findable_sizes(sides, width, height)
        side = "longer side" if self._width is None else "longer side, one width"
        return (
            f"{width} × {height} px: searched at {', '.join(map(str, sides))} px ({side}); "
            f"finds fruit of {low:.0f} to {high:.0f} px"
            + (AT_FIRST if self._width is None and max(sides) > LARGEST_WHOLE else "")
        )

    def add(self, width: int, height: int, sizes: Float64) -> None:
        """Add the longer sides (n,) [px] of the fruit in a picture of this size."""
        self._sizes.append(sizes)
        if not self._range_known:
            return
        lower, upper = at_edge(sizes, self._sides(width, height), width, height)
        self._lower = self._lower + lower
        self._upper = self._upper + upper
        self._widest = max(self._widest, width)

    def lines(self) -> list[str]:
        """Return the sizes found, and a warning where they lie at an edge of the range."""
        sizes = np.concatenate([np.empty(0), *self._sizes])
        if not sizes.size:
            return []
        low, middle, high = np.quantile(sizes, (0.1, 0.5, 0.9))
        lines = [
            f"longer sides of the boxes: {low:.0f} to {high:.0f} px (10 % to 90 %), median {middle:.0f} px"
        ]
        if self._lower >= CUT * sizes.size:
            wider = 2 * (self._width or self._widest)
            cure = (
                f"enlarge them: --width {wider}" if wider <= LARGEST_SIDE else "cut them into parts"
            )
            lines.append(
                f"{self._lower / sizes.size:.0%} of the fruit are as small as the search can find: smaller fruit is "
                f"missed. Take the pictures from nearer, or {cure}"
            )
        if self._upper >= CUT * sizes.size:
            lines.append(
                f"{self._upper / sizes.size:.0%} of the fruit are as large as the search can find: larger fruit is "
                "missed. Leave --width out, or take a smaller one"
            )
        return lines

    def _sides(self, width: int, height: int) -> Sequence[int]:
        if self._width is None:
            return search_sides(width, height)
        return (round(self._width * max(width, height) / width),)
