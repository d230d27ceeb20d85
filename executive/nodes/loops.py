"""Repeat and for-each: the same child again, one round each tick at most."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from executive.nodes.in_sight import ForEachCount, RepeatCount
from executive.nodes.wrapper import Wrapper
from executive.reasons import NoValue


class Repeat(Wrapper):
    """Runs its child until it has succeeded so many times; a failure ends it. None repeats for ever."""

    def __init__(
        self, name: str, child: Behaviour, rounds: Callable[[], int | None], count: RepeatCount | None = None
    ) -> None:
        super().__init__(name, child)
        self._rounds, self._count = rounds, count or RepeatCount()
        self._of: int | None = 1

    def begin(self) -> Status | None:
        self._of = self._rounds()
        if self._of is not None and self._of < 1:
            raise NoValue(f"{self.name}: the number of rounds is {self._of}, it must be at least 1")
        self._count.round = 1
        return None

    def after(self, status: Status) -> Status:
        of = "" if self._of is None else f" of {self._of}"
        self.feedback_message = f"round {self._count.round}{of}"
        if status is Status.SUCCESS and (self._of is None or self._count.round < self._of):
            self._count.round += 1
            return Status.RUNNING
        return super().after(status)


class ForEach(Wrapper):
    """Runs its child once for each item, which it hands to the child by `give`; a failure ends it."""

    def __init__(
        self,
        name: str,
        child: Behaviour,
        items: Callable[[], Sequence[Any]],
        give: Callable[[Any], None],
        count: ForEachCount | None = None,
    ) -> None:
        super().__init__(name, child)
        self._read, self._give, self._count = items, give, count or ForEachCount()
        self._items: tuple[Any, ...] = ()

    def begin(self) -> Status | None:
        try:
            self._items = tuple(self._read())
        except TypeError as error:
            raise NoValue(f"{self.name}: what for_each goes through is no list: {error}") from None
        self._count.index, self._count.of = 1, len(self._items)
        if not self._items:
            return Status.SUCCESS
        self._give(self._items[0])
        return None

    def after(self, status: Status) -> Status:
        self.feedback_message = f"item {self._count.index} of {self._count.of}"
        if status is Status.SUCCESS and self._count.index < self._count.of:
            self._count.index += 1
            self._give(self._items[self._count.index - 1])
            return Status.RUNNING
        return super().after(status)
