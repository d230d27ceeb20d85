"""A line at the terminal answers the prompt that was on the screen when it was typed."""

from __future__ import annotations

import io
import os
import pty
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest
from fake_runs import Turn, make

from pomona.executive.registry import Registry
from pomona.executive.running.events import Event, OperatorActed, StateChanged
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import RunResult
from pomona.executive.terminal.keys import Keys
from pomona.executive.terminal.screen import Screen

SKILLS = Registry({"Turn": Turn})
ASKING = """
pomona: 1
tree: asking
root:
  sequence:
    - ask: Is it ripe?
      choices: [ripe, "not yet"]
      answer: said
    - check: "{said} == 'not yet'"
    - Turn: {duration: 40 ms}
      breakpoint: before
"""
PROMPT, PAUSED = "? Is it ripe? [ripe/not yet]", "paused: Enter goes on"


@dataclass
class Terminal:
    """A pseudo-terminal, the operator's end of it, and the screen's contents so far."""

    lines: io.TextIOWrapper
    keyboard: int
    screen: Screen
    shown: io.StringIO
    events: list[Event] = field(default_factory=list)

    def type(self, text: str) -> None:
        os.write(self.keyboard, text.encode())

    def wait(self, words: str, times: int = 1) -> None:
        until = time.monotonic() + 10.0
        while self.shown.getvalue().count(words) < times:
            assert time.monotonic() < until, self.shown.getvalue()
            threading.Event().wait(0.005)

    def run(self, text: str, person: Callable[[Runner], None]) -> RunResult:
        """Run a tree while a person types."""
        keys = Keys(self.screen, self.lines)
        patience = dict.fromkeys(
            range(1, 5_000), lambda _runner, _cell: threading.Event().wait(0.002)
        )
        runner, _cell, self.events = make(
            text, SKILLS, patience, attended=True, listeners=[keys.on_event]
        )
        keys.serve(runner)
        failed: list[BaseException] = []

        def type_and_end() -> None:
            try:
                person(runner)
            except BaseException as error:
                failed.append(error)
                runner.stop("the test")

        typing = threading.Thread(target=type_and_end)
        typing.start()
        try:
            result = runner.run()
        finally:
            typing.join()
            keys.close()
        if failed:
            raise failed[0]
        return result

    def acts(self) -> list[tuple[str, str]]:
        return [(e.action, e.who) for e in self.events if isinstance(e, OperatorActed)]


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    keyboard, line = pty.openpty()
    shown, screen = io.StringIO(), Screen()
    screen.file = shown
    with os.fdopen(line) as lines:
        yield Terminal(lines, keyboard, screen, shown)
    os.close(keyboard)


def unanswered(terminal: Terminal, seconds: float = 0.3) -> None:
    """Nothing may happen: there is no event to wait for."""
    threading.Event().wait(seconds)
    assert terminal.acts() == []


def test_the_first_letters_answer_and_enter_ends_a_pause(terminal: Terminal) -> None:
    def person(_runner: Runner) -> None:
        terminal.wait(PROMPT)
        terminal.type("green\nNO\n")
        terminal.wait(PAUSED)
        terminal.type("stop\n\n")

    assert terminal.run(ASKING, person).outcome == "success"
    assert terminal.acts() == [("answer", "terminal"), ("resume", "terminal")]
    assert "one of: ripe, not yet" in terminal.shown.getvalue()
    assert "Enter alone goes on" in terminal.shown.getvalue()


def test_reload_takes_the_file_over_or_gives_the_reason_and_the_pause_goes_on(
    terminal: Terminal,
) -> None:
    def person(_runner: Runner) -> None:
        terminal.wait(PROMPT)
        terminal.type("green\nNO\n")
        terminal.wait(PAUSED)
        terminal.type("reload\n")
        terminal.wait("this run has no tree file")
        terminal.type("\n")

    assert terminal.run(ASKING, person).outcome == "success"
    assert terminal.acts() == [("answer", "terminal"), ("resume", "terminal")]


@pytest.mark.parametrize("typed", ["ripe\n", "ripe\nripe\n\n\n", "r"])
def test_text_typed_before_the_question_does_not_answer_it(terminal: Terminal, typed: str) -> None:
    terminal.type(typed)

    def person(_runner: Runner) -> None:
        terminal.wait(PROMPT)
        unanswered(terminal)
        terminal.type("\nnot\n")  # behind an "r" that was left in the line, this would be "r"
        terminal.wait(PAUSED)
        terminal.type("\n")

    assert terminal.run(ASKING, person).outcome == "success"


def test_enter_before_the_pause_does_not_end_it(terminal: Terminal) -> None:
    terminal.type("\n\n")
    waiting: list[tuple[str, str]] = []

    def person(_runner: Runner) -> None:
        terminal.wait(PAUSED)
        threading.Event().wait(0.3)
        waiting.extend(terminal.acts())
        terminal.type("\n")

    text = "pomona: 1\ntree: t\nroot: {Turn: {duration: 40 ms}, breakpoint: before}\n"
    assert terminal.run(text, person).outcome == "success"
    assert waiting == []
    assert terminal.acts() == [("resume", "terminal")]


def test_lines_behind_an_answer_do_not_answer_the_next_question(terminal: Terminal) -> None:
    text = "pomona: 1\ntree: t\nroot:\n  sequence:\n    - ask: One?\n    - ask: Two?\n"

    def person(runner: Runner) -> None:
        terminal.wait("? One?")
        terminal.type("yes\nyes\nyes\n")  # in one read
        terminal.wait("? Two?")
        threading.Event().wait(0.3)
        assert [act for act, _who in terminal.acts()] == ["answer"]
        runner.stop()

    assert terminal.run(text, person).outcome == "stopped"


def test_a_question_that_stands_behind_another_is_asked_again_when_that_one_has_gone(
    terminal: Terminal,
) -> None:
    """A line that was meant for the question that has just been answered by its default must not answer this one."""
    text = """
pomona: 1
tree: t
root:
  parallel:
    - ask: Open the fingers?
      within: 200 ms
      default: no
    - ask: Is the table free?
"""

    def person(runner: Runner) -> None:
        terminal.wait("? Open the fingers?")
        terminal.wait("? Is the table free?")
        terminal.type("yes\n")

    assert terminal.run(text, person).outcome == "success"
    assert terminal.shown.getvalue().index("Open the fingers?") < terminal.shown.getvalue().index(
        "Is the table free?"
    )
    assert terminal.acts() == [("answer", "terminal")]


def test_enter_ends_a_pause_that_came_over_a_question(terminal: Terminal) -> None:
    def person(runner: Runner) -> None:
        terminal.wait(PROMPT)
        runner.pause("ada")
        terminal.wait(PAUSED)
        terminal.type("\n")
        terminal.wait(PROMPT, times=2)
        terminal.type("not\n")
        terminal.wait(PAUSED, times=2)
        terminal.type("\n")

    assert terminal.run(ASKING, person).outcome == "success"
    paused = [
        event.pause
        for event in terminal.events
        if isinstance(event, StateChanged) and event.state == "paused"
    ]
    assert paused == [1, 2]


def test_a_terminal_that_is_gone_ends_the_reading_and_not_the_run(terminal: Terminal) -> None:
    def person(runner: Runner) -> None:
        terminal.wait(PROMPT)
        terminal.type("\x04")  # the end of input
        threading.Event().wait(0.2)
        runner.stop()

    assert terminal.run(ASKING, person).outcome == "stopped"


def test_a_terminal_of_another_process_group_is_neither_read_nor_flushed(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the background of a shell the system would stop the process, and the arm with it."""
    monkeypatch.setattr(os, "tcgetpgrp", lambda _file: os.getpgrp() + 1)

    def person(runner: Runner) -> None:
        terminal.wait(PROMPT)
        terminal.type("ripe\n")
        unanswered(terminal)
        runner.stop()

    assert terminal.run(ASKING, person).outcome == "stopped"
    assert os.read(terminal.lines.fileno(), 100) == b"ripe\n"
