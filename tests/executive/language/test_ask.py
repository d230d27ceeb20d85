"""Asking a person, and nodes that are switched off."""

from __future__ import annotations

import pytest

from pomona.executive.reasons import reason_of

ASK = "root: {sequence: [{ask: 'Clear?', answer: a%s}, {check: '{a} == yes'}]}"
PATH = "t/ask"


def asking(built, rest="", attended=True):
    run = built(ASK % rest)
    run.tree.questions[PATH].attended = attended
    return run, run.tree.questions[PATH]


def test_an_answer_is_written_and_ends_it(built):
    run, question = asking(built)
    assert run.tick(5) == "RUNNING"
    assert (question.feedback_message, question.choices, question.open) == (
        "Clear?",
        ("yes", "no"),
        True,
    )
    assert question.answer(question.starts, "yes")
    assert run.run() == "SUCCESS"
    assert run.value("/a") == "yes"


def test_the_answer_chooses_the_branch(built):
    run, question = asking(built)
    run.tick()
    question.answer(question.starts, "no")
    assert run.run() == "FAILURE"


@pytest.mark.parametrize(
    ("rest", "attended", "code", "answer"),
    [
        (", within: 100 ms", True, "NO_ANSWER", None),
        (", within: 100 ms", False, "NOBODY_TO_ASK", None),
        (", within: 100 ms, default: yes", True, None, "yes"),
        (", default: yes", False, None, "yes"),
    ],
)
def test_without_an_answer(built, rest, attended, code, answer):
    run, _ = asking(built, rest, attended)
    assert run.run() == ("FAILURE" if code else "SUCCESS")
    assert run.value("/a") == answer
    if code:
        assert reason_of(run.tree.root).code == code


def test_an_unknown_choice_is_no_answer(built):
    run, question = asking(built)
    assert not question.answer(question.starts, "yes")  # nothing is asked yet
    run.tick()
    assert not question.answer(question.starts, "perhaps")
    assert question.answer(question.starts, "yes")
    assert not question.answer(question.starts, "no")  # it was answered already


def test_it_asks_again_at_each_start(built):
    run = built("root: {ask: 'Clear?', choices: [a, b], repeat: 2}")
    question = run.tree.questions["t"]
    question.attended = True
    for choice in ("a", "b"):
        assert run.tick(2) == "RUNNING"
        assert question.answer(question.starts, choice)
    assert run.run() == "SUCCESS"


@pytest.mark.parametrize(
    ("node", "message"),
    [
        ("{ask: Go?, default: maybe}", "the default 'maybe' is not one of the choices: yes, no"),
        ("{ask: Go?, choices: [a, a]}", "an answer stands twice in 'choices'"),
        ("{ask: Go?, choices: a}", "'choices' is a list of texts"),
        ("{ask: Go?, answer: '{a}'}", "'answer' takes a name without braces"),
        ("{ask: Go?, within: 3}", "within: '3' lacks a unit: a time is given in s, ms, us, min, h"),
    ],
)
def test_mistakes(findings_of, node, message):
    assert message in [finding.message for finding in findings_of(f"root: {node}")]


def test_its_codes_are_known(findings_of):
    def after(ask: str, code: str) -> list[str]:
        body = f"root: {{fallback: [{ask}, {{succeed: {{}}, when: 'failure.code == {code}'}}]}}"
        return [finding.code for finding in findings_of(body)]

    assert after("{ask: Go?}", "NO_ANSWER") == []
    assert after("{ask: Go?}", "TIMEOUT") == ["unknown-code"]
    assert after("{ask: Go?, default: yes}", "NO_ANSWER") == ["unknown-code", "unreachable"]


def test_a_disabled_node_is_skipped(built):
    run = built("root: {sequence: [{fail: {}, disabled: true}, {MoveTo: {pose: a}, name: A}]}")
    assert run.run() == "SUCCESS"
    assert run.skill("t/A").starts == 1
    assert built("root: {sequence: [{fail: {}, disabled: false}]}").run() == "FAILURE"


def test_a_disabled_node_is_checked_and_writes_nothing(findings_of):
    codes = [
        f.code for f in findings_of("root: {sequence: [{Refien: {}, disabled: true}, {Beep: {}}]}")
    ]
    assert codes == ["unknown-skill"]
    body = "root: {sequence: [{set: {n: 1}, disabled: true}, {check: '{n} > 0'}]}"
    assert [f.code for f in findings_of(body)] == ["unset"]
