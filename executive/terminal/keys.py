"""The person at the terminal: answers the tree's questions, and goes on after a breakpoint."""

from __future__ import annotations

import os
import select
import threading
from collections.abc import Mapping
from typing import TextIO

from executive.nodes.question import Question
from executive.running.events import Event, NodeChanged, RunEnded, StateChanged
from executive.running.requests import AnswerRefusedError
from executive.running.runner import Runner
from executive.terminal.screen import Screen

LOOK = 0.1
"""Seconds between two looks whether the run has ended, while lines are waited for."""
WHO = "terminal"


class Keys:
    """Reads lines from the first question on. It never blocks on the terminal: the process can end at any time."""

    def __init__(self, console: Screen, lines: TextIO) -> None:
        self._console, self._lines = console, lines
        self._runner: Runner | None = None
        self._questions: Mapping[str, Question] = {}
        self._asked: list[str] = []
        self._paused = self._ended = False
        self._thread: threading.Thread | None = None

    def serve(self, runner: Runner) -> None:
        """Answer this run's questions."""
        self._runner, self._questions = runner, runner.tree.questions

    def on_event(self, event: Event) -> None:
        """Follow the run."""
        if isinstance(event, NodeChanged) and event.path in self._questions:
            if event.status != "RUNNING":
                self._asked = [path for path in self._asked if path != event.path]
            elif event.path not in self._asked:
                self._asked.append(event.path)
                self._say(f"? {event.feedback} [{'/'.join(self._questions[event.path].choices)}]")
        elif isinstance(event, StateChanged):
            self._paused = event.state == "paused"
            if self._paused:
                self._say("paused: Enter goes on")
        elif isinstance(event, RunEnded):
            self._ended = True

    def close(self) -> None:
        """Read no more. Harmless when nothing was asked."""
        self._ended = True
        if self._thread is not None:
            self._thread.join()

    def _say(self, what: str) -> None:
        self._console.print(what, style="bold yellow")
        if self._thread is None:
            self._thread = threading.Thread(target=self._follow, name="pomona-keys", daemon=True)
            self._thread.start()

    def _follow(self) -> None:
        file, rest = self._lines.fileno(), b""
        while not self._ended:
            if not select.select([file], [], [], LOOK)[0]:
                continue
            read = os.read(file, 1024)
            if not read:
                return
            *lines, rest = (rest + read).split(b"\n")
            for line in lines:
                self._take(line.decode(errors="replace").strip())

    def _take(self, line: str) -> None:
        if self._runner is None:
            return
        if not self._asked:
            if self._paused:
                self._runner.resume(WHO)
            return
        path = self._asked[0]
        choices = self._questions[path].choices
        meant = [choice for choice in choices if line and choice.casefold().startswith(line.casefold())]
        chosen = line if line in choices else meant[0] if len(meant) == 1 else None
        if chosen is None:
            self._console.print(f"  one of: {', '.join(choices)}")
            return
        try:
            self._runner.answer(path, chosen, WHO)
        except AnswerRefusedError as error:  # it has ended meanwhile
            self._console.print(f"  {error}")
