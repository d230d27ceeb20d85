"""A node around one child, and the simple ones of its kind: timeout, invert, force, subtree."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.decorators import Decorator

from executive.reasons import NoValue, Reason, from_causes, path_of, reason_of


class Wrapper(Decorator):
    """A decorator that knows why it failed. Subclasses override `begin` and `after`."""

    path = ""

    def __init__(self, name: str, child: Behaviour) -> None:
        super().__init__(name, child)
        self.why: Reason | None = None

    def begin(self) -> Status | None:
        """Called at each start, before the child's first tick; a status ends the node without ticking the child.

        Raises:
            NoValue: a value that the node needs is not there; the node fails.
        """
        return None

    def after(self, status: Status) -> Status:
        """The node's own status, given its child's."""
        return Status.FAILURE if status is Status.INVALID else status

    def fails(self, code: str, message: str, *causes: Reason, **data: object) -> Status:
        """Note why the node fails."""
        self.why = Reason(path_of(self), code, message, data, causes)
        self.feedback_message = message
        return Status.FAILURE

    def explain(self) -> Reason:
        """Why the node failed."""
        return self.why or from_causes(self, (reason_of(self.decorated),))

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.why = None
            self.feedback_message = ""
            try:
                ended = self.begin()
            except NoValue as missing:
                ended = self.fails("BAD_VALUE", str(missing))
            if ended is not None:
                self.stop(ended)
                yield self
                return
        yield from self.decorated.tick()
        status = self.after(self.decorated.status)
        if status is not Status.RUNNING:
            self.stop(status)
        self.status = status
        yield self

    def stop(self, new_status: Status) -> None:
        child = self.decorated
        if child.status is Status.RUNNING or (new_status is Status.INVALID and child.status is not Status.INVALID):
            child.stop(Status.INVALID)
        self.terminate(new_status)
        self.status = new_status

    def update(self) -> Status:
        return self.after(self.decorated.status)


class Timeout(Wrapper):
    """Interrupts its child when it still runs after a duration on the run's clock."""

    def __init__(self, name: str, child: Behaviour, duration: Callable[[], float], now: Callable[[], float]) -> None:
        super().__init__(name, child)
        self._duration, self._now = duration, now
        self._limit = self._end = 0.0

    def begin(self) -> Status | None:
        self._limit = self._duration()
        self._end = self._now() + self._limit
        return None

    def after(self, status: Status) -> Status:
        if status is not Status.RUNNING or self._now() < self._end - 1e-9:
            return super().after(status)
        tip = self.decorated.tip() or self.decorated
        doing = f": {tip.feedback_message}" if tip.feedback_message else ""
        message = f"{tip.name} was still running after {self._limit:g} s{doing}"
        return self.fails("TIMEOUT", message, limit=self._limit, running=path_of(tip), feedback=tip.feedback_message)


class Invert(Wrapper):
    """Succeeds when its child fails, and fails when it succeeds."""

    def after(self, status: Status) -> Status:
        if status is Status.SUCCESS:
            return self.fails("INVERTED", f"{self.decorated.name} succeeded, which counts as a failure here")
        return Status.RUNNING if status is Status.RUNNING else Status.SUCCESS


class Force(Wrapper):
    """Ends with one status whatever its child says."""

    def __init__(self, name: str, child: Behaviour, end: Literal["success", "failure"]) -> None:
        super().__init__(name, child)
        self._end = end

    def after(self, status: Status) -> Status:
        if status is Status.RUNNING:
            return status
        if self._end == "success":
            return Status.SUCCESS
        if status is Status.SUCCESS:
            return self.fails("FORCED", f"{self.decorated.name} succeeded, which counts as a failure here")
        return Status.FAILURE


class Subtree(Wrapper):
    """The frame around a subtree."""
