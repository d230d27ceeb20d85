"""Nodes that look at values: check, wait_until, guard, when."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from executive.nodes.leaves import Leaf
from executive.nodes.wrapper import Wrapper
from executive.reasons import NoValue


class Condition:
    """An expression with the values that it reads, for the sentence that says why it is false."""

    def __init__(
        self, text: str, holds: Callable[[], bool], read: Mapping[str, Callable[[], object]] | None = None
    ) -> None:
        self.text, self.holds, self._read = text, holds, dict(read or {})

    def values(self) -> dict[str, object]:
        """What the expression reads, as it is now."""
        found: dict[str, object] = {}
        for name, get in self._read.items():
            try:
                value = get()
            except NoValue:
                continue
            found[name] = value if isinstance(value, (bool, int, float, str)) or value is None else str(value)[:80]
        return found

    def sentence(self) -> str:
        """`{width} > 0.05 is false: width is 0.03`."""
        shown = ", ".join(
            f"{n} is {v:.6g}" if isinstance(v, float) else f"{n} is {v}" for n, v in self.values().items()
        )
        return f"{self.text} is false" + (f": {shown}" if shown else "")


class Check(Leaf):
    """Succeeds when its condition holds, fails otherwise."""

    def __init__(self, name: str, condition: Condition) -> None:
        super().__init__(name)
        self._condition = condition

    def act(self) -> Status:
        if self._condition.holds():
            return Status.SUCCESS
        return self.fails("CONDITION_FALSE", self._condition.sentence(), **self._condition.values())


class WaitUntil(Leaf):
    """Runs until its condition holds."""

    def __init__(self, name: str, condition: Condition) -> None:
        super().__init__(name)
        self._condition = condition

    def act(self) -> Status:
        if self._condition.holds():
            return Status.SUCCESS
        self.feedback_message = f"waiting until {self._condition.text}"
        return Status.RUNNING


class Guard(Wrapper):
    """Looks at its condition before every tick of its child; when it does not hold, interrupts the child and fails."""

    def __init__(self, name: str, child: Behaviour, condition: Condition) -> None:
        super().__init__(name, child)
        self._condition = condition

    def tick(self) -> Iterator[Behaviour]:
        try:
            holds = self._condition.holds()
        except NoValue as missing:
            self.stop(self.fails("BAD_VALUE", str(missing)))
            yield self
            return
        if holds:
            yield from super().tick()
            return
        self.stop(self.fails("CONDITION_FALSE", self._condition.sentence(), **self._condition.values()))
        yield self


class When(Wrapper):
    """Looks at its condition at its start; when it does not hold, the child is skipped.

    Args:
        skipped: how a skipped node ends, so that its parent goes on as if it were not there.
    """

    def __init__(self, name: str, child: Behaviour, condition: Condition, skipped: Status) -> None:
        super().__init__(name, child)
        self._condition, self._skipped = condition, skipped

    def begin(self) -> Status | None:
        if self._condition.holds():
            return None
        self.fails("SKIPPED", f"skipped: {self._condition.sentence()}", **self._condition.values())
        return self._skipped

    @property
    def was_skipped(self) -> bool:
        """Whether the newest start skipped the child."""
        return self.why is not None and self.why.code == "SKIPPED"
