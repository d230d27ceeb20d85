"""Devices have one owner below the skills: commands from anywhere else are refused, named and recorded."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from fake_cell import FakeCell, Wheel
from fake_runs import Turn, make

from pomona.executive.registry import Registry
from pomona.executive.running.compute import Computations
from pomona.executive.running.events import (
    ErrorRaised,
    Event,
    RunEnded,
    RunStarted,
    SafeStopped,
    StateChanged,
)
from pomona.executive.running.tick import RunContext
from pomona.executive.skill import Skill, Work
from pomona.tools.dashboard.explain import explain

TREE = "pomona: 1\ntree: t\nroot: {sequence: [{Lurk: {}}, {wait: 100 ms}]}"


class Lurk(Skill):
    """Leaves a thread behind that commands the wheel whenever it is let."""

    devices = (Wheel,)
    go: Callable[[], None]
    refused: list[BaseException]

    def run(self) -> Work[None]:
        wheel = self.device(Wheel)

        def go() -> None:
            def command() -> None:
                try:
                    wheel.start()
                except BaseException as error:
                    Lurk.refused.append(error)

            thread = threading.Thread(target=command)
            thread.start()
            thread.join()

        Lurk.go, Lurk.refused = staticmethod(go), []
        yield None


REGISTRY = Registry({"Lurk": Lurk, "Turn": Turn})


def refusals(events: list[Event]) -> list[ErrorRaised]:
    return [
        event
        for event in events
        if isinstance(event, ErrorRaised) and event.error == "NotOwnerError"
    ]


def test_a_thread_that_outlives_its_skill_commands_nothing_and_is_named() -> None:
    def command(_runner: object, _cell: FakeCell) -> None:
        for _ in range(3):
            Lurk.go()

    runner, cell, events = make(TREE, REGISTRY, {5: command})
    result = runner.run()
    assert result.outcome == "success"
    assert cell.wheel.log == []
    assert len(Lurk.refused) == 3
    (told,) = refusals(events)
    assert "/Lurk" in told.node
    assert told.during == "a refused command"
    assert told.message.endswith(
        "refused to command 'start' of the wheel: the skill has ended; nothing has moved"
    )
    assert "test_leases.py" in told.place
    assert "in command" in told.place
    nodes = tuple(info.facts() for info in runner.tree.nodes)
    started = RunStarted(
        0.0, 0, "r", "t", "t", "", "", "c", "mock", "", "", 0, {}, nodes, {}, 0.0, 0.02
    )
    assert "of Lurk, NotOwnerError was raised in" in "\n".join(explain([started, *events]))


def test_a_thread_that_outlives_the_last_skill_begins_no_motion_behind_the_end() -> None:
    runner, cell, events = make(TREE, REGISTRY)
    settled = cell.settled

    def last_look() -> bool:
        at_rest = settled()
        if runner.tree.root.status.name == "SUCCESS":
            Lurk.go()
        return at_rest

    cell.settled = last_look  # type: ignore[method-assign]
    assert runner.run().outcome == "success"
    assert not cell.wheel.turning
    assert refusals(events)


@contextmanager
def moving_after_the_end(cell: FakeCell) -> Iterator[None]:
    """Start a motion without a command as soon as the run has found everything at rest."""
    settled, looks = cell.settled, [0]

    def look() -> bool:
        at_rest = settled()
        looks[0] += 1
        if looks[0] == 1:
            cell.wheel.start()
        return at_rest

    cell.settled = look  # type: ignore[method-assign]
    yield


@pytest.mark.parametrize("end", ["wait: 40 ms", "fail: {}"])
def test_a_motion_that_begins_behind_the_end_ends_the_run_in_the_safe_state(end: str) -> None:
    runner, cell, events = make(f"pomona: 1\ntree: t\nroot: {{{end}}}", REGISTRY)
    with moving_after_the_end(cell):
        result = runner.run()
    assert result.outcome == "error"
    assert result.reason is not None
    expected = "something began to move after the end of the tree, when all was at rest"
    assert result.reason.message == cell.latched == expected
    assert not cell.wheel.turning
    assert [event.state for event in events if isinstance(event, StateChanged)][-1] == "faulted"
    assert [event.outcome for event in events if isinstance(event, RunEnded)] == ["error"]
    assert any(isinstance(event, SafeStopped) for event in events)


def test_a_skill_that_commands_a_device_that_it_only_reads_ends_the_run_in_the_safe_state() -> None:
    class Look(Skill):
        """Declares no motion."""

        devices = (Wheel,)
        moves = ()

        def run(self) -> Work[None]:
            self.device(Wheel).start()
            yield None

    runner, cell, events = make("pomona: 1\ntree: t\nroot: {Look: {}}", Registry({"Look": Look}))
    result = runner.run()
    assert result.outcome == "error"
    assert result.reason is not None
    assert result.reason.code == "NotOwnerError"
    assert "may only look at the Wheel" in result.reason.message
    assert cell.wheel.log == []
    assert len(refusals(events)) == 1


def test_a_device_has_one_owner_under_all_its_names() -> None:
    class Spin:
        """Another interface of the wheel."""

    class Spins(Skill):
        devices = (Spin,)

        def run(self) -> Work[None]:
            yield None

    cell = FakeCell()
    cell.wheel.interfaces = (Wheel, Spin)
    computations = Computations()
    context = RunContext(cell, computations, 0, lambda *_: None)
    first, second = Turn("First"), Spins("Second")
    assert context.acquire(first) is None
    assert context.acquire(second) == "waiting for First, which uses the Spin"
    context.release(first)
    assert context.acquire(second) is None
    assert set(context.owners) == {Wheel, Spin}
    computations.close()
