"""Scores of a run in a simulated world."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.executive.values.kinds import Words
from pomona.executive.values.sections import value


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Quantities of the world's truth that count: conditions for a success, and figures for reports."""

    success: tuple[str, ...] | None = value(
        Words(), None, "conditions that the world must report in addition to the tree's success"
    )
    figures: tuple[str, ...] = value(Words(), (), "numbers of the world's truth, for reports")

    def over(self, cells: Score | None) -> Score:
        """Return this score, completed by the cell's; the cell's figures come first."""
        if cells is None:
            return self
        success = cells.success if self.success is None else self.success
        return Score(success=success, figures=tuple(dict.fromkeys((*self.figures, *cells.figures))))
