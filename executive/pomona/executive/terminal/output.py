"""Standard output and standard error of a command that moves a robot: writing to them never waits for their reader.

A pager, a full pipe and a stopped terminal (Ctrl-S) take no text for hours. A thread for each stream writes; the tick
only puts texts into its queue. The output of compiled libraries does not pass here.
"""

from __future__ import annotations

import contextlib
import os
import queue
import select
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any, TextIO, cast

SHORT = 0.02  # wait for the system to take a text [s], so that an error of the stream shows in the call that wrote
MOST = 10_000  # texts that wait for the reader; later ones are left out and counted
ENDING = 10.0  # time that the reader has for the remaining texts when the command has ended [s]


class Output:
    """A stream whose `write` and `flush` return at once."""

    def __init__(self, stream: TextIO) -> None:
        """
        Args:
            stream: an open stream with a file descriptor.
        """
        self._stream, self._file, self._process = stream, stream.fileno(), os.getpid()
        self._waiting: queue.SimpleQueue[bytes | threading.Event] = queue.SimpleQueue()
        self._writing = self._late = False
        self._left_out = 0
        self._error: OSError | None = None
        threading.Thread(target=self._work, name="pomona-output", daemon=True).start()

    @property
    def is_behind(self) -> bool:
        """Whether the reader has not yet taken everything."""
        return self._writing or not self._waiting.empty()

    def write(self, text: str) -> int:
        """Queue a text. Raises OSError: an earlier text could not be written."""
        if os.getpid() != self._process:  # a forked child has no such thread
            return self._stream.write(text)
        self._refuse_broken()
        if self._waiting.qsize() < MOST:
            self._waiting.put(self._coded(text))
        else:
            self._left_out += 1
        return len(text)

    def flush(self) -> None:
        """Wait for `SHORT` at most, and not while the reader is late. Raises OSError as `write`."""
        if os.getpid() != self._process:
            self._stream.flush()
        elif not (self._late and self.is_behind):
            self._late = not self.wait(SHORT)
        self._refuse_broken()

    def wait(self, limit: float) -> bool:
        """Wait for the reader; return True if it has taken everything within `limit` [s]."""
        taken = threading.Event()
        self._waiting.put(taken)
        return taken.wait(limit)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _coded(self, text: str) -> bytes:
        return text.encode(self._stream.encoding, self._stream.errors or "strict")

    def _refuse_broken(self) -> None:
        if self._error is not None:
            raise OSError(self._error.errno, self._error.strerror)  # Python makes it a BrokenPipeError

    def _work(self) -> None:
        while True:
            item = self._waiting.get()
            if isinstance(item, threading.Event):
                item.set()
                continue
            self._writing = True
            try:
                if self._error is None:
                    self._write_all(item)
            except OSError as error:
                self._error = error
            self._writing = False

    def _write_all(self, data: bytes) -> None:
        # Not through the stream: a lock of it would be held while the reader takes nothing.
        while data:
            try:
                data = data[os.write(self._file, data) :]
            except BlockingIOError:  # another process has made it non-blocking
                select.select([], [self._file], [])
        if self._left_out and self._waiting.qsize() < MOST:
            left_out, self._left_out = self._left_out, 0
            self._write_all(self._coded(f"\n[{left_out} texts are left out here: the output was not read]\n"))


@contextlib.contextmanager
def unwaiting_output() -> Iterator[None]:
    """Make standard output and standard error an `Output` each; at the end their readers have `ENDING` in all."""
    before = sys.stdout, sys.stderr
    for stream in before:
        with contextlib.suppress(OSError):
            stream.flush()
    outputs = [Output(stream) for stream in before]
    sys.stdout, sys.stderr = (cast(TextIO, output) for output in outputs)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
        until = time.monotonic() + ENDING
        for output in outputs:
            output.wait(max(until - time.monotonic(), 0.0))
