"""The operator at the terminal: answers the tree's questions, and ends a pause.

A line answers the prompt that was on the screen when it was typed. Before each prompt all earlier input is discarded:
the terminal's own buffer, and lines that were read but not used.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
from dataclasses import dataclass
from typing import TextIO

from pomona.executive.errors import PomonaError
from pomona.executive.running.events import (
    Event,
    NodeChanged,
    OperatorActed,
    RunEnded,
    StateChanged,
)
from pomona.executive.running.requests import AnswerRefusedError
from pomona.executive.running.runner import Runner
from pomona.executive.terminal.screen import Screen

LOOK = 0.1  # longest wait for input before the thread checks whether the run has ended [s]
WHO = "terminal"


@dataclass(frozen=True, slots=True)
class _Prompt:
    """A question at `path`, or a pause where `path` is empty."""

    path: str
    number: int


class Keys:
    """Reads lines from the first prompt on. It never blocks on the terminal: the process can end at any time."""

    def __init__(self, console: Screen, lines: TextIO) -> None:
        self._console = console
        self._lines = lines
        self._runner: Runner | None = None
        self._pause = 0
        self._ended = False
        self._prompt: _Prompt | None = None
        self._answered = False
        self._rest = b""
        self._reading = threading.Lock()
        self._thread: threading.Thread | None = None

    def serve(self, runner: Runner) -> None:
        """Answer this run's questions."""
        self._runner = runner

    def on_event(self, event: Event) -> None:
        """Follow the run."""
        if isinstance(event, StateChanged):
            self._pause = event.pause if event.state == "paused" else 0
        elif isinstance(event, OperatorActed) and (event.who, event.action) == (WHO, "too_late"):
            self._prompt = None  # it is still open: ask again
        elif isinstance(event, RunEnded):
            self._ended = True
        elif not isinstance(event, NodeChanged):
            return
        prompt = self._current()
        if not self._ended and prompt != self._prompt:
            self._show(prompt)

    def close(self) -> None:
        """Read no more. Harmless when nothing was asked."""
        self._ended = True
        if self._thread is not None:
            self._thread.join()

    def _current(self) -> _Prompt | None:
        """One prompt at a time: the pause first, then the question that is on the screen already."""
        if self._pause:
            return _Prompt("", self._pause)
        questions = {} if self._runner is None else self._runner.questions
        asked = [
            _Prompt(path, question.starts) for path, question in questions.items() if question.open
        ]
        return self._prompt if self._prompt in asked else asked[0] if asked else None

    def _show(self, prompt: _Prompt | None) -> None:
        with self._reading:
            self._prompt = prompt
            self._answered = False
            if prompt is not None:
                self._discard_typed()
                self._console.print(self._words(prompt), style="bold yellow")
        if prompt is not None and self._thread is None:
            self._thread = threading.Thread(target=self._follow, name="pomona-keys", daemon=True)
            self._thread.start()

    def _words(self, prompt: _Prompt) -> str:
        if not prompt.path:
            return "paused: Enter goes on; reload takes the changed tree file over"
        assert self._runner is not None
        question = self._runner.questions[prompt.path]
        return f"? {question.feedback_message} [{'/'.join(question.choices)}]"

    def _discard_typed(self) -> None:
        """Discard everything that was typed up to now, an unfinished line too."""
        self._rest = b""
        if not _is_foreground(self._lines.fileno()):
            return
        try:
            import termios
        except ImportError:  # Windows
            return
        with contextlib.suppress(termios.error):  # no terminal
            termios.tcflush(self._lines, termios.TCIFLUSH)
        while self._is_readable(0.0) and os.read(self._lines.fileno(), 1024):
            pass

    def _is_readable(self, patience: float) -> bool:
        return bool(select.select([self._lines], [], [], patience)[0])

    def _follow(self) -> None:
        file = self._lines.fileno()
        while not self._ended:
            if not _is_foreground(file):
                threading.Event().wait(LOOK)
                continue
            if not self._is_readable(LOOK):
                continue
            with self._reading:
                if not self._is_readable(0.0):  # discarded meanwhile
                    continue
                read = os.read(file, 1024)
                if not read:
                    return
                *lines, self._rest = (self._rest + read).split(b"\n")
                for line in lines:
                    self._take(line.decode(errors="replace").strip())

    def _take(self, line: str) -> None:
        prompt = self._prompt
        if self._runner is None or prompt is None or self._answered:
            return
        try:
            if not prompt.path:
                if line == "reload":
                    self._runner.reload(prompt.number, WHO)
                    return
                if line:
                    self._console.print("  Enter alone goes on")
                    return
                self._runner.resume(prompt.number, WHO)
            else:
                choices = self._runner.questions[prompt.path].choices
                meant = [
                    choice
                    for choice in choices
                    if line and choice.casefold().startswith(line.casefold())
                ]
                chosen = line if line in choices else meant[0] if len(meant) == 1 else None
                if chosen is None:
                    self._console.print(f"  one of: {', '.join(choices)}")
                    return
                self._runner.answer(prompt.path, prompt.number, chosen, WHO)
        except AnswerRefusedError as error:  # it has ended meanwhile
            self._console.print(f"  {error}")
        except PomonaError as error:  # the file is not taken over: the pause goes on
            self._console.print(f"  {error}")
            return
        self._answered = True


def _is_foreground(file: int) -> bool:
    """Return False for the terminal of another process group: the system stops a process that reads or flushes it."""
    try:
        return os.tcgetpgrp(file) == os.getpgrp()
    except OSError:  # no terminal, or not this session's
        return True
