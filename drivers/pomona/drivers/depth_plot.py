"""A picture of a depth calibration: the depth error of each ball, before and after."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pomona.drivers.depth_calibration import DepthCalibration


def draw_calibration(calibration: DepthCalibration, path: Path) -> None:
    """Draw measured minus true distance of every ball over its distance, into a PNG, SVG or PDF file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    model, seen = calibration.model, calibration.seen
    true = np.array([s.true for s in seen])
    outlines = calibration.outline_growth * np.array([s.per_pixel for s in seen])
    before = np.array([s.measured for s in seen]) - true
    after = before - outlines - model.offset - model.scale * true
    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, values, title in zip(
        figure.subplots(1, 2, sharey=True), (before, after), ("before", "after"), strict=True
    ):
        axes.errorbar(true, 1e3 * values, 1e3 * np.array([s.deviation for s in seen]), fmt="o", capsize=3)
        axes.axhline(0.0, color="0.6", linewidth=0.8)
        axes.set_title(title)
        axes.set_xlabel("distance from the outline [m]")
    figure.axes[0].set_ylabel("depth differs by [mm]")
    figure.savefig(path)
