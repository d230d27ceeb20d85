"""Compare the grip controller with the one by the probability of slip, on the same draws.

    python -m benchmarks.compare_grasp [--lifts 60] [--seed 7] [--world lugre|mujoco|both] [--cases known,uncertain,…]
        [--set horizon=0.05 …]

Each row has both controllers: lost fruit, steady force and peak of the lift over the theoretical minimum, slip and
turn. P values are those of paired signed-rank tests, two-sided; of lost fruit that of McNemar's exact test.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import binomtest, wilcoxon

from benchmarks.bench_grasp import (
    BUMP,
    BUMP_TIME,
    NOISE,
    WORLDS,
    Draw,
    draw_tasks,
    least_in_bump,
    settings_for,
)
from benchmarks.grasp_mujoco import MujocoGrasp
from benchmarks.grasp_patch import GRAVITY, PatchGrasp
from benchmarks.grasp_probability import ProbabilityController, ProbabilitySettings
from benchmarks.grasp_trial import Lifting, TrialResult, run_trial
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.grip import IN_HAND
from pomona.skills.grip.settings import ForceLaw

World = type[PatchGrasp] | type[MujocoGrasp]


class GripCase(NamedTuple):
    """A case of the comparison.

    Attributes:
        mu_error: relative error of the configured friction; None for that of the draw.
        mu_uncertainty: its configured uncertainty.
        bump, reserve: push while the fruit is held, and the force held for it [N].
    """

    mu_error: float | None = 0.0
    mu_uncertainty: float = 0.0
    bump: float = 0.0
    reserve: float = 0.0


CASES = {
    "known": GripCase(),
    "uncertain": GripCase(None, 0.15),
    "high": GripCase(0.5, 0.15),
    "low": GripCase(-0.5, 0.15),
    "expected": GripCase(bump=BUMP, reserve=BUMP),
    "unexpected": GripCase(bump=BUMP),
}


class LiftFigures(NamedTuple):
    """LiftFigures of one lift.

    Attributes:
        lost: 1 for a lost fruit.
        steady, peak: force at the end and largest one of the lift, over the theoretical minimum at rest.
        at_peak: the largest ratio of the force and the theoretical minimum of that moment, once the fruit hangs.
        slip, turn: largest motion on the pads [mm, °].
    """

    lost: float
    steady: float
    peak: float
    at_peak: float
    slip: float
    turn: float


def lift(task: Draw, case: GripCase, world: World, control: type[GripController]) -> LiftFigures:
    """Lift one draw."""
    settings = settings_for(task, world, ForceLaw.SLIP_AVOIDANCE, case.mu_error is None, 0.0)
    if case.mu_error:
        off = replace(task, mu_error=case.mu_error)
        settings = settings_for(off, world, ForceLaw.SLIP_AVOIDANCE, True, 0.0)
    lifting = Lifting(
        acceleration=task.acceleration, pull=case.bump, pull_rise=0.002, pull_time=BUMP_TIME
    )
    hangs: list[bool] = []

    def watch(_t: float, controller: GripController, grasp: PatchGrasp | MujocoGrasp) -> None:
        hangs.append(grasp.off_table and controller.mode in IN_HAND)

    settings = replace(settings, reserve=case.reserve)
    result = run_trial(
        task.fruit, settings, lifting, NOISE, task.seed, world=world, watch=watch, control=control
    )
    return figures(task, case, world, lifting, result, hangs)


def figures(
    task: Draw,
    case: GripCase,
    world: World,
    lifting: Lifting,
    result: TrialResult,
    hangs: Sequence[bool],
) -> LiftFigures:
    """Return the figures of a lift; nan where it has none."""
    if not result.grasped:
        return LiftFigures(1.0, *(np.nan,) * 5)
    trace, least = result.trace, result.least
    t = np.array(trace.t) - trace.t[0] - 0.04
    f_n = np.array(trace.f_n)
    in_lift = (t > 0.0) & (t < lifting.duration)
    hanging = np.array(hangs[-len(t) :]) & in_lift
    moment = least * np.array([1.0 + max(lifting.acceleration_at(u) / GRAVITY, -0.5) for u in t])
    steady = result.steady / (least_in_bump(task.fruit, world) if case.reserve else least)
    return LiftFigures(
        1.0 - result.held,
        steady if result.held and least > 0.5 else np.nan,
        float(f_n[in_lift].max()) / least if least > 0.5 else np.nan,
        float((f_n / moment)[hanging].max()) if hanging.any() and least > 0.5 else np.nan,
        1e3 * result.slip,
        float(np.degrees(result.turn)),
    )


def summary(name: str, ours: Float64, theirs: Float64) -> str:
    """Return a row of the table: both controllers' figures, shape (n, 6), and p values."""
    one, other = (
        int(((ours[:, 0] > 0) & (theirs[:, 0] == 0)).sum()),
        int(((ours[:, 0] == 0) & (theirs[:, 0] > 0)).sum()),
    )
    p_lost = binomtest(one, one + other).pvalue if one + other else 1.0
    cells = [
        f"{name:24} lost {ours[:, 0].sum():.0f} / {theirs[:, 0].sum():.0f} of {len(ours)} (p {p_lost:.2f})"
    ]
    held = (ours[:, 0] == 0) & (theirs[:, 0] == 0)
    for column, label in enumerate(LiftFigures._fields):
        a, b = ours[held, column], theirs[held, column]
        both = np.isfinite(a) & np.isfinite(b)
        if column == 0 or not both.any():
            continue
        a, b = a[both], b[both]
        p = wilcoxon(a, b).pvalue if (a != b).any() else 1.0
        before, after = np.percentile(a, [50, 95]), np.percentile(b, [50, 95])
        cells.append(
            f"{label} {before[0]:.3g}, {before[1]:.3g} / {after[0]:.3g}, {after[1]:.3g} (p {p:.2g})"
        )
    return "; ".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--lifts", type=int, default=60, help="random lifts a case")
    parser.add_argument("--seed", type=int, default=7, help="of the draws")
    parser.add_argument("--world", choices=tuple(WORLDS), default="lugre", help="contact model")
    parser.add_argument("--cases", default=",".join(CASES), help="names, with commas")
    parser.add_argument(
        "--set",
        nargs="*",
        default=(),
        metavar="NAME=VALUE",
        help="other constants of the reference",
    )
    arguments = parser.parse_args()
    changed = dict(pair.split("=") for pair in arguments.set)
    ProbabilityController.constants = ProbabilitySettings()._replace(
        **{k: float(v) for k, v in changed.items()}
    )
    tasks, _ = draw_tasks(arguments.lifts, arguments.seed)
    for world, model in WORLDS[arguments.world]:
        print(f"{model}, seed {arguments.seed}; today's / by the probability of slip; median, p95")
        for name in arguments.cases.split(","):
            rows = [
                [lift(task, CASES[name], world, control) for task in tasks] for control in CONTROLS
            ]
            print(summary(name, *(np.array(row, np.float64) for row in rows)), flush=True)


CONTROLS: tuple[type[GripController], ...] = (GripController, ProbabilityController)

if __name__ == "__main__":
    main()
