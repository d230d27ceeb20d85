"""Conditions that can never hold, and those that contradict earlier ones, are reported; all others are not."""

from __future__ import annotations

import pytest

PARAMETER = "parameters: {n: {type: int, default: 3}, mode: {type: text, default: a}}\n"


def tree(*nodes: str, composite: str = "sequence", head: str = "") -> str:
    return f"{head}root:\n  {composite}:\n" + "".join(f"    - {node}\n" for node in nodes)


def told(findings) -> list[str]:
    about = ("never-holds", "contradiction", "never-changes")
    return [finding.code for finding in findings if finding.code in about]


COUNT = 'set: {k: "{retry.attempt}"}'


def after(*nodes: str, composite: str = "sequence") -> str:
    """Nodes after one that writes `k`, which is not known before the run."""
    inner = "".join(f"        - {node}\n" for node in nodes)
    return f"root:\n  sequence:\n    - {COUNT}\n    - {composite}:\n{inner}  retry: 2\n"


class TestWhatCanNeverHold:
    @pytest.mark.parametrize(
        "condition",
        [
            "{k} > 2 and {k} < 1",
            "{k} >= 2 and {k} < 2",
            "{k} == 3 and {k} != 3",
            "{k} == 3 and ({k} > 5 or {k} < 2)",
            "{k} in [1, 2] and {k} in [3, 4]",
            "not ({k} > 1 or {k} < 3)",
            "{k} > 2 and 1 > {k}",
            "abs({k}) < 0",
            "abs({k} - 1) > 3 and abs({k}-1) < 2",
        ],
    )
    def test_in_one_condition(self, findings_of, condition):
        assert told(findings_of(after(f'check: "{condition}"'))) == ["never-holds"]

    @pytest.mark.parametrize(
        "condition",
        ["{k} > 2 and {k} < 4", "{k} >= 2 and {k} <= 2", "{k} == 3 or {k} == 4", "{k} != 3 and {k} != 4",
         "{k} > 1 and abs({k}) > 0", "{k} in [1, 2] and {k} in [2, 3]", "not ({k} > 3 and {k} < 1)"],
    )  # fmt: skip
    def test_a_sufficient_grip_is_not_reported(self, findings_of, condition):
        assert told(findings_of(after(f'check: "{condition}"'))) == []

    def test_a_switch_in_the_parameters_is_no_mistake(self, findings_of):
        body = tree(
            '{Beep: {times: "{n}"}, when: "{mode} == b"}', 'check: "{n} > 5"', head=PARAMETER
        )
        assert told(findings_of(body)) == []


class TestWordsAlone:
    @pytest.mark.parametrize(
        ("condition", "said"),
        [
            ("outcome != moved", "'outcome != moved' compares two words and always holds"),
            ("{k} > 1 and mode == b", "'mode == b' compares two words and can never hold"),
        ],
    )
    def test_a_comparison_of_two_words_reads_no_value(self, findings_of, condition, said):
        found = [
            finding
            for finding in findings_of(after(f'check: "{condition}"'))
            if finding.code == "words-alone"
        ]
        assert [finding.message for finding in found] == [said]
        assert found[0].hint == "a value stands in braces: '{name}'"

    @pytest.mark.parametrize(
        "condition", ["{mode} == b", "b == {mode}", "true", "1 < 2", "{mode} in [a, b]"]
    )
    def test_others_are_not_reported(self, findings_of, condition):
        body = tree(f'check: "{condition}"', head=PARAMETER)
        assert not any(finding.code == "words-alone" for finding in findings_of(body))


class TestContradictions:
    @pytest.mark.parametrize(
        ("first", "second"),
        [
            ('check: "{k} > 2"', 'check: "{k} < 1"'),
            ('check: "{k} == 2"', 'check: "{k} in [3, 4]"'),
            ("set: {j: 1}", 'check: "{j} > 2"'),
            ('check: "{k} > 2"', '{MoveTo: {pose: home}, when: "{k} < 1"}'),
            ('wait_until: "{k} > 2"', 'check: "{k} < 1"'),
            ('{MoveTo: {pose: home}, guard: "{k} > 2"}', 'check: "{k} < 1"'),
        ],
    )
    def test_the_second_names_the_first(self, findings_of, first, second):
        findings = findings_of(after(first, "Beep: {}", second))
        assert "contradiction" in told(findings)
        found = next(finding for finding in findings if finding.code == "contradiction")
        assert "(line 7)" in found.message
        assert (found.line, found.severity) == (9, "warning")

    def test_a_write_between_ends_it(self, findings_of):
        assert (
            told(findings_of(after('check: "{k} > 2"', 'set: {k: "{k} - 2"}', 'check: "{k} < 1"')))
            == []
        )

    def test_alternatives_are_no_contradiction(self, findings_of):
        assert (
            told(findings_of(after('check: "{k} > 2"', 'check: "{k} < 1"', composite="fallback")))
            == []
        )

    def test_the_other_side_of_an_if_does_not_hold(self, findings_of):
        node = '{{if: "{{k}} > 2", then: {{check: "{{k}} {}"}}, else: {{check: "{{k}} < 1"}}}}'
        assert told(findings_of(after(node.format("< 1")))) == ["contradiction"]
        assert told(findings_of(after(node.format("> 5")))) == []

    def test_a_node_that_may_have_been_skipped_proves_nothing(self, findings_of):
        body = after('{check: "{k} > 2", when: "{k} != 7"}', 'check: "{k} < 1"')
        assert told(findings_of(body)) == []

    def test_a_value_that_lives_may_change_while_time_passes(self, findings_of):
        detect, first = 'Detect: {fruit: apple, detection: "{d}"}', 'check: "{d.index} > 2"'
        assert told(findings_of(tree(detect, first, 'check: "{d.index} < 1"'))) == ["contradiction"]
        assert told(findings_of(tree(detect, first, "wait: 1 s", 'check: "{d.index} < 1"'))) == []

    def test_beside_a_child_that_writes_nothing_is_sure(self, findings_of):
        child = 'sequence: [{check: "{k} > 2"}, {wait: 1 s}, {check: "{k} < 1"}]'
        assert told(findings_of(after(child, 'set: {k: "{k} + 1"}', composite="parallel"))) == []

    def test_a_round_of_a_repeat_does_not_know_the_last_one(self, findings_of):
        body = after('check: "{k} > 2"', '{sequence: [{set: {j: 1}}, {set: {k: "{k} - 1"}}], repeat: 5}',
                     'check: "{k} < 1"', 'check: "{j} > 0"')  # fmt: skip
        assert told(findings_of(body)) == []


class TestWaiting:
    def test_for_a_condition_that_is_never_true(self, findings_of):
        assert told(findings_of(tree('wait_until: "1 > 2"', "Beep: {}"))) == ["never-holds"]
        assert told(findings_of(tree('wait_until: "{n} > 5"', head=PARAMETER))) == ["never-holds"]
        assert told(
            findings_of(tree('wait_until: "{n} > 5"', head=PARAMETER), overrides=["n=6"])
        ) == ["never-changes"]

    def test_for_a_name_without_a_writer(self, findings_of):
        found = findings_of(after('wait_until: "{k} > 5"'))
        assert told(found) == ["never-changes"]

    def test_for_a_name_that_another_child_writes(self, findings_of):
        assert (
            told(
                findings_of(
                    after('wait_until: "{k} > 5"', 'set: {k: "{k} + 1"}', composite="parallel")
                )
            )
            == []
        )
        reactive = after(
            'set: {k: "{k} + 1"}', 'wait_until: "{k} > 5"', composite="reactive_sequence"
        )
        assert told(findings_of(reactive)) == []

    def test_for_a_value_that_lives(self, findings_of):
        body = tree('Detect: {fruit: apple, detection: "{d}"}', 'wait_until: "{d.index} > 2"')
        assert told(findings_of(body)) == []
