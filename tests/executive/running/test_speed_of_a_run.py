"""Speed of the arm: settings of the operator, the tree and the skill, and the time from which each applies."""

from __future__ import annotations

from typing import Any

import pytest
from fake_cell import FakeCell, Wheel
from fake_runs import TURN, Turn, make

from pomona.executive.errors import UsageError
from pomona.executive.language import build, read
from pomona.executive.registry import Registry
from pomona.executive.running.events import Event, NodeChanged, OperatorActed
from pomona.executive.running.requests import LATE
from pomona.executive.running.runner import Runner
from pomona.executive.running.tick import EventStream
from pomona.executive.speed import SpeedRefusedError


class Feel(Turn):
    """Turn at a speed of its own."""

    own_speed = True


REGISTRY = Registry({"Turn": Turn, "Feel": Feel})
EACH = """
pomona: 1
tree: each
parameters:
  slow: {type: ratio, default: 20 %}
root:
  sequence:
    - Turn: {duration: 20 ms}
    - sequence:
        - Turn: {duration: 20 ms}
          speed: "{slow}"
        - part: {}
        - Feel: {duration: 20 ms}
      speed: 50 %
    - Turn: {duration: 20 ms}
subtrees:
  part:
    root:
      Turn: {duration: 20 ms}
"""


def given(cell: FakeCell) -> list[float]:
    """The speeds that the wheel's owners were given."""
    return [round(speed, 6) for speed, of in cell.speeds if of == (Wheel,)]


def acts(events: list[Event]) -> list[tuple[str, str, str]]:
    return [
        (event.who, event.action, event.detail)
        for event in events
        if isinstance(event, OperatorActed)
    ]


def runner_of(text: str, cell: FakeCell, **options: Any) -> Runner:
    document = read(text, "tree.yaml")
    return Runner(
        lambda context, board: build(document, REGISTRY, context=context, board=board),
        cell,
        EventStream(),
        **options,
    )


def test_a_tree_slows_its_parts_and_one_in_another_multiply() -> None:
    runner, cell, _events = make(EACH, REGISTRY)
    assert runner.run().outcome == "success"
    assert given(cell) == [1.0, 0.1, 0.5, 1.0, 1.0]


def test_the_operators_share_multiplies_the_trees_but_not_a_motion_with_its_own_speed() -> None:
    cell = FakeCell()
    assert runner_of(EACH, cell, speed=0.5).run().outcome == "success"
    assert cell.speeds[0] == (0.5, ())
    assert given(cell) == [0.5, 0.05, 0.25, 1.0, 0.5]


def test_a_change_counts_at_once_also_for_a_moving_device() -> None:
    runner, cell, events = make(
        TURN, REGISTRY, {3: lambda runner, _cell: runner.set_speed(0.3, "ada")}
    )
    assert runner.run().outcome == "success"
    assert given(cell) == [1.0, 0.3, 0.3]  # the first turn, the same turn again, the second
    assert acts(events) == [("ada", "speed", "30 %")]


@pytest.mark.parametrize("speed", [0.0, 0.05, 1.5, float("nan")])
def test_an_invalid_speed_is_refused_and_changes_nothing(speed: float) -> None:
    def ask(runner: Runner, _cell: FakeCell) -> None:
        with pytest.raises(SpeedRefusedError, match="10 % to 100 %"):
            runner.set_speed(speed)

    runner, cell, events = make(TURN, REGISTRY, {3: ask})
    assert runner.run().outcome == "success"
    assert given(cell) == [1.0, 1.0]
    assert acts(events) == []


def test_a_speed_that_a_tree_computes_wrongly_fails_the_node_before_anything_moves() -> None:
    computed = EACH.replace(
        'speed: "{slow}"', 'speed: "{slow} * retry.attempt / 10"\n          retry: 2'
    )
    runner, cell, _events = make(computed, REGISTRY)
    result = runner.run()
    assert result.reason is not None
    assert "10 % to 100 %, not 4 %" in str(list(result.reason.leaves())[-1].message)
    assert cell.wheel.log == ["start", "stop"]  # the turn before


def test_a_late_request_for_more_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tick that hung may be over without supervision; less speed is never too late."""

    def ask(runner: Runner, _cell: FakeCell) -> None:
        runner._speeds.put((0.2, "ada", -10.0 * LATE))
        runner._speeds.put((0.9, "ada", -10.0 * LATE))

    runner, cell, events = make(TURN, REGISTRY, {3: ask})
    runner.run()
    assert [act[1] for act in acts(events)] == ["speed", "too_late"]
    assert given(cell)[-1] == 0.2


def test_the_speeds_of_a_run_are_repeated_at_its_moments() -> None:
    changes = {
        3: lambda runner, _cell: runner.set_speed(0.3, "ada"),
        7: lambda runner, _cell: runner.set_speed(1.0),
    }
    runner, cell, events = make(TURN, REGISTRY, changes)
    runner.run()
    again, cell_again = EventStream(), FakeCell()
    events_again: list[Event] = []
    again.subscribe(events_again.append)
    document = read(TURN, "tree.yaml")
    repeated = Runner(
        lambda context, board: build(document, REGISTRY, context=context, board=board),
        cell_again,
        again,
        speeds=[event for event in events if isinstance(event, OperatorActed)],
    )
    repeated.run()
    kept = (OperatorActed, NodeChanged)
    assert [e for e in events_again if isinstance(e, kept)] == [
        e for e in events if isinstance(e, kept)
    ]
    assert cell_again.speeds == cell.speeds


def test_an_arm_that_cannot_go_slower_is_refused_wherever_less_is_asked_for() -> None:
    class Fixed(FakeCell):
        full_speed_only = ("arm",)

    cell = Fixed()
    with pytest.raises(UsageError, match="arm: the driver cannot move it more slowly"):
        runner_of(TURN, cell, speed=0.5)
    with pytest.raises(UsageError, match="arm"):
        runner_of(EACH, cell)
    runner = runner_of(TURN, cell)
    with pytest.raises(SpeedRefusedError, match="arm"):
        runner.set_speed(0.5)
    assert cell.wheel.log == []
