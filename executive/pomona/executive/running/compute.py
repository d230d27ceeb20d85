"""Work beside the tick: a thread for code that releases the GIL, a process for code that does not.

An isolated computation runs in one spawned worker process that stays warm between calls; cancelling it kills the
worker, so a late planner ends at once. On a simulated clock the runner waits for computations before time moves on,
which makes a run independent of how fast the machine is.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import copy_context
from multiprocessing.connection import Connection
from typing import Any

from pomona.executive.errors import PomonaError
from pomona.executive.running.traces import keep_place, place_of, traceback_of
from pomona.executive.values.processes import WORDS
from pomona.executive.values.sentences import sentence_of

COMPUTING = "pomona-compute"  # prefix of the names of the threads


class WorkerDied(PomonaError):
    """The process of an isolated computation ended without an answer."""

    def __init__(self, function: str, exit_code: int | None) -> None:
        self.function = function
        self.exit_code = exit_code
        super().__init__(f"the process computing {function} died (exit code {exit_code})")


def _give_way() -> None:
    """Lower this thread's priority: the tick and the control loops come first when processors are scarce."""
    if (
        sys.platform == "linux"
    ):  # elsewhere a niceness belongs to the whole process, the tick included
        # of computations, beside 0 of the tick. On two busy processors the tick was up to 14 ms late without it.
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 10)


class _Threaded:
    """A computation in a thread. Python cannot stop a thread: cancelling abandons its result."""

    def __init__(self, future: Future[Any]) -> None:
        self._future = future

    def done(self) -> bool:
        return self._future.done()

    def result(self) -> Any:
        return self._future.result()

    def cancel(self) -> None:
        self._future.cancel()


def _serve(connection: Connection, runs: bool) -> None:
    """The worker's loop: receive (function, arguments), send (True, result) or (False, exception).

    The parent handles signals that the terminal or the system sends to the process group. With `runs`, the computed run
    handles SIGTERM: it ends in its safe state.
    """
    _give_way()
    for number in WORDS:
        if not (runs and number == signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
    threading.Thread(
        target=_end_with_parent, args=(runs,), name="pomona-parent", daemon=True
    ).start()
    while True:
        try:
            function, arguments = connection.recv()
        except (EOFError, OSError):
            return
        try:
            answer = (True, function(*arguments))
        except BaseException as error:  # SystemExit, too: it is the caller's to judge
            answer = (False, _portable(error))
        try:
            connection.send(answer)
        except OSError:  # the parent is gone
            return
        except Exception as error:  # an answer that cannot be pickled
            connection.send((False, RuntimeError(f"the result cannot be sent back: {error}")))


def _end_with_parent(runs: bool) -> None:
    """End a worker whose parent was killed: its result is not needed, and it must not hold a device."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    parent.join()
    if runs:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(
            15.0
        )  # seconds that a run has to end in its safe state when the process that wanted it is gone
    os._exit(1)


def _portable(error: BaseException) -> BaseException:
    """Return the same exception with its traceback as a note, or an equivalent one if it cannot be pickled."""
    trace = "in the worker process:\n" + traceback_of(error)
    place = place_of(error)
    try:
        error.add_note(trace)
        keep_place(error, place)
        pickle.loads(pickle.dumps(error))
    except (
        Exception
    ):  # its class takes other arguments than its message, or holds objects that cannot be pickled
        error = RuntimeError(f"{type(error).__name__}: {sentence_of(error)}")
        error.add_note(trace)
        keep_place(error, place)
    return error


class Worker:
    """One spawned process that computes one thing at a time.

    With `runs` it computes whole runs: it may have processes of its own, and on a request to end it ends a run in its
    safe state.
    """

    def __init__(self, runs: bool = False) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.connection, there = spawn.Pipe()
        self.process = spawn.Process(
            target=_serve, args=(there, runs), daemon=not runs, name="pomona-worker"
        )
        self.process.start()
        there.close()

    def tell_to_end(self) -> None:
        """Request the end of its computation: a run ends in its safe state. `kill` must follow after a while."""
        self.process.terminate()
        self.connection.close()

    def kill(self) -> None:
        """End the process at once."""
        self.process.kill()
        self.process.join()
        self.connection.close()


class _Isolated:
    """A computation in a worker process."""

    def __init__(
        self, worker: Worker, function: str, release: Callable[[Worker | None], None]
    ) -> None:
        self._worker = worker
        self._function = function
        self._release = release
        self._answer: tuple[bool, Any] | None = None

    def done(self) -> bool:
        if self._answer is None and self._worker.connection.poll():
            try:
                self._answer = self._worker.connection.recv()
                self._release(self._worker)
            except (EOFError, OSError):
                self._worker.process.join(1.0)
                self._answer = (False, WorkerDied(self._function, self._worker.process.exitcode))
                self._release(None)
        return self._answer is not None

    def result(self) -> Any:
        while not self.done():
            self._worker.connection.poll(0.1)
        assert self._answer is not None
        succeeded, value = self._answer
        if not succeeded:
            raise value
        return value

    def cancel(self) -> None:
        if self._answer is None:
            self._worker.kill()
            self._answer = (False, WorkerDied(self._function, None))
            self._release(None)


_spare: list[Worker] | None = None


def keep_workers_warm() -> None:
    """Keep this process's workers for its next run: it does many, and starting a worker takes longer than a pick."""
    global _spare
    if _spare is None:
        _spare = []
        # they ignore the signal with which Python ends them at its exit, and it would wait for ever
        atexit.register(lambda kept: list(map(Worker.kill, kept)), _spare)


class Computations:
    """All work of a run that goes on beside its tick."""

    def __init__(
        self, on_done: Callable[[str, str, float], None] = lambda _node, _function, _wall: None
    ) -> None:
        self._threads = ThreadPoolExecutor(
            max_workers=2, thread_name_prefix=COMPUTING, initializer=_give_way
        )
        self._idle: list[Worker] = []
        self._pending: list[tuple[str, str, float, _Threaded | _Isolated]] = []
        self._on_done = on_done
        self._lock = threading.Lock()

    def submit(
        self, node: str, function: Callable[..., Any], arguments: tuple[Any, ...], isolated: bool
    ) -> Any:
        """Start a computation.

        Returns:
            an `pomona.executive.skill.Computation`.
        """
        name = f"{function.__module__}.{function.__qualname__}"
        computation: _Threaded | _Isolated
        if isolated:
            worker = self._take()
            worker.connection.send((function, arguments))
            computation = _Isolated(worker, name, self._give_back)
        else:
            computation = _Threaded(self._threads.submit(copy_context().run, function, *arguments))
        self._pending.append((node, name, time.perf_counter(), computation))
        return computation

    @property
    def started(self) -> bool:
        """Whether anything was started that `pending` has not yet reported as ended."""
        return bool(self._pending)

    def pending(self) -> bool:
        """Return True while a computation runs; report those that have ended since the last call."""
        still = []
        for entry in self._pending:
            node, name, started, computation = entry
            if computation.done():
                self._on_done(node, name, time.perf_counter() - started)
            else:
                still.append(entry)
        self._pending = still
        return bool(still)

    def wait(self, timeout: float) -> bool:
        """Wait for all that runs; False when the time was not enough."""
        end = time.perf_counter() + timeout
        while self.pending():
            left = end - time.perf_counter()
            if left <= 0.0:
                return False
            time.sleep(min(0.0005, left))
        return True

    def close(self) -> None:
        for _node, _name, _started, computation in self._pending:
            computation.cancel()
        self._pending.clear()
        self._threads.shutdown(wait=False, cancel_futures=True)
        with self._lock:
            for worker in self._idle:
                if _spare is None:
                    worker.kill()
                else:
                    _spare.append(worker)
            self._idle.clear()

    def _take(self) -> Worker:
        with self._lock:
            for kept in (self._idle, _spare or []):
                while kept:
                    worker = kept.pop()
                    if worker.process.is_alive():
                        return worker
                    worker.kill()
        return Worker()

    def _give_back(self, worker: Worker | None) -> None:
        if worker is not None:
            with self._lock:
                self._idle.append(worker)
