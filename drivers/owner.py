"""One owner for every device: the thread that alone touches its wire and the state that comes from it.

A driver gives its `Owner` two functions and leaves everything that touches the wire to it:

    self._owner = Owner(name, step=self.step, failed=self._lose)
    self._owner.start()                               # from now on the thread calls `step` without end
    self._owner.do(lambda: self._send(request))       # leave a call: it is made between two steps, in order
    self._owner.ask(lambda: self._acknowledge())      # the same, and wait for its result or its error
    self._owner.close()                               # makes the calls that are left, then ends the thread

Other threads read what the owner has published by single assignments of immutable values (a frozen state, a problem),
and never iterate over what it writes. Refusals that must be told at once are judged by the caller on such values, and
again by the call itself when it is made: a safe stop may have come between.

Before `start` and after `close` whoever calls is the owner: calls are made at once, under a lock. So a driver on a
virtual clock needs no thread: its world calls `step`.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from drivers.errors import DeviceLost
from drivers.wire import raise_priority

T = TypeVar("T")

ANSWER = 0.5
"""Deadline of a call that somebody waits for [s of the wall's clock]: steps take a few milliseconds."""
HUNG = 1.0
"""A thread that has made no step for so long serves nobody [s of the wall's clock]; a blocked send takes 50 ms."""


class Owner:
    """Calls `step` again and again, and between the steps what others left to be done.

    What goes wrong in a step or in a call is handed to `failed`, in the owner's thread, whatever it is: a device that
    nobody serves must not look alive. The thread then goes on, so that the driver can open its wire again.
    """

    def __init__(self, device: str, step: Callable[[], None], failed: Callable[[BaseException], None]) -> None:
        self._device, self._step, self._failed = device, step, failed
        self._calls: deque[Callable[[], None]] = deque()
        self._closed = threading.Event()
        self._turning = threading.RLock()  # taken by the owner for each step and call
        self._thread: threading.Thread | None = None
        self._turned_at = time.monotonic()

    def start(self) -> None:
        """Let a thread of its own be the owner."""
        self._closed.clear()
        self._turned_at = time.monotonic()
        self._thread = threading.Thread(target=self._run, name=f"{self._device} owner", daemon=True)
        self._thread.start()

    def do(self, call: Callable[[], None]) -> None:
        """Leave a call for the owner; calls are made in the order in which they were left. Never waits for it."""
        self._calls.append(call)
        if self._is_caller():
            self._make_calls()

    def ask(self, call: Callable[[], T], deadline: float = ANSWER) -> T:
        """Leave a call for the owner and wait for its result.

        Raises:
            DeviceLost: the owner did not come to it within `deadline` [s]; it is not made any more.
            Exception: whatever the call raised.
        """
        answer: Future[T] = Future()

        def make() -> None:
            if answer.set_running_or_notify_cancel():
                try:
                    answer.set_result(call())
                except BaseException as error:
                    answer.set_exception(error)

        self.do(make)
        try:
            return answer.result(deadline)
        except TimeoutError:
            if answer.cancel() or not answer.done():
                raise DeviceLost(self._device, f"its thread did nothing for {deadline:g} s") from None
            return answer.result()

    def check(self) -> None:
        """Look whether the thread still serves the device.

        Raises:
            DeviceLost: it hangs, or has ended by itself.
        """
        thread = self._thread
        if thread is None or self._closed.is_set():
            return
        if not thread.is_alive():
            raise DeviceLost(self._device, "its thread has ended")
        if time.monotonic() - self._turned_at > HUNG:
            raise DeviceLost(self._device, f"its thread hangs for {time.monotonic() - self._turned_at:.1f} s")

    def close(self, deadline: float = 2.0) -> None:
        """Let the present step end, make the calls that are left, and end the thread."""
        self._closed.set()
        thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join(deadline)

    def _is_caller(self) -> bool:
        """Whether the present thread may make calls by itself: it is the owner, or there is no other."""
        thread = self._thread
        return thread is None or not thread.is_alive() or thread is threading.current_thread()

    def _make_calls(self) -> None:
        with self._turning:
            while self._calls:
                try:
                    self._calls.popleft()()
                except Exception as error:
                    self._failed(error)

    def _run(self) -> None:
        raise_priority()
        while not self._closed.is_set():
            self._turned_at = time.monotonic()
            try:
                with self._turning:
                    self._make_calls()
                    self._step()
            except BaseException as error:  # SystemExit of a listener would end the thread without a word
                self._failed(error)
        self._make_calls()
