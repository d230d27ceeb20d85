"""Looks after the cell in every tick: faults, links, and whatever else a run must not do without."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

from pomona.executive.errors import PomonaError
from pomona.executive.running.cell import Cell
from pomona.executive.running.watching import Watch


class SafeStopRequestedError(PomonaError):
    """The run must end in the safe state, for the reason that this says."""

    code: ClassVar[str] = "SAFE_STOP"


class InterruptRequestedError(SafeStopRequestedError):
    """Somebody at the keyboard wants the run to end."""

    code = "INTERRUPTED"


class CellWatch:
    """Asks each device, and each other thing that was named, how it is; tells what has changed."""

    def __init__(
        self, cell: Cell, linked: Callable[[str, str], None], felt: Callable[[str], None], watch: Watch
    ) -> None:
        """
        Args:
            cell: connected.
            linked: called with (device, state) when a link's state has changed.
            felt: called with what is felt between the fingers, when that has changed.
            watch: shows what the cell looks like.
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
        """Watch something beside the cell's devices, too; `state` says 'ok', or what is wrong."""
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
        if wanting:  # told before what the devices miss: a run that stood still has heard of none of them meanwhile
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
