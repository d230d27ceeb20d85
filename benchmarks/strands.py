"""Drivers' threads as greenlets: a process that emulates devices can then be forked in the middle of a run.

Under virtual time a driver's thread runs only when it is its turn, so that a greenlet in its place does the same, in
the same order. The difference: this cannot find a race.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from greenlet import getcurrent, greenlet

from pomona.devices.emulators import virtual_world
from pomona.devices.emulators.virtual_time import VirtualTime
from pomona.executive.cell import owner


class Strand:
    """Stands in for `pomona.devices.emulators.virtual_time.Turn`."""

    def __init__(self, run: Callable[[], None], time: StrandTime) -> None:
        self.until, self.ready, self.polls = 0.0, (lambda: False), 0
        self._time, self._greenlet = time, greenlet(run)

    def start(self) -> None:
        """Have the first turn with the next step."""
        self._time.turns.append(self)  # type: ignore[arg-type]

    def is_alive(self) -> bool:
        return not self._greenlet.dead

    def join(self, timeout: float | None = None) -> None:
        """As `Turn.join`."""
        end = self._time.now() + (timeout if timeout is not None else 1e9)
        while self.is_alive() and self._time.now() < end:
            self._time.step()

    def give(self) -> None:
        """Let it run until it waits again."""
        before, self._time.running = self._time.running, self
        self._greenlet.parent = getcurrent()
        self._greenlet.switch()
        self._time.running = before
        if not self.is_alive():
            self._time.turns.remove(self)  # type: ignore[arg-type]

    def wait(self) -> None:
        """End this turn."""
        assert self._greenlet.parent is not None
        self._greenlet.parent.switch()


class StrandTime(VirtualTime):
    """Virtual time whose turns are greenlets."""

    running: Strand | None = None

    def thread(self, name: str, run: Callable[[], None]) -> Any:
        return Strand(run, self)

    def turn(self) -> Any:
        return self.running


def use_strands() -> None:
    """From now on, for the whole process."""
    names = {name: getattr(threading, name) for name in ("Event", "RLock", "Thread")}
    setattr(virtual_world, "VirtualTime", StrandTime)  # noqa: B010 - mypy
    setattr(owner, "threading", SimpleNamespace(**names, get_ident=lambda: id(getcurrent())))  # noqa: B010
