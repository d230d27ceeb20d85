"""One order to run a tree: read, check, connect, run, record. Command line, campaigns and dashboard all call this."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import hashlib
import logging
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from pomona.executive.board import Board
from pomona.executive.cell import connect
from pomona.executive.cell.cell import Cell, dry_cell
from pomona.executive.cell.cell_file import SIMULATED, CellFile
from pomona.executive.cell.errors import DriverError
from pomona.executive.errors import UsageError
from pomona.executive.files import read_text
from pomona.executive.judging import judge, split_settings
from pomona.executive.language import BuiltTree, Document, Mocks, build, format_findings
from pomona.executive.language.built import Side
from pomona.executive.language.changes import Around, ReloadRefusedError, Takeover
from pomona.executive.language.check import read_document, refuse_errors
from pomona.executive.language.mocks import MockPlan, read_mocks
from pomona.executive.reasons import Reason
from pomona.executive.recording.folder import refuse_unwritable
from pomona.executive.recording.session import Reader, RecordingSession, unfinished
from pomona.executive.registry import Registry
from pomona.executive.run_views import RunViews
from pomona.executive.running.cell_watch import installed_watchers
from pomona.executive.running.events import Listener, OperatorActed, RunStarted
from pomona.executive.running.runner import Runner
from pomona.executive.running.signals import RunSignals, Terminated
from pomona.executive.running.starting import RunResult, StartCancelledError, Starting, alone_on
from pomona.executive.running.supervisor import RunSupervision
from pomona.executive.running.tick import EventStream
from pomona.executive.running.traces import place_of
from pomona.executive.skill import SkillContext, leave_if_forked, run_in_progress
from pomona.executive.terminal.summary import Summary
from pomona.executive.values.findings import did_you_mean
from pomona.executive.values.installation import (
    commit_here,
    distribution,
    installed_trees,
)
from pomona.executive.values.sentences import sentence_of
from pomona.executive.values.yaml_nodes import written

logger = logging.getLogger(__name__)

RECOVERY_SETTINGS = {
    "release",
    "home",
}  # parameters of the tree `recover` that `--set` passes to it

NO_RECORD = "NO_RECORD"  # failure code of a run whose cell requires a record, and whose record is incomplete
MOST_SEED = 2**63 - 1  # largest seed: records hold whole numbers of 64 bits
PERIOD = 0.02  # tick period [s]


@dataclass(frozen=True, slots=True)
class RunOrder:
    """The settings of a run.

    Attributes:
        tree, cell: files.
        seed: every random choice comes from it.
        settings: parameters of the tree; names that it does not declare are options of the cell.
        real_time: pace a simulated cell to wall-clock time.
        record: folder of records, or None for no record.
        past: folder of records in which the last run on this cell is looked for; None: `record`.
        dry: replace every skill by a mock and the cell by an empty one.
        mocks: file with the behaviour of the mocks; without one they all succeed at once.
        texts: contents of files, by path, to use instead of those on the disk.
        recover: if the last run on this cell was cut off, run the installed tree `recover` first.
        cleared: an operator has checked the cell since then.
        attended: an operator is there to answer questions and to resume after breakpoints.
        breaks: breakpoints to set at the start: a node's name, type or path, and its side.
        speed: initial ratio of the arm's speed to the commanded one, 0.1 to 1.
        speeds: changes of that in another run, to repeat at their moments.
        simulated: refuse a cell that is not simulated.
    """

    tree: Path
    cell: Path
    seed: int = 0
    settings: Mapping[str, str] = field(default_factory=dict)
    real_time: bool = False
    record: Path | None = None
    past: Path | None = None
    dry: bool = False
    mocks: Path | None = None
    texts: Mapping[str, str] = field(default_factory=dict)
    breaks: tuple[tuple[str, Side], ...] = ()
    recover: bool = False
    cleared: bool = False
    attended: bool = False
    speed: float = 1.0
    speeds: tuple[OperatorActed, ...] = ()
    simulated: bool = False

    def __post_init__(self) -> None:
        """Raises UsageError: the seed is negative, or greater than a record holds."""
        if not 0 <= self.seed <= MOST_SEED:
            raise UsageError(f"the seed {self.seed} is not from 0 to {MOST_SEED}")


@dataclass(frozen=True, slots=True)
class Executed:
    """The outcome of an order.

    Attributes:
        result: the run's.
        summary: of its events.
        record: folder of its record.
        problem: the problem with the record, if any.
        signal: number of the signal that asked it to end, if any.
    """

    result: RunResult
    summary: Summary
    record: Path | None
    problem: str
    signal: int | None = None


def execute(
    order: RunOrder,
    listeners: Sequence[Listener] = (),
    *,
    on_ready: Callable[[Runner], None] = lambda _runner: None,
    on_latched: Callable[[Runner], None] = lambda _runner: None,
    starting: Starting | None = None,
    readers: Sequence[Reader] = (),
) -> Executed:
    """Run an order to its end, in this thread.

    A real cell has its supervisor here as well. Only the parent process of `pomona run` is missing: if compiled code or
    `os.exec*` ends this process, its exit status is not the run's.

    Args:
        order: the settings of the run.
        listeners: get every event.
        on_ready: gets the runner before it starts: to pause, stop or step it from another thread.
        on_latched: gets the runner after a run that ended in the safe state, while the cell is still connected.
        starting: gets the progress of the preparation and can cancel it; once the cell is connected, that is a run
            stopped before its first tick.
        readers: get the measurements of the cell's devices, ten times a second.

    Raises:
        UsageError: the tree, a setting or the cell cannot be used; nothing has moved.
        StartCancelledError: it was cancelled before there was a cell.
        KeyboardInterrupt: a signal came before the run had begun; a note names the stage.
    """
    starting = starting or Starting()
    starting.reach("reading the tree")
    followers = _Followers(listeners, readers, on_ready, on_latched, starting)
    try:
        if order.record is not None:
            refuse_unwritable(order.record)
        if order.dry:
            return _run_dry(order, followers)
        ready = _read(order, starting)
        if ready.cell.record_required and order.record is None:
            raise UsageError(
                f"{ready.cell.name}: its file has `record: required`, but this run would not be recorded"
            )
        # No other run may start between the check of the last run's end and the start of this one.
        with alone_on(order.cell, ready.cell.kind, ready.cell.wires()):
            if order.tree.resolve() != _recovery():
                ready = replace(ready, order=admitted(order, ready.cell))
                _after_cut(ready, followers)
            try:
                return _run_on_cell(ready, followers)
            finally:
                give_back_memory()
    except KeyboardInterrupt as ended:
        if starting.stage is not None:
            ended.add_note(
                f"The run had not begun ({starting.stage.what}): no skill of it moved anything."
            )
        raise


def admitted(order: RunOrder, cell: CellFile) -> RunOrder:
    """Return the order as packages admit it, perhaps slower. Raises UsageError: one refuses it; nothing has moved."""
    for view in RunViews.installed():
        order = view.admit(order, cell)
    return order


run_tree = execute
"""The public name: in `pomona.executive`, this module hides a function of its own name."""


def give_back_memory() -> None:
    """Return the memory that a run has freed to the operating system.

    glibc (other C libraries do not) keeps freed memory in ever more fragments: 305 of 1 114 MB after eight picks. A
    process with many runs kept growing.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


@dataclass(frozen=True, slots=True)
class _Followers:
    """Listeners of a run; see `execute`."""

    listeners: Sequence[Listener]
    readers: Sequence[Reader]
    on_ready: Callable[[Runner], None]
    on_latched: Callable[[Runner], None]
    starting: Starting


@dataclass(frozen=True, slots=True)
class _Ready:
    """An order with files that have been read and have passed the check."""

    order: RunOrder
    registry: Registry
    document: Document
    settings: Mapping[str, str]
    cell: CellFile


def _read(order: RunOrder, starting: Starting) -> _Ready:
    registry = Registry.installed()
    document = read_document(order.tree, order.texts)
    missing = sorted(document.main.declared_skills.keys() - registry.keys())
    if missing:
        words = f"{', '.join(missing)}: declared in the tree and not installed"
        raise UsageError(
            f"{order.tree}: {words}. Nothing was run. Install their packages, or run it with --dry."
        )
    settings = {
        key: value
        for key, value in order.settings.items()
        if not (order.recover and key in RECOVERY_SETTINGS and key not in document.main.parameters)
    }
    judged = judge(document, registry, settings, order.cell, order.texts)
    judged.refuse_errors()
    assert judged.cell is not None
    if order.simulated and judged.cell.kind not in SIMULATED:
        raise UsageError(
            f"{order.cell}: not a simulated cell but of kind {judged.cell.kind}. Nothing was run."
        )
    starting.cell_kind = judged.cell.kind
    return _Ready(order, registry, document, split_settings(document, settings)[0], judged.cell)


def _run_dry(order: RunOrder, followers: _Followers) -> Executed:
    document = read_document(order.tree, order.texts)
    registry = Registry.installed().declaring(document.main.declared_skills)
    settings, cell_settings = split_settings(document, order.settings)
    refuse_errors(document, registry, settings, None)
    if cell_settings:
        raise UsageError(
            f"the tree has no parameter {', '.join(sorted(cell_settings))}, and a dry run has no cell"
        )
    mocks = _read_mocks(order.mocks, order.texts, document, registry)
    with RunSignals() as signals, run_in_progress():
        nothing = dry_cell()
        work = _Work(
            order, registry, document, settings, nothing, mocks, signals, RunSupervision(nothing)
        )
        return _run(work, followers)


def _run_on_cell(ready: _Ready, followers: _Followers) -> Executed:
    """Connect the cell, which no other run is using, and run."""
    order = ready.order
    file = ready.cell
    starting = followers.starting
    with RunSignals() as signals, run_in_progress(), contextlib.ExitStack() as stack:
        starting.refuse_cancelled()
        starting.reach("connecting the cell")
        cell = connect_cell(file, order)
        supervision = RunSupervision(cell)
        stack.callback(
            supervision.close
        )  # last of all: until the cell is closed, something could still move
        stack.callback(cell.close)
        stack.callback(leave_if_forked)
        stack.callback(
            signals.wait
        )  # after any end of the run, closing the cell is not interrupted
        if (order.cleared or order.recover) and not cell.clock.simulated:
            try:
                cell.acknowledge()  # the operator's order: a lost client leaves a gripper in its fast stop
            except DriverError as error:
                raise UsageError(f"{error}; nothing has moved") from error
        _refuse_full_hand(order, cell)
        work = _Work(
            order,
            ready.registry,
            ready.document,
            ready.settings,
            cell,
            None,
            signals,
            supervision,
            file.files,
        )
        return _run(work, followers)


def _recovery() -> Path:
    return (installed_trees() / "recover.yaml").resolve()


WHAT_TO_DO = (
    "`--recover` first moves the arm home slowly; with `--set release=true` it first puts down a held fruit. "
    "`--cleared` confirms that an operator has checked the cell. On the page, choose either where the run is started."
)


def _refuse_full_hand(order: RunOrder, cell: Cell) -> None:
    """Refuse a picking tree with something between the fingers, independent of the last run's end and record.

    Raises UsageError: the fingers measure a contact, and the order is not `cleared`.
    """
    hand = "" if order.cleared or order.tree.resolve() == _recovery() else cell.in_hand()
    if hand:
        what = (
            "It was still there after the recovery. Nothing else was run."
            if order.recover
            else "Nothing was run."
        )
        raise UsageError(f"{cell.name}: {hand} before the run has begun.\n{what} {WHAT_TO_DO}")


def _after_cut(ready: _Ready, followers: _Followers) -> None:
    """If the last run on this cell was cut off: recover if ordered, else refuse a cell that may hold something.

    Raises UsageError: it may hold something, or the recovery did not succeed; KeyboardInterrupt: a signal came.
    """
    order = ready.order
    starting = followers.starting
    past = order.past or order.record
    cut = unfinished(past, order.cell) if past is not None and not order.cleared else None
    if cut is None and not order.recover:
        return
    words = cut.sentence if cut else "no record shows that the last run on this cell was cut"
    starting.reach(words)
    if cut is None or order.recover:
        logger.warning("%s: recovering first", words)
        own = ready.document.main.parameters.keys() - RECOVERY_SETTINGS
        settings = {key: value for key, value in order.settings.items() if key not in own}
        recovery = replace(order, tree=_recovery(), settings=settings, breaks=())
        recovered = _run_on_cell(
            _read(recovery, starting), replace(followers, on_latched=lambda _runner: None)
        )
        if recovered.result.outcome != "success":
            raise UsageError(f"{recovered.summary.sentence()}. Nothing else was run.")
        if (
            recovered.signal is not None
        ):  # it came while the recovery's record and cell were being closed
            raise Terminated(recovered.signal)
    elif (cut.kind or starting.cell_kind) in ("real", "emulated") and cut.hand != "":
        raise UsageError(f"{words}.\nNothing was run. {WHAT_TO_DO}")
    else:
        logger.warning("%s", words)


@dataclass(frozen=True, slots=True)
class _Work:
    """An order with files that have been read, and a connected cell."""

    order: RunOrder
    registry: Registry
    document: Document
    settings: Mapping[str, str]
    cell: Cell
    mocks: Mocks | None
    signals: RunSignals
    supervision: RunSupervision
    cell_texts: Mapping[str, str] = field(default_factory=dict)
    around: Around = field(default_factory=dict)

    def build(self, context: SkillContext, board: Board) -> BuiltTree:
        given = self.settings
        mocks = self.mocks
        around = self.around
        document = self.document
        registry = self.registry
        return build(
            document,
            registry,
            overrides=given,
            context=context,
            board=board,
            mocks=mocks,
            around=around,
        )

    def take_over(
        self, context: SkillContext, board: Board, running: BuiltTree, held: str
    ) -> Takeover:
        """See `RunView.takeover`."""
        for view in RunViews.installed():
            found = view.takeover(running, held, partial(self.rebuild, context, board))
            if found is not None:
                return found
        raise ReloadRefusedError("no package is installed that takes changed files over")

    def rebuild(self, context: SkillContext, board: Board, around: Around) -> BuiltTree:
        """As `build`, from the tree's files as they are now. Raises UsageError: they cannot be read, or have errors."""
        order = self.order
        document = read_document(order.tree) if order.dry else _read(order, Starting()).document
        return replace(self, document=document, around=around).build(context, board)


def _run(work: _Work, followers: _Followers) -> Executed:
    order = work.order
    cell = work.cell
    signals = work.signals
    starting = followers.starting
    events = EventStream()
    summary = Summary()
    session = RecordingSession(order.record, cell, followers.readers)
    supervision = work.supervision
    runner = Runner(
        work.build,
        cell,
        events,
        seed=order.seed,
        period=PERIOD,
        real_time=order.real_time,
        attended=order.attended,
        watchers=[*installed_watchers(cell), session],
        heartbeat=supervision.beat,
        speed=order.speed,
        speeds=order.speeds,
        take_over=None if order.texts else work.take_over,
    )
    _set_breakpoints(runner, order.breaks)
    events.subscribe(summary.on_event, feedback=False)
    for listener in followers.listeners:
        events.subscribe(listener)
    problem = ""
    try:
        starting.attach(runner)
        _prepare(runner, starting)
        gc.freeze()  # from here on collections are short: they look at the run's own objects
        gc.enable()
        with signals.ask(runner):
            session.begin(runner, events)
            supervision.begin(runner, session.folder)
            events.emit(_started(work, runner, session.folder, starting.age))
            followers.on_ready(runner)
            starting.begin()
            result = runner.run()
        supervision.rest()
        session.draw(f"{runner.tree.name}: {result.outcome}, seed {order.seed}")
        if runner.latched is not None:
            with signals.raise_again():
                followers.on_latched(runner)
    finally:
        leave_if_forked()
        signals.wait()
        runner.close()
        problem = session.close()
    if result.outcome in ("success", "partial", "failure") and (
        breach := session.breach(result.outcome)
    ):
        problem = breach
        cell.safe_stop(problem)
        result = replace(result, outcome="error", reason=Reason("", NO_RECORD, problem))
        events.emit(result.event(*runner.progress))
    return Executed(result, summary, session.folder, problem, signals.number)


def _set_breakpoints(runner: Runner, breaks: Sequence[tuple[str, Side]]) -> None:
    for name, side in breaks:
        paths = runner.tree.find(name)
        if not paths:
            known = [word for node in runner.tree.nodes for word in (node.name, node.type)]
            raise UsageError(
                f"no node '{name}' to break at: {did_you_mean(name, known) or '`pomona show` lists them'}"
            )
        for path in paths:
            runner.break_at(path, side, who="command line")


def _read_mocks(
    path: Path | None, texts: Mapping[str, str], document: Document, registry: Registry
) -> MockPlan:
    if path is None:
        return MockPlan()
    plan, findings = read_mocks(_text_of(path, texts), path, document, registry)
    if findings:
        raise UsageError(f"{format_findings(findings)} Nothing was run.")
    return plan


def _prepare(runner: Runner, starting: Starting) -> None:
    notes = _Notes(starting)

    def tell(skill: str, done: int, of: int) -> None:
        starting.refuse_cancelled()
        starting.reach(f"preparing {skill}{notes.text}", done, of)

    logging.getLogger("pomona").addHandler(notes)
    try:
        runner.prepare(tell)
    except (KeyboardInterrupt, BrokenPipeError):  # BrokenPipeError: `pomona run … | head`
        raise
    except StartCancelledError:  # the run is stopped before its first tick, and recorded
        return
    except (
        BaseException
    ) as error:  # weights that do not load, a robot file that is wrong: nothing has moved
        raise UsageError(f"the skills cannot be prepared: {_with_place(error)}") from error
    finally:
        logging.getLogger("pomona").removeHandler(notes)


class _Notes(logging.Handler):
    """Shows the newest warning of the preparation, such as a first compilation, with each stage."""

    def __init__(self, starting: Starting) -> None:
        super().__init__(logging.WARNING)
        self._starting = starting
        self.text = ""

    def emit(self, record: logging.LogRecord) -> None:
        self.text = f": {record.getMessage()}"
        stage = self._starting.stage
        if stage is not None:
            self._starting.reach(
                f"{stage.what.partition(': ')[0]}{self.text}", stage.done, stage.of
            )


def connect_cell(file: CellFile, order: RunOrder) -> Cell:
    """Connect a cell as ordered.

    Raises:
        UsageError: a device cannot be reached, or refuses.
    """
    try:
        return connect.connect_cell(
            file, seed=order.seed, cleared=order.cleared, takes_over=order.cleared or order.recover
        )
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # any error of a driver while it connects: nothing has moved
        raise UsageError(_with_place(error)) from error


def _with_place(error: BaseException) -> str:
    """Return an exception's message; for built-in exceptions, with the place in the code."""
    place = (
        place_of(error)
        if type(error).__module__ == "builtins" and not isinstance(error, OSError)
        else ""
    )
    return f"{sentence_of(error)} ({place})" if place else sentence_of(error)


def _started(work: _Work, runner: Runner, folder: Path | None, preparation: float) -> RunStarted:
    """Return the first event of a run: everything that is needed to repeat it."""
    order = work.order
    document = work.document
    cell = work.cell
    return RunStarted(
        0.0,
        0,
        run=folder.name if folder is not None else f"{runner.tree.name}-{order.seed}",
        tree=runner.tree.name,
        tree_path=str(order.tree),
        tree_text=document.text,
        tree_hash=hashlib.sha256(document.text.encode()).hexdigest()[:16],
        cell=cell.name,
        cell_kind=cell.kind,
        cell_path=str((order.mocks or "") if order.dry else order.cell.resolve()),
        cell_text=_text_of(order.mocks if order.dry else order.cell, order.texts),
        seed=order.seed,
        parameters=runner.tree.parameters,
        nodes=tuple(node.facts() for node in runner.tree.nodes),
        versions=versions(),
        wall_time=time.time(),
        period=PERIOD,
        settings=dict(order.settings),
        speed=order.speed,
        preparation=round(preparation, 3),
        cell_files={
            name: text for name, text in work.cell_texts.items() if name != order.cell.name
        },
        parameter_texts=_parameter_texts(document, work.settings),
        tree_files={
            file.source.path: file.source.text
            for file in document.files
            if file is not document.main
        },
    )


def _parameter_texts(document: Document, settings: Mapping[str, str]) -> dict[str, str]:
    declared = document.main.parameters.items()
    texts = {
        name: written(parameter.default)
        for name, parameter in declared
        if parameter.default is not None
    }
    return texts | dict(settings)


def _text_of(path: Path | None, texts: Mapping[str, str]) -> str:
    if path is None:
        return ""
    return texts[str(path)] if str(path) in texts else read_text(path)


@cache
def versions() -> Mapping[str, str]:
    """Return the versions in use: the commit of Pomona in a git checkout, Python, packages."""
    commit = commit_here()
    found = {"git": commit} if commit else {}
    found |= {"python": platform.python_version(), "platform": platform.platform(terse=True)}
    for package in (distribution(), "py-trees", "numpy", "onnxruntime", "ompl", "mujoco-core"):
        with contextlib.suppress(PackageNotFoundError):
            found[package] = version(package)
    return found
