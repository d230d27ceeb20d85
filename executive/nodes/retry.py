"""Retry: try again, with something done between two tries, and remember why each try failed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Composite

from executive.nodes.in_sight import FailureInSight, RetryCount
from executive.reasons import NoValue, Reason, path_of, reason_of


@dataclass(frozen=True, slots=True)
class Attempt:
    """One try: its number from 1, how it ended and why, and when on the run's clock."""

    number: int
    status: Status
    reason: Reason | None
    started: float
    ended: float


class Retry(Composite):
    """Ticks its first child until it succeeds or all tries are used up; one tick at least for each try.

    The second child, if there is one, runs after each failed try; also after the last one unless `between_only`. When
    it fails itself, the retry fails at once, with both reasons.

    Attributes:
        attempts: the tries of the newest start that have ended.
        total: how many tries there are.
        listener: called with the node and each attempt that ends.
    """

    path = ""

    def __init__(
        self,
        name: str,
        child: Behaviour,
        now: Callable[[], float],
        total: Callable[[], int],
        *,
        count: RetryCount | None = None,
        on_failure: Behaviour | None = None,
        between_only: bool = False,
        retry_if: Callable[[], bool] | None = None,
        in_sight: FailureInSight | None = None,
    ) -> None:
        super().__init__(name, [child] if on_failure is None else [child, on_failure])
        self.attempts: tuple[Attempt, ...] = ()
        self.listener: Callable[[Retry, Attempt], None] | None = None
        self._now, self._total, self._retry_if, self._between_only = now, total, retry_if, between_only
        self._count = count or RetryCount()
        self._in_sight = in_sight or FailureInSight()
        self._recovering = self._last = False
        self._started = 0.0
        self._why: Reason | None = None

    @property
    def total(self) -> int:
        return self._count.of

    def explain(self) -> Reason:
        """Every try's reason, and that of `on_failure` if it failed."""
        if self._why is not None:
            return self._why
        causes = tuple(attempt.reason for attempt in self.attempts if attempt.reason is not None)
        tries = f"all {len(causes)} attempts failed" if len(causes) > 1 else "the attempt failed"
        if len(causes) < self.total:
            tries = f"gave up after attempt {len(causes)} of {self.total}"
        data = {"attempts": len(causes), "of": self.total}
        return Reason(path_of(self), causes[-1].code, f"{tries}; the last: {causes[-1].message}", data, causes)

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
        for child in self.children:
            if child.status is not Status.INVALID:
                child.stop(Status.INVALID)
        self.attempts, self._why, self._recovering, self._last = (), None, False, False
        total = self._total()
        if total < 1:
            raise NoValue(f"{self.name}: the number of tries is {total}, it must be at least 1")
        self._count.attempt, self._count.of = 1, total
        self._started = self._now()

    def _next(self) -> None:
        self._count.attempt += 1
        self._started = self._now()

    def _after_try(self, child: Behaviour) -> Status:
        if child.status is Status.RUNNING:
            return Status.RUNNING
        number = self._count.attempt
        succeeded = child.status is Status.SUCCESS
        reason = None if succeeded else reason_of(child)
        attempt = Attempt(number, child.status, reason, self._started, self._now())
        self.attempts += (attempt,)
        self.feedback_message = f"attempt {number} of {self.total} {'succeeded' if succeeded else 'failed'}"
        if self.listener is not None:
            self.listener(self, attempt)
        if reason is None:
            return Status.SUCCESS
        self._in_sight.see(reason)
        self._last = number >= self.total or (self._retry_if is not None and not self._retry_if())
        if len(self.children) > 1 and not (self._last and self._between_only):
            self._recovering = True
            return Status.RUNNING
        return Status.FAILURE if self._last else Status.RUNNING

    def _after_recovery(self, child: Behaviour) -> Status:
        if child.status is Status.RUNNING:
            return Status.RUNNING
        self._recovering = False
        if child.status is Status.SUCCESS:
            return Status.FAILURE if self._last else Status.RUNNING
        broken = reason_of(child)
        tried = tuple(attempt.reason for attempt in self.attempts if attempt.reason is not None)
        message = f"{child.name}, which follows a failed attempt, failed: {broken.message}"
        self._why = Reason(path_of(self), broken.code, message, {"attempts": len(tried)}, (*tried, broken))
        return Status.FAILURE
