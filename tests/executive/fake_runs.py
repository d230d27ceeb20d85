"""Runs on a fake cell: a skill that turns its wheel, and a runner whose looks at the cell can be scripted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from fake_cell import FakeCell, Wheel

from pomona.executive.language import BuiltTree, build, read
from pomona.executive.language.changes import Takeover
from pomona.executive.ports import Outputs, Time
from pomona.executive.registry import Registry
from pomona.executive.running.events import Event, Listener
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import RunState
from pomona.executive.running.tick import EventStream
from pomona.executive.skill import Interrupted, Skill, Work


class Turned(Outputs):
    turned: float


class Turn(Skill):
    """Turn the wheel for a while."""

    devices = (Wheel,)
    failures = ("JAMMED",)

    def run(self, duration: Time = 0.2) -> Work[Turned]:
        wheel = self.device(Wheel)
        wheel.start()
        try:
            yield from self.wait(duration)
        except Interrupted:
            wheel.stop()
            while wheel.coasting:
                yield "coasting"
            wheel.log.append("at rest")
            raise
        wheel.stop()
        return Turned(duration)


TURN = """
pomona: 1
tree: turn
root:
  sequence:
    - Turn: {duration: 200 ms, turned: "{a}"}
    - Turn: {duration: 200 ms, turned: "{b}"}
"""


def make(
    text: str,
    registry: Registry,
    at_tick: dict[int, Callable[[Runner, FakeCell], Any]] | None = None,
    *,
    attended: bool = False,
    go_on: bool = False,
    listeners: Sequence[Listener] = (),
    reread: Callable[[], str] = lambda: "",
    takeover: Callable[..., Takeover] | None = None,
) -> tuple[Runner, FakeCell, list[Event]]:
    """A runner on a fake cell. `at_tick` acts at the start of the n-th look at the cell, paused ones counted too.

    `go_on` resumes whenever the run is paused; `takeover` takes the changed file over, whose text `reread` returns.
    """
    cell, events, received = FakeCell(), EventStream(), []
    for listener in (received.append, *listeners):
        events.subscribe(listener)

    def built(text: str, context: Any, board: Any, around: Any = ()) -> BuiltTree:
        return build(read(text, "tree.yaml"), registry, context=context, board=board, around=around)

    def take_over(context: Any, board: Any, running: BuiltTree, held: str) -> Takeover:
        assert takeover is not None
        return takeover(running, held, lambda around: built(reread(), context, board, around))

    runner = Runner(
        lambda context, board: built(text, context, board),
        cell,
        events,
        attended=attended,
        take_over=None if takeover is None else take_over,
    )
    looks = iter(range(1, 10_000))
    check = cell.check

    def scripted_check() -> None:
        action = (at_tick or {}).get(next(looks))
        if action is not None:
            action(runner, cell)
        if go_on and runner.state is RunState.PAUSED:
            runner.resume(runner.pause_number)
        check()

    cell.check = scripted_check  # type: ignore[method-assign]
    return runner, cell, received
