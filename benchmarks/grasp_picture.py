"""One lift, drawn from bias to rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.grasp_mujoco import MujocoGrasp
from benchmarks.grasp_patch import Fruit, PatchGrasp
from benchmarks.grasp_trial import Lifting, least_grasp_force, run_trial
from pomona.executive.palette import INK, MUTED, SERIES
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.limit_surface import SoftContact, bruising_force
from pomona.skills.grip.settings import GripSettings

FRUIT = Fruit(mass=0.2, width=0.075, mu=0.6, offset=(0.003, 0.004), off_centre=0.001)
LIFTING = Lifting(acceleration=1.0, jerk_time=0.1, hold=1.0)
NOISE = 0.04
"""The fruit, the lift and the noise [N] of the picture: those of a simulated pick."""

SETTINGS = GripSettings(
    contact=SoftContact(FRUIT.mu, FRUIT.delta, FRUIT.gamma, FRUIT.k),
    mu_uncertainty=0.1,
    offset=0.003,
)
FORCE, LEAST, QUIET = SERIES[0], SERIES[2], MUTED


def lift() -> tuple[Float64, list[str]]:
    """The lift, sample by sample: t, force, wanted, least, slip [mm/s], width [mm], shape (n, 6); and its phases."""
    seen: list[tuple[float, ...]] = []
    phases: list[str] = []

    def watch(t: float, controller: GripController, grasp: PatchGrasp | MujocoGrasp) -> None:
        phases.append(controller.phase.value)
        reading = controller.reading
        seen.append(
            (
                t,
                grasp.f_n,
                reading.f_ref,
                reading.f_least,
                1e3 * reading.slip_speed,
                1e3 * grasp.width,
            )
        )

    run_trial(FRUIT, SETTINGS, LIFTING, noise=NOISE, seed=1, watch=watch)
    return np.array(seen), phases


def draw(path: Path) -> None:
    """Draw the lift to a picture file."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    seen, phases = lift()
    t, f_n, f_ref, f_least, slip_speed, width = seen.T
    starts = [i for i in range(len(phases)) if i == 0 or phases[i] != phases[i - 1]]
    rises = t[starts[-1]] + 0.04
    moments = [(t[i], phases[i]) for i in starts[:-1]] + [
        (rises, "lift"),
        (rises + LIFTING.duration, "rest"),
    ]

    figure = plt.figure(figsize=(8.4, 5.0), layout="constrained")
    grid = figure.add_gridspec(3, 1, height_ratios=(2.4, 1.0, 1.0))
    force = figure.add_subplot(grid[0])
    speed, opening = (
        figure.add_subplot(grid[1], sharex=force),
        figure.add_subplot(grid[2], sharex=force),
    )
    force.plot(t, f_n, color=FORCE, lw=1.4, label="grasp force")
    force.plot(t, f_ref, color=FORCE, lw=0.8, ls="--", label="wanted")
    force.plot(t, f_least, color=LEAST, lw=1.2, label="minimum grip force, sensed")
    force.axhline(
        least_grasp_force(FRUIT),
        color=INK,
        lw=0.8,
        ls=":",
        label="minimum grip force at rest, theory",
    )
    force.axhline(SETTINGS.loop.max_force, color=MUTED, lw=0.9, ls="--", label="force limit")
    force.plot(
        [], [], ls="none", label=f"no bruise below {bruising_force(0.5 * FRUIT.width):.0f} N"
    )
    force.legend(fontsize=7, loc="upper right", bbox_to_anchor=(1.0, 0.93))
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
        force.text(
            0.5 * (begin + end),
            1.02,
            words,
            transform=force.get_xaxis_transform(),
            ha="center",
            fontsize=7,
        )
    opening.set_xlabel("time [s]", fontsize=8)
    figure.savefig(path, dpi=100)
    plt.close(figure)
