"""A skipped node neither succeeds nor fails, as BehaviorTree.CPP's SKIPPED; and the decisive child of a parallel."""

from __future__ import annotations

import pytest

SKIPPED = "{succeed: {}, when: '1 == 2', name: S}"
GOOD, BAD = "{succeed: {}, name: G}", "{fail: {}, name: B}"


@pytest.mark.parametrize(
    ("node", "ended"),
    [
        (f"sequence: [{SKIPPED}, {GOOD}]", "SUCCESS"),
        (f"sequence: [{GOOD}, {SKIPPED}]", "SUCCESS"),
        (f"sequence: [{SKIPPED}, {BAD}]", "FAILURE"),
        (f"sequence: [{SKIPPED}]", "INVALID"),
        (f"reactive_sequence: [{SKIPPED}]", "INVALID"),
        (f"fallback: [{BAD}, {SKIPPED}]", "FAILURE"),
        (f"fallback: [{SKIPPED}, {BAD}]", "FAILURE"),
        (f"fallback: [{SKIPPED}, {GOOD}]", "SUCCESS"),
        (f"fallback: [{SKIPPED}]", "INVALID"),
        (f"reactive_fallback: [{SKIPPED}]", "INVALID"),
        (f"parallel: [{SKIPPED}, {GOOD}]", "SUCCESS"),
        (f"parallel: [{SKIPPED}]", "SUCCESS"),  # as in BehaviorTree.CPP: all there was to wait for
        (f"parallel: [{SKIPPED}, {BAD}]", "FAILURE"),
        (f"parallel: [{SKIPPED}], success_on: one", "INVALID"),
        (f"parallel: [{SKIPPED}, {GOOD}], success_on: one", "SUCCESS"),
        (f"parallel: [{SKIPPED}, {{wait: 1 h}}], success_on: one", "RUNNING"),
        (f"parallel: [{SKIPPED}, {{wait: 1 h}}], success_on: [S]", "SUCCESS"),
        (f"sequence: [{SKIPPED}], invert: true", "INVALID"),
        (f"sequence: [{SKIPPED}], force: failure", "INVALID"),
        (f"sequence: [{SKIPPED}], retry: 2", "INVALID"),
        (f"sequence: [{SKIPPED}], repeat: 2", "INVALID"),
        (f"sequence: [{SKIPPED}], timeout: 1 s", "INVALID"),
        (f"sequence: [{SKIPPED}], guard: '1 == 1'", "INVALID"),
        (f"sequence: [{SKIPPED}], delay: 0 s", "INVALID"),
        (f"sequence: [{SKIPPED}], rate: 1 Hz", "INVALID"),
        (f"sequence: [{SKIPPED}], run_once: true", "INVALID"),
        ("sub: {}", "INVALID"),
        (f"if: {SKIPPED}, then: {GOOD}, else: {BAD}", "INVALID"),
        (f"if: '1 == 1', then: {SKIPPED}", "INVALID"),
        (f"if: '1 == 2', then: {GOOD}", "INVALID"),
        (f"switch: a, cases: {{b: {GOOD}}}", "INVALID"),
    ],
)
def test_parents_treat_a_skipped_child_by_their_rule(built, node, ended):
    run = built(
        f"root: {{sequence: [{{{node}, name: P}}, {{succeed: {{}}}}]}}\n"
        f"subtrees: {{sub: {{root: {SKIPPED}}}, other: {{root: {{sub: {{}}}}}}}}"
    )
    for _ in range(3):
        if run.tick() != "RUNNING":
            break
    paths = [path for path in run.tree.behaviours if path.startswith("t/P") and "/" not in path[4:]]
    outermost = next(info.path for info in run.tree.nodes if info.path in paths)
    assert run.tree.behaviours[outermost].status.name == ended


def test_a_tree_that_is_skipped_as_a_whole_has_succeeded(built):
    run = built(f"root: {SKIPPED}")
    assert run.run() == "SUCCESS"
    assert run.tree.behaviours["t:when"].status.name == "INVALID"
    assert "skipped: 1 == 2 is false" in run.tree.behaviours["t:when"].feedback_message


def test_a_parallel_asks_a_skipped_child_again(built):
    run = built(
        "root: {sequence: [{set: {n: 0}}, {parallel: [{succeed: {}, when: '{n} == 1', name: A},"
        " {sequence: [{wait: 50 ms}, {set: {n: 1}}, {wait: 50 ms}]}]}]}"
    )
    states = []
    while run.tick() == "RUNNING":
        states.append(run.tree.behaviours["t/parallel/A"].status.name)
    assert states[0] == "INVALID"
    assert states[-1] == "SUCCESS"


@pytest.mark.parametrize(
    ("children", "success_on", "ended"),
    [
        (("succeed", "fail"), "one", "SUCCESS"),
        (("fail", "succeed"), "one", "FAILURE"),
        (("succeed", "fail"), "all", "FAILURE"),
        (("succeed", "fail"), "[c0]", "SUCCESS"),
        (("succeed", "fail"), "[c1]", "FAILURE"),
    ],
)
def test_the_first_child_that_decides_ends_a_parallel(built, children, success_on, ended):
    nodes = ", ".join(f"{{{child}: {{}}, name: c{i}}}" for i, child in enumerate(children))
    run = built(
        f"root: {{parallel: [{nodes}, {{MoveTo: {{pose: a}}, name: Z}}], success_on: {success_on}}}"
    )
    assert run.tick() == ended
    assert run.skill("t/Z").starts == 0
