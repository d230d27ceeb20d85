"""Questions and breakpoints of a tree file in a run: who is there answers and goes on, and nothing waits for nobody."""

from __future__ import annotations

import io
import os
import threading
import time

import pytest
from fake_runs import Turn, make

from executive.dashboard.control_lock import ControlLock, RefusedError
from executive.registry import Registry
from executive.running.events import OperatorActed, PortWritten, StateChanged
from executive.running.requests import AnswerRefusedError
from executive.terminal.keys import Keys
from executive.terminal.screen import Screen

TEXT = """
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
PATH = "asking/ask"
SKILLS = Registry({"Turn": Turn})


def test_who_answered_is_in_the_events():
    runner, _, events = make(
        TEXT, SKILLS, {5: lambda runner, _: runner.answer(PATH, "not yet", "Ada")}, attended=True, go_on=True
    )
    assert runner.run().outcome == "success"
    acted = [event for event in events if isinstance(event, OperatorActed) and event.action == "answer"]
    assert [(event.who, event.detail) for event in acted] == [("Ada", f"not yet ← {PATH}")]
    assert [event.value for event in events if isinstance(event, PortWritten)] == ["not yet"]


def test_breakpoints_of_the_file_hold_when_somebody_is_there():
    answer = {3: lambda runner, _: runner.answer(PATH, "not yet")}
    runner, _, events = make(TEXT, SKILLS, answer, attended=True, go_on=True)
    runner.run()
    because = [event.because for event in events if isinstance(event, StateChanged)]
    assert "breakpoint before asking/Turn" in because


def test_without_anybody_nothing_waits():
    runner, _, events = make(TEXT.replace("answer: said", 'answer: said\n      default: "not yet"'), SKILLS)
    assert runner.run().outcome == "success"
    assert not any(isinstance(event, StateChanged) and event.state == "pausing" for event in events)


def test_answers_that_are_none_are_refused():
    refused = []

    def try_it(runner, _cell):
        for path, choice in ((PATH, "rotten"), ("asking/Turn", "ripe")):
            with pytest.raises(AnswerRefusedError) as error:
                runner.answer(path, choice)
            refused.append(str(error.value))
        runner.answer(PATH, "not yet")
        runner.answer(PATH, "ripe")  # too late: the first one counts

    runner, _, _ = make(TEXT, SKILLS, {3: try_it}, attended=True, go_on=True)
    assert runner.run().outcome == "success"
    assert refused == ["'rotten' is no answer: ripe, not yet", "nothing is asked at asking/Turn now"]


def test_on_the_page_who_holds_control_answers():
    lock, refused = ControlLock(), []

    def act(runner, _cell):
        lock.serve(runner)
        with pytest.raises(RefusedError):
            lock.act("page 1", "answer", f"not yet ← {PATH}")
        lock.take("page 1", "Ada")
        with pytest.raises(RefusedError) as error:
            lock.act("page 1", "answer", f"green ← {PATH}")
        refused.append(str(error.value))
        lock.act("page 1", "answer", f"not yet ← {PATH}")

    runner, _, events = make(TEXT, SKILLS, {3: act}, attended=True, go_on=True)
    assert runner.run().outcome == "success"
    assert refused == ["'green' is no answer: ripe, not yet"]
    assert [e.who for e in events if isinstance(e, OperatorActed) and e.action == "answer"] == ["Ada"]


def test_at_the_terminal_the_first_letters_do_and_enter_goes_on():
    reading, writing = os.pipe()
    shown = io.StringIO()
    console = Screen()
    console.file = shown
    with open(reading) as lines, open(writing, "wb", buffering=0) as keyboard:
        keys = Keys(console, lines)
        patience = dict.fromkeys(range(1, 2_000), lambda _runner, _cell: threading.Event().wait(0.002))
        runner, _, events = make(TEXT, SKILLS, patience, attended=True, listeners=[keys.on_event])
        keys.serve(runner)

        def person() -> None:
            for sign, line in (("ripe/not yet", b"green\nNO\n"), ("Enter goes on", b"\n")):
                until = time.monotonic() + 5.0
                while sign not in shown.getvalue() and time.monotonic() < until:
                    threading.Event().wait(0.005)
                keyboard.write(line)

        typing = threading.Thread(target=person)
        typing.start()
        result = runner.run()
        assert result.outcome == "success", result.reason
        typing.join()
        keys.close()
    assert "? Is it ripe? [ripe/not yet]" in shown.getvalue()
    assert "one of: ripe, not yet" in shown.getvalue()
    assert {e.who for e in events if isinstance(e, OperatorActed)} == {"terminal"}
