"""Blackboard of one run: stamped values, exchanged between nodes, accessed by the tick thread only."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from pomona.executive.clock import Clock
from pomona.executive.errors import PomonaError
from pomona.executive.values.read_only import shared


@dataclass(frozen=True, slots=True)
class Entry:
    """A value on the board: when it was written (run's clock [s] and tick) and by which node."""

    value: Any
    time: float
    tick: int
    writer: str


class WrongThread(PomonaError):
    """Something other than the tick thread wrote to the board."""

    def __init__(self, key: str) -> None:
        self.key = key
        super().__init__(
            f"'{key}' was written outside the tick thread; only nodes write to the board, in their tick"
        )


WriteListener = Callable[[str, Entry], None]


class Board:
    """Values by absolute key: `/measured` in the tree's own scope, `/perceive/detection` in a subtree's."""

    def __init__(self, clock: Clock) -> None:
        self.tick = 0
        self._clock = clock
        self._entries: dict[str, Entry] = {}
        self._listeners: list[WriteListener] = []
        self._owner: int | None = None

    @property
    def entries(self) -> Mapping[str, Entry]:
        """A live, read-only view."""
        return MappingProxyType(self._entries)

    def adopt(self) -> None:
        """From now on only the calling thread may write."""
        self._owner = threading.get_ident()

    def subscribe(self, listener: WriteListener) -> None:
        """`listener(key, entry)` is called in the tick, after each write."""
        self._listeners.append(listener)

    def write(self, key: str, value: Any, writer: str) -> None:
        """Set a value, which nothing can change then; the tick thread alone may, once it has adopted the board.

        Raises WrongThread: another thread writes.
        """
        if self._owner is not None and threading.get_ident() != self._owner:
            raise WrongThread(key)
        entry = Entry(shared(value), self._clock.now(), self.tick, writer)
        self._entries[key] = entry
        for listener in self._listeners:
            listener(key, entry)

    def get(self, key: str) -> Entry | None:
        """Return the newest entry, or None when nothing was written yet."""
        return self._entries.get(key)
