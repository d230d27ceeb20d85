"""Monitors the cell in every tick: faults, links, services that a run requires, and views that packages add.

A package names its watcher in the entry point group `pomona.cells` as `watcher`. One is made for every run whose cell
has all the devices that it needs.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import ClassVar, Protocol

from pomona.executive.cell.cell import Cell
from pomona.executive.errors import PomonaError
from pomona.executive.values.installation import entry_points
from pomona.executive.values.processes import warn

logger = logging.getLogger(__name__)

EVERY = 0.1  # seconds of the cell's clock between two looks


class Watcher(Protocol):
    """Looks at devices. Made with a function that gives the cell's device of an interface."""

    def look(self) -> Iterable[tuple[str, object]]:
        """Return the changes, as (topic, view). Called in the tick's thread; must take no longer than a millisecond."""


class Watch:
    """All watchers of one run."""

    def __init__(
        self,
        cell: Cell,
        publish: Callable[[str, str, object], None],
        watchers: Sequence[Watcher],
        tell: Callable[[str, str, BaseException], None] = lambda _node, _during, _error: None,
    ) -> None:
        """
        Args:
            cell: connected.
            publish: called with ("", topic, view) for each change.
            watchers: asked in this order.
            tell: called with ("", the activity, the exception) when one fails.
        """
        self._cell, self._publish, self._watchers, self._tell = cell, publish, list(watchers), tell
        self._next = -math.inf
        self.last_seen: Mapping[
            str, float
        ] = {}  # when each device was last seen [s], as of the last look

    def look(self) -> None:
        """Publish the watchers' views when due. A watcher that fails is not called again: it must not end a run."""
        now = self._cell.clock.now()
        if now < self._next:
            return
        self._next = now + EVERY
        self.last_seen = self._cell.last_seen()
        for watcher in tuple(self._watchers):
            try:
                for topic, view in watcher.look():
                    self._publish("", topic, view)
            except Exception as error:  # of a third party's code
                warn(logger, "%s is not asked again: %s", type(watcher).__name__, error)
                self._watchers.remove(watcher)
                self._tell(
                    "", f"a look of {type(watcher).__name__}, which is not asked again", error
                )


def installed_watchers(cell: Cell) -> list[Watcher]:
    """Return the watchers whose `devices` the cell has; the log reports one that cannot be loaded or created."""
    found: list[Watcher] = []
    for point in entry_points(group="pomona.cells", name="watcher"):
        try:
            kind = point.load()
            if set(kind.devices) <= set(cell.interfaces()):
                found.append(kind(cell.device))
        except Exception as error:  # of a third party's code
            logger.warning("the watcher %s cannot be used: %s", point.name, error)
    return found


class SafeStopRequestedError(PomonaError):
    """The run must end in the safe state, for the reason in the text."""

    code: ClassVar[str] = "SAFE_STOP"


class InterruptRequestedError(SafeStopRequestedError):
    """The operator has requested the end of the run from the keyboard."""

    code = "INTERRUPTED"


class CellWatch:
    """Polls each device and each registered service; reports changes."""

    def __init__(
        self,
        cell: Cell,
        linked: Callable[[str, str], None],
        felt: Callable[[str], None],
        watch: Watch,
    ) -> None:
        """
        Args:
            cell: connected.
            linked: called with (device, state) when a link's state has changed.
            felt: called with the contact between the fingers, when it has changed.
            watch: shows the appearance of the cell.
        """
        self._cell = cell
        self._linked = linked
        self._felt = felt
        self._watch = watch
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
            self._note(
                device, state
            )  # before a lost one ends the run: who looks must know that it does not answer
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
