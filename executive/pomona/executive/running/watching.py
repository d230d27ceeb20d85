"""Watchers: they show the appearance of a cell throughout a run, under any skill.

A package names its watchers in the entry point group `pomona.watchers`. One is made for every run whose cell has all
the devices that it needs.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import entry_points
from typing import Protocol

from pomona.executive.cell.cell import Cell
from pomona.executive.values.processes import warn

logger = logging.getLogger(__name__)

GROUP = "pomona.watchers"
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
        self.last_seen: Mapping[str, float] = {}  # when each device was last seen [s], as of the last look

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
                self._tell("", f"a look of {type(watcher).__name__}, which is not asked again", error)


def installed_watchers(cell: Cell) -> list[Watcher]:
    """Return the watchers whose `devices` the cell has; the log reports one that cannot be loaded or created."""
    found: list[Watcher] = []
    for point in entry_points(group=GROUP):
        try:
            kind = point.load()
            if set(kind.devices) <= set(cell.interfaces()):
                found.append(kind(cell.device))
        except Exception as error:  # of a third party's code
            logger.warning("the watcher %s cannot be used: %s", point.name, error)
    return found
