"""The account of a task with many fruits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pomona.executive import Float64

DONE = "done"  # the outcome that is no failure


@dataclass(frozen=True, slots=True, eq=False)
class TalliedFruit:
    """One fruit."""

    p_base: Float64 | None  # its position, shape (3,) [m], or None when it was not seen
    size: Float64 | None  # its dimensions, shape (3,) [m], or None when it was not measured
    outcome: str  # a word: `DONE`, or another outcome
    why: str  # a sentence, empty when there is nothing to explain
    tries: int = 1  # number of tries
    # its number, where fruit moves and a place is of no fruit; None: known by its place
    number: int | None = None
    # width between the pads when both had touched it [m]; None: not felt by both
    felt: float | None = None

    @property
    def place(self) -> str:
        """Text for the operator."""
        if self.p_base is None:
            return "an unknown place"
        x, y = 1e3 * self.p_base[:2]
        return f"({x:.0f}, {y:.0f}) mm"

    @property
    def width(self) -> str:
        """Text for the operator; empty where the pads felt none."""
        return "" if self.felt is None else f"{1e3 * self.felt:.1f} mm"

    def is_same(self, other: TalliedFruit) -> bool:
        """Return True for the same fruit, seen again: by number where there is one, else by place."""
        if self.number is not None or other.number is not None:
            return self.number == other.number
        if self.p_base is None or other.p_base is None:
            return False
        # a fruit seen this near to an earlier one is the same, tried again [m]: less than half a fruit
        return float(np.linalg.norm(self.p_base[:2] - other.p_base[:2])) < 0.04

    @property
    def dimensions(self) -> str:
        """Text for the operator."""
        return (
            "not measured"
            if self.size is None
            else " × ".join(f"{1e3 * d:.0f}" for d in self.size) + " mm"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """All fruits so far, in the order in which they were first tried; `known` counts those that were seen, too."""

    entries: tuple[TalliedFruit, ...] = ()
    known: int = 0

    def with_entry(self, entry: TalliedFruit, found: int = 1) -> Tally:
        """Return the tally with one more try, of a frame with `found` fruit.

        A fruit that failed before at the same place, or with the same number, is the same fruit.
        """
        seen = len(self.entries) - len(self.left) + found
        for k, known in enumerate(self.entries):
            if known.outcome != DONE and entry.is_same(known):
                again = replace(
                    entry,
                    tries=known.tries + 1,
                    size=known.size if entry.size is None else entry.size,
                )
                return Tally((*self.entries[:k], again, *self.entries[k + 1 :]), seen)
        return Tally((*self.entries, entry), seen)

    @property
    def left(self) -> tuple[TalliedFruit, ...]:
        """Those that came to nothing."""
        return tuple(entry for entry in self.entries if entry.outcome != DONE)

    @property
    def sentence(self) -> str:
        """Text for the operator, with the given-up fruit."""
        done = f"{len(self.entries) - len(self.left)} of {max(self.known, len(self.entries))} fruit put away"
        return "; ".join(
            (done, *(f"{entry.outcome} at {entry.place}: {entry.why}" for entry in self.left))
        )

    @property
    def facts(self) -> Mapping[str, object]:
        """For reports."""
        return {
            "done": len(self.entries) - len(self.left),
            "felt_m": [entry.felt for entry in self.entries],
            "left": [
                {"position_m": e.p_base, "outcome": e.outcome, "why": e.why, "tries": e.tries}
                for e in self.left
            ],
        }
