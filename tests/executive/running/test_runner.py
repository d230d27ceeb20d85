"""The runner's state machine: ends, pauses, steps, stops, breakpoints, and every way into the safe state."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from fake_cell import COASTING, FakeCell
from fake_runs import TURN, Turn, make as make_run

from pomona.executive.cell.device import FaultSwitch
from pomona.executive.ports import Outputs
from pomona.executive.registry import Registry
from pomona.executive.running.compute import Computations
from pomona.executive.running.events import (
    ErrorRaised,
    Event,
    NodeChanged,
    OperatorActed,
    PortWritten,
    RunEnded,
    SafeStopped,
    StateChanged,
)
from pomona.executive.running.requests import LATE, AnswerRefusedError
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import RunState
from pomona.executive.running.tick import UnknownNodeError
from pomona.executive.skill import Interrupted, Skill, Work


class Jam(Skill):
    """Fail."""

    failures = ("JAMMED",)

    def run(self) -> Work:
        yield None
        raise self.failure("JAMMED", "the wheel is stuck", angle=0.5)


class Break(Skill):
    """A skill with a bug."""

    def run(self) -> Work:
        yield None
        raise ZeroDivisionError("one over nothing")


class Squared(Outputs):
    y: int


class Square(Skill):
    """Compute beside the tick."""

    def run(self) -> Work[Squared]:
        y = yield from self.compute(pow, 7, 2)
        return Squared(y)


REGISTRY = Registry({"Turn": Turn, "Jam": Jam, "Break": Break, "Square": Square})


def make(
    text: str,
    at_tick: dict[int, Callable[[Runner, FakeCell], Any]] | None = None,
    registry: Registry = REGISTRY,
) -> tuple[Runner, FakeCell, list[Event]]:
    return make_run(text, registry, at_tick)


def states(events: list[Event]) -> list[str]:
    return [event.state for event in events if isinstance(event, StateChanged)]


def test_a_tree_that_succeeds() -> None:
    runner, cell, events = make(TURN)
    result = runner.run()
    assert (result.outcome, result.reason) == ("success", None)
    assert states(events) == ["running", "succeeded"]
    assert result.time == pytest.approx(0.4 + COASTING, abs=0.05)
    assert [event.key for event in events if isinstance(event, PortWritten)] == ["/a", "/b"]
    assert isinstance(events[-1], RunEnded)
    assert cell.latched is None


def test_a_failure_names_its_leaf_and_reason() -> None:
    runner, _cell, events = make(
        "pomona: 1\ntree: t\nroot:\n  sequence:\n    - Jam: {}\n      name: The jam\n"
    )
    result = runner.run()
    assert result.outcome == "failure"
    assert result.reason is not None
    (leaf,) = result.reason.leaves()
    assert (leaf.code, leaf.message, leaf.data) == ("JAMMED", "the wheel is stuck", {"angle": 0.5})
    assert leaf.node_path.endswith("The jam")
    failed = [
        event for event in events if isinstance(event, NodeChanged) and event.status == "FAILURE"
    ]
    assert all(event.reason is not None for event in failed)


def test_an_exception_ends_in_the_safe_state_with_the_skill_named() -> None:
    runner, cell, events = make("pomona: 1\ntree: t\nroot:\n  sequence:\n    - Break: {}\n")
    result = runner.run()
    assert result.outcome == "error"
    assert result.reason is not None
    assert result.reason.code == "ZeroDivisionError"
    assert result.reason.node_path.endswith("Break")
    assert cell.latched == "one over nothing"
    assert any(isinstance(event, SafeStopped) for event in events)
    assert states(events)[-1] == "faulted"


def test_a_lost_device_ends_in_the_safe_state_and_the_wheel_comes_to_rest() -> None:
    def lose(_runner: Runner, cell: FakeCell) -> None:
        cell.wheel.trouble = ConnectionError("the wheel does not answer")

    runner, cell, _events = make(TURN, {5: lose})
    result = runner.run()
    assert result.outcome == "error"
    assert cell.latched == "the wheel does not answer"
    assert cell.wheel.log[:2] == ["start", "stop"]
    assert not cell.wheel.turning


def test_an_operators_safe_stop_acts_at_once_and_is_an_outcome() -> None:
    runner, cell, events = make(
        TURN, {4: lambda runner, _cell: runner.safe_stop("hand in the cell", "ada")}
    )
    result = runner.run()
    assert result.outcome == "stopped"
    assert cell.latched == "hand in the cell"
    assert result.ticks < 6
    assert [event.who for event in events if isinstance(event, OperatorActed)] in (["ada"], [])


def test_a_safe_stop_from_the_cells_own_side_ends_the_run_too() -> None:
    runner, _cell, _events = make(TURN, {4: lambda _runner, cell: cell.safe_stop("light curtain")})
    result = runner.run()
    assert result.outcome == "stopped"
    assert result.reason is not None
    assert result.reason.message == "light curtain"


def test_stop_lets_the_skill_come_to_rest_over_several_ticks() -> None:
    runner, cell, events = make(TURN, {4: lambda runner, _cell: runner.stop("ada")})
    result = runner.run()
    assert result.outcome == "stopped"
    assert cell.wheel.log == ["start", "stop", "at rest"]
    assert states(events) == ["running", "stopping", "stopped"]


def test_pause_freezes_the_runs_time_and_resume_goes_on_in_place() -> None:
    runner, cell, events = make(
        TURN,
        {
            4: lambda runner, _cell: runner.pause("ada"),
            60: lambda runner, _cell: runner.resume(runner.pause_number, "ada"),
        },
    )
    result = runner.run()
    assert result.outcome == "success"
    assert states(events) == ["running", "pausing", "paused", "running", "succeeded"]
    assert result.time == pytest.approx(0.4 + COASTING, abs=0.05)
    assert cell.clock.now() > 1.2
    assert cell.wheel.log.count("start") == 2


def test_a_resume_ends_the_pause_that_it_names_and_no_other() -> None:
    refused: list[str] = []

    def resume(number: int) -> Callable[[Runner, FakeCell], None]:
        def act(runner: Runner, _cell: FakeCell) -> None:
            with pytest.raises(AnswerRefusedError) as error:
                runner.resume(number, "ada")
            refused.append(str(error.value))

        return act

    def pause(runner: Runner, _cell: FakeCell) -> None:
        runner.pause("ada")

    def press_twice(runner: Runner, _cell: FakeCell) -> None:
        runner.resume(1, "ada")
        runner.resume(1, "bob")  # another page, in the same moment

    script = {3: resume(0), 4: pause, 20: resume(0), 40: press_twice, 44: pause, 80: resume(1)}
    script[84] = lambda runner, _cell: runner.resume(2, "ada")
    runner, _cell, events = make(TURN, script)
    assert runner.run().outcome == "success"
    assert refused == [
        "the run is not paused",
        "the run is in pause 1; the request names pause 0",
        "the run is in pause 2; the request names pause 1",
    ]
    acts = [
        (e.who, e.action, e.detail)
        for e in events
        if isinstance(e, OperatorActed) and e.action != "pause"
    ]
    assert acts == [
        ("ada", "resume", ""),
        ("bob", "too_late", "resume, pause already over"),
        ("ada", "resume", ""),
    ]
    assert [e.pause for e in events if isinstance(e, StateChanged)] == [0, 1, 1, 0, 2, 2, 0, 0]


def test_resume_into_a_changed_world_is_refused_and_safe() -> None:
    def change(runner: Runner, cell: FakeCell) -> None:
        cell.surroundings.changed = True
        runner.resume(runner.pause_number, "ada")

    runner, cell, _events = make(TURN, {4: lambda runner, _cell: runner.pause("ada"), 12: change})
    result = runner.run()
    assert result.outcome == "error"
    assert cell.latched == "the wheel was turned by hand"


@pytest.mark.parametrize("action", ["resume", "step"])
def test_requests_during_a_hung_tick_do_not_set_the_arm_in_motion_afterwards(
    action: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ask_and_hang(runner: Runner, _cell: FakeCell) -> None:
        getattr(runner, action)(runner.pause_number, "ada")
        monkeypatch.setattr(time, "monotonic", lambda now=time.monotonic: now() + LATE + 1.0)

    script = {4: lambda runner, _cell: runner.pause("ada"), 20: ask_and_hang}
    script[60] = lambda runner, _cell: runner.stop("bob")
    runner, _cell, events = make(TURN, script)
    result = runner.run()
    assert result.outcome == "stopped"
    assert states(events) == ["running", "pausing", "paused", "stopping", "stopped"]
    acts = [(e.who, e.action, e.detail) for e in events if isinstance(e, OperatorActed)]
    assert acts == [
        ("ada", "pause", ""),
        ("ada", "too_late", f"{action}, requested 3.0 s earlier"),
        ("bob", "stop", ""),
    ]


def brakes_for_long(_runner: Runner, cell: FakeCell) -> None:
    """From now on a pause takes 100 ms until all is at rest."""
    pause, settled = cell.pause, cell.settled
    since: list[float] = []
    cell.pause = lambda: (pause(), since.append(cell.clock.now()))[0]  # type: ignore[method-assign]
    cell.settled = lambda: settled() and cell.clock.now() >= (since or [0.0])[-1] + 0.1  # type: ignore[method-assign]


@pytest.mark.parametrize("action", ["resume", "step"])
def test_a_resume_during_braking_is_carried_out_once_all_is_at_rest(action: str) -> None:
    script = {1: brakes_for_long, 4: lambda runner, _cell: runner.pause("ada")}
    script[6] = lambda runner, _cell: getattr(runner, action)(runner.pause_number, "ada")
    script[30] = lambda runner, _cell: (
        runner.resume(runner.pause_number, "bob") if action == "step" else None
    )
    runner, _cell, events = make(TURN, script)
    assert runner.run().outcome == "success"
    after = ["pausing", "paused", "running"] if action == "step" else []
    assert states(events) == ["running", "pausing", "paused", "running", *after, "succeeded"]
    resumed = [
        event for event in events if isinstance(event, StateChanged) and event.state == "running"
    ][1]
    assert resumed.because == ("step" if action == "step" else "resumed")


def test_a_pause_after_a_resume_during_braking_stays_a_pause() -> None:
    script = {1: brakes_for_long, 4: lambda runner, _cell: runner.pause("ada")}
    script[5] = lambda runner, _cell: (
        runner.resume(runner.pause_number, "ada"),
        runner.pause("bob"),
    )
    script[40] = lambda runner, _cell: runner.stop("bob")
    runner, _cell, events = make(TURN, script)
    assert runner.run().outcome == "stopped"
    assert states(events) == ["running", "pausing", "paused", "stopping", "stopped"]


def test_a_resume_during_a_braking_that_lasts_too_long_sets_nothing_in_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def ask_and_wait(runner: Runner, _cell: FakeCell) -> None:
        runner.resume(runner.pause_number, "ada")

    script = {1: brakes_for_long, 4: lambda runner, _cell: runner.pause("ada"), 5: ask_and_wait}
    script[7] = lambda _runner, _cell: monkeypatch.setattr(
        time, "monotonic", lambda now=time.monotonic: now() + LATE + 1.0
    )
    script[40] = lambda runner, _cell: runner.stop("bob")
    runner, _cell, events = make(TURN, script)
    assert runner.run().outcome == "stopped"
    assert states(events) == ["running", "pausing", "paused", "stopping", "stopped"]
    acts = [(e.who, e.action) for e in events if isinstance(e, OperatorActed)]
    assert acts == [("ada", "pause"), ("ada", "resume"), ("ada", "too_late"), ("bob", "stop")]


def test_step_runs_one_tick_and_pauses_again() -> None:
    ticks: list[int] = []

    def note(runner: Runner, _cell: FakeCell) -> None:
        ticks.append(runner._ticks)
        runner.step(runner.pause_number, "ada")

    script = {4: lambda runner, _cell: runner.pause("ada"), **dict.fromkeys((10, 20, 30), note)}
    script[40] = lambda runner, _cell: runner.stop("ada")
    runner, _cell, _events = make(TURN, script)
    runner.run()
    assert [after - before for before, after in itertools.pairwise(ticks)] == [1, 1]


def test_a_breakpoint_holds_a_skill_before_it_starts() -> None:
    runner, cell, events = make(
        TURN, {60: lambda runner, _cell: runner.resume(runner.pause_number, "ada")}
    )
    second = [path for path in runner.tree.behaviours if "Turn" in path][1]
    runner.break_at(second)
    result = runner.run()
    assert result.outcome == "success"
    assert states(events) == ["running", "pausing", "paused", "running", "succeeded"]
    assert cell.wheel.log.count("start") == 2


def test_a_breakpoint_before_a_skill_stops_a_run_before_it_has_started() -> None:
    runner, cell, _events = make(TURN, {60: lambda runner, _cell: runner.stop("ada")})
    second = [path for path in runner.tree.behaviours if "Turn" in path][1]
    runner.break_at(second)
    assert runner.run().outcome == "stopped"
    assert cell.wheel.log.count("start") == 1


def test_a_breakpoint_after_a_skill_holds_before_the_next_one_starts() -> None:
    runner, cell, events = make(
        TURN, {60: lambda runner, _cell: runner.resume(runner.pause_number, "ada")}
    )
    first = next(path for path in runner.tree.behaviours if "Turn" in path)
    runner.break_at(first, "after", who="ada")
    result = runner.run()
    assert result.outcome == "success"
    held = next(e for e in events if isinstance(e, StateChanged) and e.state == "pausing")
    assert held.because == f"breakpoint after {first}"
    ended = next(
        e
        for e in events
        if isinstance(e, NodeChanged) and e.path == first and e.status == "SUCCESS"
    )
    assert events.index(ended) < events.index(held)
    started = [
        e for e in events if isinstance(e, NodeChanged) and e.path != first and e.starts == 1
    ]
    assert all(events.index(held) < events.index(e) for e in started)
    assert cell.wheel.log.count("start") == 2


def test_a_breakpoint_taken_away_holds_nothing() -> None:
    runner, _cell, events = make(TURN)
    first = next(path for path in runner.tree.behaviours if "Turn" in path)
    for on in (True, False):
        runner.break_at(first, "after", on)
    assert runner.run().outcome == "success"
    assert "paused" not in states(events)


def test_a_breakpoint_at_no_node_of_the_tree_is_refused() -> None:
    runner, _cell, _events = make(TURN)
    with pytest.raises(UnknownNodeError, match="no node turn/Trun"):
        runner.break_at("turn/Trun")


def test_a_fault_while_a_breakpoint_holds_ends_in_the_safe_state() -> None:
    runner, cell, _events = make(
        TURN, {60: lambda runner, _cell: runner.safe_stop("enough", "ada")}
    )
    runner.break_at(next(path for path in runner.tree.behaviours if "Turn" in path), "after")
    assert runner.run().outcome == "stopped"
    assert cell.latched == "enough"
    assert cell.wheel.log.count("start") == 1


def test_computing_takes_no_simulated_time() -> None:
    runner, cell, _events = make(
        'pomona: 1\ntree: t\nroot:\n  sequence:\n    - Square: {y: "{y}"}\n'
    )
    result = runner.run()
    assert result.outcome == "success"
    assert cell.clock.now() == 0.0


@pytest.mark.parametrize("quick", [True, False])
def test_however_quick_computations_are_the_run_is_the_same(
    quick: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    submit = Computations.submit

    def submit_and_wait(self: Computations, *arguments: Any) -> Any:
        computation = submit(self, *arguments)
        if quick:
            computation.result()  # it has ended before anybody asks
        return computation

    monkeypatch.setattr(Computations, "submit", submit_and_wait)
    squares = "".join(f"    - Square: {{y: '{{y{k}}}'}}\n" for k in range(10))
    runner, cell, _events = make(f"pomona: 1\ntree: t\nroot:\n  sequence:\n{squares}")
    result = runner.run()
    assert result.outcome == "success"
    assert result.ticks == 11
    assert cell.clock.now() == 0.0


def test_ctrl_c_is_a_safe_stop_and_is_reported_as_one() -> None:
    def interrupt(_runner: Runner, _cell: FakeCell) -> None:
        raise KeyboardInterrupt

    runner, cell, events = make(TURN, {4: interrupt})
    result = runner.run()
    assert result.interrupted
    assert result.outcome == "stopped"
    assert cell.latched == "interrupted from the keyboard"
    assert isinstance(events[-1], RunEnded)


def test_ctrl_c_from_a_signals_handler_ends_the_run_before_the_next_tick() -> None:
    runner, cell, events = make(TURN, {4: lambda runner, _cell: runner.interrupt()})
    result = runner.run()
    assert result.interrupted
    assert result.outcome == "stopped"
    assert cell.latched == "interrupted from the keyboard"
    assert [(e.who, e.action) for e in events if isinstance(e, OperatorActed)] == [
        ("keyboard", "interrupt")
    ]
    assert max(e.tick for e in events) == 3


def test_a_skill_that_never_lets_go_is_a_fault() -> None:
    class Stubborn(Skill):
        """Never ends."""

        def run(self) -> Work:
            while True:
                try:
                    yield None
                except Interrupted:
                    continue

    registry = Registry({"Stubborn": Stubborn})
    text = "pomona: 1\ntree: t\nroot:\n  sequence:\n    - Stubborn: {}\n"
    runner, cell, _events = make(text, {3: lambda runner, _cell: runner.stop("ada")}, registry)
    result = runner.run()
    assert result.outcome == "error"
    assert runner.state is RunState.FAULTED
    assert cell.latched is not None


def outcomes() -> Iterator[str]:
    for _ in range(2):
        runner, _cell, events = make(TURN)
        runner.run()
        yield repr([(e.t, e.tick, type(e).__name__) for e in events])


def test_two_runs_give_the_same_events() -> None:
    first, second = outcomes()
    assert first == second


def latched_run(*acts: Callable[[Runner], Any]) -> tuple[FakeCell, list[Event]]:
    """Return a run that was safe-stopped, and the requests while it holds its latched state."""
    runner, cell, events = make(
        TURN, {4: lambda runner, _cell: runner.safe_stop("hand in the cell", "ada")}
    )
    runner.run()
    for act in acts:
        act(runner)
    runner.hold_latched()
    return cell, events


def test_the_safe_state_is_held_until_somebody_acknowledges_its_reason() -> None:
    cell, events = latched_run(
        lambda runner: runner.pause("eve"), lambda runner: runner.acknowledge("ben")
    )
    assert cell.latched is None
    last = events[-1]
    assert isinstance(last, OperatorActed)
    assert (last.who, last.action, last.detail) == ("ben", "acknowledge", "hand in the cell")


def test_an_acknowledgement_that_a_device_refuses_is_reported_and_the_safe_state_stays() -> None:
    runner, cell, events = make(
        TURN, {4: lambda runner, _cell: runner.safe_stop("hand in the cell", "ada")}
    )
    runner.run()
    acknowledge, tries = cell.acknowledge, iter((True, False))

    def refused_first() -> None:
        if next(tries):
            raise ConnectionError("the wheel is still lost")
        acknowledge()

    cell.acknowledge = refused_first  # type: ignore[method-assign]
    runner.acknowledge("ben")
    runner.acknowledge("ben")
    runner.hold_latched()
    assert cell.latched is None
    told = [event for event in events if isinstance(event, ErrorRaised)]
    assert [(error.during, error.message) for error in told] == [
        ("the acknowledgement", "the wheel is still lost")
    ]


def test_a_fault_of_a_simulated_cell_can_be_cleared_in_the_safe_state() -> None:
    switch = FaultSwitch()
    switch.fault = "lost"

    def latched_with_fault(runner: Runner, cell: FakeCell) -> None:
        cell.switches["wheel"] = switch
        runner.safe_stop("the wheel is lost")

    runner, cell, _events = make(TURN, {4: latched_with_fault})
    runner.run()
    runner.fail("wheel", "")
    runner.acknowledge("ben")
    runner.hold_latched()
    assert switch.fault is None
    assert cell.latched is None


def test_the_process_may_end_without_an_acknowledgement() -> None:
    cell, _events = latched_run(lambda runner: runner.leave())
    assert cell.latched == "hand in the cell"


def test_leaving_is_remembered_when_it_is_asked_for_during_the_run() -> None:
    def leave(runner: Runner, _cell: FakeCell) -> None:
        runner.safe_stop("the end", "ada")
        runner.leave()

    runner, cell, _events = make(TURN, {4: leave})
    runner.run()
    runner.hold_latched()
    assert cell.latched == "the end"
