"""The fault matrix: every fault in every phase of a pick, judged by the simulator's truth and by the record.

    python -m benchmarks.fault_matrix [--cell sim] [--only fingers.stuck …] [--phases lifting …] [--seed 3] [--jobs 2]

For each case: the run ends as its row says, within its deadline; the device is named; the arm comes to rest within its
limits; a grip that held is never opened; no force above the limit; the record can be read and says the same; nothing
resumes; once the fault is cleared and acknowledged, the cell is clean; and no success is none.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from drivers.faults import FaultPlan, FaultSwitch, PlannedFault
from drivers.interfaces import Arm
from drivers.sim.world import SimWorld
from executive.execute import RunOrder, execute
from executive.files import find_cell
from executive.recording.read import read_events
from executive.running.compute import Computations
from executive.running.events import Event, NodeChanged, RunEnded, SafeStopped
from executive.running.runner import Runner
from executive.values.units import TIME

TABLE = Path(__file__).with_suffix(".yaml")
TREE = Path(__file__).with_name("fault_pick.yaml")
SETTINGS = {"fruit": "apple_4", "place": "2", "distractors": "0"}

FORCE_MAX = 14.0
"""What the tree allows for both fingers together [N]: SlipAvoidGrasp's default."""
OVERSHOOT = 1.05
"""The arm's deceleration and the grip's force, as measured in the world, over their limits."""
OPENED = 1.5e-3
"""A grip that held may give way so much in the safe state [m]: the pads' own softness, and a force that is let down."""
RESTING = 2e-3
"""An arm with no joint faster than this stands [rad/s]: what a held arm trembles in the world."""
AFTERWARDS = 1.0
"""How long nothing may move after the end [s]."""


@dataclass(frozen=True, slots=True)
class Phase:
    """Where in the run a fault begins: so long after a node's start; with what the operator did before it."""

    name: str
    node: str
    after: float
    operator: str = ""


@dataclass(frozen=True, slots=True)
class Case:
    """One fault in one phase, and how the run must end."""

    device: str
    kind: str
    phase: Phase
    ends: str
    within: float


@dataclass(slots=True)
class Verdict:
    """What became of a case; `wrong` is empty when everything held.

    Attributes:
        noticed: from the fault to the safe state, or to the failure of a skill [s]; NaN when neither came.
        rested: from the safe state to an arm that stands [s].
    """

    case: Case
    outcome: str = ""
    reason: str = ""
    noticed: float = np.nan
    rested: float = np.nan
    peak: float = 0.0
    lifted: bool | None = None
    wrong: list[str] = field(default_factory=list)


def read_table(path: Path = TABLE) -> list[Case]:
    """The cases of a table.

    Raises:
        ValueError: a row names no phase, or no way to end.
    """
    table = yaml.safe_load(path.read_text())
    phases = {
        name: Phase(name, said["node"], TIME(said["after"]), said.get("operator", ""))
        for name, said in table["phases"].items()
    }
    cases = []
    for row in table["rows"]:
        device, kind = row["fault"].split(".")
        names = list(phases) if row["phases"] == "all" else row["phases"]
        if unknown := [name for name in names if name not in phases]:
            raise ValueError(f"{row['fault']}: there is no phase {', '.join(unknown)}")
        if row["ends"] not in ("safe", "failure", "anything"):
            raise ValueError(f"{row['fault']}: a run ends safe, failure or anything, not {row['ends']}")
        within = TIME(row["within"]) if "within" in row else np.inf
        cases += [Case(device, kind, phases[name], row["ends"], within) for name in names]
    return cases


class _Watcher:
    """Lives in the world while a case runs: begins phases, turns the switch, and notes the truth of every step."""

    def __init__(self, case: Case, runner: Runner) -> None:
        self.case, self.runner = case, runner
        cell: Any = runner._cell
        self.world: SimWorld = cell.devices["world"]
        self.switch: FaultSwitch = cell.devices[case.device]
        self.limits = runner.context.device(Arm).limits
        planned = PlannedFault(case.device, case.kind, case.phase.after, case.phase.node or None)
        self.plan = FaultPlan([planned], {case.device: self.switch})
        self._wrenches = [self.world.sensor(f"wrench_{pad}") for pad in ("pad_left", "pad_right")]
        model = self.world.model
        self._qvel = model.jnt_dofadr[self.world.arm_joints]
        self._finger = model.joint("finger_left").qposadr[0]
        self._rest_z = float(self.world.state.body("fruit_0").xpos[2])
        self.safe_at = self.failed_at = np.nan
        self.rested_at = np.nan
        self.peak = 0.0
        self.width_held: float | None = None
        self.widest = -np.inf
        self.hung: bool | None = None
        self._acted = False
        self._node_began: float | None = None
        self.world.after_step.append(self._step)

    @property
    def began(self) -> float:
        return self.plan.injected[0][0] if self.plan.injected else np.nan

    def on_event(self, event: Event) -> None:
        """Phases begin with their nodes; the end is noted on the world's clock."""
        now = self.world.clock.now()
        if isinstance(event, NodeChanged):
            node = event.path.rsplit("/", 1)[-1].split("#")[0]
            if event.status == "RUNNING" and node == self.case.phase.node and self._node_began is None:
                self._node_began = now
                self.plan.begin(node, now)
            if event.status == "FAILURE" and np.isnan(self.failed_at) and self.plan.injected:
                self.failed_at = now
            if node == "Lift" and event.status == "SUCCESS":
                self.hung = float(self.world.state.body("fruit_0").xpos[2]) - self._rest_z > 0.05
        elif isinstance(event, SafeStopped) and np.isnan(self.safe_at):
            self.safe_at = now

    def _step(self) -> None:
        now, state = self.world.clock.now(), self.world.state
        operator = self.case.phase.operator
        if operator and not self._acted and self._node_began is not None and now >= self._node_began + 0.25:
            self._acted = True
            (self.runner.pause if operator == "pause" else self.runner.stop)("fault matrix")
        forces = [float(np.linalg.norm(view[:3])) for view in self._wrenches]
        self.peak = max(self.peak, sum(forces))
        held = min(forces) > 0.3
        width = 2.0 * float(state.qpos[self._finger])
        before = bool(self.plan.injected)
        self.plan.step(now)
        if self.plan.injected and not before:
            self.width_held = width if held else None
        if self.width_held is not None and not np.isnan(self.safe_at):
            self.widest = max(self.widest, width)
        standing = float(np.abs(state.qvel[self._qvel]).max()) < RESTING
        if not np.isnan(self.safe_at):
            self.rested_at = (now if np.isnan(self.rested_at) else self.rested_at) if standing else np.nan


def run_case(case: Case, cell: str = "sim", seed: int = 3) -> Verdict:
    """Run one case on a fresh cell and judge it."""
    verdict, watchers = Verdict(case), []

    def on_ready(runner: Runner) -> None:
        watcher = _Watcher(case, runner)
        watchers.append(watcher)
        if not case.phase.node:
            watcher.plan.begin("", 0.0)
            watcher.switch.inject_fault(case.kind)
            watcher.plan.injected.append((watcher.world.clock.now(), PlannedFault(case.device, case.kind)))

    def on_latched(runner: Runner) -> None:
        _judge_afterwards(watchers[0], runner, verdict)

    def on_event(event: Event) -> None:
        if watchers:
            watchers[0].on_event(event)

    with tempfile.TemporaryDirectory() as folder:
        order = RunOrder(TREE, find_cell(cell), seed, SETTINGS, record=Path(folder))
        executed = execute(order, [on_event], on_ready=on_ready, on_latched=on_latched)
        _judge_record(executed.record, executed.result.outcome, verdict)
    _judge(watchers[0], executed.result, verdict)
    return verdict


def _judge(watcher: _Watcher, result: Any, verdict: Verdict) -> None:
    case, wrong = verdict.case, verdict.wrong
    verdict.outcome = result.outcome
    verdict.reason = f"{result.reason.code}: {result.reason.message}" if result.reason else ""
    verdict.peak = watcher.peak
    verdict.lifted = watcher.hung
    if np.isnan(watcher.began):
        wrong.append("the fault never began")
        return
    ended = np.nanmin([watcher.safe_at, watcher.failed_at]) if case.ends == "failure" else watcher.safe_at
    verdict.noticed = float(ended - watcher.began)
    if case.ends == "safe":
        if np.isnan(verdict.noticed):
            wrong.append(f"ended as {result.outcome}, not in the safe state")
        elif verdict.noticed > case.within + 1e-9:
            wrong.append(f"noticed after {1e3 * verdict.noticed:.0f} ms")
        elif case.device not in verdict.reason and result.outcome == "error":
            wrong.append(f"does not name the {case.device}")
    elif case.ends == "failure" and (np.isnan(verdict.noticed) or verdict.noticed > case.within):
        wrong.append(f"ended as {result.outcome}")
    if watcher.hung is False:
        wrong.append("FALSE SUCCESS: Lift said that the fruit hangs")
    if watcher.peak > OVERSHOOT * FORCE_MAX:
        wrong.append(f"pressed {watcher.peak:.1f} N")
    if watcher.width_held is not None and watcher.widest > watcher.width_held + OPENED:
        wrong.append(f"opened {1e3 * (watcher.widest - watcher.width_held):.1f} mm while fruit was held")


def _judge_afterwards(watcher: _Watcher, runner: Runner, verdict: Verdict) -> None:
    """In the safe state: nothing moves, nothing resumes, and a cleared cell is clean."""
    cell: Any = runner._cell
    speed = float(np.max(watcher.limits.velocity / watcher.limits.acceleration))
    allowed = speed + float(np.max(watcher.limits.acceleration / watcher.limits.jerk)) + 0.05
    cell.clock.advance(AFTERWARDS)
    verdict.rested = float(watcher.rested_at - watcher.safe_at)
    if np.isnan(verdict.rested):
        verdict.wrong.append("the arm does not come to rest")
    elif verdict.rested > allowed:
        verdict.wrong.append(f"at rest only after {verdict.rested:.2f} s")
    watcher.switch.clear_fault()
    cell.clock.advance(0.2)
    try:
        cell.acknowledge()
        cell.clock.advance(0.1)
        cell.check()
    except Exception as error:
        verdict.wrong.append(f"not clean after an acknowledgement: {error}")
    if float(np.abs(watcher.world.state.qvel[watcher._qvel]).max()) > RESTING:
        verdict.wrong.append("moves after the acknowledgement")


def _judge_record(record: Path | None, outcome: str, verdict: Verdict) -> None:
    if record is None:
        verdict.wrong.append("left no record")
        return
    ends = [event for event in read_events(record) if isinstance(event, RunEnded)]
    if [event.outcome for event in ends] != [outcome]:
        verdict.wrong.append(f"the record says {[event.outcome for event in ends]}, the run {outcome}")


def _run(job: tuple[Case, str, int]) -> Verdict:
    case, cell, seed = job
    try:
        return run_case(case, cell, seed)
    except Exception as error:  # a case that breaks the harness is a finding, too
        return Verdict(case, wrong=[f"{type(error).__name__}: {error}"])


def _plan_here() -> None:
    """Plan in this process: a planner's own process for each of some hundred cells takes longer than the cases."""
    submit = Computations.submit

    def beside(
        self: Computations, node: str, function: Callable[..., Any], arguments: tuple[Any, ...], isolated: bool
    ) -> Any:
        return submit(self, node, function, arguments, False)

    Computations.submit = beside  # type: ignore[method-assign]


def report(verdicts: Sequence[Verdict]) -> str:
    """The table and its sums."""
    lines = [f"{'fault':26}{'phase':13}{'ended':9}{'noticed':>9}{'rest':>8}{'peak N':>8}  "]
    for v in verdicts:
        noticed = f"{1e3 * v.noticed:6.0f} ms" if np.isfinite(v.noticed) else "–"
        rested = f"{1e3 * v.rested:5.0f} ms" if np.isfinite(v.rested) else "–"
        fault = f"{v.case.device}.{v.case.kind}"
        said = "WRONG " + "; ".join(v.wrong) if v.wrong else v.reason
        lines.append(f"{fault:26}{v.case.phase.name:13}{v.outcome:9}{noticed:>9}{rested:>8}{v.peak:8.1f}  {said}"[:220])
    by_device: dict[str, list[float]] = {}
    for v in verdicts:
        if v.case.ends == "safe" and np.isfinite(v.noticed):
            by_device.setdefault(v.case.device, []).append(1e3 * v.noticed)
    lines.append("")
    for device, noticed_ms in by_device.items():
        lines.append(
            f"{device}: noticed after {np.median(noticed_ms):.0f} ms (median), {max(noticed_ms):.0f} ms (worst)"
        )
    rests = [1e3 * v.rested for v in verdicts if np.isfinite(v.rested)]
    if rests:
        lines.append(f"arm at rest {np.median(rests):.0f} ms (median), {max(rests):.0f} ms (worst) after the safe stop")
    ended = Counter(v.outcome for v in verdicts)
    bad = [v for v in verdicts if v.wrong]
    lines.append(
        f"{len(verdicts)} cases: {len(verdicts) - len(bad)} as they must be, {len(bad)} wrong, "
        f"{sum(v.lifted is False for v in verdicts)} false successes; "
        + ", ".join(f"{count} {name}" for name, count in sorted(ended.items()))
    )
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", default="sim")
    parser.add_argument("--only", nargs="*", help="faults, as device.fault")
    parser.add_argument("--phases", nargs="*")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    jobs = [
        (case, options.cell, options.seed)
        for case in read_table()
        if (not options.only or f"{case.device}.{case.kind}" in options.only)
        and (not options.phases or case.phase.name in options.phases)
    ]
    verdicts = []
    with ProcessPoolExecutor(options.jobs, get_context("spawn"), initializer=_plan_here) as pool:
        for verdict in pool.map(_run, jobs):
            verdicts.append(verdict)
            mark = "✗" if verdict.wrong else "✓"
            print(
                f"{len(verdicts)}/{len(jobs)} {mark} {verdict.case.device}.{verdict.case.kind} "
                f"{verdict.case.phase.name} {'; '.join(verdict.wrong)}",
                file=sys.stderr,
                flush=True,
            )
    print(report(verdicts))
    return 1 if any(verdict.wrong for verdict in verdicts) else 0


if __name__ == "__main__":
    sys.exit(main())
