"""After any exception the cell ends in its safe state, at rest, and record and operator get the cause."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from fake_cell import FakeCell, Wheel
from fake_runs import Turn, make

from pomona.executive.reasons import Reason
from pomona.executive.registry import Registry
from pomona.executive.running.events import (
    ErrorRaised,
    Event,
    NodeChanged,
    RunEnded,
    RunStarted,
    SafeStopped,
)
from pomona.executive.running.runner import Runner
from pomona.executive.skill import Interrupted, Skill, Work
from pomona.executive.values.sentences import LONGEST, sentence_of
from pomona.tools.dashboard.explain import explain

RAISED = [
    SystemExit(0),
    KeyboardInterrupt(),
    GeneratorExit(),
    MemoryError(),
    RecursionError("too deep"),
    Interrupted(),
]
BESIDE = """
pomona: 1
tree: beside
root:
  parallel:
    - Turn: {duration: 9 s}
    - Raise: {}
"""
"""One skill turns the wheel, the other raises."""


def raising(error: BaseException, ticks: int = 3, letting_go: bool = False) -> Registry:
    """Skills of a tree: Turn, and Raise, which raises after so many ticks, or while it lets go."""

    class Raise(Skill):
        """Raises a given exception."""

        def run(self) -> Work:
            try:
                for _ in range(ticks):
                    yield None
                if letting_go:
                    raise ValueError("first")
            except Interrupted:
                if letting_go:
                    raise error from None
                raise
            raise error

    return Registry({"Turn": Turn, "Raise": Raise})


def errors(events: list[Event]) -> list[ErrorRaised]:
    return [event for event in events if isinstance(event, ErrorRaised)]


def is_safe(runner: Runner, cell: FakeCell, events: list[Event]) -> bool:
    """Return True if the cell is latched, at rest, and the end was reported."""
    still = not cell.wheel.turning and not cell.wheel.coasting
    told = any(isinstance(event, SafeStopped) for event in events)
    return (
        still
        and told
        and cell.latched is not None
        and isinstance(events[-1], RunEnded)
        and runner.state.ended
    )


@pytest.mark.parametrize("error", RAISED, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("ticks", [0, 3])
def test_whatever_a_skill_raises_beside_a_moving_one_ends_in_the_safe_state(
    error: BaseException, ticks: int
) -> None:
    runner, cell, events = make(BESIDE, raising(error, ticks))
    result = runner.run()
    assert result.outcome in ("error", "stopped")
    assert result.outcome == "error" or isinstance(error, KeyboardInterrupt)
    assert is_safe(runner, cell, events)
    assert cell.wheel.log == ["start", "stop", "at rest"]
    assert result.reason is not None
    assert result.reason.node_path.endswith("Raise")
    (told,) = errors(events)
    assert "test_faults.py" in told.place
    assert "in run" in told.traceback


class Leave(Skill):
    """Starts the wheel, and is done."""

    devices = (Wheel,)

    def run(self) -> Work[None]:
        self.device(Wheel).start()
        yield None


@pytest.mark.parametrize("said", [5, b"text", object(), Reason])
def test_a_line_of_feedback_that_is_no_text_is_a_fault_of_its_skill(said: Any) -> None:
    class Say(Skill):
        """Yields an object that cannot be shown."""

        def run(self) -> Work[None]:
            yield said

    runner, cell, events = make(
        BESIDE.replace("Raise", "Say"), Registry({"Turn": Turn, "Say": Say})
    )
    result = runner.run()
    assert is_safe(runner, cell, events)
    assert result.reason is not None
    assert result.reason.message.startswith("beside/Say: its feedback is no text but ")


def test_a_text_of_ten_megabytes_is_shortened_before_the_tick_prints_it() -> None:
    long = "a" * 10_000_000

    class Say(Skill):
        """Shows a text that is too long, and fails with it."""

        failures = ("LONG",)

        def run(self) -> Work[None]:
            yield long
            raise self.failure("LONG", long)

    runner, _cell, events = make("pomona: 1\ntree: t\nroot: {Say: {}}", Registry({"Say": Say}))
    result = runner.run()
    assert result.reason is not None
    shown = [
        event.feedback for event in events if isinstance(event, NodeChanged) and event.feedback
    ]
    assert len(shown) == 2
    for text in (*shown, result.reason.message):
        assert len(text) <= LONGEST
        assert "a … (10000000 characters)" in text


@pytest.mark.parametrize("lost", [False, True])
def test_a_tree_that_ends_beside_something_that_still_moves_is_no_success(lost: bool) -> None:
    def lose(_runner: object, cell: FakeCell) -> None:
        cell.wheel.trouble = ConnectionError("the wheel does not answer") if lost else None

    runner, cell, _events = make(
        "pomona: 1\ntree: t\nroot: {Leave: {}}", Registry({"Leave": Leave}), {20: lose}
    )
    result = runner.run()
    assert result.outcome == "error"
    assert not cell.wheel.turning
    assert result.reason is not None
    expected = (
        "the wheel does not answer"
        if lost
        else "something still moves 2 s after the end of the tree"
    )
    assert result.reason.message == cell.latched == expected


def test_a_function_that_raises_stop_iteration_is_no_success() -> None:
    class Raise(Skill):
        """Instant work with a bug."""

        def run(self) -> None:
            return next(iter(()))

    runner, cell, events = make(BESIDE, Registry({"Turn": Turn, "Raise": Raise}))
    assert runner.run().outcome == "error"
    assert is_safe(runner, cell, events)


def test_a_failure_while_halting_is_reported_and_the_other_skills_are_halted_all_the_same() -> None:
    runner, cell, events = make(
        BESIDE.replace("- Raise", "- Raise: {}\n      name: First\n    - Raise"),
        raising(OSError("no hands"), 3, True),
    )
    result = runner.run()
    assert result.outcome == "error"
    assert is_safe(runner, cell, events)
    assert cell.wheel.log[-1] == "at rest"
    assert [(e.error, e.during) for e in errors(events)] == [
        ("ValueError", "the tick"),
        ("OSError", "letting go"),
    ]


def test_a_skill_that_fails_to_let_go_in_a_healthy_run_is_a_fault() -> None:
    text = BESIDE.replace("parallel:", "parallel:\n    - sequence: [{wait: 60 ms}, {fail: {}}]")
    runner, cell, events = make(text, raising(SystemExit(0), 99, True))
    result = runner.run()
    assert result.outcome == "error"
    assert result.reason is not None
    assert result.reason.code == "SystemExit"
    assert result.reason.node_path.endswith("Raise")
    assert is_safe(runner, cell, events)


def test_a_listener_that_fails_ends_the_run_safely_and_the_others_hear_the_end() -> None:
    runner, cell, events = make(
        "pomona: 1\ntree: t\nroot: {Turn: {duration: 9 s}}", raising(SystemExit())
    )

    def broken(event: Event) -> None:
        if event.tick == 1:
            raise BrokenPipeError(32, "Broken pipe")

    received: list[Event] = []
    runner._events.subscribe(broken)
    runner._events.subscribe(received.append)
    result = runner.run()
    assert result.outcome == "error"
    assert result.reason is not None
    assert "Broken pipe" in result.reason.message
    assert is_safe(runner, cell, events)
    assert received == events


@pytest.mark.parametrize("error", [SystemExit(0), MemoryError()])
def test_a_watcher_that_ends_the_process_ends_the_run_safely(error: BaseException) -> None:
    class Leaving:
        """Looks once too often."""

        looks = 0

        def look(self) -> list[tuple[str, object]]:
            self.looks += 1
            if self.looks == 2:
                raise error
            return []

    runner, cell, events = make(
        "pomona: 1\ntree: t\nroot: {Turn: {duration: 1 s}}", raising(SystemExit())
    )
    runner._watch._watch._watchers.append(Leaving())
    result = runner.run()
    assert errors(events)[0].error == type(error).__name__
    if isinstance(error, SystemExit):
        assert result.outcome == "error"
        assert is_safe(runner, cell, events)
    else:  # an exception leaves the watcher out, and is told
        assert result.outcome == "success"


@pytest.mark.parametrize("isolated", [False, True])
def test_a_computation_that_ends_the_process_ends_the_run_safely(isolated: bool) -> None:
    class Raise(Skill):
        """Runs a computation that leaves the process."""

        def run(self) -> Work:
            yield from self.compute(leave, isolated=isolated)
            return {}

    runner, cell, events = make(BESIDE, Registry({"Turn": Turn, "Raise": Raise}))
    assert runner.run().outcome == "error"
    assert is_safe(runner, cell, events)
    (told,) = errors(events)
    assert told.error == "SystemExit"
    assert "test_faults.py" in told.place
    assert told.place.endswith("in leave")


def leave() -> None:
    raise SystemExit(0)


def test_a_cell_that_can_no_longer_be_scored_or_stepped_is_reported() -> None:
    runner, cell, events = make(BESIDE, raising(ValueError("bug")))

    def broken(*_: object) -> Any:
        raise RuntimeError("the world has ended")

    cell.truth = broken  # type: ignore[method-assign]
    cell.clock.advance = broken  # type: ignore[method-assign]
    assert runner.run().outcome == "error"
    assert {e.during for e in errors(events)} >= {"the tick", "scoring the run"}
    assert cell.latched is not None
    assert isinstance(events[-1], RunEnded)


def test_an_error_is_explained_with_its_place_and_its_traceback() -> None:
    class Raise(Skill):
        """A plain bug."""

        def run(self) -> Work:
            yield None
            samples: list[float] = []
            samples[3]

    runner, _cell, events = make(BESIDE, Registry({"Turn": Turn, "Raise": Raise}))
    runner.run()
    story = "\n".join(explain([started(runner), *events]))
    assert "list index out of range" in story
    assert "test_faults.py:" in story
    assert "samples[3]" in story
    assert "Traceback (most recent call last)" in story


def test_a_long_recursion_keeps_a_traceback_of_limited_length() -> None:
    class Raise(Skill):
        """Calls itself."""

        def run(self) -> Work:
            yield None
            self.down(lambda again: self.down(again))

        def down(self, again: Callable[..., Any]) -> None:
            again(lambda other: self.down(other) if other else again(again))
            self.down(again)

    runner, cell, events = make(BESIDE, Registry({"Turn": Turn, "Raise": Raise}))
    runner.run()
    (told,) = errors(events)
    assert told.error == "RecursionError"
    assert len(told.traceback) < 20_000
    assert is_safe(runner, cell, events)


def started(runner: Runner) -> Event:
    nodes = tuple(node.facts() for node in runner.tree.nodes)
    return RunStarted(
        0.0, 0, "r", "t", "t", "", "", "c", "mock", "", "", 0, {}, nodes, {}, 0.0, 0.02
    )


@pytest.mark.parametrize("ends", ["succeed", "fail"])
def test_a_tree_that_ends_in_the_tick_of_a_safe_stop_was_stopped(ends: str) -> None:
    class Raise(Skill):
        """Sees the cell stop in the middle of the tick in which the tree ends."""

        failures = ("ENDED",)

        def run(self) -> Work:
            yield None
            cell.safe_stop("hand in the cell")
            if ends == "fail":
                raise self.failure("ENDED", "the motion was stopped")

    runner, cell, events = make("pomona: 1\ntree: t\nroot: {Raise: {}}", Registry({"Raise": Raise}))
    result = runner.run()
    assert result.outcome == "stopped"
    assert result.reason is not None
    assert (result.reason.code, result.reason.message) == ("SAFE_STOP", "hand in the cell")
    assert is_safe(runner, cell, events)


class Unspeakable(Exception):
    """An exception whose own words fail."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


def test_an_exception_that_cannot_be_shown_ends_in_the_safe_state_as_any_other() -> None:
    runner, cell, events = make(BESIDE, raising(Unspeakable()))
    result = runner.run()
    assert result.outcome == "error"
    assert is_safe(runner, cell, events)
    assert result.reason is not None
    assert result.reason.message == "Unspeakable, which cannot be shown: RuntimeError"


def test_a_skill_that_has_used_up_the_memory_is_reported_as_such() -> None:
    assert sentence_of(MemoryError()) == "MemoryError: there is no memory left"
