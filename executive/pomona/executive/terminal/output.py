"""Output of a command that moves a robot: it is filtered for a terminal, and never waits for its reader.

A pager, a full pipe and a stopped terminal (Ctrl-S) take no text for hours. A thread for each stream writes; the tick
only puts texts into its queue. The output of compiled libraries does not pass here.

Escape sequences set a window's title, clear the screen, move the cursor or write to the clipboard; right-to-left and
invisible marks make a name look like another one. The filter makes each such character visible: ESC as ␛, a
right-to-left override as <U+202E>. Line breaks and tabs stay.

`filtered_output` filters stdout and stderr of a whole command. A `Screen` (screen.py) filters its input before it adds
colours.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import re
import select
import sys
import threading
import time
from collections.abc import Iterable, Iterator
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
            raise OSError(
                self._error.errno, self._error.strerror
            )  # Python makes it a BrokenPipeError

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
            left_out = self._left_out
            self._left_out = 0
            self._write_all(
                self._coded(f"\n[{left_out} texts are left out here: the output was not read]\n")
            )


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


HARMFUL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u00ad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    "\U000e0000-\U000e007f\ud800-\udfff]"
)
"""Control characters but line break and tab, Unicode's format characters, line separators, halves of characters."""


def visible(text: str) -> str:
    """Return the text with every character that would act instead of being shown replaced by a sign for it."""
    return HARMFUL.sub(_sign, text)


def json_text(value: Any, indent: int | None = None) -> str:
    """Return JSON with such characters escaped, so that a terminal and a program read the same text."""
    return HARMFUL.sub(_escaped, json.dumps(value, ensure_ascii=False, indent=indent))


def write_json(value: Any, indent: int | None = None) -> None:
    """Write a JSON value and a line's end to standard output."""
    sys.stdout.write(json_text(value, indent) + "\n")


def _sign(found: re.Match[str]) -> str:
    code = ord(found[0])
    if code < 0x20:
        return chr(0x2400 + code)
    return "\u2421" if code == 0x7F else f"<U+{code:04X}>"


def _escaped(found: re.Match[str]) -> str:
    return json.dumps(found[0])[1:-1] if found[0] != "\x7f" else "\\u007f"


class Filtered:
    """A stream that filters. It is no terminal, since the colour codes of a library would become visible."""

    def __init__(self, unfiltered: TextIO) -> None:
        self.unfiltered = unfiltered

    def write(self, text: str) -> int:
        """Write a text, filtered."""
        self.unfiltered.write(visible(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write texts, filtered."""
        for line in lines:
            self.write(line)

    def write_document(self, text: str) -> None:
        """Write a file's text: as it is where that goes into a file or a pipe, filtered in a terminal."""
        self.unfiltered.write(visible(text) if self.unfiltered.isatty() else text)

    def isatty(self) -> bool:
        """Never: see the class."""
        return False

    def __getattr__(self, name: str) -> Any:
        return getattr(self.unfiltered, name)


@contextlib.contextmanager
def filtered_output() -> Iterator[None]:
    """Filter standard output and standard error until the end."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (cast(TextIO, Filtered(stream)) for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
