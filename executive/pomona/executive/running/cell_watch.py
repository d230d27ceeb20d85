"""Monitors the cell in every tick: faults, links, and other services that a run requires."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

from pomona.executive.cell.cell import Cell
from pomona.executive.errors import PomonaError
from pomona.executive.running.watching import Watch


class SafeStopRequestedError(PomonaError):
    """The run must end in the safe state, for the reason in the text."""

    code: ClassVar[str] = "SAFE_STOP"


class InterruptRequestedError(SafeStopRequestedError):
    """The operator has requested the end of the run from the keyboard."""

    code = "INTERRUPTED"


class CellWatch:
    """Polls each device and each registered service; reports changes."""

    def __init__(
        self, cell: Cell, linked: Callable[[str, str], None], felt: Callable[[str], None], watch: Watch
    ) -> None:
        """
        Args:
            cell: connected.
            linked: called with (device, state) when a link's state has changed.
            felt: called with the contact between the fingers, when it has changed.
            watch: shows the appearance of the cell.
        """
        self._cell, self._linked, self._felt, self._watch = cell, linked, felt, watch
        self._hand: str | None = None
        self._links: dict[str, str] = {}
        self._others: dict[str, tuple[Callable[[], str], bool]] = {}

    @property
    def last_seen(self) -> Mapping[str, float]:
        """When each device was last seen [s], as of the last look."""
        return self._watch.last_seen

    def look_after(self, name: str, state: Callable[[], str], *, required: bool) -> None:
        """Monitor a service beside the cell's devices; `state` returns 'ok', or the problem."""
        self._others[name] = (state, required)

    def look(self) -> None:
        """Once a tick.

        Raises:
            SafeStopRequestedError: the safe state is latched, or something that is required is lost.
            Exception: of a device that is lost or reports a fault, as `Cell.check` raises it.
        """
        for device, state in self._cell.links().items():
            self._note(device, state)  # before a lost one ends the run: who looks must know that it does not answer
        wanting = ""
        for name, (ask, required) in self._others.items():
            state = ask()
            self._note(name, state)
            if required and state != "ok":
                wanting = wanting or state
        if wanting:  # reported before the devices' faults: a run that stalled has received none of their data
            raise SafeStopRequestedError(wanting)
        self._cell.check()
        if self._cell.latched is not None:
            raise SafeStopRequestedError(self._cell.latched)
        hand = self._cell.in_hand()
        if hand is not None and hand != self._hand:
            self._hand = hand
            self._felt(hand)
        self._watch.look()

    def _note(self, name: str, state: str) -> None:
        if self._links.get(name) != state:
            self._links[name] = state
            self._linked(name, state)
