"""Breakpoints: a tick is held in its middle, exactly before a node starts or after it has ended.

A py_trees tick is a generator that hands over every node as soon as it has been ticked, before its parent goes on. A
node with a breakpoint also hands over a `HeldTick`; the caller that iterates the tick stops there, and later continues
the same iteration. Nothing else in the tree has moved meanwhile: no sibling was started, none was interrupted. Nodes
without a breakpoint pay nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.errors import PomonaError
from pomona.executive.language.built import Side

BREAK_ACTIONS: dict[str, tuple[Side, bool]] = {
    "break": ("before", True),
    "unbreak": ("before", False),
    "break_after": ("after", True),
    "unbreak_after": ("after", False),
}
"""Breakpoint actions of an operator, by the name of the action in events and in the live stream."""


class UnknownNodeError(PomonaError):
    """A breakpoint at a node that the tree does not have."""

    def __init__(self, path: str) -> None:
        self.path = path
        super().__init__(f"the tree has no node {path}")


@dataclass(frozen=True, slots=True)
class HeldTick:
    """Where a tick is held."""

    path: str
    side: Side


class Breakpoints:
    """The breakpoints of one tree, and the tick that one of them holds."""

    def __init__(self, behaviours: Mapping[str, Behaviour]) -> None:
        """
        Args:
            behaviours: the tree's nodes by path.
        """
        self._behaviours = behaviours
        self._set: dict[Side, set[str]] = {"before": set(), "after": set()}
        self._patched: set[str] = set()
        self._walk: Iterator[Any] | None = None

    def check(self, path: str) -> None:
        """Raises UnknownNodeError: there is no such node."""
        if path not in self._behaviours:
            raise UnknownNodeError(path)

    def change(self, path: str, side: Side, on: bool) -> None:
        """Set or clear one. Raises UnknownNodeError: there is no such node."""
        self.check(path)
        if not on:
            self._set[side].discard(path)
            return
        self._set[side].add(path)
        if path not in self._patched:
            self._patched.add(path)
            behaviour = self._behaviours[path]
            # In the instance, so that its class and all other nodes stay as they are.
            vars(behaviour)["tick"] = self._stopping(path, behaviour, behaviour.tick)

    @property
    def holding(self) -> bool:
        """Whether a tick is held."""
        return self._walk is not None

    def tick(self, root: Behaviour, visited: Callable[[Behaviour], object] = id) -> HeldTick | None:
        """Tick the tree once, or go on with the tick that is held, up to the next breakpoint.

        Args:
            root: the tree's root.
            visited: gets each behaviour right after its tick.

        Returns:
            where the tick is held; None when it is complete.
        """
        walk = self._walk if self._walk is not None else root.tick()
        self._walk = None
        for node in walk:
            if type(node) is HeldTick:
                self._walk = walk
                return node
            visited(node)
        return None

    def drop(self) -> None:
        """Forget the tick that is held; the caller stops the tree."""
        self._walk = None

    def _stopping(
        self, path: str, behaviour: Behaviour, tick: Callable[[], Iterator[Behaviour]]
    ) -> Callable[[], Iterator[Any]]:
        def walk() -> Iterator[Any]:
            if behaviour.status is not Status.RUNNING and path in self._set["before"]:
                behaviour.feedback_message = "held by a breakpoint"
                yield HeldTick(path, "before")
            yield from tick()
            if behaviour.status is not Status.RUNNING and path in self._set["after"]:
                yield HeldTick(path, "after")

        return walk
