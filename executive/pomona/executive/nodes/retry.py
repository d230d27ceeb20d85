"""Second chances: retry tries again, fallback takes the next alternative. Both remember why each one failed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Branch
from pomona.executive.nodes.context import (
    Around,
    BuildContext,
    CheckContext,
    FactContext,
    FlowContext,
    LastFailure,
    OutcomeContext,
    RetryCount,
)
from pomona.executive.nodes.facts import ALL, NO_CODES, Ends, Facts, Names, Outcome, codes_of
from pomona.executive.nodes.node_type import Composite, Modifier
from pomona.executive.reasons import NoValue, Reason, from_causes, path_of, reason_of


@dataclass(frozen=True, slots=True)
class Attempt:
    """One try: its number from 1, how it ended and why, and when on the run's clock."""

    number: int
    status: Status
    reason: Reason | None
    started: float
    ended: float


class Retry(Branch):
    """Ticks its first child until it succeeds or all tries are used up; one tick at least for each try.

    The second child, if there is one, runs after each failed try, also after the last one. When it fails itself, the
    retry fails at once, with both reasons. A try that is skipped skips the retry.

    Attributes:
        attempts: the tries of the newest start that have ended.
        total: how many tries there are.
        listener: called with the node and each attempt that ends.
    """

    def __init__(
        self,
        name: str,
        child: Behaviour,
        now: Callable[[], float],
        total: Callable[[], int],
        *,
        count: RetryCount | None = None,
        on_failure: Behaviour | None = None,
        retry_if: Callable[[], bool] | None = None,
        last_failure: LastFailure | None = None,
    ) -> None:
        super().__init__(name, [child] if on_failure is None else [child, on_failure])
        self.attempts: tuple[Attempt, ...] = ()
        self.listener: Callable[[Retry, Attempt], None] | None = None
        self._now = now
        self._total = total
        self._retry_if = retry_if
        self._count = count or RetryCount()
        self._last_failure = last_failure or LastFailure()
        self._recovering = self._last = False
        self._started = 0.0
        self._why: Reason | None = None

    @property
    def total(self) -> int:
        """How many tries there are."""
        return self._count.of

    def explain(self) -> Reason:
        """Return every try's reason, and that of `on_failure` if it failed."""
        if self._why is not None:
            return self._why
        causes = tuple(attempt.reason for attempt in self.attempts if attempt.reason is not None)
        tries = f"all {len(causes)} attempts failed" if len(causes) > 1 else "the attempt failed"
        if len(causes) < self.total:
            tries = f"gave up after attempt {len(causes)} of {self.total}"
        data = {"attempts": len(causes), "of": self.total}
        return Reason(
            path_of(self), causes[-1].code, f"{tries}; the last: {causes[-1].message}", data, causes
        )

    def tick(self) -> Iterator[Behaviour]:
        try:
            if self.status is not Status.RUNNING:
                self._start()
            elif not self._recovering and self.children[0].status is not Status.RUNNING:
                self._next()
            active = self.children[1 if self._recovering else 0]
            self.current_child = active
            yield from active.tick()
            status = self._after_recovery(active) if self._recovering else self._after_try(active)
        except NoValue as missing:
            self._why = Reason(path_of(self), "BAD_VALUE", str(missing))
            status = Status.FAILURE
        if status is Status.RUNNING:
            self.status = status
        else:
            self.stop(status)
        yield self

    def _start(self) -> None:
        self.reset()
        self.attempts = ()
        self._why = None
        self._recovering = False
        self._last = False
        total = self._total()
        if total < 1:
            raise NoValue(f"{self.name}: the number of tries is {total}, but must be at least 1")
        self._count.attempt, self._count.of = 1, total
        self._started = self._now()

    def _next(self) -> None:
        self._count.attempt += 1
        self._started = self._now()

    def _after_try(self, child: Behaviour) -> Status:
        if child.status is Status.RUNNING or child.status is Status.INVALID:
            return child.status
        number = self._count.attempt
        succeeded = child.status is Status.SUCCESS
        reason = None if succeeded else reason_of(child)
        attempt = Attempt(number, child.status, reason, self._started, self._now())
        self.attempts += (attempt,)
        self.feedback_message = (
            f"attempt {number} of {self.total} {'succeeded' if succeeded else 'failed'}"
        )
        if self.listener is not None:
            self.listener(self, attempt)
        if reason is None:
            return Status.SUCCESS
        self._last_failure.see(reason)
        self._last = number >= self.total or (self._retry_if is not None and not self._retry_if())
        if len(self.children) > 1:
            self._recovering = True
            return Status.RUNNING
        return Status.FAILURE if self._last else Status.RUNNING

    def _after_recovery(self, child: Behaviour) -> Status:
        if child.status is Status.RUNNING:
            return Status.RUNNING
        self._recovering = False
        if child.status is not Status.FAILURE:
            return Status.FAILURE if self._last else Status.RUNNING
        broken = reason_of(child)
        tried = tuple(attempt.reason for attempt in self.attempts if attempt.reason is not None)
        message = f"{child.name}, which follows a failed attempt, failed: {broken.message}"
        self._why = Reason(
            path_of(self), broken.code, message, {"attempts": len(tried)}, (*tried, broken)
        )
        return Status.FAILURE


class RetryType(Modifier):
    """limits the number of tries"""

    key = "retry"
    symbol = "↻"
    value = takes.count("number of tries")
    fields: ClassVar[takes.Fields] = {
        "retry_if": takes.Condition("looked at after a failed try: go on trying?"),
        "on_failure": takes.Part("runs after each failed try, also the last one"),
    }
    late = frozenset({"retry_if"})
    named = False
    other_names = ("RetryUntilSuccessful", "RetryUntilSuccesful")

    def check_layer(self, at: CheckContext) -> None:
        codes = at.outcomes.inside().codes
        if not codes:
            key = at.node.modifiers[self.key][0]
            at.findings.warning(
                key,
                "cannot-fail",
                f"'retry' around {at.node.label}, which cannot fail",
                "leave the retry out",
            )
        written = at.written("retry_if")
        if written is not None:
            at.condition("retry_if", written, self.after(at))
        super().check_layer(at)

    def after(self, at: CheckContext) -> Around:
        """Return the names that `retry_if` and `on_failure` find around them."""
        return replace(self.around(at, 0), failure=at.outcomes.inside().codes, failed=at.node.label)

    def around(self, at: CheckContext, index: int) -> Around:
        if index > 0:
            return self.after(at)
        return replace(at.around, counters=at.around.counters | {"retry"})

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        inside = at.inside()
        after = at.part("on_failure")
        return inside.plus(*after.codes) if inside.codes and after is not None else inside

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        at.require("retry_if", ends.failure)
        recovered = at.part("on_failure", ends.failure)
        return ends if recovered is None else Ends(ends.success, recovered.any(), ends.skipped)

    def build(self, at: BuildContext) -> Behaviour:
        count = RetryCount()
        last_failure = LastFailure()
        retry_if = (
            at.condition("retry_if", retry=count, failure=last_failure).holds
            if at.given("retry_if")
            else None
        )
        child = at.inside(retry=count)
        on_failure = at.part("on_failure", retry=count, failure=last_failure)
        total = at.value(self.key)
        return Retry(
            at.name,
            child,
            at.now,
            total,
            count=count,
            on_failure=on_failure,
            retry_if=retry_if,
            last_failure=last_failure,
        )


class Fallback(Branch):
    """py_trees' selector forgets a child's failure once it has gone on; this one keeps it and shows it to the next.

    Without memory every tick starts again with the first child.
    """

    def __init__(
        self,
        name: str,
        memory: bool,
        children: Sequence[Behaviour],
        last_failure: LastFailure | None = None,
    ) -> None:
        super().__init__(name, children)
        self.memory = memory
        self._at = self._skipped = 0
        self._causes: list[Reason] = []
        self._last_failure = last_failure or LastFailure()

    def explain(self) -> Reason:
        """Return all children's reasons; the code is that of the last one."""
        causes = tuple(self._causes)
        if len(causes) < 2:
            return from_causes(self, causes)
        return Reason(
            path_of(self),
            causes[-1].code,
            f"none of {len(causes)} alternatives succeeded; the last: {causes[-1].message}",
            causes=causes,
        )

    def tick(self) -> Iterator[Behaviour]:
        children = self.children
        if self.status is not Status.RUNNING:
            self.reset()
            self._begin()
        elif not self.memory:
            self._begin()
        for at, child in islice(
            enumerate(children), self._at, None
        ):  # a held tick may find more children
            self.current_child = child
            yield from child.tick()
            status = child.status
            if status is Status.INVALID:
                self._skipped += 1
                continue
            if status is Status.FAILURE:
                reason = reason_of(child)
                self._causes.append(reason)
                self._last_failure.see(reason)
                continue
            self._at = at
            for lower in children[at + 1 :]:
                if lower.status is not Status.INVALID:
                    lower.stop(Status.INVALID)
            if status is Status.SUCCESS:
                self.stop(status)
            else:
                self.status = status
            yield self
            return
        self.stop(Status.INVALID if self._skipped == len(children) else Status.FAILURE)
        yield self

    def _begin(self) -> None:
        self._at = self._skipped = 0
        self._causes.clear()


class FallbackType(Composite):
    """one after the other until one succeeds"""

    key = "fallback"
    symbol = "?"
    value = takes.Children("one after the other until one succeeds")
    other_names: ClassVar[tuple[str, ...]] = ("Fallback", "FallbackStar", "AsyncFallback")
    memory: ClassVar[bool] = True

    def around(self, at: CheckContext, index: int) -> Around:
        if index == 0:
            return at.around
        before = at.outcomes.child(index - 1)
        codes = NO_CODES
        failed = at.node.children[index - 1].label
        if not (before.codes or before.skips):
            at.findings.warning(
                at.node.children[index].key,
                "unreachable",
                f"{at.node.children[index].label} is never reached: {at.node.children[index - 1].label} cannot fail",
            )
        while index and before.skips:
            codes = codes | before.codes
            index = index - 1
            before = (
                at.outcomes.child(index - 1) if index else Outcome(at.around.failure or NO_CODES)
            )
        return Around(at.around.counters, codes | before.codes, at.around.items, failed)

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        outcomes = at.children()
        skips = all(outcome.skips for outcome in outcomes)
        succeeds = any(outcome.succeeds for outcome in outcomes)
        least = min((outcome.least for outcome in outcomes if outcome.succeeds), default=0.0)
        if not all(outcome.codes or outcome.skips for outcome in outcomes):
            return Outcome(succeeds=succeeds, least=least)
        return Outcome(codes_of(outcomes), succeeds, skips, least)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        success = ALL
        failure = ALL
        skipped = before
        for index in range(len(at.node.children)):
            ends = at.child(index, failure & skipped)
            success &= ends.success
            failure = ends.failure & ends.skipped.when(failure)
            skipped = ends.skipped.when(skipped)
        return Ends(success, failure, skipped)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        if not self.memory:
            return super().known_facts(at, known)
        for index in range(len(at.node.children)):
            at.child(index, known)
            known = at.after(index, known)
        return known

    def build(self, at: BuildContext) -> Behaviour:
        last_failure = LastFailure()
        children = [
            at.child(i, failure=last_failure) if i else at.child(i)
            for i in range(len(at.node.children))
        ]
        return Fallback(at.name, self.memory, children, last_failure)


class ReactiveFallbackType(FallbackType):
    """begins again with the first in every tick"""

    key = "reactive_fallback"
    symbol = "⁇"
    value = takes.Children("begins again with the first in every tick")
    other_names = ("ReactiveFallback",)
    memory = False
