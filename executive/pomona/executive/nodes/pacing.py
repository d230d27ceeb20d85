"""Modifiers of time: delay, rate, run_once, timeout, and speed of the arm."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import replace

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.context import (
    CheckContext,
    OutcomeContext,
)
from pomona.executive.nodes.facts import Outcome
from pomona.executive.nodes.node_type import Modifier
from pomona.executive.ports import RATE, Port
from pomona.executive.reasons import NoValue, path_of
from pomona.executive.skill import Skill
from pomona.executive.speed import SHARE, SpeedRefusedError, checked_speed


class Timed(Wrapper):
    """A wrapper with a duration or a rate, on the run's clock."""

    def __init__(
        self, name: str, child: Behaviour, value: Callable[[], float], now: Callable[[], float]
    ) -> None:
        super().__init__(name, child)
        self._value = value
        self._now = now


class Late(Timed):
    """Delays its child's start until a moment on the run's clock. Subclasses choose the moment (`due`)."""

    _due = 0.0
    _started = False

    @abstractmethod
    def due(self) -> float:
        """When the child may start, asked at each start; may raise NoValue."""

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.why = None
            self._started = False
            try:
                self._due = self.due()
            except NoValue as missing:
                self.stop(self.fails("BAD_VALUE", str(missing)))
                yield self
                return
        left = self._due - self._now()
        if not self._started and left > 1e-9:
            self.feedback_message = f"starts in {left:.1f} s"
            self.status = Status.RUNNING
            yield self
            return
        self._started = True
        self.feedback_message = ""
        yield from self.decorated.tick()
        status = self.decorated.status
        if status is not Status.RUNNING:
            self.ended(status)
            self.stop(status)
        self.status = status
        yield self

    def ended(self, status: Status) -> None:
        """Called when the child has ended or was skipped."""


class Delay(Late):
    """Waits before its child starts."""

    def due(self) -> float:
        return self._now() + self._value()


class Rate(Late):
    """Lets a period pass between a success of its child and the next start; the first start is at once."""

    _success: float | None = None

    def due(self) -> float:
        rate = self._value()
        if rate <= 0.0:
            raise NoValue(f"{self.name}: the rate is {rate:g} Hz, it must be above 0")
        since = self._success
        self._success = None
        return self._now() if since is None else since + 1.0 / rate

    def ended(self, status: Status) -> None:
        self._success = self._now() if status is Status.SUCCESS else None

    def stop(self, new_status: Status) -> None:
        if new_status is Status.INVALID:
            self._success = None
        super().stop(new_status)


class RunOnce(Wrapper):
    """Runs its child to an end once in a run, and is skipped from then on."""

    def __init__(self, name: str, child: Behaviour) -> None:
        super().__init__(name, child)
        self.remembers = False  # whether it has run to an end

    def begin(self) -> Status | None:
        if self.remembers:
            self.feedback_message = "skipped: it has run already"
            return Status.INVALID
        return None

    def after(self, status: Status) -> Status:
        self.remembers = self.remembers or status is not Status.RUNNING
        return status


class DelayType(Modifier):
    """waits before each start of the node"""

    key = "delay"
    symbol = "◷"
    value = takes.duration("passes before each start of the node")
    other_names = ("Delay",)

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        inside = at.inside()
        delay = at.literal(self.key)
        return replace(inside, least=inside.least + delay) if isinstance(delay, float) else inside

    makes = Delay
    gives = ("value", "now")


class RateType(Modifier):
    """limits the rate of starts: after a success, the next start waits until the rate allows it"""

    key = "rate"
    symbol = "♩"
    value = takes.Value(Port(RATE, min=0.001), "starts a second at most")
    other_names = ("RateController",)

    makes = Rate
    gives = ("value", "now")


class RunOnceType(Modifier):
    """runs to an end once in a run; from then on the node is skipped"""

    key = "run_once"
    symbol = "1"
    value = takes.Value(Port(bool), known=True)
    other_names = ("RunOnce",)
    skips = True

    makes = RunOnce


class Timeout(Timed):
    """Interrupts its child when it still runs after a duration on the run's clock."""

    _limit = 0.0
    _end = 0.0

    def begin(self) -> Status | None:
        self._limit = self._value()
        self._end = self._now() + self._limit
        return None

    def after(self, status: Status) -> Status:
        if status is not Status.RUNNING or self._now() < self._end - 1e-9:
            return status
        tip = self.decorated.tip() or self.decorated
        doing = f": {tip.feedback_message}" if tip.feedback_message else ""
        return self.fails(
            "TIMEOUT",
            f"{tip.name} was still running after {self._limit:g} s{doing}",
            limit=self._limit,
            running=path_of(tip),
            feedback=tip.feedback_message,
        )


class TimeoutType(Modifier):
    """interrupts one try that takes longer; fails with `TIMEOUT`"""

    key = "timeout"
    symbol = "◷"
    value = takes.duration("for each try")
    codes = ("TIMEOUT",)
    faithful = True
    other_names = ("Timeout",)

    def check_layer(self, at: CheckContext) -> None:
        super().check_layer(at)
        limit = at.literal(self.key)
        key = at.node.modifiers[self.key][0]
        if not isinstance(limit, float):
            return
        least = at.outcomes.inside().least
        if limit == 0.0:
            message = "a timeout of 0 s interrupts everything that does not end in its first tick"
            at.findings.warning(key, "too-short", message)
        elif least > limit:
            message = f"{at.node.label} takes {least:g} s at least and is always interrupted after {limit:g} s"
            at.findings.warning(key, "too-short", message)

    makes = Timeout
    gives = ("value", "now")


class Slower(Wrapper):
    """Gives the skills below it a share of the speed at which they move the arm, looked up at each start."""

    def __init__(self, name: str, child: Behaviour, share: Callable[[], float]) -> None:
        super().__init__(name, child)
        self._share = share
        self._now = 1.0
        for behaviour in child.iterate():
            if isinstance(behaviour, Skill):
                behaviour.slowed_by.append(lambda: self._now)

    def begin(self) -> Status | None:
        try:
            self._now = checked_speed(self._share())
        except SpeedRefusedError as error:
            raise NoValue(f"{self.name}: {error}") from None
        return None


class SpeedType(Modifier):
    """moves the arm inside at a ratio of its speed, from 10 % to 100 %; nested speeds multiply"""

    key = "speed"
    symbol = "»"
    value = takes.Value(SHARE, "share of the speed that the skills command")

    makes = Slower
    gives = ("value",)
