"""The page about the language names tests that exist, and shows files that are right; each word has a test."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pomona.executive.nodes import NodeTypes

HERE = Path(__file__).parent
PAGE = (HERE.parents[2] / "docs" / "tree_language.md").read_text()
PROOFS: dict[str, tuple[str, ...]] = {
    "sequence": ("test_run.py::test_a_sequence_remembers_where_it_is",),
    "reactive_sequence": (
        "test_run.py::test_a_reactive_sequence_interrupts_the_running_child_when_an_earlier_one_fails",
    ),
    "fallback": ("test_run.py::test_a_fallback_goes_on_until_one_succeeds",),
    "reactive_fallback": ("test_run.py::test_a_reactive_fallback_gives_way_to_an_earlier_child",),
    "sequence_with_memory": (
        "test_new_nodes.py::test_a_sequence_with_memory_goes_on_with_the_failed_child",
    ),
    "parallel": (
        "test_run.py::test_a_parallel_fails_with_its_first_failure_and_interrupts_the_rest",
        "test_run.py::test_a_parallel_succeeds_on_one",
        "test_run.py::test_a_parallel_succeeds_on_a_number_of_children",
        "test_run.py::test_a_parallel_succeeds_on_chosen_children",
    ),
    "recovery": ("test_run.py::test_recovery_recovers_between_two_tries_only",),
    "if": (
        "test_new_nodes.py::test_if_chooses",
        "test_new_nodes.py::test_an_if_whose_condition_has_no_value_fails",
    ),
    "reactive_if": ("test_new_nodes.py::test_a_reactive_if_changes_sides",),
    "switch": ("test_new_nodes.py::test_switch_runs_the_case_of_the_value",),
    "round_robin": ("test_new_nodes.py::test_round_robin_takes_turns",),
    "pipeline_sequence": (
        "test_new_nodes.py::test_a_pipeline_goes_on_ticking_its_earlier_children",
    ),
    "check": ("test_run.py::test_check",),
    "wait_until": ("test_run.py::test_wait_until",),
    "wait": ("test_run.py::test_timeout_interrupts_on_the_runs_clock",),
    "set": ("test_run.py::test_set_computes",),
    "ask": (
        "test_ask.py::test_an_answer_is_written_and_ends_it",
        "test_ask.py::test_without_an_answer",
    ),
    "succeed": ("test_run.py::test_fail",),
    "fail": ("test_run.py::test_fail",),
    "untranslated": (
        "test_groot.py::test_an_element_without_counterpart_keeps_its_children_and_is_refused",
    ),
    "speed": ("test_speed_of_a_run.py::test_a_tree_slows_its_parts_and_one_in_another_multiply",),
    "timeout": ("test_run.py::test_timeout_is_for_each_try",),
    "invert": ("test_run.py::test_invert",),
    "force": ("test_run.py::test_force",),
    "delay": ("test_new_nodes.py::test_delay_waits_before_each_try",),
    "rate": ("test_new_nodes.py::test_rate_limits_the_starts_of_a_second",),
    "retry": (
        "test_run.py::test_the_number_is_that_of_all_tries",
        "test_run.py::test_only_for_some_codes",
        "test_run.py::test_on_failure_follows_each_failed_try_also_the_last",
        "test_run.py::test_a_failed_on_failure_ends_the_retry_with_both_reasons",
    ),
    "repeat": (
        "test_run.py::test_repeat",
        "test_run.py::test_repeat_for_ever",
    ),
    "for_each": (
        "test_run.py::test_for_each_hands_on_one_item_after_the_other",
        "test_run.py::test_for_each_of_nothing_succeeds",
    ),
    "run_once": ("test_new_nodes.py::test_run_once_is_skipped_from_then_on",),
    "guard": ("test_run.py::test_guard_interrupts",),
    "when": (
        "test_run.py::test_when_skips_in_a_sequence",
        "test_run.py::test_when_skips_in_a_fallback_and_the_failure_before_stays_in_sight",
    ),
    "disabled": ("test_ask.py::test_a_disabled_node_is_skipped",),
    "breakpoint": ("test_questions.py::test_breakpoints_of_the_file_hold_when_somebody_is_there",),
    "approve": (
        "test_approval.py::test_a_node_waits_until_somebody_approves",
        "test_approval.py::test_an_unapproved_node_does_not_start",
    ),
}
"""Tests of each word: the site shows a word's function from its class."""

IN_PAGE = set(re.findall(r"`(test_\w+\.py)::(\w+)`", PAGE))
NAMED = sorted(
    IN_PAGE | {tuple(proof.split("::")) for proofs in PROOFS.values() for proof in proofs}
)


@pytest.mark.parametrize(("file", "name"), NAMED, ids=lambda value: value)
def test_a_named_test_exists(file, name):
    assert re.search(rf"(def|class) {name}\b", next(HERE.parent.rglob(file)).read_text())


def test_every_row_of_a_table_with_proofs_has_one():
    rows = []
    for table in re.findall(r"(?:^\|[^\n]*\n)+", PAGE, re.MULTILINE):
        header, _, *lines = table.splitlines()
        rows += lines if header.endswith("| Proof |") else []
    assert len(rows) > 15
    assert [row for row in rows if "`test_" not in row] == []


def test_every_rule_names_its_proof():
    """Paragraphs, points and rows; but not headings, examples and the text before a table or an example."""
    rules = re.split(
        r"\n\n|\n(?=- |\|)", re.sub(r"```.*?```", "", PAGE.partition("\n## ")[2], flags=re.DOTALL)
    )
    rows = re.compile(r"\||#|\{words: |$")
    bare = [
        rule
        for rule in rules
        if "test_" not in rule and not rows.match(rule) and not rule.endswith(":")
    ]
    tables = [row for row in rules if re.match(r"\| `|\| an? |\| any ", row) and "test_" not in row]
    assert bare + tables == ["Nodes"]  # what is left of the first heading


def test_every_word_has_a_test():
    installed = NodeTypes.installed().values()
    assert set(PROOFS) == {
        found.key for found in installed if type(found).__module__.startswith("pomona.")
    }
    assert all(PROOFS.values())


def test_the_first_example_is_right(findings_of):
    example = re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[1]
    assert findings_of(example) == []
