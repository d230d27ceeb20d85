"""A tick that is held in its middle: exactly there, nothing else moves, and it goes on as if it had not been held."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given, settings, strategies as st
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes.behaviours import LeafBehaviour as Leaf, Sequence
from pomona.executive.nodes.retry import Fallback
from pomona.executive.running.tick import Breakpoints, HeldTick, Side, UnknownNodeError

SIDES: tuple[Side, ...] = ("before", "after")


class Step(Leaf):
    """Ends with a given status, after some ticks; notes its ticks in a common log."""

    def __init__(
        self, name: str, log: list[str], ticks: int = 1, end: Status = Status.SUCCESS
    ) -> None:
        super().__init__(name)
        self._log, self._ticks, self._end = log, ticks, end
        self._left = 0

    def begin(self) -> None:
        self._left = self._ticks

    def act(self) -> Status:
        self._log.append(self.name)
        self._left -= 1
        return Status.RUNNING if self._left > 0 else self._end


def tree(log: list[str]) -> tuple[Behaviour, dict[str, Behaviour]]:
    """fallback(reactive sequence(a, b fails), sequence(c over two ticks, d))."""
    a, b = Step("a", log), Step("b", log, end=Status.FAILURE)
    c, d = Step("c", log, ticks=2), Step("d", log)
    first, second = Sequence("first", False, [a, b]), Sequence("second", True, [c, d])
    root = Fallback("root", True, [first, second])
    return root, {node.name: node for node in (root, first, a, b, second, c, d)}


def walked(
    breaks: list[tuple[str, Side]], between: Callable[[], None] = lambda: None
) -> tuple[list[str], list[HeldTick]]:
    """The log of a whole run of the tree, and where it was held."""
    log: list[str] = []
    root, nodes = tree(log)
    points, holds = Breakpoints(nodes), []
    for name, side in breaks:
        points.change(name, side, True)
    while root.status not in (Status.SUCCESS, Status.FAILURE) or points.holding:
        held = points.tick(root)
        if held is not None:
            holds.append(held)
            log.append(f"{held.side} {held.path}")
            between()
        assert len(log) < 100
    return log, holds


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["root", "first", "a", "b", "second", "c", "d"]), st.sampled_from(SIDES)
        )
    )
)
@settings(max_examples=100)
def test_holding_changes_nothing_but_when(breaks: list[tuple[str, Side]]) -> None:
    log, holds = walked(breaks)
    assert [entry for entry in log if " " not in entry] == walked([])[0]
    assert {(held.path, held.side) for held in holds} == set(breaks)
    assert len(holds) == len(set(breaks))


@pytest.mark.parametrize(
    ("name", "side", "log"),
    [
        ("a", "before", ["before a", "a", "b", "c", "c", "d"]),
        ("a", "after", ["a", "after a", "b", "c", "c", "d"]),
        ("first", "after", ["a", "b", "after first", "c", "c", "d"]),
        ("second", "before", ["a", "b", "before second", "c", "c", "d"]),
        ("c", "after", ["a", "b", "c", "c", "after c", "d"]),
        ("root", "after", ["a", "b", "c", "c", "d", "after root"]),
    ],
)
def test_it_holds_exactly_there(name: str, side: Side, log: list[str]) -> None:
    assert walked([(name, side)])[0] == log


def test_a_held_node_is_shown_as_held_until_it_starts() -> None:
    log: list[str] = []
    root, nodes = tree(log)
    points = Breakpoints(nodes)
    points.change("a", "before", True)
    assert points.tick(root) == HeldTick("a", "before")
    assert nodes["a"].feedback_message == "held by a breakpoint"
    points.tick(root)
    assert nodes["a"].feedback_message == ""


def test_a_held_tick_that_is_dropped_leaves_a_tree_that_can_be_stopped_and_run_again() -> None:
    log: list[str] = []
    root, nodes = tree(log)
    points = Breakpoints(nodes)
    points.change("c", "after", True)
    while points.tick(root) is None:
        pass
    points.drop()
    root.stop(Status.INVALID)
    assert all(node.status is Status.INVALID for node in nodes.values())
    points.change("c", "after", False)
    log.clear()
    while root.status is not Status.SUCCESS:
        assert points.tick(root) is None
    assert log == walked([])[0]


def test_an_unknown_node_is_named() -> None:
    with pytest.raises(UnknownNodeError, match="no node q"):
        Breakpoints(tree([])[1]).change("q", "before", True)
