"""The operator's desk: who holds control, and what is done with it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from executive.errors import PomonaError
from executive.runner import Runner

ACTIONS = ("pause", "resume", "step", "stop", "break", "unbreak")


class RefusedError(PomonaError):
    """An action that is not carried out, and why."""


@dataclass(frozen=True, slots=True)
class Held:
    """Who holds control now; empty when nobody does."""

    who: str
    viewer: str


class Desk:
    """One operator at a time acts; anybody may safe-stop. Methods may be called from any thread."""

    def __init__(self, changed: Callable[[], None] = lambda: None) -> None:
        self._lock = threading.Lock()
        self._held = Held("", "")
        self._runner: Runner | None = None
        self._changed = changed

    @property
    def holder(self) -> Held:
        return self._held

    @property
    def runner(self) -> Runner | None:
        return self._runner

    def serve(self, runner: Runner | None) -> None:
        """Act on this runner from now on."""
        self._runner = runner

    def take(self, viewer: str, who: str) -> None:
        """Take control; it is taken visibly, also from somebody else."""
        with self._lock:
            self._held = Held(who, viewer)
        self._changed()

    def release(self, viewer: str) -> None:
        """Give control back; harmless for a viewer that does not hold it."""
        with self._lock:
            if self._held.viewer != viewer:
                return
            self._held = Held("", "")
        self._changed()

    def safe_stop(self, who: str) -> None:
        """Stop now. Nobody needs control for this.

        Raises:
            RefusedError: nothing runs.
        """
        if self._runner is None:
            raise RefusedError("nothing is running")
        self._runner.safe_stop(f"safe stop by {who}", who)

    def act(self, viewer: str, action: str, detail: str = "") -> None:
        """Pass an action to the runner.

        Raises:
            RefusedError: the viewer does not hold control, nothing runs, or there is no such action.
        """
        if self._held.viewer != viewer:
            holder = self._held.who or "nobody"
            raise RefusedError(f"{holder} holds control; take it first")
        if self._runner is None or self._runner.state.ended:
            raise RefusedError("nothing is running")
        if action not in ACTIONS:
            raise RefusedError(f"'{action}' is no action")
        who = self._held.who
        if action in ("break", "unbreak"):
            self._runner.break_at(detail, action == "break", who)
        else:
            getattr(self._runner, action)(who)
