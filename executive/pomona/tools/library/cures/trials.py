"""Repetitions of a run in other processes, each with its own limit: a crash or a hang ends that repetition alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from pomona.executive.account import disagreement
from pomona.executive.errors import PomonaError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.running.compute import keep_workers_warm
from pomona.tools.library.pool import OrderTooLong, WorkerPool

# the code of a repetition that was given up: nothing is known of its end
OVER_BUDGET = "OVER_BUDGET"
FORCES = (
    "finger_peak_n",
    "peak_force_n",
)  # figures of a world's score that hold the largest force [N]


@dataclass(frozen=True, slots=True)
class Trial:
    """One repetition's result.

    Attributes:
        outcome: success, failure, stopped, error; `unusable` if the run could not start, `lost` if its process died or
            took too long, `false` if the run succeeded and the world's truth contradicts it.
        code, message: why it did not succeed.
        time: on the run's clock [s].
        force: largest force of the world's score [N]; None without one.
        wall: real time [s].
    """

    outcome: str
    code: str = ""
    message: str = ""
    time: float = 0.0
    force: float | None = None
    wall: float = 0.0

    @property
    def succeeded(self) -> bool:
        """Whether the run succeeded and the world's truth agrees."""
        return self.outcome == "success"


def force_of(truth: Any) -> float | None:
    """Return the largest force of a world's score [N]; None if it reports none."""
    figures = truth if isinstance(truth, dict) else {}
    return next(
        (float(figures[name]) for name in FORCES if isinstance(figures.get(name), (int, float))),
        None,
    )


def run_trial(order: RunOrder) -> Trial:
    """Repeat a run in this process."""
    keep_workers_warm()
    begun = time.monotonic()
    try:
        executed = execute(order)
    except PomonaError as error:
        return Trial("unusable", type(error).__name__, str(error).partition("\n")[0])
    told = executed.summary.as_json(None)
    truth = told["truth"]
    reason = told["reason"] or {}
    outcome = told["outcome"]
    code = reason.get("code", "")
    message = reason.get("message", "")
    missed = disagreement(outcome, told["account"], truth)
    if missed and outcome == "success":
        outcome = "false"
        code, _, message = missed.partition(": ")
    return Trial(outcome, code, message, told["time_s"], force_of(truth), time.monotonic() - begun)


class TrialPool:
    """Trials in worker processes: one that takes too long, or whose process dies, is lost alone."""

    def __init__(self, jobs: int | None, work: Callable[[RunOrder], Trial] = run_trial) -> None:
        """
        Args:
            jobs: processes at once; None for one per core.
            work: called with an order in a worker.
        """
        self._pool = WorkerPool(jobs, grace=0.0)
        self._work = work
        self.give_up = self._pool.give_up
        self.close = self._pool.close

    @property
    def free(self) -> bool:
        """Whether one more can be started."""
        return self._pool.free

    def start(self, key: Any, order: RunOrder, limit: float) -> None:
        """Start a repetition, which is given up after `limit` seconds."""
        self._pool.start(key, self._work, (order,), limit)

    def ended(self) -> Iterator[tuple[Any, Trial]]:
        """Wait for the next ends; yields nothing when none is in progress."""
        for key, answer in self._pool.ended():
            yield key, answer if isinstance(answer, Trial) else _lost(answer)


def _lost(error: Exception) -> Trial:
    late = isinstance(error, OrderTooLong)
    code = OVER_BUDGET if late else getattr(error, "code", type(error).__name__)
    return Trial("lost", code, str(error))
