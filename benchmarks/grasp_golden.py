"""Golden traces of the grip controller: every command and reading of many draws, as digests, and their rounded figures.

    python -m benchmarks.grasp_golden --against COMMIT    # this tree and a commit on this machine, to the last bit
    python -m benchmarks.grasp_golden --write             # renew the figures that the test compares
    options: --draws 8 (random lifts per case and contact model)

A rewrite of the controller is bit-equal when the digests of all draws are. Digests depend on the processor's
arithmetic, so both sides are computed on one machine; the committed file keeps rounded figures of a small set.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench_grasp import (
    BUMP,
    BUMP_TIME,
    LUGRE,
    MUJOCO,
    NOISE,
    Draw,
    draw_tasks,
    settings_for,
)
from benchmarks.grasp_mujoco import MujocoGrasp
from benchmarks.grasp_patch import PatchGrasp
from benchmarks.grasp_trial import Corrupt, Lifting, run_trial
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.grip import GripPhase
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.observer import GENTLE
from pomona.skills.grip.settings import ForceLaw, GripSettings

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "tests" / "skills" / "grip" / "golden.json"
CHANNEL_NOISE = np.array([1, 1, 1, 0.005, 0.005, 0.005])


class Golden:
    """Digest and figures of one draw, taken sample by sample."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._codes: list[str] = []
        self._commands, self._closed, self._highest, self._last = 0, 0.0, 0.0, 0.0
        self._phase = GripPhase.BIAS

    def command(self, t: float, speed: float) -> None:
        """Take a command and its time [s]."""
        self._hash.update(np.array((t, speed), np.float64).tobytes())
        self._commands, self._closed = self._commands + 1, self._closed - speed

    def reading(self, controller: GripController) -> None:
        """Take the controller's state after a sample."""
        reading, problem = controller.reading, controller.problem
        values = (
            reading.f_n,
            reading.f_ref,
            reading.f_least,
            reading.f_t,
            reading.tau_n,
            reading.slip_speed,
            reading.slip,
            *(() if problem is None else problem.data.values()),
        )
        self._hash.update(np.array(values, np.float64).tobytes())
        self._hash.update(reading.phase.name.encode())
        code = "" if problem is None else problem.code
        self._hash.update(code.encode())
        if code and code not in self._codes:
            self._codes.append(code)
        self._phase = reading.phase
        self._highest, self._last = max(self._highest, reading.f_ref), reading.f_ref

    def finish(self) -> dict[str, object]:
        """Return the digest and the rounded figures."""
        return {
            "digest": self._hash.hexdigest()[:16],
            "phase": self._phase.name,
            "codes": self._codes,
            "commands": self._commands,
            "closed_mm_at_50_hz": round(20.0 * self._closed, 2),
            "highest_reference_n": round(self._highest, 2),
            "last_reference_n": round(self._last, 2),
        }


# ------------------------------------------------------------------------------------------------------ lifts


@dataclass(frozen=True, slots=True)
class LiftCase:
    """A way to lift the random draws of `bench_grasp`.

    Attributes:
        law, uncertain, wrong, reserve: as in `lift_all`.
        pull: downward force while the fruit is held [N]; for `pull_time` [s].
        changes: other settings.
        corrupt: makes a stream fault.
    """

    law: ForceLaw = ForceLaw.SLIP_AVOIDANCE
    uncertain: bool = False
    wrong: float = 0.0
    reserve: float = 0.0
    pull: float = 0.0
    pull_time: float = 0.3
    changes: tuple[tuple[str, object], ...] = ()
    corrupt: Callable[[], Corrupt] | None = None


def _gap(count: int = 50, at: int = 900) -> Corrupt:
    """A stream from which `count` samples are missing after `at`."""
    seen = 0

    def corrupt(sequence: int, stamp: float, wrenches: Float64) -> list[tuple[int, float, Float64]]:
        nonlocal seen
        seen += 1
        return [] if at < seen <= at + count else [(sequence, stamp, wrenches)]

    return corrupt


def _odd_order(at: int = 700) -> Corrupt:
    """A stream that repeats samples, lets them overtake each other, and breaks some values."""
    seen = 0

    def corrupt(sequence: int, stamp: float, wrenches: Float64) -> list[tuple[int, float, Float64]]:
        nonlocal seen
        seen += 1
        if seen < at or seen % 3:
            return [(sequence, stamp, wrenches)]
        bad = wrenches.copy()
        bad[seen % 2, seen % 6] = np.nan
        return [
            (sequence, stamp, bad),
            (sequence, stamp, wrenches),
            (sequence - 3, stamp - 0.006, -wrenches),
        ]

    return corrupt


LIFTS = {
    "known": LiftCase(),
    "uncertain": LiftCase(uncertain=True),
    "wrong": LiftCase(uncertain=True, wrong=0.5),
    "bump": LiftCase(pull=BUMP, pull_time=BUMP_TIME),
    "bump_reserve": LiftCase(pull=BUMP, pull_time=BUMP_TIME, reserve=BUMP),
    "pull": LiftCase(pull=2.0),
    "pull_reserve": LiftCase(pull=2.0, reserve=2.0),
    "gentle": LiftCase(changes=(("dynamic", GENTLE),)),
    "expected_load": LiftCase(changes=(("expected_load", 2.5),)),
    "static": LiftCase(law=ForceLaw.STATIC),
    "coulomb": LiftCase(law=ForceLaw.COULOMB),
    "constant": LiftCase(law=ForceLaw.CONSTANT),
    "gap": LiftCase(corrupt=_gap),
    "odd_order": LiftCase(corrupt=_odd_order),
    "rate_100": LiftCase(changes=(("rate", 100.0),)),
    "rate_1000": LiftCase(changes=(("rate", 1000.0),)),
}


def lift(task: Draw, case: LiftCase, world: type) -> dict[str, object]:
    """Lift one draw."""
    settings = replace(
        settings_for(task, world, case.law, case.uncertain, 10.0, case.wrong),
        reserve=case.reserve,
        **dict(case.changes),  # type: ignore[arg-type]
    )
    rise = 0.002 if case.pull_time < 0.1 else 0.05
    lifting = Lifting(
        acceleration=task.acceleration, pull=case.pull, pull_rise=rise, pull_time=case.pull_time
    )
    golden = Golden()

    def watch(_t: float, controller: GripController, _grasp: PatchGrasp | MujocoGrasp) -> None:
        golden.reading(controller)

    corrupt = None if case.corrupt is None else case.corrupt()
    result = run_trial(task.fruit, settings, lifting, NOISE, task.seed, corrupt, world, watch)
    for t, speed in result.trace.commands:
        golden.command(t, speed)
    return golden.finish()


# ------------------------------------------------------------------------------------------- two springs by hand


class Springs:
    """Two noisy pads on springs around a fruit; a script changes their loads, sample by sample.

    Attributes:
        controller: steps with 500 Hz.
        load, moment: of the fruit on both fingers [N, N·m].
        fruit: opening at which the pads touch [m].
        shown: changes the wrenches of a sample before the controller sees them.
        saturated: flags of the samples.
        blocked: the fingers do not move.
    """

    def __init__(self, noise: float = 0.04, seed: int = 0, **settings: Any) -> None:
        self.controller = GripController(replace(GripSettings(), **settings))
        self.controller.width = 0.09
        self.golden = Golden()
        self.load, self.moment, self.fruit = 0.0, 0.0, 0.080
        self.shown: Callable[[Float64], None] = lambda _wrenches: None
        self.saturated = (False, False)
        self.blocked = False
        self._noise, self._rng, self._count = noise, np.random.default_rng(seed), 0

    def run(self, seconds: float) -> None:
        """Let some time pass."""
        for _ in range(round(500.0 * seconds)):
            self._step()

    def until(self, phase: GripPhase, within: float = 5.0) -> None:
        """Let time pass until the controller is in a phase."""
        for _ in range(round(500.0 * within)):
            if self.controller.phase is phase:
                return
            self._step()
        raise RuntimeError(
            f"the grip is {self.controller.phase.value} after {within} s, expected: {phase.value}"
        )

    def lift(self, load: float = 2.0, moment: float = 0.0) -> None:
        """Grasp and let the load come within 0.1 s, then hold for a second."""
        self.until(GripPhase.HOLDING)
        self.run(0.1)
        for share in np.linspace(0.0, 1.0, 50):
            self.load, self.moment = load * share, moment * share
            self._step()
        self.run(1.0)

    def _step(self) -> None:
        controller = self.controller
        wrenches = np.zeros((2, 6))
        pressed = max(1000.0 * (self.fruit - controller.width), 0.0)
        wrenches[:, 2] = -pressed
        if pressed > 0.0:
            wrenches[:, 0] = 0.5 * self.load
            wrenches[:, 5] = 0.5 * self.moment, -0.5 * self.moment
        wrenches += self._noise * CHANNEL_NOISE * self._rng.normal(0.0, 1.0, (2, 6))
        self.shown(wrenches)
        t = 0.002 * self._count
        speed = controller.step(t, self._count, wrenches, self.saturated)
        if speed is not None:
            self.golden.command(t, speed)
        self.golden.reading(controller)
        self._count += 1
        if not self.blocked:
            controller.width += 0.002 * controller.speed


Script = Callable[[], Springs]


def _plain() -> Springs:
    springs = Springs()
    springs.lift(2.0, 0.006)
    return springs


def _slide() -> Springs:
    """Friction is measured by sliding, then the fruit is lifted."""
    springs = Springs(expected_load=3.0, initial_force=0.8)
    springs.until(GripPhase.HOLDING)
    springs.controller.slide(0.7)
    springs.load = -0.5
    springs.run(0.4)
    springs.controller.slide(2.2)
    springs.load = 0.9
    springs.run(0.4)
    springs.controller.slide(None)
    springs.controller.set_friction(SoftContact(mu=0.6), 0.05, 2.2)
    springs.run(0.3)
    springs.load = 2.0
    springs.run(1.0)
    return springs


def _pivot() -> Springs:
    springs = Springs()
    springs.lift(1.5, 0.008)
    springs.controller.pivot(True)
    for share in np.linspace(1.0, 0.1, 500):
        springs.moment = 0.008 * share
        springs.run(0.002)
    springs.controller.pivot(False)
    springs.run(0.5)
    return springs


def _push() -> Springs:
    """Pushes of 5 N with and without a reserve."""
    springs = Springs(reserve=1.0)
    springs.lift(1.5, 0.002)
    for length in (0.05, 1.5):
        springs.load = 6.5
        springs.run(length)
        springs.load = 1.5
        springs.run(0.8)
    return springs


def _saturated() -> Springs:
    springs = Springs()
    springs.lift()
    springs.saturated = (False, True)
    springs.run(0.2)
    springs.saturated = (False, False)
    springs.run(0.2)
    return springs


def _gone() -> Springs:
    springs = Springs()
    springs.lift()
    springs.fruit = 0.0
    springs.run(0.3)
    return springs


def _heavy() -> Springs:
    springs = Springs()
    springs.lift(11.0, 0.03)
    return springs


def _shown(change: Callable[[Float64], None], seconds: float = 0.4, **settings: Any) -> Script:
    def script() -> Springs:
        springs = Springs(**settings)
        springs.lift()
        springs.shown = change
        springs.run(seconds)
        return springs

    return script


def _dead(wrenches: Float64) -> None:
    wrenches[1] *= 0.05


def _zero(wrenches: Float64) -> None:
    wrenches[:] = 0.0


def _half(wrenches: Float64) -> None:
    wrenches[0] *= 0.5


def _shift(finger: int | slice, channel: int, by: float) -> Callable[[Float64], None]:
    def change(wrenches: Float64) -> None:
        wrenches[finger, channel] += by

    return change


def _motor() -> Springs:
    springs = Springs()
    springs.lift()
    springs.controller.motor_force = 9.0
    springs.run(0.2)
    return springs


def _no_fruit() -> Springs:
    springs = Springs()
    springs.fruit = -1.0
    springs.until(GripPhase.FAILED)
    return springs


def _one_finger() -> Springs:
    def only_left(wrenches: Float64) -> None:
        wrenches[1, 2] = 200.0 * wrenches[1, 3]  # noise of the same size, no force

    springs = Springs(contact_width=0.085)
    springs.shown = only_left
    springs.until(GripPhase.FAILED)
    return springs


def _blocked() -> Springs:
    springs = Springs()
    springs.until(GripPhase.CLOSING)
    springs.blocked = True
    springs.until(GripPhase.FAILED)
    return springs


def _short_stroke() -> Springs:
    springs = Springs(width_min=0.0795)
    springs.until(GripPhase.FAILED)
    return springs


def _slips_away() -> Springs:
    springs = Springs()
    springs.until(GripPhase.RAMP)
    springs.run(0.1)
    springs.fruit = -1.0
    springs.until(GripPhase.FAILED)
    return springs


def _touched_at_start() -> Springs:
    springs = Springs()
    springs.controller.width = 0.075
    springs.until(GripPhase.FAILED)
    return springs


SCRIPTS: dict[str, Script] = {
    "plain": _plain,
    "slide": _slide,
    "pivot": _pivot,
    "push": _push,
    "saturated": _saturated,
    "gone": _gone,
    "heavy": _heavy,
    "dead": _shown(_dead),
    "zero": _shown(_zero),
    "half": _shown(_half),
    "left_presses_more": _shown(_shift(0, 2, -1.2)),
    "both_press_more": _shown(_shift(slice(None), 2, -1.2)),
    "left_pulled": _shown(_shift(0, 0, 1.2)),
    "left_pulled_little": _shown(_shift(0, 0, 0.5)),
    "motor": _motor,
    "no_fruit": _no_fruit,
    "one_finger": _one_finger,
    "blocked": _blocked,
    "short_stroke": _short_stroke,
    "slips_away": _slips_away,
    "touched_at_start": _touched_at_start,
}

WORLDS = {"lugre": LUGRE[0], "mujoco": MUJOCO[0]}

TESTED = (
    *(f"springs {name}" for name in SCRIPTS),
    "lugre known 0",
    "lugre uncertain 1",
    "lugre wrong 2",
    "lugre bump 1",
    "lugre gap 0",
    "mujoco known 0",
    "mujoco bump_reserve 1",
)
"""Names of the draws whose figures the test compares."""


def all_names(draws: int) -> tuple[str, ...]:
    """Names of the scripts, and of `draws` lifts of each case on each contact model, where they differ."""
    lifts = (
        f"{world} {case} {draw}"
        for world in WORLDS
        for case in LIFTS
        for draw in range(draws)
        if world == "lugre" or "rate" not in case
    )
    return (*(f"springs {name}" for name in SCRIPTS), *lifts)


def run(name: str) -> dict[str, object]:
    """Run one draw and return its digest and figures."""
    world, case, *draw = name.split()
    if world == "springs":
        return SCRIPTS[case]().golden.finish()
    tasks, _ = draw_tasks(int(draw[0]) + 1)
    return lift(tasks[-1], LIFTS[case], WORLDS[world])


def digests_of(commit: str, draws: int) -> dict[str, dict[str, object]]:
    """Compute everything with the code of a commit, in a work tree and a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        subprocess.run(
            ["git", "worktree", "add", "--detach", "--quiet", str(tree), commit],
            cwd=ROOT,
            check=True,
        )
        try:
            paths = [tree, tree / "executive", tree / "skills", tree / "drivers"]
            environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))}
            command = [
                sys.executable,
                "-m",
                "benchmarks.grasp_golden",
                "--print",
                "--draws",
                str(draws),
            ]
            done = subprocess.run(
                command, cwd=tree, env=environment, check=True, stdout=subprocess.PIPE
            )
        finally:
            subprocess.run(
                ["git", "worktree", "remove", "--force", str(tree)], cwd=ROOT, check=True
            )
    found: dict[str, dict[str, object]] = json.loads(done.stdout)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--draws", type=int, default=8, help="random lifts of each case on each contact model"
    )
    parser.add_argument("--against", metavar="COMMIT", help="compare with this commit, bit by bit")
    parser.add_argument(
        "--before", type=Path, metavar="FILE", help="compare with the output of --print, bit by bit"
    )
    parser.add_argument("--print", action="store_true", help="print everything as JSON")
    parser.add_argument("--write", action="store_true", help=f"renew {FIGURES.relative_to(ROOT)}")
    arguments = parser.parse_args()
    if arguments.write:
        lines = (f"{json.dumps(name)}: {json.dumps(run(name))}" for name in TESTED)
        FIGURES.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
        return 0
    now = {name: run(name) for name in all_names(arguments.draws)}
    if arguments.print:
        print(json.dumps(now))
        return 0
    if arguments.before is not None:
        before = json.loads(arguments.before.read_text("utf-8"))
    else:
        before = digests_of(arguments.against or "HEAD", arguments.draws)
    differing = [name for name in now if now[name] != before.get(name)]
    for name in differing:
        print(f"{name}\n  before {before.get(name)}\n  now    {now[name]}")
    print(f"{len(now)} draws, {len(differing)} differ")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
