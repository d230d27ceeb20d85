"""Leaves without a skill: wait, set, succeed, fail."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from executive.reasons import NoValue, Reason, path_of


class Leaf(Behaviour):
    """A leaf that knows why it failed. Subclasses override `act`, and `begin` if they must."""

    path = ""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.why: Reason | None = None

    def begin(self) -> None:
        """Called at each start; may raise NoValue."""

    def act(self) -> Status:
        """One tick; may raise NoValue."""
        return Status.SUCCESS

    def fails(self, code: str, message: str, **data: object) -> Status:
        """Note why the node fails."""
        self.why = Reason(path_of(self), code, message, data)
        self.feedback_message = message
        return Status.FAILURE

    def explain(self) -> Reason:
        """Why the node failed."""
        return self.why or Reason(path_of(self), "FAILED", f"{self.name} failed")

    def update(self) -> Status:
        return self.act()

    def tick(self) -> Iterator[Behaviour]:
        try:
            if self.status is not Status.RUNNING:
                self.why = None
                self.feedback_message = ""
                self.begin()
            status = self.act()
        except NoValue as missing:
            status = self.fails("BAD_VALUE", str(missing))
        if status is not Status.RUNNING:
            self.stop(status)
        self.status = status
        yield self


class Wait(Leaf):
    """Lets a duration on the run's clock pass."""

    def __init__(self, name: str, duration: Callable[[], float], now: Callable[[], float]) -> None:
        super().__init__(name)
        self._duration, self._now = duration, now
        self._end = 0.0

    def begin(self) -> None:
        self._end = self._now() + self._duration()

    def act(self) -> Status:
        left = self._end - self._now()
        self.feedback_message = f"{max(left, 0.0):.1f} s left"
        return Status.RUNNING if left > 1e-9 else Status.SUCCESS


class SetValues(Leaf):
    """Writes values to the board."""

    def __init__(self, name: str, values: Mapping[str, Callable[[], Any]], write: Callable[[str, Any], None]) -> None:
        super().__init__(name)
        self._values, self._write = dict(values), write

    def act(self) -> Status:
        for name, value in {name: get() for name, get in self._values.items()}.items():
            self._write(name, value)
        return Status.SUCCESS


class Succeed(Leaf):
    """Succeeds at once."""


class Fail(Leaf):
    """Fails at once, with a code and a sentence of the author's choice."""

    def __init__(self, name: str, code: Callable[[], str], message: Callable[[], str]) -> None:
        super().__init__(name)
        self._code, self._message = code, message

    def act(self) -> Status:
        return self.fails(self._code(), self._message() or f"{self.name} fails")
