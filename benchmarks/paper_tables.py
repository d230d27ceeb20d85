"""The tables of the paper's experiment: printed, recomputed from the paper's own numbers, and ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks import paper_numbers as printed
from benchmarks.paper_cells import FRUITS, PLACES, REFINED, UNREFINED, Cells
from pomona.tools.library.campaign.document import Paragraph, Table
from pomona.tools.library.campaign.report import numbers, rate
from pomona.tools.library.campaign.statistics import Estimate, mean, median

ATTEMPT_3 = "3"
APPLES = tuple(f"Apple {i}" for i in range(1, 6))
FORCE_GOAL = 1.25


def success(cells: Cells) -> list[Table | Paragraph]:
    blocks: list[Table | Paragraph] = []
    for arm, paper, title in (
        (REFINED, printed.REFINED_SUCCESS, "With pose refinement"),
        (UNREFINED, printed.UNREFINED_SUCCESS, "Without pose refinement"),
    ):
        rows = []
        for i, (name, fruit) in enumerate(zip(APPLES, FRUITS, strict=True)):
            runs = [run for run in cells.arm(arm) if run["varied"]["fruit"] == fruit]
            each = [
                f"{100 * paper[i, j]:.0f} / **{_percent(cells.rate(arm, fruit, place))}**"
                for j, place in enumerate(PLACES)
            ]
            rows.append(
                (
                    name,
                    *each,
                    f"{100 * paper[i].mean():.1f} %",
                    rate(runs),
                )
            )
        everything = rate(cells.arm(arm))
        columns = [f"{_percent(cells.rate(arm, None, place))}" for place in PLACES]
        of_paper = [f"{100 * paper[:, j].mean():.0f}" for j in range(5)]
        means = [f"{a} / **{b}**" for a, b in zip(of_paper, columns, strict=True)]
        rows.append(("All", *means, f"{100 * paper.mean():.1f} %", everything))
        header = ("", *(f"att. {j} [%]" for j in range(1, 6)), "paper, all", "ours, all (95 %)")
        blocks.append(Table(header, tuple(rows), f"{title}: paper / **ours**"))
    blocks.append(
        Paragraph(
            f"The paper made {printed.REPETITIONS} repetitions a cell, we {_repetitions(cells)}. "
            "Intervals are Wilson's.",
            note=True,
        )
    )
    return blocks


def _percent(rate: float) -> str:
    return "–" if np.isnan(rate) else f"{100 * rate:.0f}"


def _repetitions(cells: Cells) -> str:
    refined = len(cells.arm(REFINED)) / 25
    unrefined = len(cells.arm(UNREFINED)) / 25
    return f"{refined:.0f} with and {unrefined:.0f} without refinement"


# ------------------------------------------------------------------------------------------- tables of errors


def refined(cells: Cells) -> list[Table | Paragraph]:
    position, size, scale = [], [], []
    centroid = printed.centroid_errors(printed.REFINED_POSITION)
    dimension = printed.dimension_errors(printed.REFINED_DIMENSIONS)
    for i, (name, fruit) in enumerate(zip(APPLES, FRUITS, strict=True)):
        runs = cells.at(REFINED, fruit, ATTEMPT_3)
        position.append(
            (
                name,
                _vector(printed.REFINED_POSITION[i]),
                _vector(cells.mean_position(runs)),
                _vector(cells.mean_true_position(runs)),
                _signed(1e3 * printed.REFINED_CENTROID_ERROR[i]),
                _signed(1e3 * centroid[i]),
                _mean(mean(numbers(runs, cells.truth("centroid_error_mm")))),
            )
        )
        size.append(
            (
                name,
                _vector(printed.REFINED_DIMENSIONS[i]),
                _vector(cells.mean_dimensions(runs)),
                _vector(cells.mean_true_dimensions(runs)),
                _signed(1e3 * printed.REFINED_DIMENSION_ERROR[i]),
                _signed(1e3 * dimension[i]),
                _mean(mean(numbers(runs, cells.truth("size_error_mm")))),
            )
        )
        scale.append((name, f"{printed.MU_OPT[i]:.3f}", _mean(mean(cells.mu(runs)), 3)))
    return [
        Table(
            (
                "",
                "paper: refined pos. [m]",
                "ours [m]",
                "true [m]",
                "centroid err. printed",
                "recomputed",
                "ours [mm]",
            ),
            tuple(position),
            "Refined position, on the table's surface with z up, and centroid error [mm] (half the height less the "
            "estimated z; positive when the estimate is too low)",
        ),
        Table(
            (
                "",
                "paper: est. dim. [m]",
                "ours [m]",
                "true [m]",
                "dim. err. printed",
                "recomputed",
                "ours [mm]",
            ),
            tuple(size),
            "Estimated dimensions and dimension error [mm] (norm of the difference)",
        ),
        Table(("", "paper", "ours"), tuple(scale), "μ_opt, the scale of the CAD model"),
        _interval_note(cells),
    ]


def unrefined(cells: Cells) -> list[Table | Paragraph]:
    recomputed = printed.centroid_errors(printed.UNREFINED_POSITION)
    rows = []
    for i, (name, fruit) in enumerate(zip(APPLES, FRUITS, strict=True)):
        runs = cells.at(UNREFINED, fruit, ATTEMPT_3)
        rows.append(
            (
                name,
                _vector(printed.UNREFINED_POSITION[i]),
                _vector(cells.mean_position(runs)),
                _vector(cells.mean_true_position(runs)),
                _signed(1e3 * printed.UNREFINED_CENTROID_ERROR[i], 0),
                _signed(1e3 * recomputed[i]),
                _mean(mean(numbers(runs, cells.truth("centroid_error_mm"))), 1),
            )
        )
    header = (
        "",
        "paper: est. position [m]",
        "ours [m]",
        "true [m]",
        "centroid err. printed",
        "recomputed",
        "ours [mm]",
    )
    return [
        Table(
            header,
            tuple(rows),
            "Position as detected, with the CAD model's size, and centroid error [mm]",
        )
    ]


def everywhere(cells: Cells) -> list[Table]:
    rows = []
    for arm, label in ((REFINED, "with"), (UNREFINED, "without")):
        for name, fruit in zip(APPLES, FRUITS, strict=True):
            runs = [run for run in cells.arm(arm) if run["varied"]["fruit"] == fruit]
            figures = (mean(numbers(runs, cells.truth(key))) for key in cells.ERRORS)
            rows.append((f"{name}, {label}", *map(_mean, figures), str(len(runs))))
    header = (
        "refinement",
        "position err. [mm]",
        "centroid err. [mm]",
        "dimension err. [mm]",
        "width err. [mm]",
        "runs",
    )
    return [
        Table(header, tuple(rows), "Means over all places with Student's 95 % interval"),
    ]


# --------------------------------------------------------------------------------------------------- force


def force(cells: Cells) -> list[Table | Paragraph]:
    good = cells.good(cells.arm(REFINED))
    rows = []
    for name, fruit in (*zip(APPLES, FRUITS, strict=True), ("All", None)):
        runs = [run for run in good if fruit is None or run["varied"]["fruit"] == fruit]
        presses = numbers(runs, cells.truth("largest_press"))
        figures = [
            numbers(runs, cells.truth(key))
            for key in ("hold_force_n", "hold_ratio", "end_ratio", "slip_mm")
        ]
        peak = f"{max(presses):.2f}" if presses else "–"
        rows.append(
            (name, *(_interval(median(values), 2) for values in figures), peak, str(len(runs)))
        )
    header = (
        "",
        "force [N]",
        "force / least",
        "at the end",
        "slip [mm]",
        "largest press",
        "picks",
    )
    return [
        Table(
            header,
            tuple(rows),
            "Medians of successful picks with refinement, with the bootstrap's 95 % interval",
        ),
        Paragraph(
            "Force: normal force of both fingers, its median while the fruit hangs free. Least: what the limit surface "
            "of the simulator's pads needs for the load of the same moment. Largest press: of anything that touches the "
            "fruit, over the force with which Hertz's contact has 100 kPa; apples do not bruise below (Processes 2024, 12, "
            "543).",
            note=True,
        ),
    ]


def _interval_note(cells: Cells) -> Paragraph:
    count = max(len(cells.at(REFINED, fruit, ATTEMPT_3)) for fruit in FRUITS)
    return Paragraph(f"Ours: means of {count} runs a row, with Student's 95 % interval.", note=True)


def _vector(values: Any) -> str:
    return "–" if values is None else ", ".join(_signed(value, 3) for value in values)


def _signed(value: float, digits: int = 1) -> str:
    return f"{value:.{digits}f}".replace("-", "−")


def _mean(estimate: Estimate, digits: int = 2) -> str:
    """`0.72 ± 0.20`: mean and half its interval."""
    if not estimate.count:
        return "–"
    if estimate.count == 1:
        return _signed(estimate.value, digits)
    return f"{_signed(estimate.value, digits)} ± {estimate.high - estimate.value:.{digits}f}"


def _interval(estimate: Estimate, digits: int = 2) -> str:
    if not estimate.count:
        return "–"
    return f"{estimate.value:.{digits}f} ({estimate.low:.{digits}f} … {estimate.high:.{digits}f})"
