"""Runs the cases of the fault matrix and judges them by the simulator's truth, the run's events, and its record.

`run_case` runs one case from its beginning. `branch_cases` runs the pick once: where a phase begins, a fork of the
process goes on with each fault, so that a case costs no more than the part after its fault.
"""

from __future__ import annotations

import os
import pickle
import resource
import select
import signal
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fault_executive import Leftovers, Operator, SteppedBack
from benchmarks.fault_plan import FaultPlan, PlannedFault
from benchmarks.fault_table import Case, CaseVerdict
from benchmarks.fault_truth import PRESSED, TableTruth, truth_of
from benchmarks.fault_world import Person
from benchmarks.strands import use_strands
from pomona.devices.emulators.virtual_world import VirtualWorld
from pomona.drivers.interfaces import Arm, Gripper
from pomona.drivers.path_arm import AT_REST
from pomona.drivers.services import ConnectContext, RobotServices
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.cell_file import read_cell_file
from pomona.executive.cell.connect import load_cell
from pomona.executive.cell.device import FaultSwitch
from pomona.executive.cell.errors import CellFileError
from pomona.executive.execute import Executed, RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.language import build
from pomona.executive.language.check import read_document
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.registry import Registry
from pomona.executive.running.compute import Computations
from pomona.executive.running.events import ErrorRaised, Event, NodeChanged, RunEnded, SafeStopped
from pomona.executive.running.runner import Runner
from pomona.executive.running.tick import EventStream
from pomona.executive.skill import continue_here
from pomona.skills.grip.hold import take_over
from pomona.tools.simulation.scene import TIMESTEP
from pomona.tools.simulation.world import PhysicsWorld, SimWorld

TREES = Path(__file__).parent
TABLE = {"fruit": "apple_4", "place": "2", "distractors": "0"}
SETTINGS = {
    "sim": TABLE, "emulated": TABLE, "emulated_ur5e_hand_e_fingers": TABLE, "emulated_xarm6_hand_e_fingers": TABLE,
    "emulated_plc": {**TABLE, "others": "0"},
    "sim_crate": {"fruit": "apple_4", "others": "0"},
    "conveyor": {"fruit": "apple_4", "most": "1", "patience": "6 s"},
}  # fmt: skip
"""Settings of each cell and its tree. Of the belt and of the crate one fruit is picked."""

CONTACT_MAX = 25.0
"""Largest force between the robot and the table, a fruit or a fixed thing in any step of the world [N]."""
OPENED = 1.5e-3
"""A grip that held may give way so much in the safe state [m]: the pads' own softness, and a force that is let down."""
RESTING = 2e-3
"""Speed of the joints below which an arm stands [rad/s]: the vibration of a held arm in the world."""
AFTERWARDS = 1.0
"""How long nothing may move after the end [s]."""
UNDER_WAY = 0.25
"""A real controller has got points of so long already: `lead` in emulated.yaml [s]."""
RECOVERS = 5.0
"""Wires are opened again, with their handshakes, within this time [s]."""
ACTS = 0.25
"""The operator acts so long after the phase's node has begun [s]."""
LIES = 0.02
"""A fruit this near to the height at which it stood lies on the table again, on whatever side [m]."""
HOME = 0.01
"""An arm this near to a pose is there [rad]."""
SHOWING: dict[str, type[Any]] = {"arm": Arm, "gripper": Gripper}
"""Devices whose faults show when they move; every other word of `shows` is a node's name."""
STIRRED = 2e-3
"""Least motion of a joint or a finger that counts as one before a run [rad or m]: an arm sags so far."""
ROBOT = slice(0, 8)
"""The robot's joints in the state of a world: arm, then fingers."""
ENDLESS = 600.0
"""Time on the run's clock after its fault at which a case is given up [s]: a pause of a minute, or an arm at a tenth of
its speed, takes less."""
GIVES_UP = frozenset({"letting the fruit go", "rising without the fruit", "rising with the fruit"})
"""Feedback of a skill that has noticed a fault, and fails once the hand is up: Intercept's."""
HANGS = 1200.0
"""Processor time of a case after which it is given up [s]: the run's clock stands."""


class Killed(BaseException):
    """The executive is gone in the middle of a run."""


class CaseWatcher:
    """Lives in the world while a case runs: begins phases, turns the switch, and notes the truth of every step."""

    def __init__(self, runner: Runner, branch: Callable[[CaseWatcher], None]) -> None:
        """
        Args:
            runner: of the run.
            branch: called in every step until there is a case; may set it.
        """
        self.case: Case | None = None
        self.runner = runner
        cell: Any = runner._cell
        self.cell = cell
        world = cell.devices["world"]
        self.world: PhysicsWorld = world if isinstance(world, PhysicsWorld) else world._world
        self.truth = truth_of(self.world)
        self.limits = cell.device(Arm).limits
        self.events: list[Event] = []
        self.began_at: dict[str, float] = {"": 0.0}
        """When each node began, by its name; the run itself has none."""
        self.safe_at = self.failed_at = self.shows_at = self.rested_at = self.gave_up_at = np.nan
        self.peak = 0.0
        self.width_held: float | None = None
        self.widest = -np.inf
        self._branch = branch
        self._plan: FaultPlan | None = None
        model = self.world.model
        self._qvel, self._qpos = (
            adr[self.world.arm_joints] for adr in (model.jnt_dofadr, model.jnt_qposadr)
        )
        self._q_rested = np.zeros(len(self._qpos))
        self._finger = model.joint("finger_left").qposadr[0]
        self._killed_at = self._taken_at = np.inf
        self.endless = False
        self.leftovers = Leftovers(runner, cell)
        self._clock = SteppedBack(self.world.clock, TIMESTEP)
        self._operator = Operator(runner)
        own = {"executive": self.leftovers, "clock": self._clock, "operator": self._operator}
        if isinstance(self.world, SimWorld):
            own["person"] = Person(self.world)
        self.switches: dict[str, FaultSwitch] = {**cell.switches, **own}
        self.world.after_step.append(self._step)

    def take(self, case: Case) -> None:
        """Go on with a case, whose phase has begun."""
        self.case, phase, self._taken_at = case, case.phase, self.now
        if case.ends == "recovered":
            self._killed_at = self.began_at[phase.node] + phase.after
            return
        planned = PlannedFault(
            case.switch,
            case.kind,
            phase.after,
            phase.node,
            case.lasts,
        )
        self._plan = FaultPlan([planned], self.switches)
        begun = self.began_at[phase.node]
        self._plan.begin(phase.node, begun)
        if phase.operator:
            self._operator.begin(phase.operator, begun + ACTS)
        self._turn(self.now)

    @property
    def now(self) -> float:
        """The world's time, also when its clock has been set back [s]."""
        return self.world.clock.now() + self._clock.back

    def _turn(self, now: float) -> None:
        assert self._plan is not None
        self._plan.step(now)
        if self.injected and np.isnan(self.shows_at) and self._can_show():
            self.shows_at = now

    @property
    def injected(self) -> bool:
        return self._plan is not None and bool(self._plan.injected)

    @property
    def speed(self) -> float:
        """Of the arm's fastest joint [rad/s]."""
        return float(np.abs(self.world.state.qvel[self._qvel]).max())

    def on_event(self, event: Event) -> None:
        """Phases begin with their nodes; the end is noted on the world's clock."""
        self.events.append(event)
        now = self.now
        if isinstance(event, NodeChanged):
            node = event.path.rsplit("/", 1)[-1].split("#")[0]
            if event.status == "RUNNING":
                self.leftovers.remember(event.path)
                self.began_at.setdefault(node, now)
            if event.feedback in GIVES_UP and self.injected and np.isnan(self.gave_up_at):
                self.gave_up_at = now
            ends = not self.truth.failing or node in self.truth.failing
            if event.status == "FAILURE" and np.isnan(self.failed_at) and self.injected and ends:
                self.failed_at = now
            if event.status == "SUCCESS":
                self.truth.judge_claim(node)
        elif isinstance(event, SafeStopped) and np.isnan(self.safe_at):
            self.safe_at = now
            if self.truth.kept_from_stop:
                self.width_held = self._width if min(self.truth.forces) > PRESSED else None

    @property
    def _width(self) -> float:
        """Opening of the fingers, without what is left when they are closed [m]."""
        return 2.0 * float(self.world.state.qpos[self._finger])

    def _step(self) -> None:
        self.leftovers.step()
        now = self.now
        for moment in list(self.truth.look(self.began_at)):
            self.began_at.setdefault(moment, now)
        if self.case is None:
            self._branch(self)
        self._operator.step(now)
        if now >= self._killed_at:
            self._killed_at, self.shows_at = np.inf, now
            if isinstance(self.cell.devices["world"], VirtualWorld):
                self.cell.devices["world"].hang_up()
            raise Killed("the executive was killed")
        if self.case is not None and now > self._taken_at + ENDLESS and not self.endless:
            self.endless = True
            self.runner.stop("fault matrix")
        self.peak = max(self.peak, self.truth.force)
        width = self._width
        if self.case is not None and self._plan is not None:
            before = self.injected
            self._turn(now)
            now = self.now
            if self.injected and not before and not self.truth.kept_from_stop:
                self.width_held = width if min(self.truth.forces) > PRESSED else None
        if not np.isnan(self.safe_at):
            if self.width_held is not None:
                self.widest = max(self.widest, width)
            q = self.world.state.qpos[self._qpos]
            if np.isnan(self.rested_at) and self.speed < AT_REST:
                self.rested_at, self._q_rested = now, q.copy()
            elif (
                np.abs(q - self._q_rested).max() > STIRRED
            ):  # a fruit that falls on the hand shakes it by less
                self.rested_at = np.nan

    def _can_show(self) -> bool:
        assert self.case is not None
        if not self.case.shows:
            return True
        if self.case.shows not in SHOWING:
            return self.case.shows in self.began_at
        device = self.cell.device(SHOWING[self.case.shows])
        # of a stream that waits at its target, nothing shows that the arm cannot move
        target = getattr(getattr(device, "_motion", None), "_target", np.inf)
        away = np.abs(target - self.world.state.qpos[self._qpos]).max()
        return not device.settled() and away > STIRRED


# --------------------------------------------------------------------------------------------------- judging


def judge(watcher: CaseWatcher, executed: Executed, verdict: CaseVerdict) -> None:
    """Check that the run ended as in its row, and that nothing forbidden happened."""
    case, wrong, result = verdict.case, verdict.wrong, executed.result
    verdict.outcome = result.outcome
    verdict.reason = f"{result.reason.code}: {result.reason.message}" if result.reason else ""
    truth = watcher.truth
    verdict.peak, verdict.contact, verdict.true = watcher.peak, truth.contact, truth.claimed
    verdict.noticed = float(watcher.safe_at - watcher.shows_at)
    if case.ends == "recovered":
        return
    if not watcher.injected:
        wrong.append("the fault never began")
        return
    if watcher.endless:
        wrong.append(f"does not end within {ENDLESS:.0f} s of the run's clock")
        return
    ended = (
        np.fmin(watcher.safe_at, watcher.failed_at) if case.ends == "failure" else watcher.safe_at
    )
    verdict.noticed = float(ended - np.fmin(watcher.shows_at, ended))  # some show before they must
    if case.notices is not None:
        verdict.gave_up = float(
            np.nanmin([watcher.gave_up_at, watcher.safe_at, np.inf]) - watcher.shows_at
        )
        if verdict.gave_up > case.notices + 1e-9:
            wrong.append(
                f"given up after {1e3 * verdict.gave_up:.0f} ms, not within {1e3 * case.notices:.0f} ms"
            )
    if case.ends == "harmless":
        if result.outcome == "success" and truth.claimed is not True and not truth.may_end_empty:
            wrong.append("FALSE SUCCESS: no claim was true")
    elif case.ends == "success":
        if result.outcome not in ("success", "partial") or truth.claimed is not True:
            wrong.append(f"ended as {result.outcome}")
        named = any(
            isinstance(event, ErrorRaised) and event.error == "NotOwnerError"
            for event in watcher.events
        )
        if watcher.leftovers.fault is not None and not (watcher.leftovers.refused and named):
            wrong.append("no refused command is recorded")
    elif np.isnan(verdict.noticed):
        wrong.append(f"ended as {result.outcome}, not as {case.ends}")
    elif verdict.noticed > case.within + 1e-9:
        wrong.append(
            f"noticed after {1e3 * verdict.noticed:.0f} ms, not within {1e3 * case.within:.0f} ms"
        )
    elif case.ends == "safe" and case.device not in verdict.reason and result.outcome == "error":
        wrong.append(f"does not name the {case.device}")
    if case.says not in verdict.reason:
        wrong.append(f"does not say {case.says}")
    if truth.claimed is False:
        wrong.append("FALSE SUCCESS: the fruit is not where a node reports it")
    if case.spoils:
        return
    if watcher.peak > truth.force_max:
        wrong.append(f"pressed {watcher.peak:.1f} N")
    if truth.contact[0] > CONTACT_MAX:
        wrong.append("pressed the {1} with {0:.1f} N".format(*truth.contact))
    if watcher.width_held is not None and watcher.widest > watcher.width_held + OPENED:
        wrong.append(
            f"opened {1e3 * (watcher.widest - watcher.width_held):.1f} mm while fruit was held"
        )
    wrong.extend(truth.troubles(result.truth or {}))


def judge_afterwards(watcher: CaseWatcher, verdict: CaseVerdict) -> None:
    """In the safe state: nothing moves, nothing resumes, and a cleared cell is clean."""
    cell, limits = watcher.cell, watcher.limits
    slowing = float(
        np.max(limits.velocity / limits.acceleration) + np.max(limits.acceleration / limits.jerk)
    )
    under_way = UNDER_WAY if isinstance(cell.devices["world"], VirtualWorld) else 0.0
    cell.clock.advance(AFTERWARDS)
    verdict.rested = float(watcher.rested_at - watcher.safe_at)
    if np.isnan(verdict.rested):
        verdict.wrong.append("the arm does not come to rest")
    elif verdict.rested > slowing + under_way + 0.05:
        verdict.wrong.append(f"at rest only after {verdict.rested:.2f} s")
    watcher.switches[verdict.case.switch].clear_fault()
    if trouble := _acknowledge(cell):
        verdict.wrong.append(f"not clean after an acknowledgement: {trouble}")
    if watcher.speed > RESTING:
        verdict.wrong.append("moves after the acknowledgement")


def recover(watcher: CaseWatcher, verdict: CaseVerdict, seed: int) -> None:
    """Run `trees/recover.yaml` on the cell afterwards: it puts down a held fruit and brings the arm home.

    On the emulated cell its drivers connect anew.
    """
    cell, wrong, truth = watcher.cell, verdict.wrong, watcher.truth
    assert isinstance(truth, TableTruth)
    take_over(cell.device(Gripper))  # the control of the grip has died with its process
    cell.clock.advance(AFTERWARDS)
    if isinstance(cell.devices["world"], VirtualWorld):
        cell = connect_anew(cell.name, cell.devices["world"], seed)
    cell.acknowledge()
    if min(truth.forces) > PRESSED and not cell.in_hand():
        wrong.append("the hand counts as empty although the fruit is held")
    registry, document = Registry.installed(), read_document(find_tree("recover"))
    settings = {"release": "true"}
    runner = Runner(
        lambda context, board: build(
            document, registry, overrides=settings, context=context, board=board
        ),
        cell,
        EventStream(),
        seed=seed,
    )
    runner.prepare()
    result = runner.run()
    height = truth.raised
    away = float(np.abs(cell.device(Arm).state().q - cell.workspace.poses["home"]).max())
    if result.outcome != "success":
        wrong.append(f"recovery ended as {result.outcome}: {result.reason}")
    if (result.truth or {}).get("drops", 0):
        wrong.append("recovery dropped the fruit")
    if abs(height) > LIES:
        wrong.append(f"the fruit is {1e3 * height:.0f} mm above where it stood")
    if away > HOME:
        wrong.append(f"the arm is {np.degrees(away):.1f}° from home")
    if cell.in_hand():
        wrong.append(f"the next run is refused: {cell.in_hand()}")


def connect_anew(name: str, world: VirtualWorld, seed: int) -> Cell:
    """Connect the drivers to the devices in their present state, as the next process does."""
    file = read_cell_file(find_cell(name), SETTINGS[name])
    context = ConnectContext(
        file.path, world.clock, seed, file.workspace, {"world": world}, takes_over=True
    )
    world.enter(context)
    for name, settings in file.section.devices.items():
        context.devices[name] = settings.driver(settings, context)
        context.devices[name].name = name
    services = RobotServices(context.devices, file.workspace)
    return Cell(file.name, file.kind, world.clock, context.devices, services, world)


def _acknowledge(cell: Any) -> str:
    """Acknowledge a cell that works again, as often as an operator would; return a remaining problem."""
    trouble, end = "", cell.clock.now() + RECOVERS
    while cell.clock.now() < end:
        cell.clock.advance(0.2)
        try:
            cell.acknowledge()
            cell.clock.advance(0.1)
            cell.check()
        except Exception as error:
            trouble = str(error)
        else:
            return ""
    return trouble


def judge_record(record: Path | None, outcome: str, verdict: CaseVerdict) -> None:
    """Check that the record can be read and agrees."""
    if record is None:
        verdict.wrong.append("left no record")
        return
    ends = [event.outcome for event in read_events(record) if isinstance(event, RunEnded)]
    if ends != [outcome]:
        verdict.wrong.append(f"the record says {ends}, the run {outcome}")


# ------------------------------------------------------------------------------------------- a case by itself


def run_case(case: Case, cell: str, seed: int) -> CaseVerdict:
    """Run one case on a fresh cell, recorded as it goes, and judge it."""
    verdict, watchers = CaseVerdict(case), []

    def take(watcher: CaseWatcher) -> None:
        if case.phase.node in watcher.began_at:
            watcher.take(case)

    def on_ready(runner: Runner) -> None:
        watchers.append(CaseWatcher(runner, take))
        take(watchers[0])

    def on_event(event: Event) -> None:
        if watchers:
            watchers[0].on_event(event)

    with tempfile.TemporaryDirectory() as folder:
        order = RunOrder(
            TREES / case.phase.tree, find_cell(cell), seed, SETTINGS[cell], record=Path(folder)
        )
        executed = execute(
            order,
            [on_event],
            on_ready=on_ready,
            on_latched=lambda _runner: judge_afterwards(watchers[0], verdict),
        )
        judge_record(executed.record, executed.result.outcome, verdict)
    judge(watchers[0], executed, verdict)
    return verdict


def refuse_case(case: Case, cell: str, seed: int) -> CaseVerdict:
    """Connect a cell that has a fault already: it is refused in one line at its place, and nothing moves."""
    verdict, worlds, enter = CaseVerdict(case, outcome="connected"), [], VirtualWorld.enter
    before: list[Any] = []

    def enter_faulty(world: VirtualWorld, context: ConnectContext) -> None:
        worlds.append(world)
        before.append(world._world.state.qpos.copy())
        world.switches[case.switch].inject_fault(case.kind)
        enter(world, context)

    setattr(VirtualWorld, "enter", enter_faulty)  # noqa: B010
    try:
        load_cell(find_cell(cell), seed=seed, overrides=SETTINGS[cell]).close()
    except CellFileError as error:
        verdict.outcome, verdict.reason = "refused", str(error)
        places = [finding for finding in error.findings if finding.severity == "error"]
        if len(places) != 1 or places[0].line < 1 or "\n" in places[0].message:
            verdict.wrong.append("not one line at one place")
        if case.says not in verdict.reason or f"{case.device}: " not in verdict.reason:
            verdict.wrong.append(f"does not say {case.says} of the {case.device}")
    except Exception as error:
        verdict.wrong.append(f"{type(error).__name__}: {error}")
    finally:
        setattr(VirtualWorld, "enter", enter)  # noqa: B010
    if verdict.outcome != "refused":
        verdict.wrong.append("is not refused")
    if (
        not worlds
        or float(np.abs(worlds[0]._world.state.qpos[ROBOT] - before[0][ROBOT]).max()) > STIRRED
    ):
        verdict.wrong.append("something has moved")
    return verdict


def plan_here() -> None:
    """Compute in the thread of the tick: a planner's own process for each case takes longer than the case."""

    def submit(
        self: Computations,
        node: str,
        function: Callable[..., Any],
        arguments: tuple[Any, ...],
        isolated: bool,
    ) -> Any:
        future: Future[Any] = Future()
        began = time.perf_counter()
        try:
            future.set_result(function(*arguments))
        except BaseException as error:
            future.set_exception(error)
        named = f"{function.__module__}.{function.__qualname__}"
        computed: Any = _Computed(future)
        self._pending.append((node, named, began, computed))
        return self._pending[-1][3]

    Computations.submit = submit  # type: ignore[method-assign]


class _Computed:
    """An answer that is there already."""

    def __init__(self, future: Future[Any]) -> None:
        self._future = future

    def done(self) -> bool:
        return True

    def result(self) -> Any:
        return self._future.result()

    def cancel(self) -> None:
        """Too late."""


# ------------------------------------------------------------------------------------------ cases by forking


class Forks:
    """Child processes, each of which goes on with the run of its parent in its own way."""

    def __init__(self, jobs: int, tell: Callable[[CaseVerdict], None]) -> None:
        self.jobs, self.tell = jobs, tell
        self.answer: int | None = None
        """Where a child writes; None in the parent."""
        self._children: dict[int, tuple[int, Case]] = {}

    def fork(self, case: Case) -> bool:
        """True in the child."""
        while len(self._children) >= self.jobs:
            self._collect()
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            self.answer = writing
            spent = int(time.process_time() + HANGS)
            resource.setrlimit(resource.RLIMIT_CPU, (spent, spent))
            continue_here()
            return True
        os.close(writing)
        self._children[reading] = child, case
        return False

    def send(self, verdict: CaseVerdict) -> None:
        """The end of a child."""
        assert self.answer is not None
        with os.fdopen(self.answer, "wb") as stream:
            pickle.dump(verdict, stream)
        os._exit(0)

    def finish(self) -> None:
        """Wait for all children."""
        while self._children:
            self._collect()

    def _collect(self) -> None:
        """Wait for one child."""
        for reading in select.select(list(self._children), [], [])[0]:
            child, case = self._children.pop(reading)
            with os.fdopen(reading, "rb") as stream:
                said = stream.read()
            spent = os.WTERMSIG(os.waitpid(child, 0)[1]) in (signal.SIGXCPU, signal.SIGKILL)
            trouble = (
                f"does not end within {HANGS:.0f} s of processor time"
                if spent
                else "the process died"
            )
            self.tell(pickle.loads(said) if said else CaseVerdict(case, wrong=[trouble]))


def branch_cases(
    cases: Sequence[Case], cell: str, seed: int, jobs: int, tell: Callable[[CaseVerdict], None]
) -> None:
    """Run the pick once, and each case from where its phase begins; all phases are of one tree.

    The process must have no other threads: `prepare_to_fork`.
    """
    waiting, forks, watchers = list(cases), Forks(jobs, tell), []
    verdict = CaseVerdict(cases[0])

    def branch(watcher: CaseWatcher) -> None:
        now = watcher.world.clock.now()
        for case in list(waiting):
            begun = watcher.began_at.get(case.phase.node)
            after = min(case.phase.after, ACTS) if case.phase.operator else case.phase.after
            if begun is not None and now >= begun + after:
                waiting.remove(case)
                if forks.fork(case):
                    verdict.case = case
                    watcher.take(case)
                    return

    def on_ready(runner: Runner) -> None:
        watchers.append(CaseWatcher(runner, branch))
        branch(watchers[0])

    def on_event(event: Event) -> None:
        if watchers:
            watchers[0].on_event(event)

    def on_latched(_runner: Runner) -> None:
        if forks.answer is not None and verdict.case.ends == "recovered":
            recover(watchers[0], verdict, seed)
        elif forks.answer is not None:
            judge_afterwards(watchers[0], verdict)

    try:
        executed = execute(
            RunOrder(TREES / cases[0].phase.tree, find_cell(cell), seed, SETTINGS[cell]),
            [on_event],
            on_ready=on_ready,
            on_latched=on_latched,
        )
        if forks.answer is not None:
            judge(watchers[0], executed, verdict)
            with tempfile.TemporaryDirectory() as folder:
                recorder = Recorder(Path(folder))
                for event in watchers[0].events:
                    recorder.on_event(event)
                recorder.close()
                judge_record(Path(folder), executed.result.outcome, verdict)
    except BaseException as error:
        if forks.answer is None:
            raise
        verdict.wrong.append(f"{type(error).__name__}: {error}")
    if forks.answer is not None:
        forks.send(verdict)
    forks.finish()
    for case in waiting:
        tell(CaseVerdict(case, wrong=["its phase never began"]))
    if (
        executed.result.outcome not in ("success", "partial")
        or watchers[0].truth.claimed is not True
    ):
        verdict.case, verdict.wrong = (
            Case("none", "none", cases[0].phase, "success", np.inf),
            ["the pick without a fault"],
        )
        verdict.outcome, verdict.reason = executed.result.outcome, str(executed.result.reason)
        tell(verdict)


def prepare_to_fork() -> None:
    """Have all that is computed and drawn in this thread: a fork has no other."""
    import torch

    from pomona.tools.simulation import camera

    plan_here()
    use_strands()
    torch.set_num_threads(1)
    os.environ["LP_NUM_THREADS"] = "0"  # of Mesa's rasteriser
    setattr(camera, "in_gl_thread", lambda function: function())  # noqa: B010
