"""A run that is being prepared: where that stands, and the wish that it does not begin."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from pomona.executive.errors import PomonaError
from pomona.executive.running.permit import Permit
from pomona.executive.running.requests import Requests


class StartCancelledError(PomonaError):
    """The operator stopped a run before it began."""


@dataclass(frozen=True, slots=True)
class StartingStage:
    """The current stage; `done` of `of` equal steps, if they can be counted."""

    what: str = "waiting"
    done: int = 0
    of: int = 0


class Starting:
    """From the order to the first tick. `execute` reports to it; anybody may cancel, from any thread."""

    def __init__(self, changed: Callable[[], None] = lambda: None, permit: Permit | None = None) -> None:
        """
        Args:
            changed: called after each change.
            permit: needed to begin, where another process may withdraw it.
        """
        self._changed, self._permit = changed, permit
        if permit is not None:
            permit.issue()
        self._lock = threading.Lock()
        self._run: Requests | None = None
        self._cancelled: tuple[str, str] | None = None
        self._leaving = False
        self._began = time.monotonic()
        self.stage: StartingStage | None = StartingStage()
        """The current stage of preparation, or None: the run is active."""
        self.cell_kind = ""

    @property
    def age(self) -> float:
        """Seconds since it was ordered."""
        return time.monotonic() - self._began

    @property
    def cancelled(self) -> str:
        """Why it must not begin, or nothing."""
        return self._cancelled[0] if self._cancelled is not None else ""

    def reach(self, what: str, done: int = 0, of: int = 0) -> None:
        """Report the next stage."""
        if self.stage is None and self._permit is not None:  # the run after a recovery, which has used its permit up
            self._permit.issue()
        self.stage = StartingStage(what, done, of)
        self._changed()

    def begin(self) -> None:
        """The run is active: its events report its progress. Without a permit it ends before its first tick."""
        if self._permit is not None and not self._permit.take():
            self.cancel("safe stop on the page during the preparation", "operator")
        self.stage = None
        self._changed()

    def refuse_cancelled(self) -> None:
        """Go no further once it was cancelled. Raises StartCancelledError: it was."""
        if self._cancelled is not None:
            raise StartCancelledError(self.cancelled)

    def attach(self, run: Requests) -> None:
        """Accept stop requests for a run with a cell from now on; apply an earlier request at once."""
        with self._lock:
            self._run = run
            cancelled, leaving = self._cancelled, self._leaving
        if cancelled is not None:
            run.safe_stop(*cancelled)
        if leaving:
            run.leave()

    def cancel(self, reason: str, who: str) -> None:
        """The run must not begin. A cell that is connected goes into its safe state now."""
        with self._lock:
            self._cancelled = self._cancelled or (reason, who)
            run = self._run
        if run is not None:
            run.safe_stop(reason, who)
        self._changed()

    def abandon(self, reason: str) -> None:
        """End the process: no run begins, an active one is stopped, and its safe state stays unacknowledged."""
        self.cancel(reason, "system")
        with self._lock:
            self._leaving = True
            run = self._run
        if run is not None:
            run.leave()
