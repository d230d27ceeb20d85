"""A person approves a node's start, and changes its inputs before it; both are recorded."""

from __future__ import annotations

import pytest
from fake_runs import Turn, make

from pomona.executive.language.changes import ChangeRefusedError
from pomona.executive.registry import Registry
from pomona.executive.running.events import NodeChanged, OperatorActed, RunStarted
from pomona.executive.running.requests import AnswerRefusedError
from pomona.tools.dashboard.control_lock import ControlLock, RefusedError
from pomona.tools.dashboard.explain import explain

TEXT = """
pomona: 1
tree: careful
root:
  sequence:
    - Turn: {duration: 40 ms}
      approve: true
    - Turn: {duration: 40 ms}
      name: Again
"""
PATH, TURN, AGAIN = "careful/Turn:approve", "careful/Turn", "careful/Again"
SKILLS = Registry({"Turn": Turn})


def starts(events, path):
    return [
        event.tick
        for event in events
        if isinstance(event, NodeChanged) and event.path == path and event.status == "RUNNING"
    ]


def test_a_node_waits_until_somebody_approves():
    runner, _, events = make(
        TEXT,
        SKILLS,
        {9: lambda runner, _: runner.answer(PATH, 1, "approve", "Ada")},
        attended=True,
        go_on=True,
    )
    assert runner.run().outcome == "success"
    assert min(starts(events, TURN)) >= 9
    assert min(starts(events, PATH)) < 3
    acted = [
        event for event in events if isinstance(event, OperatorActed) and event.action == "answer"
    ]
    assert [(event.who, event.detail) for event in acted] == [("Ada", f"approve ← {PATH}")]


def test_each_start_is_approved_anew():
    text = TEXT.replace("approve: true", "approve: true\n      repeat: 2")
    answered = {
        tick: lambda runner, _, number=number: runner.answer(
            "careful/Turn:approve", number, "approve"
        )
        for number, tick in ((1, 5), (2, 30))
    }
    runner, _, events = make(text, SKILLS, answered, attended=True, go_on=True)
    assert runner.run().outcome == "success"
    first, second = (tick for tick in sorted(set(starts(events, TURN))) if tick in (5, 6, 30, 31))
    assert first < 30 <= second


def test_a_second_press_on_the_first_approval_does_not_approve_the_next_start():
    text = TEXT.replace("approve: true", "approve: true\n      repeat: 2")
    refused = []

    def press_again(runner, _cell):
        with pytest.raises(
            AnswerRefusedError, match="now asks question 2; the answer names question 1"
        ) as error:
            runner.answer(PATH, 1, "approve", "Ada")
        refused.append(error)
        runner.answer(PATH, 2, "refuse", "Ada")

    script = {5: lambda runner, _: runner.answer(PATH, 1, "approve", "Ada"), 30: press_again}
    runner, _, events = make(text, SKILLS, script, attended=True)
    assert runner.run().outcome == "failure"
    assert refused
    assert {e.starts for e in events if isinstance(e, NodeChanged) and e.path == TURN} == {1}


def test_an_unapproved_node_does_not_start():
    runner, _, events = make(
        TEXT,
        SKILLS,
        {5: lambda runner, _: runner.answer(PATH, 1, "refuse")},
        attended=True,
        go_on=True,
    )
    result = runner.run()
    assert result.reason is not None
    assert (result.outcome, result.reason.codes()) == ("failure", {"NOT_APPROVED"})
    assert not starts(events, TURN)


def test_without_an_operator_nothing_starts_and_a_code_gives_the_reason():
    runner, _, events = make(TEXT, SKILLS)
    result = runner.run()
    assert result.reason is not None
    assert result.reason.codes() == {"NOBODY_TO_ASK"}
    assert not starts(events, TURN)


def test_an_input_is_changed_before_the_next_start_and_the_operator_is_recorded():
    def change(runner, _cell):
        runner.change(AGAIN, "duration", "200 ms", "Ada")

    def answer(runner, _cell):
        runner.answer(PATH, 2, "approve")  # a change asks again

    runner, _, events = make(TEXT, SKILLS, {3: change, 5: answer}, attended=True, go_on=True)
    assert runner.run().outcome == "success"
    again = [e.tick for e in events if isinstance(e, NodeChanged) and e.path == AGAIN]
    turned = [e.tick for e in events if isinstance(e, NodeChanged) and e.path == TURN]
    assert (
        again[-1] - again[0] >= 10 > turned[-1] - turned[0]
    )  # ticks of 20 ms: 200 ms instead of 40
    acted = [
        event for event in events if isinstance(event, OperatorActed) and event.action == "change"
    ]
    assert [(event.who, event.detail) for event in acted] == [
        ("Ada", f"duration = 200 ms ← {AGAIN}")
    ]


def test_the_explanation_names_operator_and_change():
    def change(runner, _cell):
        runner.change(AGAIN, "duration", "60 ms", "Ada")

    def answer(runner, _cell):
        runner.answer(PATH, 2, "approve", "Ada")  # a change asks again

    runner, _, events = make(TEXT, SKILLS, {3: change, 5: answer}, attended=True, go_on=True)
    runner.run()
    nodes = tuple(node.facts() for node in runner.tree.nodes)
    started = RunStarted(
        0.0,
        0,
        "r",
        "careful",
        "t.yaml",
        TEXT,
        "",
        "fake",
        "mock",
        "",
        "",
        0,
        {},
        nodes,
        {},
        0.0,
        0.02,
    )
    said = " ".join(explain([started, *events]))
    assert f"Ada: change: duration = 60 ms ← {AGAIN}." in said
    assert f"Ada: answer: approve ← {PATH}." in said


@pytest.mark.parametrize(
    ("path", "port", "text", "words"),
    [
        ("careful/nobody", "duration", "1 s", "there is no skill at careful/nobody"),
        (AGAIN, "duratoin", "1 s", "has no input 'duratoin': did you mean"),
        (AGAIN, "duration", "3 kg", "duration: "),
        (AGAIN, "duration", "[", "duration: "),
    ],
)
def test_a_change_that_means_nothing_is_refused(path, port, text, words):
    runner, _, _ = make(TEXT, SKILLS)
    with pytest.raises(ChangeRefusedError, match=words.replace("[", r"\[")):
        runner.change(path, port, text)


def test_on_the_page_the_operator_in_control_makes_changes():
    lock, refused = ControlLock(), []

    def act(runner, _cell):
        lock.serve(runner)
        lock.take("page 1", "Ada")
        with pytest.raises(RefusedError):
            lock.act("page 2", "change", f"duration = 60 ms ← {AGAIN}")
        with pytest.raises(RefusedError) as error:
            lock.act("page 1", "change", f"speed = 1 ← {AGAIN}")
        refused.append(str(error.value))
        lock.act("page 1", "change", f"duration = 60 ms ← {AGAIN}")

    def answer(runner, _cell):
        runner.answer(PATH, 2, "approve")

    runner, _, events = make(TEXT, SKILLS, {3: act, 5: answer}, attended=True, go_on=True)
    assert runner.run().outcome == "success"
    assert "has no input 'speed'" in refused[0]
    assert any(
        isinstance(e, OperatorActed) and (e.who, e.action) == ("Ada", "change") for e in events
    )
