"""Repetitions of a run in other processes, each with its own limit: a crash or a hang ends that repetition alone."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any, Protocol

from pomona.executive.errors import PomonaError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.running.compute import Worker, keep_workers_warm
from pomona.tools.library.campaign.engine import ONE_THREAD, RENEWED_AFTER

OVER_BUDGET = (
    "OVER_BUDGET"  # the code of a repetition that was given up: nothing is known of its end
)
FORCES = (
    "finger_peak_n",
    "peak_force_n",
)  # figures of a world's score that hold the largest force [N]


@dataclass(frozen=True, slots=True)
class Trial:
    """One repetition's result.

    Attributes:
        outcome: success, failure, stopped, error; `unusable` if the run could not start, `lost` if its process died or
            took too long, `false` if the tree succeeded and the world's score does not agree.
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
        """Whether the tree succeeded and the world's score agrees."""
        return self.outcome == "success"


def force_of(truth: Any) -> float | None:
    """Return the largest force of a world's score [N]; None if it reports none."""
    figures = truth if isinstance(truth, dict) else {}
    return next(
        (float(figures[name]) for name in FORCES if isinstance(figures.get(name), (int, float))),
        None,
    )


def disagrees(outcome: str | None, truth: Any, conditions: tuple[str, ...]) -> str:
    """Return the first condition of a score that a run did not fulfil though its tree succeeded; else an empty text."""
    if outcome != "success" or not isinstance(truth, dict) or not truth:
        return ""
    return next((name for name in conditions if not truth.get(name)), "")


def run_trial(order: RunOrder, conditions: tuple[str, ...]) -> Trial:
    """Repeat a run in this process. `conditions` of the world's score must hold for a success."""
    keep_workers_warm()
    begun = time.monotonic()
    try:
        executed = execute(order)
    except PomonaError as error:
        return Trial("unusable", type(error).__name__, str(error).partition("\n")[0])
    told = executed.summary.as_json(None)
    truth, reason = told["truth"], told["reason"] or {}
    outcome, code, message = told["outcome"], reason.get("code", ""), reason.get("message", "")
    missed = disagrees(outcome, truth, conditions)
    if missed:
        outcome, code, message = (
            "false",
            "NOT_SCORED",
            f"the tree succeeded, the world's score has '{missed}' not true",
        )
    return Trial(outcome, code, message, told["time_s"], force_of(truth), time.monotonic() - begun)


class TrialRunner(Protocol):
    """Something that computes trials at once, `jobs` of them."""

    @property
    def free(self) -> bool:
        """Whether one more can be started."""

    def start(self, key: Any, order: RunOrder, limit: float) -> None:
        """Start a repetition, which is given up after `limit` seconds."""

    def ended(self) -> Iterator[tuple[Any, Trial]]:
        """Wait for the next ends; yields nothing when none is in progress."""


@dataclass(slots=True)
class _Busy:
    key: Any
    worker: Worker
    ends: float


class TrialPool:
    """Worker processes; one is renewed after some runs, and after a death."""

    def __init__(self, jobs: int, work: Callable[..., Trial], *about: Any) -> None:
        """
        Args:
            jobs: processes at once.
            work: called with an order and `about` in a worker, as `run_trial`.
        """
        self._jobs, self._work, self._about = jobs, work, about
        self._idle: list[Worker] = []
        self._busy: dict[Any, _Busy] = {}
        self._done: dict[int, int] = {}  # runs of each process

    @property
    def free(self) -> bool:
        """Whether one more can be started."""
        return len(self._busy) < self._jobs

    def start(self, key: Any, order: RunOrder, limit: float) -> None:
        """Start a repetition, which is given up after `limit` seconds."""
        worker = self._idle.pop() if self._idle else _spawn()
        worker.connection.send((self._work, (order, *self._about)))
        self._busy[worker.connection] = _Busy(key, worker, time.monotonic() + limit)

    def ended(self) -> Iterator[tuple[Any, Trial]]:
        """Wait for the next ends; yields nothing when none is in progress."""
        if not self._busy:
            return
        nearest = min(busy.ends for busy in self._busy.values())
        for connection in wait(list(self._busy), timeout=max(0.0, nearest - time.monotonic())):
            busy = self._busy.pop(connection)
            try:
                succeeded, answer = busy.worker.connection.recv()
            except (EOFError, OSError):
                busy.worker.kill()
                yield busy.key, Trial("lost", "WORKER_DIED", "the repetition's process died")
                continue
            self._rest(busy.worker)
            yield (
                busy.key,
                answer if succeeded else Trial("lost", type(answer).__name__, str(answer)),
            )
        for busy in [busy for busy in self._busy.values() if busy.ends <= time.monotonic()]:
            del self._busy[busy.worker.connection]
            busy.worker.kill()
            yield (
                busy.key,
                Trial("lost", OVER_BUDGET, "the repetition did not end within the budget"),
            )

    def give_up(self) -> None:
        """End the repetitions in progress, without a result: their runs are simulated, so nothing is left in motion."""
        for busy in self._busy.values():
            busy.worker.kill()
        self._busy.clear()

    def close(self) -> None:
        """End all processes."""
        self.give_up()
        for worker in self._idle:
            worker.kill()
        self._idle.clear()

    def _rest(self, worker: Worker) -> None:
        number = worker.process.pid or 0
        self._done[number] = self._done.get(number, 0) + 1
        if self._done[number] < RENEWED_AFTER:
            self._idle.append(worker)
        else:
            worker.kill()


def _spawn() -> Worker:
    """Return a worker in the environment of one thread: so the sums of a run do not depend on the number of cores."""
    before = dict(os.environ)
    os.environ.update(ONE_THREAD)
    try:
        return Worker(runs=True)
    finally:
        for name in ONE_THREAD:
            if name in before:
                os.environ[name] = before[name]
            else:
                del os.environ[name]
