"""Grip control over many random lifts, beside its baselines, on two contact models that share no code with it.

    python -m benchmarks.bench_grasp [--lifts 200] [--seed 7] [--world lugre|mujoco|both] [--plots DIR] [--picture FILE]
        [--ours]

Fruits of 0.05 to 0.4 kg with friction 0.3 to 0.9, the centre of mass up to 15 mm off the grasp axis and up to 3 mm off
the fingers' middle, 0.2 N of white noise on every force, lifts of up to 3 m/s². The gripper can press with 20 N a
finger; a draw whose load needs more than that is drawn again (their number is printed). Steady force is compared with
the theoretical minimum grip force where that lies above the 0.5 N floor. No apple bruises below 0.10 MPa of contact
pressure (Processes 2024, 12, 543).
"""

from __future__ import annotations

import argparse
import math
import time
import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.grasp_mujoco import TORSION, MujocoGrasp, cone_contact, least_grasp_force_of_cone
from benchmarks.grasp_patch import GRAVITY, Fruit, PatchGrasp
from benchmarks.grasp_trial import Lifting, TrialResult, least_grasp_force, run_trial
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.settings import ForceLaw, ForceLoopSettings, GripSettings

BUMP, BUMP_TIME = 5.0, 0.05
"""A bump pulls at the fruit with so much [N] for so long [s]; it is there within a sample."""

WRONG = 0.5
"""Relative error of a wrong configured friction."""

FORESEEN_AFTER = 0.002
"""Delay after which fingers with knowledge of a bump react: one sample, a bound for all measuring ones [s]."""

MAX_FORCE = 40.0
NOISE = 0.2
INITIAL = 4.0
"""Grip force before a lift without any knowledge of the load [N]."""
LUGRE = (PatchGrasp, "LuGre bristles, exact limit surface")
MUJOCO = (MujocoGrasp, "MuJoCo, elliptic cone")
WORLDS = {"both": (LUGRE, MUJOCO), "lugre": (LUGRE,), "mujoco": (MUJOCO,)}


@dataclass(frozen=True, slots=True)
class Draw:
    """One random task."""

    fruit: Fruit
    acceleration: float
    mu_error: float
    seed: int


def draw_tasks(count: int, seed: int = 7) -> tuple[list[Draw], int]:
    """Random tasks, and how many were drawn again because the gripper could not bear them."""
    rng = np.random.default_rng(seed)
    tasks: list[Draw] = []
    too_heavy = 0
    while len(tasks) < count:
        fruit = Fruit(
            mass=rng.uniform(0.05, 0.4),
            width=rng.uniform(0.05, 0.09),
            mu=rng.uniform(0.3, 0.9),
            offset=(rng.uniform(-0.015, 0.015), rng.uniform(-0.015, 0.015)),
            off_centre=rng.uniform(-0.003, 0.003),
        )
        acceleration, error = rng.uniform(0.5, 3.0), rng.choice([-0.15, 0.15])
        if (
            1.1 * least_grasp_force(replace(fruit, mass=fruit.mass * (1.0 + acceleration / 9.81)))
            > MAX_FORCE
        ):
            too_heavy += 1
            continue
        tasks.append(Draw(fruit, acceleration, error, len(tasks)))
    return tasks, too_heavy


def settings_for(
    task: Draw, world: type, law: ForceLaw, uncertain: bool, constant: float, wrong: float = 0.0
) -> GripSettings:
    """Return the controller's settings: true friction, or wrong by the draw's error, or by `wrong` in its direction."""
    fruit = task.fruit
    error = math.copysign(wrong, task.mu_error) if wrong else task.mu_error if uncertain else 0.0
    mu = fruit.mu * (1.0 + error)
    contact = SoftContact(mu, fruit.delta, fruit.gamma, fruit.k)
    if world is MujocoGrasp:
        contact = cone_contact(mu, TORSION)
    return GripSettings(
        contact=contact,
        law=law,
        mu_uncertainty=0.15 if uncertain else 0.0,
        offset=0.015,
        initial_force=constant if law is ForceLaw.CONSTANT else INITIAL,
        loop=ForceLoopSettings(max_force=MAX_FORCE),
    )


def lift_all(
    tasks: Sequence[Draw],
    world: type,
    law: ForceLaw,
    uncertain: bool = False,
    constant: float = 10.0,
    pull: float = 0.0,
    reserve: float = 0.0,
    wrong: float = 0.0,
) -> list[TrialResult]:
    """Every task under one law."""
    return [
        run_trial(
            task.fruit,
            replace(settings_for(task, world, law, uncertain, constant, wrong), reserve=reserve),
            Lifting(acceleration=task.acceleration, pull=pull),
            noise=NOISE,
            seed=task.seed,
            world=world,
        )
        for task in tasks
    ]


def bump_all(
    tasks: Sequence[Draw], world: type, reserve: float = 0.0, foreseen: bool = False
) -> list[TrialResult]:
    """Every task with a bump while it is held, friction known; with fingers that foresee it, or with the controller."""
    results = []
    for task in tasks:
        settings = replace(
            settings_for(task, world, ForceLaw.SLIP_AVOIDANCE, False, 0.0), reserve=reserve
        )
        lifting = Lifting(
            acceleration=task.acceleration, pull=BUMP, pull_rise=0.002, pull_time=BUMP_TIME
        )
        watch = (
            Foresight(1.1 * least_in_bump(task.fruit, world), settings.loop) if foreseen else None
        )
        results.append(
            run_trial(task.fruit, settings, lifting, NOISE, task.seed, world=world, watch=watch)
        )
    return results


def least_in_bump(fruit: Fruit, world: type) -> float:
    """Theoretical least grasp force for the fruit's weight and a bump at its centre together [N]."""
    heavier = replace(fruit, mass=fruit.mass + BUMP / GRAVITY)
    return least_grasp_force(heavier) if world is PatchGrasp else least_grasp_force_of_cone(heavier)


class Foresight:
    """Fingers that close on a fruit as fast as they can, as soon as a bump can be known of: the bound of any answer.

    They take a rate as often as the gripper does, and keep to its fastest.
    """

    def __init__(self, needed: float, loop: ForceLoopSettings) -> None:
        """`needed` is the grasp force that the bump asks for [N]."""
        self._needed, self._loop = needed, loop
        self._began = self._told = math.nan
        self._rate = 0.0

    def __call__(
        self, t: float, controller: GripController, grasp: PatchGrasp | MujocoGrasp
    ) -> None:
        """See `run_trial`'s `watch`."""
        if math.isnan(self._began):
            self._began = t if grasp.pull[1] < 0.0 else math.nan
            return
        if not FORESEEN_AFTER <= t - self._began < 0.3:
            return
        if math.isnan(self._told) or t - self._told >= self._loop.command_period - 1e-9:
            rate = (grasp.f_n - self._needed) / (self._loop.stiffness * self._loop.command_period)
            self._rate, self._told = max(min(rate, 0.0), -self._loop.closing_speed), t
        grasp.command = self._rate


HEADER = (
    f"{'':34}{'drops':>6}{'slip p50':>9}{'p95 mm':>7}{'turn p50':>9}{'p95 °':>7}"
    f"{'force p50':>10}{'/least p50':>11}{'p95':>6}{'peak p95':>9}{'MPa max':>8}"
)


def row(name: str, results: Sequence[TrialResult]) -> str:
    """One line of the table."""
    held = [r for r in results if r.grasped]
    drops = len(results) - sum(r.held for r in results)
    slip, turn = [1e3 * r.slip for r in held], [np.degrees(r.turn) for r in held]
    ratio = [r.steady / r.least for r in held if r.held and r.least > 0.5] or [np.nan]
    return (
        f"{name:34}{drops:6d}{np.median(slip):9.2f}{np.percentile(slip, 95):7.2f}"
        f"{np.median(turn):9.1f}{np.percentile(turn, 95):7.1f}{np.median([r.steady for r in held]):10.2f}"
        f"{np.median(ratio):11.3f}{np.percentile(ratio, 95):6.2f}{np.percentile([r.peak for r in held], 95):9.1f}"
        f"{max(r.pressure for r in held) / 1e6:8.3f}"
    )


def about_bumps(
    tasks: Sequence[Draw],
    bumped: Sequence[TrialResult],
    expected: Sequence[TrialResult],
    foreseen: Sequence[TrialResult],
    world: type,
) -> str:
    """Return the cost of an expected bump and the gain for an unexpected one, relative to the best possible."""
    pairs = zip(tasks, expected, strict=True)
    ratio = [r.steady / least_in_bump(task.fruit, world) for task, r in pairs if r.held]
    saved, could = sum(r.held for r in bumped), sum(r.held for r in foreseen)
    silent = sum(not r.told for r in (*bumped, *expected))
    reaction = np.nanpercentile([1e3 * r.reaction for r in bumped if r.grasped], [50, 95])
    return (
        f"  expected: steady over least for both p50 {np.median(ratio):.3f}, p95 {np.percentile(ratio, 95):.2f}; "
        f"unexpected: {saved} of {len(bumped)} saved, "
        f"{could} by fingers that foresee it ({saved / max(could, 1):.0%}), "
        f"answer p50 {reaction[0]:.0f}, p95 {reaction[1]:.0f} ms; lost without a code within 50 ms: {silent}"
    )


def time_steps(count: int) -> str:
    """Cost of a step while holding."""
    controller = GripController(GripSettings())
    controller.width = 0.08
    rng = np.random.default_rng(0)
    samples = rng.normal(0.0, 0.05, (4096, 2, 6)) * [1.0, 1.0, 1.0, 0.005, 0.005, 0.005]
    took = np.empty(count)
    for i in range(count + 1000):
        wrenches = samples[i % 4096].copy()
        if i > 120:
            wrenches[:, 2] -= 1.0
            wrenches[:, 0] += 0.4
        began = time.perf_counter()
        controller.step(0.002 * i, i, wrenches)
        if i >= 1000:
            took[i - 1000] = 1e6 * (time.perf_counter() - began)
    p50, p99 = np.percentile(took, [50, 99])
    return f"step of the controller: p50 {p50:.1f} µs, p99 {p99:.1f} µs over {count} steps ({controller.phase.value})"


def allocation_growth(count: int) -> str:
    """Bytes that stay allocated by the controller's own code after so many steps of holding."""
    controller = GripController(GripSettings())
    controller.width = 0.08
    wrenches, touching = np.zeros((2, 6)), np.zeros((2, 6))
    touching[:, 2] = -1.0
    touching[:, 0] = 0.4
    for i in range(2000):
        controller.step(0.002 * i, i, wrenches if i < 120 else touching)
    tracemalloc.start()
    controller.step(0.002 * 2000, 2000, touching)
    before = tracemalloc.get_traced_memory()[0]
    for i in range(2001, 2001 + count):
        controller.step(0.002 * i, i, touching)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    return f"allocated more after {count} further steps: {grown} bytes"


def plot(result: TrialResult, title: str, path: Path) -> None:
    """Grip force, its minimum, slip and rotation of one trial over time."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    trace = result.trace
    figure, (force, slip) = plt.subplots(2, 1, sharex=True, figsize=(8, 5), layout="constrained")
    force.plot(trace.t, trace.f_n, label="grasp force")
    force.plot(trace.t, trace.f_ref, label="reference", lw=0.8)
    force.plot(trace.t, trace.least_sensed, label="minimum grip force, sensed", lw=0.8)
    force.axhline(result.least, ls=":", c="k", label="minimum grip force at rest, theory")
    force.set_ylabel("N")
    force.legend(fontsize=7)
    force.set_title(title, fontsize=9)
    slip.plot(trace.t, 1e3 * np.array(trace.slip), label="slip [mm]")
    slip.plot(trace.t, np.degrees(np.abs(trace.turn)), label="rotation [°]")
    slip.set_xlabel("s")
    slip.legend(fontsize=7)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--lifts",
        type=int,
        default=200,
        help="random lifts of the controller in each contact model",
    )
    parser.add_argument(
        "--plots", type=Path, help="leave a picture of every run of the controller here"
    )
    parser.add_argument("--world", choices=tuple(WORLDS), default="both", help="contact model")
    parser.add_argument(
        "--seed", type=int, default=7, help="of the draws; margins were found on those of 7"
    )
    parser.add_argument("--ours", action="store_true", help="leave the baselines out")
    arguments = parser.parse_args()
    lifts = arguments.lifts
    tasks, too_heavy = draw_tasks(lifts, arguments.seed)
    print(
        f"{lifts} random lifts, {too_heavy} drawn again because {MAX_FORCE:.0f} N would not bear them"
    )
    for world, model in WORLDS[arguments.world]:
        print(f"\n{model}\n{HEADER}")

        def tell(name: str, results: Sequence[TrialResult]) -> None:
            print(row(name, results), flush=True)

        law = ForceLaw.SLIP_AVOIDANCE
        results = lift_all(tasks, world, law)
        tell("slip avoidance, mu known", results)
        tell("slip avoidance, mu ± 15 %", lift_all(tasks, world, law, uncertain=True))
        tell(f"wrong by ± {WRONG:.0%}", lift_all(tasks, world, law, uncertain=True, wrong=WRONG))
        bumped = bump_all(tasks, world)
        tell(f"bump of {BUMP:.0f} N, {1e3 * BUMP_TIME:.0f} ms", bumped)
        expected = bump_all(tasks, world, reserve=BUMP)
        tell(f"the same, reserve {BUMP:.0f} N", expected)
        print(
            about_bumps(tasks, bumped, expected, bump_all(tasks, world, foreseen=True), world),
            flush=True,
        )
        for baseline in () if arguments.ours else (ForceLaw.STATIC, ForceLaw.COULOMB):
            tell(f"{baseline.value} only, mu known", lift_all(tasks, world, baseline))
        for constant in () if arguments.ours else (5.0, 10.0, 20.0):
            tell(
                f"constant {constant:.0f} N",
                lift_all(tasks, world, ForceLaw.CONSTANT, constant=constant),
            )
        for reserve in (0.0, 2.0):
            pulled = lift_all(tasks[: lifts // 2], world, law, pull=2.0, reserve=reserve)
            slip = [1e3 * r.pull_slip for r in pulled if r.grasped]
            reaction = [1e3 * r.reaction for r in pulled if r.grasped]
            tell(f"pulled by 2 N, reserve {reserve:.0f} N", pulled)
            print(
                f"  of the pull alone: slip p50 {np.median(slip):.2f}, p95 {np.percentile(slip, 95):.2f} mm; "
                f"reaction p50 {np.nanmedian(reaction):.0f}, p95 {np.nanpercentile(reaction, 95):.0f} ms",
                flush=True,
            )
        if arguments.plots is not None:
            arguments.plots.mkdir(parents=True, exist_ok=True)
            for task, result in zip(tasks, results, strict=True):
                fruit = task.fruit
                title = (
                    f"{fruit.mass:.2f} kg, mu {fruit.mu:.2f}, centre ({1e3 * fruit.offset[0]:+.0f}, "
                    f"{1e3 * fruit.offset[1]:+.0f}) mm, lift {task.acceleration:.1f} m/s²"
                )
                plot(result, title, arguments.plots / f"{world.__name__}_{task.seed:03d}.png")
    print(f"\n{time_steps(10**5)}\n{allocation_growth(10**6)}")


if __name__ == "__main__":
    main()
