"""Plots of the paper's experiment."""

from __future__ import annotations

import numpy as np

from benchmarks import paper_numbers as printed
from benchmarks.paper_cells import FRUITS, REFINED, UNREFINED, Cells
from pomona.executive.palette import INK, MUTED, SERIES
from pomona.tools.campaign.plots import Plot, rate_map
from pomona.tools.campaign.report import numbers

OURS, PAPER = SERIES[0], SERIES[1]
APPLES = tuple(f"Apple {i}" for i in range(1, 6))
ATTEMPTS = tuple(f"att. {i}" for i in range(1, 6))


def success_plot(cells: Cells) -> str:
    """Both success-rate tables as maps, the paper's left, ours right."""
    with Plot(2, 2, height=4.6) as plot:
        for axes, rates, title in zip(
            plot.axes,
            (
                printed.REFINED_SUCCESS,
                cells.rates(REFINED),
                printed.UNREFINED_SUCCESS,
                cells.rates(UNREFINED),
            ),
            ("Paper, with refinement", "Ours, with refinement", "Paper, without", "Ours, without"),
            strict=True,
        ):
            rate_map(axes, np.asarray(rates, np.float64).tolist(), APPLES, ATTEMPTS, title)
    return plot.svg


def errors_plot(cells: Cells) -> str:
    """Centroid and dimension error of every apple."""
    centroid = (printed.REFINED_CENTROID_ERROR, printed.centroid_errors(printed.REFINED_POSITION))
    dimension = (
        printed.REFINED_DIMENSION_ERROR,
        printed.dimension_errors(printed.REFINED_DIMENSIONS),
    )
    jitter = np.random.default_rng(0)
    with Plot(1, 2, height=3.2) as plot:
        for axes, key, (as_printed, recomputed), title in zip(
            plot.axes,
            ("centroid_error_mm", "size_error_mm"),
            (centroid, dimension),
            ("Centroid error [mm]", "Dimension error [mm]"),
            strict=True,
        ):
            for i, fruit in enumerate(FRUITS):
                runs = [run for run in cells.arm(REFINED) if run["varied"]["fruit"] == fruit]
                values = numbers(runs, cells.truth(key))
                at = i - 0.17 + jitter.uniform(-0.1, 0.1, len(values))
                axes.scatter(
                    at,
                    values,
                    s=8,
                    alpha=0.4,
                    color=OURS,
                    linewidths=0,
                    label="ours, each run" if i == 0 else None,
                )
                if values:
                    axes.plot(
                        [i - 0.33, i - 0.01], [np.mean(values)] * 2, color=OURS, linewidth=2.2
                    )
            where = np.arange(5) + 0.2
            axes.scatter(
                where,
                1e3 * as_printed,
                s=36,
                facecolors="none",
                edgecolors=PAPER,
                label="paper, printed",
            )
            axes.scatter(where, 1e3 * recomputed, s=22, color=PAPER, label="paper, recomputed")
            axes.axhline(0.0, color=MUTED, linewidth=0.8)
            axes.set_xticks(range(5), APPLES)
            axes.grid(visible=False, axis="x")
            axes.set_title(title)
        plot.axes[0].legend(frameon=False, fontsize=8, loc="upper left")
    return plot.svg


def sizes_plot(cells: Cells) -> str:
    """Estimated against true width and height."""
    runs = [
        run
        for run in cells.arm(REFINED)
        if run.get("truth") and cells.reported([run], "dimensions_m")
    ]
    estimated = 1e3 * np.array([cells.reported([run], "dimensions_m")[0] for run in runs]).reshape(
        -1, 3
    )
    true = 1e3 * np.array([run["truth"]["dimensions_m"] for run in runs]).reshape(-1, 3)
    with Plot(1, 2, height=3.6) as plot:
        for axes, axis, title in zip(
            plot.axes, (0, 1), ("Width d_x [mm]", "Height d_y [mm]"), strict=True
        ):
            low, high = (
                1e3 * printed.APPLES[:, axis].min() - 8,
                1e3 * printed.APPLES[:, axis].max() + 8,
            )
            axes.plot([low, high], [low, high], color=MUTED, linewidth=0.8)
            axes.scatter(
                true[:, axis],
                estimated[:, axis],
                s=9,
                alpha=0.5,
                color=OURS,
                linewidths=0,
                label="ours",
            )
            paper = (1e3 * printed.APPLES[:, axis], 1e3 * printed.REFINED_DIMENSIONS[:, axis])
            axes.scatter(*paper, s=30, color=PAPER, label="paper")
            axes.set_title(title)
            axes.set_xlabel("true")
            axes.set_ylabel("estimated")
        plot.axes[0].legend(frameon=False, fontsize=8, loc="upper left")
    return plot.svg


def force_plot(cells: Cells) -> str:
    """Grip force against its minimum, and slip."""
    good = [run for run in cells.good(cells.arm(REFINED)) if run["truth"].get("end_force_n")]
    with Plot(1, 2, height=3.4) as plot:
        left, right = plot.axes
        for i, fruit in enumerate(FRUITS):
            runs = [run for run in good if run["varied"]["fruit"] == fruit]
            force = np.array([run["truth"]["end_force_n"] for run in runs])
            least = force / np.array([run["truth"]["end_ratio"] for run in runs])
            left.scatter(
                least, force, s=14, alpha=0.7, color=SERIES[i], linewidths=0, label=APPLES[i]
            )
            slips = numbers(runs, cells.truth("slip_mm"))
            at = i + np.random.default_rng(i).uniform(-0.2, 0.2, len(slips))
            right.scatter(at, slips, s=14, alpha=0.6, color=SERIES[i], linewidths=0)
        top = max((run["truth"]["end_force_n"] for run in good), default=1.0)
        for factor, style in ((1.0, "-"), (1.25, "--")):
            left.plot([0.0, top / factor], [0.0, top], color=INK, linewidth=0.8, linestyle=style)
        left.set_title("Force at the end [N]")
        left.set_xlabel("minimum grip force [N]")
        left.legend(frameon=False, fontsize=8, loc="lower right")
        right.set_xticks(range(5), APPLES)
        right.set_ylim(bottom=0.0)
        right.grid(visible=False, axis="x")
        right.set_title("Slip [mm]")
    return plot.svg


def time_plot(cells: Cells) -> str:
    """Where the time of a pick goes: the robot's on one bar, computing on another."""
    good = cells.good(cells.arm(REFINED))
    order = (
        "MoveTo",
        "Detect",
        "Refine",
        "UpdateMap",
        "SampleGrasp",
        "Plan",
        "Follow",
        "Approach",
        "SlipAvoidGrasp",
    )
    names = {
        name for run in good for kind in ("robot_time_s", "compute_s") for name in run.get(kind, {})
    }
    skills = [*(name for name in order if name in names), *sorted(names - set(order))]
    with Plot(2, 1, height=2.6, sharex=False) as plot:
        for axes, kind, title in zip(
            plot.axes, ("robot_time_s", "compute_s"), ("Robot [s]", "Computing [s]"), strict=True
        ):
            start, drawn = 0.0, []
            for i, name in enumerate(skills):
                value = (
                    float(np.median([run.get(kind, {}).get(name, 0.0) for run in good]))
                    if good
                    else 0.0
                )
                axes.barh(
                    0,
                    value,
                    left=start,
                    color=SERIES[i % len(SERIES)],
                    edgecolor="white",
                    height=0.6,
                )
                drawn.append((name, start + value / 2, value))
                start += value
            for name, middle, value in drawn:
                if value > 0.03 * start:  # a narrower label would overlap its neighbour
                    axes.text(
                        middle, 0.45, f"{name}\n{value:.2f}", ha="center", va="bottom", fontsize=7.5
                    )
            axes.set_ylim(-0.4, 1.8)
            axes.set_yticks([])
            axes.spines["left"].set_visible(False)
            axes.grid(visible=False, axis="y")
            axes.set_title(title)
    return plot.svg
