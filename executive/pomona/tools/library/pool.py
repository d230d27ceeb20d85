"""Worker processes of this machine: runs of campaigns, trials of cures and rendered training frames go through them.

with closing(WorkerPool(2)) as pool:
    for index, answer in pool.map(render, [(0,), (1,), (2,)], 60.0):
        …
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any
from weakref import WeakKeyDictionary

from pomona.executive.errors import PomonaError
from pomona.executive.running.compute import Worker

TRIES = 2  # number of processes that try an order; an order whose processes all die is given up

# orders of a worker before a fresh one: simulators leave some 25 MB behind each run
RENEWED_AFTER = 40

ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "LP_NUM_THREADS",
    ),
    "1",
) | {"OPENCV_FOR_THREADS_NUM": "1"}
"""Environment of a worker. Workers fill the cores; threads inside them would only wait for each other, and sums that
several threads share out depend on how many there are."""


class OrderLost(PomonaError):
    """The process of an order died, in every try."""

    code = "WORKER_DIED"


class OrderTooLong(PomonaError):
    """An order took longer than it may; its process was killed."""

    code = "TIMEOUT"


@dataclass(frozen=True, slots=True)
class _Busy:
    key: Any
    worker: Worker
    ends: float
    limit: float


class WorkerPool:
    """Worker processes that stay warm from one order to the next, and give way to fresh ones after some."""

    def __init__(
        self, workers: int | None = None, renewed_after: int = RENEWED_AFTER, grace: float = 5.0
    ) -> None:
        """
        Args:
            workers: how many orders are computed at once; None for one per core.
            renewed_after: orders of a worker before a fresh one.
            grace: time that an order given up has to end its run in the safe state before its process is killed [s].
        """
        self.workers = workers or one_per_core()
        self._renewed_after = renewed_after
        self._grace = grace
        self._idle: list[Worker] = []
        self._done: WeakKeyDictionary[Worker, int] = WeakKeyDictionary()
        self._busy: dict[Any, _Busy] = {}

    @property
    def free(self) -> bool:
        """Whether one more order can be started."""
        return len(self._busy) < self.workers

    def start(
        self, key: Hashable, function: Callable[..., Any], order: tuple[Any, ...], limit: float
    ) -> None:
        """Compute `function(*order)` in a worker; it is given up after `limit` seconds.

        Args:
            function: importable by its name.
            order: arguments, all of which can be pickled.
        """
        worker = self._idle.pop() if self._idle else _spawn()
        worker.connection.send((function, order))
        self._busy[worker.connection] = _Busy(key, worker, time.monotonic() + limit, limit)

    def ended(self) -> Iterator[tuple[Any, Any]]:
        """Wait for the next ends; yields nothing when none is in progress.

        Yields:
            an order's key and its result; in place of a result the exception that it raised, OrderLost or
            OrderTooLong. One order never stops the rest.
        """
        if not self._busy:
            return
        nearest = min(busy.ends for busy in self._busy.values())
        for connection in wait(list(self._busy), timeout=max(0.0, nearest - time.monotonic())):
            busy = self._busy.pop(connection)
            try:
                _succeeded, answer = busy.worker.connection.recv()
            except (EOFError, OSError):
                busy.worker.process.join(5.0)
                code = busy.worker.process.exitcode
                busy.worker.kill()
                answer = OrderLost(f"its process died (exit code {code})")
            else:
                self._rest(busy.worker)
            yield busy.key, answer
        late = [busy for busy in self._busy.values() if busy.ends <= time.monotonic()]
        self._end(late)
        for busy in late:
            yield busy.key, OrderTooLong(f"not done within {busy.limit:.0f} s")

    def map(
        self, function: Callable[..., Any], orders: Sequence[tuple[Any, ...]], limit: float
    ) -> Iterator[tuple[int, Any]]:
        """Compute `function(*order)` of every order; one whose process dies is tried once more.

        Yields:
            the order's index, and its result or exception as in `ended`, as they end.
        """
        queue = [(index, 1) for index in reversed(range(len(orders)))]
        try:
            while queue or self._busy:
                while queue and self.free:
                    index, tries = queue.pop()
                    self.start((index, tries), function, orders[index], limit)
                for (index, tries), answer in self.ended():
                    if isinstance(answer, OrderLost) and tries < TRIES:
                        queue.append((index, tries + 1))
                    else:
                        yield index, answer
        finally:
            self.give_up()

    def give_up(self) -> None:
        """End the orders in progress, without a result."""
        self._end(list(self._busy.values()))

    def close(self) -> None:
        """End all processes."""
        self.give_up()
        for worker in self._idle:
            worker.kill()
        self._idle.clear()

    def _rest(self, worker: Worker) -> None:
        self._done[worker] = self._done.get(worker, 0) + 1
        if self._done[worker] < self._renewed_after:
            self._idle.append(worker)
        else:
            worker.kill()

    def _end(self, late: Sequence[_Busy]) -> None:
        """End workers in the middle of an order: a run is first given the time to reach its safe state."""
        for busy in late:
            del self._busy[busy.worker.connection]
        try:
            for busy in late:
                busy.worker.tell_to_end()
            end = time.monotonic() + self._grace
            for busy in late:
                busy.worker.process.join(max(0.0, end - time.monotonic()))
        finally:
            for busy in late:
                busy.worker.kill()


def one_per_core() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _spawn() -> Worker:
    """Return a worker in the environment of one thread; this process keeps its own."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        return Worker(runs=True)
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
