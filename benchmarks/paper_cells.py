"""The runs of a campaign of the paper's 25 cells, looked up by arm, fruit and place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.tools.library.campaign.report import Result, from_truth
from pomona.tools.library.campaign.run import succeeded
from pomona.tools.library.campaign.spec import Campaign

FRUITS = tuple(f"apple_{i}" for i in range(1, 6))
PLACES = ("1", "2", "3", "4", "5")
REFINED, UNREFINED = "refined", "unrefined"
TABLE_Z = -0.12
"""Height of the table in the base frame [m]; the paper's frame stands on the table."""


class Cells:
    """All results of a campaign with the arms `refined` and `unrefined`."""

    ERRORS: ClassVar[tuple[str, ...]] = (
        "position_error_mm",
        "centroid_error_mm",
        "size_error_mm",
        "width_error_mm",
    )

    def __init__(self, campaign: Campaign, results: Sequence[Result]) -> None:
        self.campaign, self.results = campaign, results

    def arm(self, name: str) -> list[Result]:
        return [run for run in self.results if run["arm"] == name]

    def at(self, arm: str, fruit: str | None, place: str) -> list[Result]:
        """Runs of one cell, or of a place with all fruits."""
        return [
            run
            for run in self.arm(arm)
            if run["varied"]["place"] == place
            and (fruit is None or run["varied"]["fruit"] == fruit)
        ]

    def good(self, runs: Sequence[Result]) -> list[Result]:
        return [run for run in runs if succeeded(run)]

    def rate(self, arm: str, fruit: str | None, place: str) -> float:
        """Success rate of a cell; NaN when nothing ran."""
        runs = self.at(arm, fruit, place)
        return len(self.good(runs)) / len(runs) if runs else float("nan")

    def rates(self, arm: str) -> list[list[float]]:
        return [[self.rate(arm, fruit, place) for place in PLACES] for fruit in FRUITS]

    @staticmethod
    def truth(name: str) -> Callable[[Result], Any]:
        """Reads a figure of the simulated world's truth."""
        return from_truth(name)

    # Reported and true values of a run.

    @staticmethod
    def reported(runs: Sequence[Result], name: str) -> list[Any]:
        measured = [(run.get("values") or {}).get("measured") or {} for run in runs]
        return [each[name] for each in measured if name in each]

    def mu(self, runs: Sequence[Result]) -> list[float]:
        return [float(mu) for mu in self.reported(runs, "mu")]

    def mean_position(self, runs: Sequence[Result]) -> Float64 | None:
        """Mean reported position, on the table's surface [m]."""
        return _mean([_on_table(p) for p in self.reported(runs, "position_m")])

    def mean_dimensions(self, runs: Sequence[Result]) -> Float64 | None:
        return _mean(self.reported(runs, "dimensions_m"))

    @staticmethod
    def mean_true_position(runs: Sequence[Result]) -> Float64 | None:
        """Mean true position at the look, on the table's surface [m]."""
        poses = [run["truth"]["T_base_fruit_at_look"] for run in runs if run.get("truth")]
        return _mean([_on_table(np.asarray(T)[:3, 3]) for T in poses])

    @staticmethod
    def mean_true_dimensions(runs: Sequence[Result]) -> Float64 | None:
        return _mean([run["truth"]["dimensions_m"] for run in runs if run.get("truth")])


def _on_table(position: Any) -> Float64:
    moved: Float64 = np.asarray(position, dtype=np.float64) - (0.0, 0.0, TABLE_Z)
    return moved


def _mean(vectors: Sequence[Any]) -> Float64 | None:
    return np.mean(np.asarray(vectors, dtype=np.float64), axis=0) if len(vectors) else None
