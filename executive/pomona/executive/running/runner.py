"""One run of a tree on a cell: tick, pause, step, stop, safe stop. The only owner of the tick.

    idle → running ⇄ pausing → paused
           running → succeeded | failed          the tree ended
           running → stopping → stopped          an operator stopped it: every skill is halted first
           any     → faulted                     an exception, a lost device, a safe stop: latched

`Runner.run()` blocks in the caller's thread, which is the tick thread: the only one that touches tree, board, skills.
The other methods may be called from any thread; they are carried out between two ticks. `safe_stop` alone acts at once.
"""

from __future__ import annotations

import contextlib
import queue
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from py_trees.common import Status

from pomona.executive.account import AccountEntry
from pomona.executive.board import Board, Entry
from pomona.executive.cell.cell import Cell
from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.language import BuiltTree
from pomona.executive.language.built import Side
from pomona.executive.language.changes import (
    ReloadRefusedError,
    Takeover,
    change_input,
)
from pomona.executive.lease import viewed
from pomona.executive.reasons import Reason
from pomona.executive.running.cell_watch import (
    CellWatch,
    InterruptRequestedError,
    SafeStopRequestedError,
    Watch,
    Watcher,
)
from pomona.executive.running.compute import Computations
from pomona.executive.running.events import (
    Computed,
    ErrorRaised,
    Event,
    HandChanged,
    LinkChanged,
    OperatorActed,
    PortWritten,
    Published,
    SafeStopped,
    StateChanged,
    TickOverran,
    TreeChanged,
)
from pomona.executive.running.requests import (
    LATE,
    SETS_IN_MOTION,
    AnswerRefusedError,
    Request,
    Requests,
)
from pomona.executive.running.starting import RunResult, RunState
from pomona.executive.running.tick import (
    BREAK_ACTIONS,
    Breakpoints,
    EventStream,
    RunContext,
    TreeObserver,
)
from pomona.executive.running.traces import SkillLogs, place_of, traceback_of
from pomona.executive.skill import SkillContext, leave_if_forked
from pomona.executive.speed import cannot_slow, speed_of, words_of
from pomona.executive.values.sentences import sentence_of

if TYPE_CHECKING:  # small commands do not load numpy
    from pomona.executive.values.arrays import UInt8

STOP_LIMIT = 10.0  # seconds of the cell's clock that a stop may take before it becomes a safe stop


SETTLING = 2.0  # settle time of devices after the tree has ended [s of the cell's clock]; longer motion is an error

READINESS = 1.0  # seconds that a simulated cell runs on before an acknowledgement: repaired links open again


class ListenerError(PomonaError):
    """A listener of the run (terminal, page, record) failed: later events might be lost."""

    def __init__(self, error: BaseException) -> None:
        self.error = error
        super().__init__(f"a listener of the run failed: {sentence_of(error)}")


BLOCKED = 1.0  # wall-clock seconds of a tick on a simulated clock that are reported: no timeout interrupts it


Build = Callable[[SkillContext, Board], BuiltTree]  # makes a tree that is bound to a run
TakeOver = Callable[
    [SkillContext, Board, BuiltTree, str], Takeover
]  # of this tree, held at this node


class Runner(Requests):
    """Runs one tree once."""

    def __init__(
        self,
        build: Build,
        cell: Cell,
        events: EventStream,
        *,
        seed: int = 0,
        period: float = 0.02,
        real_time: bool = False,
        attended: bool = False,
        watchers: Sequence[Watcher] = (),
        heartbeat: Callable[[], None] = lambda: None,
        speed: float = 1.0,
        speeds: Sequence[OperatorActed] = (),
        take_over: TakeOver | None = None,
    ) -> None:
        """
        Args:
            build: makes the tree, bound to the context that it is given.
            cell: connected; the caller closes it.
            events: everything that happens is emitted here, from the tick thread.
            seed: every random choice of the skills comes from it.
            period: tick period [s].
            real_time: pace a simulated cell to wall-clock time; otherwise it runs as fast as the machine allows.
            attended: whether an operator is there to answer questions and to resume after breakpoints. Otherwise
                questions get their defaults, and the breakpoints in the tree file are ignored.
            watchers: show the appearance of the cell.
            heartbeat: called in every tick, also while paused or coming to rest.
            speed: initial ratio of the arm's speed to the commanded one.
            speeds: changes of that, to repeat at the moments of another run.
            take_over: takes the files over as they are then; None without files.

        Raises:
            UsageError: a reduced speed is requested, here or in the tree, and the arm's driver has none.
        """
        super().__init__()
        self._cell = cell
        self._events = events
        self._period = period
        self._real_time = real_time
        self._heartbeat = heartbeat
        self._computations = Computations(self._computed)
        self.context = RunContext(cell, self._computations, seed, self._published)
        self.board = Board(cell.clock)
        self.board.subscribe(self._written)
        self.tree = build(viewed(self.context, SkillContext), self.board)
        self._declare()
        self._speed, self._repeated = speed, deque(speeds)
        self._changed_files, self._takeovers = take_over, dict[str, Takeover]()
        self._refuse_full_speed_only(self.tree)
        self._breakpoints = Breakpoints(self.tree.behaviours)
        self.context.attended = attended
        self._attend(self.tree.breakpoints)
        self._observer = TreeObserver(self.tree, self._emit, lambda: self.progress)
        self._logs = SkillLogs()
        self._state = RunState.IDLE
        self._ticks = 0
        self._started: float | None = None
        self._step = False
        self._next: Request | None = None
        self._pauses = 0
        self._end: tuple[RunState, str] | None = None
        self._stop_deadline = self._settled_by = 0.0
        self._reason: Reason | None = None
        self._culprit = ""
        self._interrupted = False
        self._reported: dict[str, object] = {}
        self._watch = CellWatch(
            cell, self._linked, self._felt, Watch(cell, self._published, watchers, self._tell)
        )

    @property
    def state(self) -> RunState:
        """From any thread."""
        return self._state

    @property
    def progress(self) -> tuple[float, int]:
        """Run time [s] and tick number: a sign of life."""
        return self.context.elapsed(), self._ticks

    @property
    def wall(self) -> float:
        """Wall time since the run began [s]: the computations of a simulated run take none of its own time."""
        return 0.0 if self._started is None else time.perf_counter() - self._started

    @property
    def pictures(self) -> Mapping[str, tuple[UInt8, float]]:
        """Newest image (h, w, 3) of each camera that has one at no cost, and its age [s]. From any thread."""
        now = self._cell.clock.now()
        return {
            device: (image, max(0.0, now - stamp))
            for device, (image, stamp) in self._cell.pictures().items()
        }

    @property
    def ages(self) -> dict[str, float]:
        """Seconds since each device was last seen, by its name."""
        now = self._cell.clock.now()
        return {device: max(0.0, now - stamp) for device, stamp in self._watch.last_seen.items()}

    # -------------------------------------------------------------------------------------- the tick thread

    def prepare(
        self, tell: Callable[[str, int, int], None] = lambda _name, _done, _of: None
    ) -> None:
        """Load and warm up the skills before the run's clock starts; the callback gets (name, done, of) before each."""
        self.tree.prepare(tell)
        self._computations.pending()  # computations of the preparation do not count as the run's

    def look_after(self, name: str, state: Callable[[], str], *, required: bool) -> None:
        """Monitor a service that is no device of the cell; `state` is called every tick and returns 'ok', or the
        problem.

        A change is reported as `LinkChanged`; losing a required service ends the run in the safe state.
        """
        self._watch.look_after(name, state, required=required)

    def run(self) -> RunResult:
        """Run the tree to its end. Every error in the run becomes an outcome; none is raised."""
        with self._logs.listening():
            return self._run()

    def _run(self) -> RunResult:
        started = self._started = time.perf_counter()
        try:
            self.board.adopt()
            self.context.start_clock()
            self.context.set_speed(self._speed)
            self._set_state(RunState.RUNNING, "started")
            self.breakable = True
            self._loop(started)
            self.breakable = False
            with self._telling("", "closing"):
                self.close()
            self._refuse_motion()
        except BaseException as error:  # SystemExit, too: after any error nothing may keep moving
            leave_if_forked()
            self._fault(error)
            with self._telling("", "closing"):
                self.close()
        self._tell_refusals()
        self._tell_logs(last=True)
        result = self._result(time.perf_counter() - started)
        self._emit(result.event(*self.progress))
        return result

    def hold_latched(self) -> None:
        """After the run: keep the cell connected in its safe state until an operator acknowledges the reason.

        A device that is still lost refuses the acknowledgement: that is reported, and the safe state stays latched.
        """
        while (reason := self._cell.latched) is not None and not self._leaving:
            action, who, detail, _number, _at = self._commands.get()
            if action == "leave":
                return
            self._emit(OperatorActed(*self.progress, who, action, detail or reason))
            if action == "fail":
                self._switch(detail)
            elif action == "acknowledge":
                self._acknowledge()

    def _acknowledge(self) -> None:
        try:
            if self._cell.clock.simulated:  # its time passes only when it is advanced
                self._cell.clock.advance(READINESS)
            self._cell.acknowledge()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._tell("", "the acknowledgement", error)

    def close(self) -> None:
        """Release threads and processes. Harmless when already closed."""
        self._computations.close()

    def _attend(self, breakpoints: Iterable[tuple[str, Side]]) -> None:
        self.questions = self.tree.questions
        for question in self.questions.values():
            question.attended = self.context.attended
        for path, side in breakpoints if self.context.attended else ():
            self._breakpoints.change(path, side, True)

    def _loop(self, started: float) -> None:
        next_tick = self._cell.clock.now()
        while True:
            self._heartbeat()
            self._take_commands()
            self._take_speeds()
            if self._has_ended():
                return
            self._look()
            ticking = self._state is RunState.RUNNING and self._end is None
            if ticking:
                self._tick()
            self.context.drive_halting()
            self._raise_what_failed()
            self._move_on()
            if self._has_ended():
                return
            if ticking and self._wait_for_computations():
                continue  # computing took no simulated time: tick again at the same instant
            next_tick = self._let_time_pass(next_tick, started)

    def _has_ended(self) -> bool:
        return self._state.ended

    def _tick(self) -> None:
        if not self._breakpoints.holding:
            self._ticks += 1
            self.board.tick = self._ticks
        began = time.perf_counter()
        worked = time.thread_time()
        held = self._breakpoints.tick(self.tree.root, self._observer.visited)
        leave_if_forked()
        took = time.perf_counter() - began
        worked = time.thread_time() - worked
        self._observer.after_tick()
        if took > (BLOCKED if self._cell.clock.simulated else self._period):
            self._emit(TickOverran(*self.progress, self._observer.slowest(), took, worked))
        if held is not None:
            self._step = False
            self._pause("breakpoint", f"{held.side} {held.path}")
            return
        status = self.tree.root.status
        if status is Status.SUCCESS:
            self._end = RunState.SUCCEEDED, "the tree succeeded"
        elif status is Status.FAILURE:
            self._reason = self._observer.root_reason()
            self._end = RunState.FAILED, "the tree failed"
        if self._end is not None:
            self._settled_by = self._cell.clock.now() + SETTLING
        why, self.context.pause_for = self.context.pause_for, ""
        if (self._step or why) and self._end is None:
            self._step = False
            self._pause("asked by" if why else "step", why)

    def _take_commands(self) -> None:
        while True:
            try:
                request = self._commands.get_nowait()
            except queue.Empty:
                return
            action, who, detail, number, _at = request
            if action == "leave":
                continue
            if action in (*SETS_IN_MOTION, "reload") and self._is_late(request):
                continue
            self._emit(OperatorActed(*self.progress, who, action, detail))
            if action == "safe_stop":
                raise SafeStopRequestedError(detail)
            if action == "interrupt":
                raise (
                    InterruptRequestedError(detail)
                    if who == "keyboard"
                    else SafeStopRequestedError(detail)
                )
            if action == "stop":
                if (
                    self._state is not RunState.STOPPING
                ):  # a second stop does not extend the deadline
                    self._stop(f"stopped by {who}")
            elif action == "pause":
                self._next = None
                if self._state is RunState.RUNNING:
                    self._pause(who, detail)
            elif action in ("resume", "step") and self._state is RunState.PAUSED:
                self._resume(stepping=action == "step")
            elif action in ("resume", "step") and self._state is RunState.PAUSING:
                self._next = request  # the cell comes to rest first
            elif action == "answer":
                choice, _, path = detail.rpartition(" ← ")
                self.questions[path].answer(number, choice)
            elif action == "fail":
                self._switch(detail)
            elif action in ("change", "reload"):
                if action == "change":
                    change_input(self.tree, detail)
                else:
                    self._take_over(who, detail)
                for question in self.questions.values():
                    question.renew()
            elif action in BREAK_ACTIONS:
                self._breakpoints.change(detail, *BREAK_ACTIONS[action])

    def reload(self, number: int, who: str = "operator") -> None:
        """Take the changed tree file over, in pause `number` and at rest: see `Takeover`.

        Raises:
            AnswerRefusedError: the run is not in this pause, or something still moves.
            UsageError: the file cannot be read, has errors, or needs a slow arm where there is none.
            ReloadRefusedError: a change cannot be taken over, a new skill cannot be prepared, or there is no change.
        """
        self._refuse_other_pause(number)
        if self._state is not RunState.PAUSED:
            raise AnswerRefusedError("the run still comes to rest")
        if self._changed_files is None:
            raise ReloadRefusedError("this run has no tree file")
        context = viewed(self.context, SkillContext)
        found = self._changed_files(context, self.board, self.tree, self._breakpoints.held)
        self._refuse_full_speed_only(found.fresh)
        self._takeovers[found.difference] = found
        self._ask("reload", who, found.difference, number)

    def _take_over(self, who: str, lines: str) -> None:
        before = self.tree
        try:
            self.tree = self._takeovers[lines].apply(before)
            self._declare()
        except ReloadRefusedError as error:  # another change of the file was taken over meanwhile
            self._emit(OperatorActed(*self.progress, who, "too_late", f"reload, {error}"))
            return
        self._breakpoints.follow(self.tree)
        self._observer.follow(self.tree)
        self._attend(set(self.tree.breakpoints) - set(before.breakpoints))
        self._computations.pending()  # those of the preparation do not count as the run's
        self._emit(
            TreeChanged(*self.progress, tuple(node.facts() for node in self.tree.nodes), lines)
        )

    def _is_late(self, request: Request) -> bool:
        """Refuse, in the record, a request that must not set anything in motion any more."""
        action, who, detail, _number, at = request
        if (ago := time.monotonic() - at) > LATE:
            why = f"requested {ago:.1f} s earlier"
        elif action == "answer":
            question = self.questions[detail.rpartition(" ← ")[2]]
            why = (
                ""
                if question.open and question.starts == request.number
                else "question answered or gone"
            )
        else:
            why = "" if request.number == self.pause_number else "pause already over"
        if why:
            self._emit(
                OperatorActed(
                    *self.progress, who, "too_late", f"{action} {detail}".strip() + f", {why}"
                )
            )
        return bool(why)

    def _take_speeds(self) -> None:
        """Apply changes of speed: those of a repeated run at their times, and those that an operator requested.

        They are no commands: on a simulated clock the run still waits for computations, so that a repetition has the
        same ticks.
        """
        while self._repeated and (self._repeated[0].t, self._repeated[0].tick) <= self.progress:
            act = self._repeated.popleft()
            self._change_speed(speed_of(act.detail), act.who)
        while not self._speeds.empty():
            speed, who, asked = self._speeds.get()
            ago = time.monotonic() - asked
            if speed > self.context.speed and ago > LATE:
                words = f"speed {words_of(speed)}, requested {ago:.1f} s earlier"
                self._emit(OperatorActed(*self.progress, who, "too_late", words))
            else:
                self._change_speed(speed, who)

    def _change_speed(self, speed: float, who: str) -> None:
        self._emit(OperatorActed(*self.progress, who, "speed", words_of(speed)))
        self.context.set_speed(speed)

    def _refuse_full_speed_only(self, tree: BuiltTree) -> None:
        slow = (
            self._speed < 1.0
            or bool(self._repeated)
            or any(skill.slowed_by for skill in tree.skills)
        )
        if slow and self._cell.full_speed_only:
            raise UsageError(f"{cannot_slow(self._cell.full_speed_only)}; nothing has moved")

    def _switch(self, fault: str) -> None:
        switch, _, kind = fault.partition(" ")
        device = self._cell.switches[switch]
        device.inject_fault(kind) if kind else device.clear_fault()

    def _pause(self, who: str, detail: str) -> None:
        self.context.freeze()
        self._cell.pause()
        self._set_state(RunState.PAUSING, f"{who} {detail}".strip())

    def _resume(self, stepping: bool) -> None:
        self._cell.resume()  # raises when the cell is no longer as it was when paused: that is a fault
        self.context.thaw()
        self._step = stepping
        self._set_state(RunState.RUNNING, "step" if stepping else "resumed")

    def _stop(self, because: str) -> None:
        self._reason = Reason("", "STOPPED", because)
        self.context.thaw()
        if self._state in (RunState.PAUSING, RunState.PAUSED):
            self._state = RunState.RUNNING
        self._breakpoints.drop()
        self.tree.root.stop(Status.INVALID)
        self._observer.after_tick()
        self._stop_deadline = self._cell.clock.now() + STOP_LIMIT
        self._set_state(RunState.STOPPING, because)

    def _move_on(self) -> None:
        """The transitions that wait for the cell."""
        if self._state is RunState.RUNNING and self._end is not None:
            if not self.context.halting:  # skills that the tree's end interrupted are halted first
                self._refuse_latched()
                if self._cell.settled():
                    self._set_state(*self._end)
                elif self._cell.clock.now() > self._settled_by:
                    raise PomonaError(
                        f"something still moves {SETTLING:g} s after the end of the tree"
                    )
        elif self._state is RunState.PAUSING and self._cell.settled():
            self._set_state(RunState.PAUSED, "at rest")
            request = self._next
            self._next = None
            if request is not None and not self._is_late(request):
                self._resume(stepping=request.action == "step")
        elif self._state is RunState.STOPPING:
            if not self.context.halting and self._cell.settled():
                self._safe_stop("stopped")
                self._set_state(RunState.STOPPED, "every skill is halted")
            elif self._cell.clock.now() > self._stop_deadline:
                still = ", ".join(self.context.halting) or "the cell"
                raise PomonaError(
                    f"{still} has not come to rest within {STOP_LIMIT:.0f} s of a stop"
                )

    def _look(self) -> None:
        try:
            self._watch.look()
        except SafeStopRequestedError:
            self._take_commands()  # it may have been requested since they were taken: then this names the requester
            raise

    def _refuse_latched(self) -> None:
        """Raise if the cell is latched: the tree's end is then only the effect of its stopped motions.

        Raises SafeStopRequestedError: the cell was latched during the tick; with the reason of the request.
        """
        if self._cell.latched is not None:
            self._take_commands()
            raise SafeStopRequestedError(self._cell.latched)

    def _wait_for_computations(self) -> bool:
        """On a simulated clock, wait for the computations that this tick started; True when there were any.

        Those that have already ended count, too: a run does not depend on how fast the machine is.
        """
        if not self._cell.clock.simulated:
            self._computations.pending()
            return False
        if not self._computations.started:
            return False
        while not self._computations.wait(0.05):
            if not self._commands.empty() or self._cell.latched is not None:
                return True
        return True

    def _let_time_pass(self, next_tick: float, started: float) -> float:
        clock = self._cell.clock
        if clock.simulated:
            clock.advance(self._period)
            waiting = self._state is RunState.PAUSED or any(q.open for q in self.questions.values())
            if self._real_time or waiting:
                ahead = self.context.elapsed() - (time.perf_counter() - started)
                time.sleep(min(max(ahead, 0.0), self._period) if self._real_time else self._period)
            return clock.now()
        next_tick = max(next_tick + self._period, clock.now())
        clock.advance(next_tick - clock.now())
        return next_tick

    def _refuse_motion(self) -> None:
        """A motion that has begun behind the end belongs to no skill.

        Raises PomonaError: something moves although the tree has ended and all was at rest.
        """
        if not self._cell.settled():
            raise PomonaError(
                "something began to move after the end of the tree, when all was at rest"
            )

    def _raise_what_failed(self) -> None:
        """Treat an error of a halted skill or of a listener as a fault."""
        self._tell_refusals()
        if (failed := self.context.take_failure()) is not None:
            self._culprit, error = failed
            raise error
        if (raised := self._events.take_failure()) is not None:
            if isinstance(raised, Exception):
                raise ListenerError(raised) from raised
            raise raised

    def _fault(self, error: BaseException) -> None:
        """The one way into the safe state: latch the cell, report why, halt the tree, wait until all is at rest."""
        self.breakable = False
        self._interrupted = isinstance(error, (KeyboardInterrupt, InterruptRequestedError))
        code, message = _code_and_message(error)
        node = self._culprit or self._observer.culprit()
        data: dict[str, object] = {}
        with self._telling(node, "the safe stop"):
            self._safe_stop(message)
        self._tell_logs()
        if not isinstance(error, SafeStopRequestedError):
            data = {"exception": type(error).__name__, "place": place_of(error)}
            self._tell(node, "the tick", error)
            self.context.forget_refusal(error)
        self._reason = Reason(node, code, message, data)
        with self._telling(node, "letting go"):
            self.context.thaw()
            self._breakpoints.drop()
            self.tree.root.stop(Status.INVALID)
        for (
            skill
        ) in self.tree.skills:  # a node that broke in its first tick has not stopped its children
            if skill.status is Status.RUNNING:
                with self._telling(skill.path, "letting go"):
                    skill.stop(Status.INVALID)
        with self._telling(node, "letting go"):
            self.breakable = True
            self._come_to_rest()
            self.breakable = False
        self.breakable = False
        with self._telling("", "the end"):
            self._observer.after_tick()
            self._take_last_commands()
        self._set_state(RunState.FAULTED, message)

    def _come_to_rest(self) -> None:
        """Let time pass until every skill is halted and the cell has settled.

        Raises PomonaError: it has not within `STOP_LIMIT`.
        """
        deadline = self._cell.clock.now() + STOP_LIMIT
        while self.context.halting or not self._cell.settled():
            if self._cell.clock.now() >= deadline:
                still = ", ".join(self.context.halting) or "the cell"
                raise PomonaError(
                    f"{still} has not come to rest within {STOP_LIMIT:.0f} s of the safe stop"
                )
            self._heartbeat()
            self.context.drive_halting()
            self._tell_what_failed()
            self._cell.clock.advance(self._period)

    @contextlib.contextmanager
    def _telling(self, node: str, during: str) -> Iterator[None]:
        """Report errors in here instead of raising them: the cell is latched, and later steps must still run."""
        try:
            yield
        except BaseException as error:
            self._tell(node, during, error)
        self._tell_what_failed()

    def _tell_logs(self, last: bool = False) -> None:
        for line in self._logs.take(*self.progress, last):
            self._emit(line)

    def _tell_refusals(self) -> None:
        self._tell_logs()
        while (refused := self.context.take_refusal()) is not None:
            self._tell(refused.skill, "a refused command", refused)

    def _tell_what_failed(self) -> None:
        while (failed := self.context.take_failure()) is not None:
            self._tell(failed[0], "letting go", failed[1])
        while (raised := self._events.take_failure()) is not None:
            self._tell("", "telling of the run", raised)

    def _tell(self, node: str, during: str, error: BaseException) -> None:
        self._emit(
            ErrorRaised(
                *self.progress,
                node,
                during,
                type(error).__name__,
                sentence_of(error),
                place_of(error),
                traceback_of(error),
            )
        )

    def _take_last_commands(self) -> None:
        """Record the commands that came at the last moment, too."""
        while not self._commands.empty():
            action, who, detail, _number, _at = self._commands.get()
            if action != "leave":
                self._emit(OperatorActed(*self.progress, who, action, detail))

    def _safe_stop(self, reason: str) -> None:
        failed = self._cell.safe_stop(reason)
        self._emit(SafeStopped(*self.progress, reason))
        for device, what in failed.items():
            self._emit(
                ErrorRaised(
                    *self.progress, "", "the safe stop", "NotStopped", f"{device} {what}", "", ""
                )
            )

    def _declare(self) -> None:
        # mocks measure nothing
        self.context.account.success = self.tree.success if self._cell.devices else ""

    def _result(self, wall: float) -> RunResult:
        outcome = {
            RunState.SUCCEEDED: "success",
            RunState.FAILED: "failure",
            RunState.STOPPED: "stopped",
        }.get(self._state, "error")
        if outcome == "success":
            self._reason = self.context.account.doubt(self._cell.in_hand())
            outcome = "success" if self._reason is None else "partial"
        if self._reason is not None and self._reason.code in ("SAFE_STOP", "INTERRUPTED"):
            outcome = "stopped"
        truth = None
        with self._telling("", "scoring the run"):
            truth = self._cell.truth(self._reported)
        return RunResult(
            outcome,
            self._reason,
            self._ticks,
            self.context.elapsed(),
            wall,
            truth,
            self.context.account.report(),
            self._interrupted,
        )

    # ------------------------------------------------------------------------------------------- events

    def _set_state(self, state: RunState, because: str) -> None:
        self._pauses += state is RunState.PAUSING
        self._state = state
        self.pause_number = self._pauses if state in (RunState.PAUSING, RunState.PAUSED) else 0
        self._emit(StateChanged(*self.progress, state.value, because, self.pause_number))

    def _emit(self, event: Event, *, feedback: bool = False) -> None:
        self._events.emit(event, feedback=feedback)

    def _computed(self, node: str, function: str, wall: float) -> None:
        if self._state is not RunState.IDLE:  # preparation is not the run's time
            self._emit(Computed(*self.progress, node, function, wall))

    def _linked(self, name: str, state: str) -> None:
        self._emit(LinkChanged(*self.progress, name, state))

    def _felt(self, hand: str) -> None:
        self._emit(HandChanged(*self.progress, hand))

    def _written(self, key: str, entry: Entry) -> None:
        about = type(
            entry.value
        )  # asked of the class: a mock's placeholder has no attributes at all
        sentence = entry.value.sentence if hasattr(about, "sentence") else ""
        facts = entry.value.facts if hasattr(about, "facts") else {}
        self._reported.update(facts)
        self._emit(PortWritten(*self.progress, key, entry.value, entry.writer, sentence, facts))

    def _published(self, node: str, topic: str, value: object) -> None:
        if isinstance(value, AccountEntry):
            self.context.account.add(value, node)
        self._emit(Published(*self.progress, node, topic, value))


def _code_and_message(error: BaseException) -> tuple[str, str]:
    """Failure code and sentence of an exception that ends a run."""
    if isinstance(error, SafeStopRequestedError):
        return error.code, str(error)
    if isinstance(error, KeyboardInterrupt):
        return InterruptRequestedError.code, str(error) or "interrupted from the keyboard"
    return type(error).__name__, sentence_of(error)
