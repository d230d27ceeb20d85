"""Questions and breakpoints of a tree file in a run: an operator answers and resumes, and without one nothing waits."""

from __future__ import annotations

import pytest
from fake_runs import Turn, make

from pomona.executive.registry import Registry
from pomona.executive.running.events import NodeChanged, OperatorActed, PortWritten, StateChanged
from pomona.executive.running.requests import AnswerRefusedError
from pomona.tools.dashboard.control_lock import ControlLock, RefusedError

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


def test_the_answering_operator_is_in_the_events():
    runner, _, events = make(
        TEXT,
        SKILLS,
        {5: lambda runner, _: runner.answer(PATH, 1, "not yet", "Ada")},
        attended=True,
        go_on=True,
    )
    assert runner.run().outcome == "success"
    acted = [
        event for event in events if isinstance(event, OperatorActed) and event.action == "answer"
    ]
    assert [(event.who, event.detail) for event in acted] == [("Ada", f"not yet ← {PATH}")]
    assert [event.value for event in events if isinstance(event, PortWritten)] == ["not yet"]


def test_breakpoints_of_the_file_hold_when_somebody_is_there():
    answer = {3: lambda runner, _: runner.answer(PATH, 1, "not yet")}
    runner, _, events = make(TEXT, SKILLS, answer, attended=True, go_on=True)
    runner.run()
    because = [event.because for event in events if isinstance(event, StateChanged)]
    assert "breakpoint before asking/Turn" in because


def test_without_anybody_nothing_waits():
    runner, _, events = make(
        TEXT.replace("answer: said", 'answer: said\n      default: "not yet"'), SKILLS
    )
    assert runner.run().outcome == "success"
    assert not any(isinstance(event, StateChanged) and event.state == "pausing" for event in events)


def test_answers_that_are_none_are_refused():
    refused = []

    def try_it(runner, _cell):
        for path, choice in ((PATH, "rotten"), ("asking/Turn", "ripe")):
            with pytest.raises(AnswerRefusedError) as error:
                runner.answer(path, 1, choice)
            refused.append(str(error.value))
        runner.answer(PATH, 1, "not yet")
        runner.answer(PATH, 1, "ripe")  # too late: the first one counts

    runner, _, events = make(TEXT, SKILLS, {3: try_it}, attended=True, go_on=True)
    assert runner.run().outcome == "success"
    acts = [
        (e.action, e.detail) for e in events if isinstance(e, OperatorActed) and "←" in e.detail
    ]
    assert acts == [
        ("answer", f"not yet ← {PATH}"),
        ("too_late", f"answer ripe ← {PATH}, question answered or gone"),
    ]
    assert refused == ["'rotten' is no answer: ripe, not yet", "no question is open at asking/Turn"]


def test_on_the_page_the_operator_in_control_answers():
    lock, refused = ControlLock(), []

    def act(runner, _cell):
        lock.serve(runner)
        with pytest.raises(RefusedError):
            lock.act("page 1", "answer", f"not yet ← {PATH}", 1)
        lock.take("page 1", "Ada")
        with pytest.raises(RefusedError) as error:
            lock.act("page 1", "answer", f"green ← {PATH}", 1)
        refused.append(str(error.value))
        lock.act("page 1", "answer", f"not yet ← {PATH}", 1)

    runner, _, events = make(TEXT, SKILLS, {3: act}, attended=True, go_on=True)
    assert runner.run().outcome == "success"
    assert refused == ["'green' is no answer: ripe, not yet"]
    assert [e.who for e in events if isinstance(e, OperatorActed) and e.action == "answer"] == [
        "Ada"
    ]


REPEATED = """
pomona: 1
tree: asking
root:
  ask: Is it ripe?
  repeat: 2
"""


def test_an_answer_to_the_question_before_is_refused_although_the_same_node_asks_again():
    """A press on a slow link, or the second click of a double click, arrives when the next question is open."""
    lock, refused = ControlLock(), []

    def late(_runner, _cell):
        with pytest.raises(RefusedError) as error:
            lock.act("page 1", "answer", "yes ← asking", 1)
        refused.append(str(error.value))

    def first(runner, _cell):
        lock.serve(runner)
        lock.take("page 1", "Ada")
        lock.act("page 1", "answer", "yes ← asking", 1)

    script = {3: first, 9: late, 12: lambda runner, _cell: runner.answer("asking", 2, "yes", "Bob")}
    runner, _, events = make(REPEATED, SKILLS, script, attended=True)
    assert runner.run().outcome == "success"
    assert refused == ["asking now asks question 2; the answer names question 1"]
    assert [e.who for e in events if isinstance(e, OperatorActed) and e.action == "answer"] == [
        "Ada",
        "Bob",
    ]
    asked = [
        e
        for e in events
        if isinstance(e, NodeChanged) and (e.path, e.status) == ("asking", "RUNNING")
    ]
    assert [e.starts for e in asked] == [1, 2]


def test_an_answer_that_names_no_question_is_refused():
    lock, refused = ControlLock(), []

    def act(runner, _cell):
        lock.serve(runner)
        lock.take("page 1", "Ada")
        with pytest.raises(RefusedError) as error:
            lock.act("page 1", "answer", f"ripe ← {PATH}")
        refused.append(str(error.value))
        runner.stop()

    runner, _, _ = make(TEXT, SKILLS, {3: act}, attended=True)
    assert runner.run().outcome == "stopped"
    assert refused == [f"{PATH} now asks question 1; the answer names question 0"]
