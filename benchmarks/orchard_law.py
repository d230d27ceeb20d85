"""The stems' law beside real pulls: simulated apples are pulled by a hand, and the wrench at its wrist is compared.

    python -m benchmarks.orchard_law --data FOLDER --out runs/reports/orchard_law

FOLDER holds picks.csv (pick, outcome, …, peak_force_n, peak_torque_nm) of 46 pulls of real
apples, measured at the wrist of another hand (OSUrobotics/PickApp, MIT). Without it the simulation stands alone.

The hand holds the fruit like a spring and draws back along its approach, from any direction within 35° of straight from
the wall; for pull-and-twist it turns about that line meanwhile. Where it does not slip, it pulls until the stem breaks.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from scipy.stats import ks_2samp

from pomona.applications.harvest.connect import wall_shapes
from pomona.applications.harvest.model import WallModel, build_wall_model
from pomona.applications.harvest.numbers import Provenance, WallNumbers, read_numbers
from pomona.applications.harvest.stems import TORN, Stems
from pomona.applications.harvest.wall import Wall, draw_wall
from pomona.executive.values.arrays import Float64
from pomona.executive.values.installation import commit_here
from pomona.tools.simulation.gl import load_mujoco
from pomona.tools.simulation.scene import TIMESTEP

mpl.use("Agg")
import matplotlib.pyplot as plt

TREES = Path(__file__).parents[1] / "trees"
NUMBERS, APPLE = TREES / "walls" / "apple_wall.yaml", TREES / "fruits" / "apple"
MOTIONS = ("pull", "pull and twist")
SPEED, TURNING, FARTHEST = 0.10, 1.0, 0.45
"""Of the hand [m/s], about its approach [rad/s]; where it gives up [m]."""
HOLD = 1000.0
"""Stiffness of its grip [N/m]."""
HOLD_TURNS = (0.5, 0.15, 1.5)
"""Stiffness of the hand's grip against turning [N·m/rad]: unmeasured; the first is the assumed one."""
WRIST = 0.16
"""From the fruit's middle back to the wrist's sensor [m]: a hand's length, assumed."""
CONE = np.radians(35.0)
SAMPLE = 8
"""Apples of a wall for sensitivities."""
SPARED = (
    "leaf_",
    "leaves_",
    "petiole_",
    "wind_",
    "modulus_",
    "bruise_",
    "wire_",
    "trunk_",
    "fruit_count",
    "fruit_friction",
)
"""Assumed numbers that nothing in a pull asks for."""


@dataclass(frozen=True, slots=True)
class Pull:
    """Measurements of one pull at the wrist: peaks [N], [N·m], the hand's travel [m], and the kind of break, if any."""

    force: float
    torque: float
    way: float
    came_off: bool
    torn: bool


def main() -> None:
    """Pull, compare, write the report."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--data", type=Path, help="folder of the measured traces")
    options.add_argument("--out", type=Path, default=Path("runs/reports/orchard_law"))
    options.add_argument("--walls", type=int, default=4)
    options.add_argument(
        "--sensitivity",
        type=int,
        default=1,
        help="walls for ± 50 %% of each assumed number; 0 for none",
    )
    said = options.parse_args()
    numbers, origins = read_numbers(NUMBERS)
    said.out.mkdir(parents=True, exist_ok=True)
    simulated = {motion: pulls(numbers, range(said.walls), motion) for motion in MOTIONS}
    measured = read_measured(said.data) if said.data else {}
    lines = [
        *_head(numbers, simulated),
        *_compared(simulated, measured),
        *_hands(numbers, measured),
    ]
    if measured:
        _plot(simulated, measured, said.out / "law.png")
        lines += ["", "![measured and simulated peaks](law.png)", ""]
    if said.sensitivity:
        lines += sensitivity(numbers, origins, range(said.sensitivity), measured)
    (said.out / "report.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


def pulls(
    numbers: WallNumbers,
    seeds: Sequence[int],
    motion: str,
    turn: float = HOLD_TURNS[0],
    apples: int | None = None,
) -> list[Pull]:
    """Pull every apple of some walls, each from its branch with all that hangs on it."""
    return [
        pull_off(built, i, motion, turn, np.random.default_rng([seed, 21, k]))
        for seed in seeds
        for k, (built, i) in enumerate(
            _branches(draw_wall(numbers, seed, fruit=apples, leaves=0.0))
        )
    ]


def _branches(wall: Wall) -> Iterator[tuple[WallModel, int]]:
    """Each apple with all that hangs on its lateral: the other laterals do not feel it."""
    for lateral in range(len(wall.laterals)):
        spurs = [k for k, spur in enumerate(wall.spurs) if spur.lateral == lateral]
        if not spurs:
            continue
        part = replace(
            wall,
            laterals=(wall.laterals[lateral],),
            spurs=tuple(replace(wall.spurs[k], lateral=0) for k in spurs),
            fruits=tuple(
                replace(f, spur=spurs.index(f.spur)) for f in wall.fruits if f.spur in spurs
            ),
        )
        built = build_wall_model(part, wall_shapes(part, APPLE, "red"))
        stiffness, damping = built.model.jnt_stiffness.copy(), built.model.dof_damping.copy()
        for i in range(len(part.fruits)):
            built.model.jnt_stiffness[:], built.model.dof_damping[:] = stiffness, damping
            yield built, i


def pull_off(
    built: WallModel, fruit: int, motion: str, turn: float, rng: np.random.Generator
) -> Pull:
    """One fruit's pull."""
    mujoco = load_mujoco()
    data = mujoco.MjData(built.model)
    mujoco.mj_forward(built.model, data)
    stems = Stems(built, data)
    hand = _Hand(built, data, fruit, _away(rng), TURNING if motion == MOTIONS[1] else 0.0, turn)
    force = torque = 0.0
    while hand.way < FARTHEST:
        f, t = hand.hold()
        force, torque = max(force, f), max(torque, t)
        mujoco.mj_step(built.model, data)
        stems.look()
        if stems.state[fruit]:
            return Pull(force, torque, hand.way, True, bool(stems.state[fruit] == TORN))
    return Pull(force, torque, hand.way, False, False)


def _away(rng: np.random.Generator) -> Float64:
    """From the wall, anywhere in the cone."""
    turn, lean = rng.uniform(-np.pi, np.pi), CONE * np.sqrt(rng.random())
    return np.array([np.sin(lean) * np.cos(turn), np.cos(lean), np.sin(lean) * np.sin(turn)])


class _Hand:
    """A grip like a spring on a fruit, which draws back along a line."""

    def __init__(
        self,
        built: WallModel,
        data: Any,
        fruit: int,
        away: Float64,
        turning: float,
        stiffness: float,
    ) -> None:
        body, kind = int(built.fruit_bodies[fruit]), built.wall.fruits[fruit]
        self._mujoco, self._model = load_mujoco(), built.model
        self._data, self._body, self._away, self._turning, self._stiffness = (
            data,
            body,
            away,
            turning,
            stiffness,
        )
        self._p, self._R = data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy()
        self._damping = 2.0 * 0.7 * np.sqrt(HOLD * kind.mass)
        self._turn_damping = 2.0 * 0.5 * np.sqrt(stiffness * 0.4 * kind.mass * kind.radius**2)
        x, y, z = away
        self._across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        self.way = self._angle = 0.0

    def hold(self) -> tuple[float, float]:
        """Pull for one step: force [N] and torque [N·m] at the wrist."""
        data, body, away = self._data, self._body, self._away
        self.way += SPEED * TIMESTEP
        self._angle += self._turning * TIMESTEP
        target = self._p + self.way * away
        turn = (
            np.eye(3)
            + np.sin(self._angle) * self._across
            + (1.0 - np.cos(self._angle)) * self._across @ self._across
        )
        R, wanted = data.xmat[body].reshape(3, 3), turn @ self._R
        error = 0.5 * sum((np.cross(R[:, k], wanted[:, k]) for k in range(3)), start=np.zeros(3))
        moving = np.zeros(6)
        self._mujoco.mj_objectVelocity(
            self._model, data, self._mujoco.mjtObj.mjOBJ_XBODY, body, moving, 0
        )
        f = HOLD * (target - data.xpos[body]) + self._damping * (SPEED * away - moving[3:])
        m = self._stiffness * error + self._turn_damping * (self._turning * away - moving[:3])
        data.xfrc_applied[body] = [*f, *(m + np.cross(data.xpos[body] - data.xipos[body], f))]
        wrist = target + WRIST * away
        return float(np.linalg.norm(f)), float(
            np.linalg.norm(m + np.cross(data.xpos[body] - wrist, f))
        )


# -------------------------------------------------------------------------------------------------- measured


def read_measured(folder: Path) -> dict[str, Float64]:
    """Peaks at the wrist by outcome, rows of (force, torque): 'success' and 'failed'."""
    with (folder / "picks.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    return {
        outcome: np.array(
            [
                [float(r["peak_force_n"]), float(r["peak_torque_nm"])]
                for r in rows
                if r["outcome"] == outcome
            ]
        )
        for outcome in ("success", "failed")
    }


def peaks(found: list[Pull]) -> Float64:
    """Of the pulls that took the apple off: rows of (force, torque)."""
    return np.array([[each.force, each.torque] for each in found if each.came_off]).reshape(-1, 2)


def distance(simulated: Float64, measured: Float64) -> tuple[float, float]:
    """Kolmogorov and Smirnov's distance, and how often chance alone gives as much."""
    result = ks_2samp(simulated, measured)
    return float(result.statistic), float(result.pvalue)


# ---------------------------------------------------------------------------------------------------- report


def _head(numbers: WallNumbers, simulated: Mapping[str, list[Pull]]) -> list[str]:
    lines = [
        "# The stems' law beside measured pulls",
        "",
        f"Simulated, at commit `{commit_here()}` by `make orchard-law`. Numbers of the wall: {numbers.digest()}.",
        "",
        "| motion | apples | came off | stem torn out | way of the hand, median |",
        "|---|---|---|---|---|",
    ]
    for motion, found in simulated.items():
        off = [each for each in found if each.came_off]
        way = 1e3 * float(np.median([each.way for each in off])) if off else float("nan")
        torn = sum(each.torn for each in off)
        lines.append(f"| {motion} | {len(found)} | {len(off)} | {torn} | {way:.0f} mm |")
    return lines


def _compared(simulated: Mapping[str, list[Pull]], measured: Mapping[str, Float64]) -> list[str]:
    lines = [
        "",
        "| at the wrist | n | force 5 / 50 / 95 % [N] | torque 5 / 50 / 95 % [N·m] | KS force (p) | KS torque (p) |",
        "|---|---|---|---|---|---|",
    ]
    for outcome, rows in measured.items():
        lines.append(
            f"| measured, {outcome} | {len(rows)} | {_three(rows[:, 0])} | {_three(rows[:, 1])} | | |"
        )
    for motion, found in simulated.items():
        rows = peaks(found)
        apart = ["", ""]
        if measured:
            results = [distance(rows[:, c], measured["success"][:, c]) for c in (0, 1)]
            apart = [f"{d:.2f} ({p:.2g})" for d, p in results]
        lines.append(
            f"| simulated, {motion} | {len(rows)} | {_three(rows[:, 0])} | {_three(rows[:, 1])} | {' | '.join(apart)} |"
        )
    return [
        *lines,
        "",
        "KS: against the measured successes, in which the fruit came off in the hand.",
    ]


def _hands(numbers: WallNumbers, measured: Mapping[str, Float64]) -> list[str]:
    """Return the effect of the hand's stiffness against turning, which is no number of the wall."""
    lines = [
        "",
        "| grip against turning, one wall | pull: N | N·m | KS torque | pull and twist: N | N·m | KS torque |",
        "|---|---|---|---|---|---|---|",
    ]
    for turn in HOLD_TURNS:
        cells = []
        for motion in MOTIONS:
            rows = peaks(pulls(numbers, range(1), motion, turn))
            apart = f"{distance(rows[:, 1], measured['success'][:, 1])[0]:.2f}" if measured else ""
            cells += [f"{np.median(rows[:, 0]):.1f}", f"{np.median(rows[:, 1]):.2f}", apart]
        lines.append(f"| {turn} N·m/rad | " + " | ".join(cells) + " |")
    return lines


def _three(x: Float64) -> str:
    return " / ".join(f"{q:.3g}" for q in np.quantile(x, (0.05, 0.5, 0.95)))


def sensitivity(
    numbers: WallNumbers,
    origins: Mapping[str, Provenance],
    seeds: Sequence[int],
    measured: Mapping[str, Float64],
) -> list[str]:
    """Return tables of the effect of ± 50 % of each assumed number on the medians of a pull and of a pull and twist."""
    names = [
        name
        for name, origin in origins.items()
        if origin.standing == "assumed" and not name.startswith(SPARED)
    ]
    lines = [
        "## Sensitivity",
        "",
        f"Each assumed number halved and half as much again; {len(seeds)} wall(s) of {SAMPLE} apples, the same draws. "
        "Median peaks of broken stems; KS of the pull's force. Shares that would leave their range are cut off there.",
        "",
        "| number | factor | pull: off | N | N·m | pull and twist: off | N | N·m | KS |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    lines.append(_row("as they are", "", numbers, seeds, measured))
    for name in names:
        for factor in (0.5, 1.5):
            lines.append(
                _row(name, f"{factor}", _bounded(numbers.scaled(name, factor)), seeds, measured)
            )
    spared = ", ".join(
        name for name, o in origins.items() if o.standing == "assumed" and name.startswith(SPARED)
    )
    return [*lines, "", f"Not varied, since a pull does not ask for them: {spared}."]


def _bounded(numbers: WallNumbers) -> WallNumbers:
    return replace(numbers, strength_shared=min(numbers.strength_shared, 1.0))


def _row(
    name: str,
    factor: str,
    numbers: WallNumbers,
    seeds: Sequence[int],
    measured: Mapping[str, Float64],
) -> str:
    cells = []
    for motion in MOTIONS:
        found = pulls(numbers, seeds, motion, apples=SAMPLE)
        rows = peaks(found)
        if motion == MOTIONS[0]:
            force = rows[:, 0]
        medians = np.median(rows, axis=0) if len(rows) else np.full(2, np.nan)
        cells += [f"{len(rows)} of {len(found)}", f"{medians[0]:.1f}", f"{medians[1]:.2f}"]
    apart = (
        f"{distance(force, measured['success'][:, 0])[0]:.2f}" if measured and len(force) else ""
    )
    line = f"| {name} | {factor} | " + " | ".join([*cells, apart]) + " |"
    print(line, flush=True)
    return line


def _plot(simulated: Mapping[str, list[Pull]], measured: Mapping[str, Float64], path: Path) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(13.0, 3.8), layout="constrained")
    for c, (axis, words) in enumerate(
        zip(axes, ("peak force [N]", "peak torque [N·m]"), strict=False)
    ):
        for motion, found in simulated.items():
            axis.ecdf(peaks(found)[:, c], label=f"simulated, {motion}")
        for outcome, style in (("success", "-"), ("failed", ":")):
            axis.ecdf(
                measured[outcome][:, c],
                color="black",
                linestyle=style,
                label=f"measured, {outcome}",
            )
        axis.set(xlabel=words, ylabel="share")
    for motion, found in simulated.items():
        axes[2].plot(*peaks(found).T, ".", alpha=0.5, label=motion)
    axes[2].plot(*measured["success"].T, "k+", label="measured, success")
    axes[2].set(xlabel="peak force [N]", ylabel="peak torque [N·m]")
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    main()
