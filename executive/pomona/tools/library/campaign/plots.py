"""Plots of a report as SVG text."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from pomona.executive.palette import BAD, GOOD, INK, LINE, MUTED, SERIES
from pomona.tools.library.campaign.statistics import FEWEST

RATES = LinearSegmentedColormap.from_list("rates", [BAD, "#e9b872", "#f4efd9", "#9cc7a0", GOOD])
_STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "pomona",
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": LINE,
}


class Plot:
    """A figure in the reports' style; `axes` are its parts, row by row.

    with Plot(1, 2, height=3.0) as plot:
        plot.axes[0].plot(x, y)
    text = plot.svg
    """

    def __init__(self, rows: int = 1, columns: int = 1, height: float = 3.2, **grid: Any) -> None:
        self._context = mpl.rc_context(_STYLE)
        # of a figure [in]
        self._shape = (rows, columns)
        self._size = (9.6, height)
        self._grid = grid
        self.svg = ""

    def __enter__(self) -> Plot:
        self._context.__enter__()
        self.figure = Figure(figsize=self._size, layout="constrained")
        FigureCanvasSVG(self.figure)
        self.axes: list[Any] = list(np.ravel(self.figure.subplots(*self._shape, **self._grid)))
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        try:
            if kind is None:
                text = io.StringIO()
                self.figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
                self.svg = _small(text.getvalue())
        finally:
            self._context.__exit__(kind, error, trace)


def _small(svg: str) -> str:
    """Ids of one plot must not meet those of another on the same page, and numbers need no six decimals."""
    svg = svg[svg.index("<svg") :]
    return re.sub(r"(\d+\.\d{2})\d+", r"\1", svg)


def rate_map(
    axes: Any,
    rates: Sequence[Sequence[float]],
    rows: Sequence[str],
    columns: Sequence[str],
    title: str,
) -> None:
    """Success rates (0 … 1, NaN for none) as coloured cells with their percentages."""
    grid = np.ma.masked_invalid(np.asarray(rates, dtype=np.float64))
    axes.imshow(grid, cmap=RATES, vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(columns)), columns)
    axes.set_yticks(range(len(rows)), rows)
    axes.tick_params(length=0)
    axes.grid(visible=False)
    for edge in axes.spines.values():
        edge.set_visible(False)
    for (i, j), rate in np.ndenumerate(np.ma.filled(grid, np.nan)):
        if np.isfinite(rate):
            dark = rate < 0.15 or rate > 0.85
            axes.text(
                j,
                i,
                f"{100 * rate:.0f}",
                ha="center",
                va="center",
                color="white" if dark else INK,
                fontsize=9,
            )
    axes.set_title(title)


def spread(
    axes: Any, groups: Mapping[str, Sequence[float]], label: str, colours: Sequence[str] = SERIES
) -> None:
    """Every value as a dot, its quartiles as a box, group beside group."""
    names = [name for name, values in groups.items() if len(values)]
    jitter = np.random.default_rng(0)
    for at, name in enumerate(names):
        values = np.asarray(groups[name], dtype=np.float64)
        colour = colours[list(groups).index(name) % len(colours)]
        few = values.size < FEWEST
        across = at + jitter.uniform(-0.16, 0.16, values.size)
        axes.scatter(
            across,
            values,
            s=24 if few else 7,
            alpha=0.8 if few else 0.35,
            color=colour,
            linewidths=0,
        )
        if few:
            continue
        low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
        axes.plot(
            [at - 0.28, at + 0.28],
            [middle, middle],
            color=colour,
            linewidth=2.2,
            solid_capstyle="butt",
        )
        axes.add_patch(
            mpl.patches.Rectangle((at - 0.28, low), 0.56, high - low, fill=False, edgecolor=colour)
        )
    axes.set_xticks(range(len(names)), names)
    axes.set_xlim(-0.6, max(len(names) - 0.4, 0.6))
    axes.grid(visible=False, axis="x")
    axes.set_title(label)
