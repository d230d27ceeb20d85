"""One lift, drawn from bias to rest, and beside it what many lifts came to under each law."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.grasp_mujoco import MujocoGrasp
from benchmarks.grasp_patch import Fruit, PatchGrasp
from benchmarks.grasp_trial import Lifting, least_grasp_force, run_trial
from skills.grip.controller import GripController
from skills.grip.limit_surface import SoftContact
from skills.grip.settings import GripSettings

FRUIT = Fruit(mass=0.2, width=0.075, mu=0.6, offset=(0.003, 0.004), off_centre=0.001)
LIFTING = Lifting(acceleration=1.0, jerk_time=0.1, hold=1.0)
NOISE = 0.04
"""The fruit, the lift and the noise [N] of the picture: those of a simulated pick."""

COLUMNS = {"lost": 0, "slip [mm]": 2, "turn [°]": 4, "over least": 6, "its p95": 7}
"""Columns of the picture's table, and where the benchmark's rows have them."""

INK, FORCE, LEAST, QUIET = "#22303c", "#1f77b4", "#c2571a", "#8a949c"


def draw(rows: Sequence[str], title: str, path: Path) -> None:
    """Draw the lift, and beside it the benchmark's printed rows, to a picture file."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    seen: list[tuple[float, ...]] = []
    phases: list[str] = []

    def watch(t: float, controller: GripController, grasp: PatchGrasp | MujocoGrasp) -> None:
        phases.append(controller.phase.value)
        reading = controller.reading
        seen.append((t, grasp.f_n, reading.f_ref, reading.f_least, 1e3 * reading.slip_speed, 1e3 * grasp.width))

    contact = SoftContact(FRUIT.mu, FRUIT.delta, FRUIT.gamma, FRUIT.k)
    settings = GripSettings(contact=contact, mu_uncertainty=0.1, offset=0.003)
    run_trial(FRUIT, settings, LIFTING, noise=NOISE, seed=1, watch=watch)
    t, f_n, f_ref, f_least, slip_speed, width = np.array(seen).T
    starts = [i for i in range(len(phases)) if i == 0 or phases[i] != phases[i - 1]]
    lift = t[starts[-1]] + 0.04
    moments = [(t[i], phases[i]) for i in starts[:-1]] + [(lift, "lift"), (lift + LIFTING.duration, "rest")]

    figure = plt.figure(figsize=(11, 4.6), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.25, 1.0), height_ratios=(2.2, 1.0, 1.0))
    force = figure.add_subplot(grid[0, 0])
    speed, opening = figure.add_subplot(grid[1, 0], sharex=force), figure.add_subplot(grid[2, 0], sharex=force)
    force.plot(t, f_n, color=FORCE, lw=1.4, label="grasp force")
    force.plot(t, f_ref, color=FORCE, lw=0.8, ls="--", label="wanted")
    force.plot(t, f_least, color=LEAST, lw=1.2, label="least force, sensed")
    force.axhline(least_grasp_force(FRUIT), color=INK, lw=0.8, ls=":", label="least force at rest, theory")
    force.legend(fontsize=7, frameon=False, loc="upper left")
    held = t >= t[starts[-1]]
    speed.plot(t[held], slip_speed[held], color=LEAST, lw=1.0)
    opening.plot(t, width, color=INK, lw=1.2)
    for axis, label in ((force, "force [N]"), (speed, "slip [mm/s]"), (opening, "width [mm]")):
        axis.set_ylabel(label, fontsize=8)
        axis.tick_params(labelsize=7, labelbottom=axis is opening)
        axis.spines[["top", "right"]].set_visible(False)
        for moment, _ in moments[1:]:
            axis.axvline(moment, color=QUIET, lw=0.6)
    ends = [moment for moment, _ in moments[1:]] + [t[-1]]
    for (begin, name), end in zip(moments, ends, strict=True):
        words = {"taking the bias": "bias", "raising the force": "ramp"}.get(name, name)
        force.text(0.5 * (begin + end), 1.02, words, transform=force.get_xaxis_transform(), ha="center", fontsize=7)
    opening.set_xlabel("s", fontsize=8)
    _table(figure.add_subplot(grid[:, 1]), rows, title)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def _table(axis: Any, rows: Sequence[str], title: str) -> None:
    """The benchmark's rows as text."""
    axis.axis("off")
    lines = [f"{'':27}" + "".join(f"{name:>12}" for name in COLUMNS)]
    for row in rows:
        figures = row[34:].split()
        lines.append(f"{row[:27]:27}" + "".join(f"{figures[place]:>12}" for place in COLUMNS.values()))
    axis.text(0.02, 0.84, title, fontsize=8.5, color=INK, va="top", transform=axis.transAxes, wrap=True)
    axis.text(
        0.02, 0.70, "\n".join(lines), family="monospace", fontsize=6.4, color=INK, va="top", linespacing=1.7,
        transform=axis.transAxes,
    )  # fmt: skip
