"""Random commands, faults and ticks against the runner on a fake cell: the invariants hold in every step. The runner is
driven step by step in this thread: each check of the cell passes control to the machine.
"""

from __future__ import annotations

import contextlib
import threading

from fake_cell import FakeCell, Wheel
from fake_runs import Turn, make
from hypothesis import settings, strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from pomona.executive.cell.cell import Cell
from pomona.executive.registry import Registry
from pomona.executive.running.events import ErrorRaised, OperatorActed
from pomona.executive.running.requests import AnswerRefusedError
from pomona.executive.running.starting import RunResult
from pomona.tools.dashboard.control_lock import ControlLock, RefusedError

TREES = (
    "root: {Turn: {duration: 400 ms}, repeat: 3}",
    "root: {parallel: [{Turn: {}, name: A, repeat: 2}, {Turn: {}, name: B}]}",
    "root: {parallel: [{Turn: {duration: 9 s}}, {wait: 200 ms}], success_on: one}",
    "root: {retry: 3, Turn: {duration: 9 s}, timeout: 100 ms}",
    "root: {sequence: [{ask: which?, name: Q, choices: [a, b], default: a, within: 200 ms}, {Turn: {duration: 1 s}}]}",
    "root: {Turn: {duration: 1 s}, approve: true}",
)
CLICKS = (
    ("pause", ""), ("resume", ""), ("step", ""), ("stop", ""), ("answer", "b ← t/Q"), ("answer", "approve ← t"),
    ("answer", "approve ← t/Turn"), ("answer", "refuse ← t/Turn"), ("answer", "c ← t/Q"), ("break", "t/Turn"),
    ("change", "duration = 50 ms ← t/Turn"), ("change", "duration = 1 kg ← t/Turn"), ("change", "duration = 1 s ← t"),
    ("break", "t"), ("break_after", "t/A"), ("unbreak", "t/Turn"), ("fail", "arm lost"), ("reload", ""), ("dance", ""),
)  # fmt: skip
"""Requests of two pages, sensible or not."""
PATIENCE = 20.0
"""Seconds within which the runner must reach its next look at the cell, or its end."""


class RunnerMachine(RuleBasedStateMachine):
    """One run; each step does something to it and then lets it go on for one look at the cell."""

    def __init__(self) -> None:
        super().__init__()
        self.go, self.looked, self.answered = (threading.Semaphore(0) for _ in range(3))
        self.refuses = False
        self.result: RunResult | None = None
        self.started = self.free = False
        self.cell: FakeCell | None = None
        self.desk = ControlLock()

    @precondition(lambda self: not self.started)
    @rule(tree=st.sampled_from(TREES))
    def start(self, tree: str) -> None:
        self.started = True
        self.runner, self.cell, self.events = make(
            f"pomona: 1\ntree: t\n{tree}", Registry({"Turn": Turn}), attended=True
        )
        self.desk.serve(self.runner)
        self.desk.take("first", "first page")
        check = self.cell.check

        def held() -> None:
            self.looked.release()
            if not self.free:
                self.go.acquire()
            check()

        self.cell.check = held  # type: ignore[method-assign]
        self.cell.acknowledge = self._acknowledge  # type: ignore[method-assign]
        self.thread = threading.Thread(target=self._run)
        self.thread.start()
        assert self.looked.acquire(timeout=PATIENCE)

    def _run(self) -> None:
        result = self.runner.run()
        self.latched_in_run = self.cell is not None and self.cell.latched is not None
        self.result = result
        self.looked.release()
        self.runner.hold_latched()

    def _acknowledge(self) -> None:
        assert self.cell is not None
        try:
            if self.refuses:
                raise ConnectionError("the wheel is still lost")
            Cell.acknowledge(self.cell)
        finally:
            self.answered.release()

    def _step(self) -> None:
        if self.result is None:
            self.go.release()
            assert self.looked.acquire(timeout=PATIENCE), "the runner hangs"

    @precondition(lambda self: self.started)
    @rule(count=st.integers(1, 4))
    def tick(self, count: int) -> None:
        for _ in range(count):
            self._step()

    @precondition(lambda self: self.started)
    @rule(action=st.sampled_from(["pause", "resume", "step", "stop", "interrupt", "acknowledge"]))
    def ask(self, action: str) -> None:
        if action == "acknowledge" and self.result is not None:
            return  # that is another rule's, which waits for what becomes of it
        self._ask(action)
        self._step()

    def _ask(self, action: str) -> None:
        """Ask the runner, for the present pause where that must be named; outside a pause it refuses."""
        present = (self._number(action),) if action in ("resume", "step") else ()
        with contextlib.suppress(AnswerRefusedError):
            getattr(self.runner, action)(*present)

    def _number(self, action: str, detail: str = "") -> int:
        """Of the pause that is on, or of the question that is asked."""
        question = self.runner.questions.get(detail.rpartition(" ← ")[2])
        return question.starts if question is not None else self.runner.pause_number

    @rule(page=st.sampled_from(["first", "second"]), action=st.sampled_from(["take", "release"]))
    def hand_over(self, page: str, action: str) -> None:
        if action == "take":
            self.desk.take(page, f"{page} page")
        else:
            self.desk.release(page)

    @precondition(lambda self: self.started)
    @rule(page=st.sampled_from(["first", "first", "second"]), click=st.sampled_from(CLICKS))
    def click(self, page: str, click: tuple[str, str]) -> None:
        held = self.desk.holder.viewer
        with contextlib.suppress(RefusedError):
            self.desk.act(page, *click, number=self._number(*click) if self.started else 0)
            assert held == page, "somebody acted who did not hold control"
            assert self.result is None or click[0] == "fail", (
                "something was asked of a run that has ended"
            )
        self._step()

    @precondition(lambda self: self.started and self.result is None)
    @rule()
    def stop_from_any_page(self) -> None:
        assert self.cell is not None
        self.desk.safe_stop("somebody")
        assert self.cell.latched is not None
        self._step()

    @precondition(lambda self: self.started)
    @rule(
        act=st.sampled_from(
            ["safe stop of the operator", "safe stop of the cell", "lost", "changed"]
        )
    )
    def fail(self, act: str) -> None:
        assert self.cell is not None
        match act:
            case "safe stop of the operator":
                self.runner.safe_stop("hand in the cell")
            case "safe stop of the cell":
                self.cell.safe_stop("light curtain")
            case "lost":
                self.cell.wheel.trouble = ConnectionError("the wheel does not answer")
            case _:
                self.cell.surroundings.changed = True
        self._step()

    @precondition(
        lambda self: self.result is not None and self.latched_in_run and self.thread.is_alive()
    )
    @rule(
        refuses=st.booleans(),
        between=st.sampled_from(["", "pause", "resume", "step", "stop", "interrupt"]),
    )
    def acknowledge(self, refuses: bool, between: str) -> None:
        assert self.cell is not None
        while self.answered.acquire(blocking=False):
            pass
        self.refuses = refuses
        if between:
            self._ask(between)  # of a run that has ended: recorded, and carried out by nobody
        self.runner.acknowledge()
        assert self.answered.acquire(timeout=PATIENCE), "nobody takes the acknowledgement"
        assert (self.cell.latched is not None) == refuses
        if not refuses:
            self.thread.join(PATIENCE)
            assert not self.thread.is_alive(), "it holds a cell that is not latched"

    @invariant()
    def nothing_moves_in_a_run_that_has_ended_and_all_is_told(self) -> None:
        if self.result is None or self.cell is None:
            return
        assert not self.cell.wheel.turning
        assert not self.cell.wheel.coasting
        assert self.runner.context.owners == {}
        assert self.runner.state.ended
        told = [
            event
            for event in list(self.events)
            if not isinstance(event, (OperatorActed, ErrorRaised))
        ]
        assert type(told[-1]).__name__ == "RunEnded"

    @invariant()
    def the_latch_is_respected(self) -> None:
        if self.cell is None or self.cell.latched is None:
            return
        assert not self.cell.wheel.turning, "it moves in the safe state"
        if (
            self.result is not None and self.latched_in_run
        ):  # a stop after the end latches the cell, and changes no end
            assert self.result.outcome in ("stopped", "error")

    @invariant()
    def a_device_has_one_owner(self) -> None:
        if self.cell is not None:
            assert "refused" not in self.cell.wheel.log, (
                "it was started while somebody else turned it"
            )
            assert set(self.runner.context.owners) <= {Wheel}

    def teardown(self) -> None:
        if self.started:
            self.free = True
            self.runner.stop()
            self.runner.leave()
            while self.thread.is_alive():
                self.go.release()
                self.thread.join(0.01)
            self.nothing_moves_in_a_run_that_has_ended_and_all_is_told()


TestRunner = RunnerMachine.TestCase
TestRunner.settings = settings(max_examples=25, stateful_step_count=14)
