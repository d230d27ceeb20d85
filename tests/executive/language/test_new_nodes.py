"""Composites and modifiers beyond sequence, fallback, parallel and retry."""

from __future__ import annotations

import pytest

from pomona.executive.reasons import reason_of


def move(name, **modifiers):
    rest = "".join(f", {key}: {value}" for key, value in modifiers.items())
    return f"{{MoveTo: {{pose: {name}}}, name: {name}{rest}}}"


def starts(run, *names):
    return [run.skill(f"t/{name}").starts for name in names]


def test_if_chooses(built):
    for condition, expected in (("1 == 1", [1, 0]), ("1 == 2", [0, 1])):
        run = built(f"root: {{if: '{condition}', then: {move('A')}, else: {move('B')}}}")
        assert run.run() == "SUCCESS"
        assert starts(run, "A", "B") == expected


def test_if_may_ask_a_node_and_asks_it_once(built):
    run = built(f"root: {{if: {move('Q')}, then: {move('A')}, else: {move('B')}}}").script(
        "t/Q", "NO_PATH"
    )
    assert run.run() == "SUCCESS"
    assert starts(run, "Q", "A", "B") == [1, 0, 1]


def test_the_failure_of_the_node_that_was_asked_is_in_sight_in_else(built):
    run = built(
        f"root: {{if: {move('Q')}, then: {move('A')}, else: {{check: 'failure.code == NO_PATH'}}}}"
    ).script("t/Q", "NO_PATH")
    assert run.run() == "SUCCESS"


def test_an_if_whose_condition_has_no_value_fails(built):
    body = "root: {sequence: [{set: {n: 0}}, {if: '1 / {n} > 1', then: {succeed: {}}, else: {succeed: {}}}]}"
    run = built(body)
    assert run.run() == "FAILURE"
    assert reason_of(run.tree.root).code == "BAD_VALUE"


def test_an_if_needs_a_then(findings_of):
    assert [f.code for f in findings_of("root: {if: '1 == 1'}")] == ["missing-key"]


def test_a_reactive_if_changes_sides(built):
    run = built(
        "root: {sequence: [{set: {n: 0}}, {parallel: ["
        f"{{reactive_if: '{{n}} == 0', then: {{MoveTo: {{pose: a}}, name: A, repeat: forever}}, else: {move('B')}}},"
        " {sequence: [{wait: 100 ms}, {set: {n: 1}}]}]}]}"
    )
    assert run.run() == "SUCCESS"
    assert run.skill("t/parallel/reactive_if/A").status.name == "INVALID"
    assert run.skill("t/parallel/reactive_if/B").starts == 1


@pytest.mark.parametrize(
    ("value", "expected"), [("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1])]
)
def test_switch_runs_the_case_of_the_value(built, value, expected):
    run = built(
        f"root: {{sequence: [{{set: {{v: {value}}}}}, {{switch: '{{v}}',"
        f" cases: {{x: {move('A')}, y: {move('B')}}}, default: {move('C')}}}]}}"
    )
    assert run.run() == "SUCCESS"
    assert starts(run, "switch/A", "switch/B", "switch/C") == expected


def test_switch_follows_the_value(built):
    run = built(
        "root: {sequence: [{set: {v: x}}, {parallel: ["
        f"{{switch: '{{v}}', cases: {{x: {{wait_until: '1 == 2'}}, y: {move('B')}}}}},"
        " {sequence: [{wait: 100 ms}, {set: {v: y}}]}]}]}"
    )
    assert run.run() == "SUCCESS"
    assert run.context.clock.now() < 0.3


@pytest.mark.parametrize(("value", "word"), [("3", "3"), ("0.5", "0.5"), ("true", "true")])
def test_cases_are_words_of_any_type(built, value, word):
    run = built(
        f"root: {{sequence: [{{set: {{v: {value}}}}}, {{switch: '{{v}}', cases: {{{word}: {{succeed: {{}}}}}},"
        " default: {fail: {}}}]}"
    )
    assert run.run() == "SUCCESS"


def test_a_sequence_with_memory_goes_on_with_the_failed_child(built):
    run = built(
        f"root: {{sequence_with_memory: [{move('A')}, {move('B')}, {move('C')}], retry: 3}}"
    )
    run.script("t/B", "NO_PATH", None)
    assert run.run() == "SUCCESS"
    assert starts(run, "A", "B", "C") == [1, 2, 1]
    run = built(f"root: {{sequence: [{move('A')}, {move('B')}, {move('C')}], retry: 3}}").script(
        "t/B", "NO_PATH", None
    )
    assert run.run() == "SUCCESS"
    assert starts(run, "A", "B", "C") == [2, 2, 1]


def test_delay_waits_before_each_try(built):
    run = built(f"root: {move('A', delay='1 s', retry=2)}").script("t", "NO_PATH", None)
    assert run.run() == "SUCCESS"
    assert 2.0 < run.context.clock.now() < 2.2


def test_rate_limits_the_starts_of_a_second(built):
    run = built("root: {Beep: {}, rate: 5 Hz, repeat: 11}")
    assert run.run() == "SUCCESS"
    assert run.context.clock.now() == pytest.approx(2.0, abs=0.25)
    assert run.skill("t").starts == 11


def test_a_rate_that_cannot_be_is_refused(findings_of):
    assert [f.code for f in findings_of("root: {Beep: {}, rate: 0 Hz}")] == ["range"]
    assert [f.code for f in findings_of("root: {Beep: {}, rate: 5}")] == ["value"]


def test_run_once_is_skipped_from_then_on(built):
    run = built(f"root: {{sequence: [{move('A', run_once='true')}, {move('B')}], repeat: 3}}")
    assert run.run() == "SUCCESS"
    assert starts(run, "A", "B") == [1, 3]
