"""Many processes on this machine."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any
from weakref import WeakKeyDictionary

from pomona.executive.errors import UsageError
from pomona.executive.running.compute import Worker
from pomona.tools.library.campaign.engine import (
    ONE_THREAD,
    RENEWED_AFTER,
    TRIES,
    Engine,
    OrderLost,
    OrderTooLong,
    one_per_core,
)


@dataclass(slots=True)
class _Running:
    worker: Worker
    index: int
    tries: int
    ends: float


class LocalEngine:
    """Worker processes that stay warm from one order to the next, and give way to fresh ones after some."""

    def __init__(self, workers: int, renewed_after: int = RENEWED_AFTER) -> None:
        self.workers, self._renewed_after = workers, renewed_after
        self._idle: list[Worker] = []
        self._done: WeakKeyDictionary[Worker, int] = WeakKeyDictionary()
        self._busy: dict[Any, _Running] = {}

    def map(
        self, function: Callable[..., Any], orders: Sequence[tuple[Any, ...]], limit: float
    ) -> Iterator[tuple[int, Any]]:
        """See `Engine.map`."""
        queue = [(index, 1) for index in reversed(range(len(orders)))]
        try:
            while queue or self._busy:
                while queue and len(self._busy) < self.workers:
                    index, tries = queue.pop()
                    self._start(function, orders[index], index, tries, limit)
                nearest = min(running.ends for running in self._busy.values())
                for connection in wait(
                    list(self._busy), timeout=max(0.0, nearest - time.monotonic())
                ):
                    running = self._busy.pop(connection)
                    try:
                        _succeeded, answer = running.worker.connection.recv()
                    except (EOFError, OSError):
                        code = self._bury(running.worker)
                        if running.tries < TRIES:
                            queue.append((running.index, running.tries + 1))
                        else:
                            yield (
                                running.index,
                                OrderLost(f"its process died {TRIES} times (exit code {code})"),
                            )
                    else:
                        self._rest(running.worker)
                        yield running.index, answer
                late = [
                    running for running in self._busy.values() if running.ends <= time.monotonic()
                ]
                for running in late:
                    del self._busy[running.worker.connection]
                _end(late)
                for running in late:
                    yield running.index, OrderTooLong(f"not done within {limit:.0f} s")
        finally:
            busy = list(self._busy.values())
            self._busy.clear()
            _end(busy)

    def close(self) -> None:
        """End the processes."""
        for worker in self._idle:
            worker.kill()
        self._idle.clear()

    def _start(
        self,
        function: Callable[..., Any],
        order: tuple[Any, ...],
        index: int,
        tries: int,
        limit: float,
    ) -> None:
        worker = self._idle.pop() if self._idle else _spawn()
        worker.connection.send((function, order))
        self._busy[worker.connection] = _Running(worker, index, tries, time.monotonic() + limit)

    def _rest(self, worker: Worker) -> None:
        self._done[worker] = self._done.get(worker, 0) + 1
        if self._done[worker] < self._renewed_after:
            self._idle.append(worker)
        else:
            worker.kill()

    @staticmethod
    def _bury(worker: Worker) -> int | None:
        worker.process.join(5.0)
        code = worker.process.exitcode
        worker.kill()
        return code


def _end(busy: Sequence[_Running]) -> None:
    """End workers in the middle of an order: a run is first given the time to reach its safe state."""
    try:
        for running in busy:
            running.worker.tell_to_end()
        # seconds that an order's process has to end its run in the safe state before it is killed
        end = time.monotonic() + 5.0
        for running in busy:
            running.worker.process.join(max(0.0, end - time.monotonic()))
    finally:
        for running in busy:
            running.worker.kill()


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


@contextmanager
def open_local(workers: int | None, address: str | None) -> Iterator[Engine]:
    """The engine `local`. Raises UsageError: an address, which local processes have not."""
    if address is not None:
        raise UsageError("--address is for --engine ray; local processes have none")
    engine = LocalEngine(workers or one_per_core())
    try:
        yield engine
    finally:
        engine.close()
