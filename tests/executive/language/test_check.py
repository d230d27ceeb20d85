"""Every kind of mistake is found, at its place, with the correction."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from types import FrameType
from typing import Annotated

import numpy as np
import pytest
from numpy.typing import NDArray

from pomona.executive.language import check, format_finding, read
from pomona.executive.ports import FORCE, LENGTH, Ports
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill
from pomona.executive.values import findings
from pomona.executive.values.units import Array

HEAD = "pomona: 1\ntree: t\n"
DETECT = 'Detect: {fruit: apple, detection: "{detection}"}'
REFINE = 'Refine: {detection: "{detection}", measured: "{measured}"}'
SAMPLE = 'SampleGrasp: {around: "{measured}", candidates: "{candidates}"}'


def sequence(*nodes: str) -> str:
    return "root:\n  sequence:\n" + "".join(f"    - {node}\n" for node in nodes)


def only(findings, code, severity="error"):
    """The only finding, which has this code."""
    assert [(f.code, f.severity) for f in findings] == [(code, severity)], [
        format_finding(f) for f in findings
    ]
    return findings[0]


class TestNamesAreKnown:
    def test_unknown_skill(self, findings_of):
        found = only(findings_of(sequence(DETECT.replace("Detect", "Detekt"))), "unknown-skill")
        assert (found.line, found.column, found.length) == (5, 7, 6)
        assert "did you mean 'Detect'?" in found.hint

    def test_unknown_subtree(self, findings_of):
        body = "root: {percieve: {}}\nsubtrees:\n  perceive: {root: {Beep: {}}}"
        assert "did you mean 'perceive'?" in only(findings_of(body), "unknown-type-of-node").hint

    @pytest.mark.parametrize("node", ["Detekt: apple", "wiat: 1 s", "foobar: [1]"])
    def test_the_value_of_an_unknown_node_gives_no_second_error(self, findings_of, node):
        (found,) = findings_of(sequence(node))
        assert found.code in ("unknown-skill", "unknown-type-of-node")

    @pytest.mark.parametrize(
        ("node", "column"), [("MoveTo: home", 15), ("set: 5", 12), ("set:", 7), ("set: {}", 7)]
    )
    def test_ports_that_are_no_mapping_are_one_error(self, findings_of, node, column):
        assert only(findings_of(sequence(node)), "shape").column == column

    def test_unknown_port(self, findings_of):
        found = only(findings_of(sequence("Beep: {time: 3}")), "unknown-port")
        assert found.message == "Beep has no port 'time'"
        assert found.hint == "did you mean 'times'?"

    def test_missing_port(self, findings_of):
        assert "'pose', a text" in only(findings_of(sequence("MoveTo: {}")), "missing-port").message

    def test_a_port_s_name_of_the_version_before(self, findings_of):
        assert (
            only(findings_of(sequence("Beep: {rings: 3}")), "removed").hint
            == "it is called 'times' now"
        )

    def test_unknown_modifier(self, findings_of):
        found = only(findings_of("root:\n  Beep: {}\n  tmeout: 3 s"), "unknown-key")
        assert (found.line, found.column) == (5, 3)
        assert found.hint == "did you mean 'timeout'?"

    def test_unknown_key_at_the_top(self, findings_of):
        assert (
            only(findings_of("root: {Beep: {}}\nparamters: {}"), "unknown-key").hint
            == "did you mean 'parameters'?"
        )

    def test_unknown_type(self, findings_of):
        body = 'parameters: {d: {type: lenght, default: 3 mm}}\nroot: {Retreat: {distance: "{d}"}}'
        assert only(findings_of(body), "unknown-type").hint == "did you mean 'length'?"

    def test_unknown_name_in_braces(self, findings_of):
        body = (
            'parameters: {far: {type: length, default: 1 cm}}\nroot: {Retreat: {distance: "{fra}"}}'
        )
        assert only(findings_of(body), "unknown-port").hint == "did you mean 'far'?"

    def test_unknown_field(self, findings_of):
        body = sequence(DETECT, 'check: "{detection.scroe} > 0.5"')
        found = only(findings_of(body), "unknown-field")
        assert found.hint == "did you mean 'score'?"
        assert found.line == 6

    def test_one_unknown_skill_is_one_finding(self, findings_of):
        body = sequence(
            'Detec: {detection: "{detection}"}',
            REFINE,
            SAMPLE,
            'check: "len({candidates.grasps}) > 0"',
        )
        only(findings_of(body), "unknown-skill")

    def test_a_name_can_be_taken_only_once(self, findings_of):
        found = only(
            findings_of(sequence("{Beep: {}, name: A}", "{Beep: {}, name: A}")), "duplicate-name"
        )
        assert "line 5" in found.message

    def test_duplicate_key(self, findings_of):
        assert only(findings_of("root: {Beep: {times: 1, times: 2}}"), "duplicate-key").line == 3


class TestTypesFit:
    def test_wrong_type_names_its_writer(self, findings_of):
        body = sequence(
            DETECT,
            SAMPLE.replace("{measured}", "{detection}"),
            'check: "len({candidates.grasps}) > 0"',
        )
        found = only(findings_of(body), "port-type")
        assert found.message == (
            "SampleGrasp.around takes a fruit_pose, '{detection}' is a detection (written by Detect, line 5)"
        )
        assert (found.line, found.column) == (6, 29)

    @pytest.mark.parametrize(
        ("node", "message"),
        [
            ("Retreat: {distance: 3}", "'3' lacks a unit"),
            ("Retreat: {distance: 3 deg}", "'deg' is no unit of length"),
            ("Beep: {times: 2.5}", "not a whole number"),
            ("Beep: {loud: yes}", "not a bool"),
            (f"Aim: {{share: {'9' * 400}}}", "'999999999999…99999999' is too large for a number"),
            ("Aim: {pose: {position: [1e400, 0, 0]}}", "'1e400' is too large for a number"),
            ("Aim: {pose: {position: [1e400 m, 0, 0]}}", "'1e400 m' is too large for a length"),
            ("MoveTo: {pose: [1, 2]}", "a text is needed here, this is a list"),
            ("Aim: {hold: hard}", "not a hold"),
            ("Aim: {grasp: {idx: 1}}", "no field 'idx'"),
            ("Aim: {grasp: {width: 1 mm}}", "also needs index"),
            ("Aim: {pose: {position: [1, 2]}}", "position has 3 numbers"),
        ],
    )
    def test_literals(self, findings_of, node, message):
        assert message in only(findings_of(sequence(node)), "value").message

    def test_choices(self, findings_of):
        node = DETECT.replace("apple,", "apple, policy: neerest,")
        found = only(findings_of(sequence(node, 'check: "{detection.score} > 0"')), "value")
        assert found.hint == "did you mean 'nearest'?"

    def test_two_writers_of_different_types(self, findings_of):
        body = sequence(DETECT, REFINE.replace("{measured}", "{detection}"))
        found = findings_of(body)[0]
        assert found.code == "port-type"
        assert "written by Detect, line 5" in found.message

    def test_outputs_cannot_write_parameters(self, findings_of):
        body = "parameters: {detection: {type: int, default: 1}}\n" + sequence(DETECT)
        only(findings_of(body), "read-only")

    def test_outputs_are_wired_to_names(self, findings_of):
        only(findings_of(sequence("Detect: {fruit: apple, detection: here}")), "output")

    def test_forgotten_quotes(self, findings_of):
        body = "parameters: {n: {type: int, default: 1}}\nroot: {Beep: {times: {n}}}"
        assert only(findings_of(body), "shape").hint == 'write "{n}"'

    @pytest.mark.parametrize(
        ("condition", "message"),
        [
            ("{detection.score}", "takes true or false, this is a number in SI"),
            ("{detection.score} > high", "compares numbers, this is a text"),
            ("{detection} == 3", "cannot be compared"),
            ("1 + 3 mm > 2", "cannot be added"),
            ("3 mm < 2", "cannot be compared"),
            ("1 in 2", "takes a list"),
            ("{detection.index[0]} == 1", "has no elements"),
            ("not 1", "takes true or false"),
            ("len({detection}) > 1", "len takes a list"),
            ("3 mm * 2 mm > 1 mm", "cannot be multiplied"),
        ],
    )
    def test_expressions(self, findings_of, condition, message):
        findings = findings_of(
            sequence(DETECT, f'check: "{condition} or {{detection.index}} == 0"')
        )
        assert findings[0].code == "expression-type"
        assert message in findings[0].message

    def test_syntax_of_expressions(self, findings_of):
        assert "too large" in only(findings_of("root: {check: '1e400 > 1'}"), "expression").message
        found = only(findings_of("root: {check: '1 > > 1'}"), "expression")
        assert (found.line, found.column) == (3, 20)

    @pytest.mark.parametrize(
        ("condition", "column"),
        [("1 / 0 > 1", 20), ("{n} > 3 / (1 - 1)", 27), ("1 / {zero} > 1 mm / 2 mm", 21)],
    )
    def test_a_division_by_zero(self, findings_of, condition, column):
        body = f"constants: {{zero: 0, n: 5}}\nroot: {{check: '{condition}'}}"
        found = next(f for f in findings_of(body) if f.severity == "error")
        assert (found.code, found.line, found.column) == ("division", 4, column)


class TestRanges:
    def test_literal(self, findings_of):
        found = only(findings_of(sequence("Beep: {times: 11}")), "range")
        assert found.message == "Beep.times is at most 10, 11 is above"

    def test_quantity(self, findings_of):
        nodes = (DETECT, REFINE, SAMPLE.replace("candidates:", "radius: 5 mm, candidates:"))
        found = only(
            findings_of(sequence(*nodes, 'check: "len({candidates.grasps}) > 0"')), "range"
        )
        assert found.message == "SampleGrasp.radius is at least 20 mm, 5 mm is below"

    @pytest.mark.parametrize(
        ("written", "said"),
        [("0.0051 m", "0.02 m, 0.0051 m"), ("0.1 cm", "2 cm, 0.1 cm")],
    )
    def test_unit_of_the_file(self, findings_of, written, said):
        nodes = (DETECT, REFINE, SAMPLE.replace("candidates:", f"radius: {written}, candidates:"))
        found = only(
            findings_of(sequence(*nodes, 'check: "len({candidates.grasps}) > 0"')), "range"
        )
        assert found.message == f"SampleGrasp.radius is at least {said} is below"

    def test_parameter_that_is_wired(self, findings_of):
        body = 'parameters: {n: {type: int, default: 3}}\nroot: {Beep: {times: "{n}"}}'
        assert findings_of(body) == []
        assert only(findings_of(body, overrides=["n=12"]), "range").message.startswith(
            "Beep.times is at most 10"
        )

    def test_default_of_a_parameter(self, findings_of):
        body = 'parameters: {n: {type: int, default: 0, min: 1}}\nroot: {Beep: {times: "{n}"}}'
        assert "at least 1" in findings_of(body)[0].message

    def test_number_of_tries(self, findings_of):
        only(findings_of("root:\n  MoveTo: {pose: home}\n  retry: 0"), "range")


class TestEverythingIsWrittenBeforeItIsRead:
    def test_wrong_order(self, findings_of):
        found = only(
            findings_of(sequence(REFINE, DETECT, 'check: "{measured.inlier_ratio} > 0"')), "unset"
        )
        assert (
            found.message
            == "Refine reads 'detection', which may not be written yet (Detect writes it, line 6)"
        )

    def test_one_branch_of_a_fallback_does_not_write(self, findings_of):
        body = (
            "root:\n  sequence:\n    - fallback:\n"
            f"        - {DETECT}\n        - MoveTo: {{pose: home}}\n    - {REFINE}\n"
            '    - check: "{measured.inlier_ratio} > 0"\n'
        )
        assert only(findings_of(body), "unset").line == 8

    def test_every_branch_of_a_fallback_writes(self, findings_of):
        body = (
            f"root:\n  sequence:\n    - fallback:\n        - {DETECT}\n        - {DETECT}\n    - {REFINE}\n"
            '    - check: "{measured.inlier_ratio} > 0"\n'
        )
        assert findings_of(body) == []

    def test_a_skipped_node_writes_nothing(self, findings_of):
        body = sequence(
            f'{{{DETECT}, when: "1 == 2"}}', REFINE, 'check: "{measured.inlier_ratio} > 0"'
        )
        only(findings_of(body), "unset")

    def test_a_failed_node_that_was_forced_to_succeed(self, findings_of):
        body = sequence(
            f"{{{DETECT}, force: success}}", REFINE, 'check: "{measured.inlier_ratio} > 0"'
        )
        only(findings_of(body), "unset")

    def test_children_of_a_parallel_do_not_wait_for_each_other(self, findings_of):
        body = f"root:\n  parallel:\n    - {DETECT}\n    - {REFINE}\n"
        assert {f.code for f in findings_of(body)} == {"unset", "unread"}

    def test_names_that_a_whole_parallel_writes_are_written_after_it(self, findings_of):
        body = f"root:\n  sequence:\n    - parallel:\n        - {DETECT}\n        - Beep: {{}}\n    - {REFINE}\n"
        only(findings_of(body), "unread", "warning")

    def test_a_race_writes_only_the_names_that_every_child_writes(self, findings_of):
        body = (
            f"root:\n  sequence:\n    - parallel:\n        - {DETECT}\n        - MoveTo: {{pose: home}}\n"
            f"      success_on: one\n    - {REFINE}\n"
        )
        assert {f.code for f in findings_of(body)} == {"unset", "unread"}

    @pytest.mark.parametrize(("number", "is_written"), [(1, False), (2, True), (3, True)])
    def test_of_a_number_of_children_only_names_that_any_such_number_writes_are_written(
        self, findings_of, number, is_written
    ):
        children = f"        - {DETECT}\n        - {DETECT}\n        - MoveTo: {{pose: home}}\n"
        body = (
            f"root:\n  sequence:\n    - parallel:\n{children}      success_on: {number}\n    - {REFINE}\n"
            "    - check: '{measured.inlier_ratio} > 0'\n"
        )
        assert ("unset" not in {f.code for f in findings_of(body)}) == is_written

    @pytest.mark.parametrize("number", ["0", "3"])
    def test_a_number_of_children_that_there_are_not(self, findings_of, number):
        body = f"root:\n  parallel: [{{Beep: {{}}}}, {{Beep: {{}}}}]\n  success_on: {number}"
        assert "at most 2" in only(findings_of(body), "range").message

    def test_an_optional_input_may_be_fed_back_in_a_retry(self, findings_of):
        plan = 'Plan: {to: "{candidates}", grasp: "{grasp}", path: "{path}"}'
        sample = SAMPLE.replace("candidates:", 'tried: "{grasp}", candidates:')
        attempt = (
            f"{{sequence: [{{{sample}}}, {{{plan}}}, {{Follow: {{path: '{{path}}'}}}}], retry: 3}}"
        )
        assert findings_of(sequence(DETECT, REFINE, attempt)) == []

    def test_a_node_that_computes_may_fail_before_it_has_written(self, findings_of):
        body = (
            "root:\n  sequence:\n    - set: {n: 1}\n    - fallback:\n        - set: {m: '1 / {n}'}\n"
            "        - Beep: {}\n    - check: '{m} > 0'\n"
        )
        assert "unset" in {f.code for f in findings_of(body)}

    def test_an_item_is_known_inside_its_loop_only(self, findings_of):
        loop = "{Approach: {grasp: '{grasp}'}, for_each: '{candidates.grasps}', as: grasp}"
        assert findings_of(sequence(DETECT, REFINE, SAMPLE, loop)) == []
        after = findings_of(sequence(DETECT, REFINE, SAMPLE, loop, "Approach: {grasp: '{grasp}'}"))
        only(after, "unset")

    def test_nested_loops_have_items_of_their_own(self, findings_of):
        inner = "{Beep: {times: '{item}'}, for_each: [1, 2]}"
        found = only(
            findings_of(f"root: {{sequence: [{inner}], for_each: [1, 2]}}"), "duplicate-name"
        )
        assert "for_each around" in found.message
        named = inner.replace("for_each: [1, 2]", "for_each: [1, 2], as: n").replace(
            "{item}", "{n} * {item}"
        )
        assert findings_of(f"root: {{sequence: [{named}], for_each: [1, 2]}}") == []

    def test_outputs_of_subtrees_are_written_on_every_path(self, findings_of):
        body = (
            'root: {look: {detection: "{d}"}}\nsubtrees:\n  look:\n    out: {detection: detection}\n'
            f"    root:\n      fallback:\n        - {DETECT}\n        - MoveTo: {{pose: home}}\n"
        )
        assert "may succeed without having written" in findings_of(body)[0].message

    def test_outputs_of_subtrees_have_their_declared_type(self, findings_of):
        body = (
            'root: {look: {detection: "{d}"}}\nsubtrees:\n  look:\n    out: {detection: grasp}\n'
            f"    root:\n      {DETECT}\n"
        )
        assert "port-type" in {f.code for f in findings_of(body)}

    def test_an_output_without_a_reader(self, findings_of):
        found = only(findings_of(sequence(DETECT)), "unread", "warning")
        assert found.message == "no node reads 'detection', which Detect writes"

    def test_a_parameter_without_a_reader(self, findings_of):
        body = "parameters: {far: {type: int, default: 1}}\nroot: {Beep: {}}"
        assert "parameter 'far'" in only(findings_of(body), "unread", "warning").message

    def test_an_input_without_a_reader(self, findings_of):
        body = "root: {a: {x: 3}}\nsubtrees: {a: {in: {x: int}, root: {Beep: {}}}}"
        assert "input 'x'" in only(findings_of(body), "unread", "warning").message

    def test_a_subtree_without_a_caller(self, findings_of):
        only(
            findings_of("root: {Beep: {}}\nsubtrees: {a: {root: {Beep: {}}}}"), "unused", "warning"
        )


class TestStructure:
    def test_recursion(self, findings_of):
        body = "root: {a: {}}\nsubtrees:\n  a: {root: {b: {}}}\n  b: {root: {sequence: [{a: {}}]}}"
        assert "a → b → a" in only(findings_of(body), "recursion").message

    def test_device_that_the_cell_lacks(self, findings_of, skills):
        (arm,) = skills["MoveTo"].devices
        (camera,) = skills["Detect"].devices
        body = sequence("MoveTo: {pose: home}")
        assert findings_of(body, interfaces=(arm, camera)) == []
        found = only(findings_of(body, interfaces=(camera,)), "no-device")
        assert found.message == "the cell has no Arm, which MoveTo needs"

    def test_a_device_that_the_cell_lacks_is_reported_once_with_the_nodes_that_need_it(
        self, findings_of, skills
    ):
        (camera,) = skills["Detect"].devices
        body = sequence(*["MoveTo: {pose: home}"] * 17)
        found = only(findings_of(body, interfaces=(camera,)), "no-device")
        message, _, lines = found.message.partition(", the first in lines ")
        assert message == "the cell has no Arm, which MoveTo needs (17 nodes need it"
        first = [int(word) for word in lines.removesuffix(")").split(", ")]
        assert first == [found.line, found.line + 1, found.line + 2]

    def test_retry_around_a_node_that_cannot_fail(self, findings_of):
        only(findings_of("root:\n  Beep: {}\n  retry: 3"), "cannot-fail", "warning")
        only(
            findings_of("root:\n  fallback: [{MoveTo: {pose: a}}, {Beep: {}}]\n  retry: 3"),
            "cannot-fail",
            "warning",
        )

    def test_a_child_that_is_never_reached(self, findings_of):
        only(
            findings_of("root: {fallback: [{Beep: {}}, {MoveTo: {pose: a}}]}"),
            "unreachable",
            "warning",
        )

    def test_two_types_in_one_node(self, findings_of):
        only(findings_of("root: {Beep: {}, MoveTo: {pose: a}}"), "two-types")

    def test_no_type(self, findings_of):
        only(findings_of("root: {timeout: 3 s}"), "no-type")

    def test_a_node_that_is_a_word(self, findings_of):
        assert only(findings_of("root: Beep"), "shape").hint == "write 'Beep: {}'"

    def test_children_that_are_no_list(self, findings_of):
        only(findings_of("root: {sequence: {Beep: {}}}"), "shape")

    @pytest.mark.parametrize("value", ["[]", "[a]", "{a: 1}", ""])
    def test_a_switch_over_no_single_value(self, findings_of, value):
        found = only(
            findings_of(f"root:\n  switch: {value}\n  cases: {{a: {{Beep: {{}}}}}}\n"), "shape"
        )
        assert "'switch' takes a single value" in found.message
        assert found.line == 4

    @pytest.mark.parametrize(
        ("head", "value"),
        [
            ("parameters: {reach: {type: length, default: 20 mm}}", '"{reach}"'),
            ("parameters: {reach: {type: length, default: 20 mm}}", '"{reach} * 2"'),
            ("constants: {reach: 20 mm}", '"{reach}"'),
            ("", "20 mm"),
        ],
    )
    def test_a_switch_over_a_quantity(self, findings_of, head, value):
        found = only(
            findings_of(f"{head}\nroot:\n  switch: {value}\n  cases: {{20 mm: {{Beep: {{}}}}}}\n"),
            "port-type",
        )
        assert "a case has no unit" in found.message

    def test_on_failure_without_retry(self, findings_of):
        only(findings_of("root:\n  MoveTo: {pose: a}\n  on_failure: {Beep: {}}"), "missing-key")

    def test_failure_where_none_is_in_sight(self, findings_of):
        only(
            findings_of('root:\n  MoveTo: {pose: a}\n  when: "failure.code == NO_PATH"'),
            "no-failure",
        )

    def test_code_that_the_failure_never_has(self, findings_of):
        body = 'root:\n  fallback:\n    - MoveTo: {pose: a}\n    - Beep: {}\n      when: "failure.code in [NO_PAHT]"'
        assert only(findings_of(body), "unknown-code").hint == "did you mean 'NO_PATH'?"

    def test_a_code_by_its_name_of_the_version_before(self, findings_of):
        body = 'root:\n  fallback:\n    - Lift: {hold: "{h}"}\n    - Beep: {}\n      when: "failure.code == FELL"'
        found = [found for found in findings_of(body) if found.code == "removed"]
        assert [f.hint for f in found] == ["it is called 'DROPPED' now"]

    def test_a_renamed_code_that_the_failure_never_has(self, findings_of):
        body = 'root:\n  fallback:\n    - MoveTo: {pose: a}\n    - Beep: {}\n      when: "failure.code == FELL"'
        assert "DROPPED" not in only(findings_of(body), "unknown-code").hint

    def test_counter_of_no_retry(self, findings_of):
        only(findings_of('root: {MoveTo: {pose: a, variation: "{retry.attempt}"}}'), "no-counter")

    def test_broken_skill(self, skills):
        from pomona.executive.language import check, read
        from pomona.executive.registry import Registry

        problem = "scale:Weigh cannot be imported: ImportError: no scale"
        broken = Registry({**skills, "Weigh": lambda: problem})
        found = check(read("pomona: 1\ntree: t\nroot: {Weigh: {}}", "t.yaml"), broken)
        assert "no scale" in only(found, "broken-skill").message

    def test_exploding_subtrees(self, findings_of):
        body = "root: {s0: {}}\nsubtrees:\n" + "".join(
            f"  s{i}: {{root: {{sequence: [{{s{i + 1}: {{}}}}, {{s{i + 1}: {{}}}}]}}}}\n"
            for i in range(30)
        )
        only(findings_of(body + "  s30: {root: {Beep: {}}}\n"), "too-large")

    def test_deep_subtrees(self, findings_of):
        body = "root: {s0: {}}\nsubtrees:\n" + "".join(
            f"  s{i}: {{root: {{s{i + 1}: {{}}}}}}\n" for i in range(300)
        )
        only(findings_of(body + "  s300: {root: {Beep: {}}}\n"), "too-deep")


class TestOverrides:
    BODY = 'parameters: {far: {type: length, default: 1 cm, max: 1 m}}\nroot: {Retreat: {distance: "{far}"}}'

    @pytest.mark.parametrize(
        ("override", "message"),
        [
            ("far=20", "lacks a unit"),
            ("fra=2 mm", "no parameter 'fra'"),
            ("far", "write --set name=value"),
            ("far=2 m", "at most 1 m"),
            ("far=", "is not a length"),
        ],
    )
    def test_wrong(self, findings_of, override, message):
        found = only(findings_of(self.BODY, overrides=[override]), "set")
        assert message in found.message
        assert found.path.startswith("--set ")

    def test_right(self, built):
        assert built(self.BODY, overrides={"far": "2 cm"}).tree.parameters == {"far": 0.02}

    def test_parameter_without_a_value(self, findings_of):
        body = 'parameters: {far: {type: length}}\nroot: {Retreat: {distance: "{far}"}}'
        assert "--set far=" in only(findings_of(body), "no-value").hint
        assert findings_of(body, overrides=["far=1 cm"]) == []


def test_a_finding_reads_like_a_compilers(findings_of):
    text = format_finding(findings_of(sequence(DETECT.replace("Detect", "Detekt")))[0])
    assert text == (
        "t.yaml:5:7: error[unknown-skill]: no skill named 'Detekt'; did you mean 'Detect'?\n"
        '    5 |     - Detekt: {fruit: apple, detection: "{detection}"}\n'
        "      |       ^^^^^^"
    )


def test_a_file_of_a_thousand_nodes_takes_its_share_of_work_and_not_the_square_of_it(findings_of):
    """Work is counted in calls of functions, independent of the load of the machine."""
    node = '{fallback: [{MoveTo: {pose: a}, retry: 2}, {MoveTo: {pose: b}, when: "failure.code == NO_PATH"}]}'

    def calls(nodes: int) -> int:
        counted = 0

        def count(_frame: FrameType, event: str, _argument: object) -> None:
            nonlocal counted
            counted += event == "call"

        body = "root:\n  sequence:\n" + f"    - {node}\n" * (nodes // 3)
        sys.setprofile(count)
        try:
            found = findings_of(body)
        finally:
            sys.setprofile(None)
        assert found == []
        return counted

    calls(100)  # what is imported at the first use is no part of it
    assert calls(1000) < 11.0 * calls(100)


def test_suggestions_are_searched_while_few_words_are_wrong(findings_of, monkeypatch):
    compared = []
    monkeypatch.setattr(
        findings,
        "get_close_matches",
        lambda word, known, **_: compared.append(len(known)) or known[:1],
    )
    monkeypatch.setattr(findings, "MAX_COMPARED", 1000)
    subtrees = "".join(f"  subtree{i}: {{root: {{Beep: {{}}}}}}\n" for i in range(200))
    root = "root:\n  sequence:\n" + "".join(f"    - sabtree{i}: {{}}\n" for i in range(300))
    found = [
        f for f in findings_of(f"subtrees:\n{subtrees}{root}") if f.code == "unknown-type-of-node"
    ]
    assert len(found) == 300
    assert "did you mean" in found[0].hint
    assert "did you mean" not in found[-1].hint
    assert sum(compared) < 2000


def test_all_mistakes_are_found_in_one_pass(findings_of, pick_apple):
    wrong = (
        pick_apple.replace("Refine:", "Refien:")
        .replace("150 mm", "150")
        .replace("timeout: 5 s", "timeout: 5")
    )
    assert [f.code for f in findings_of(wrong)] == ["value", "value", "unknown-skill"]


class TestTimesFit:
    @pytest.mark.parametrize(
        ("node", "message"),
        [
            (
                "{wait: 10 s, timeout: 5 s}",
                "wait takes 10 s at least and is always interrupted after 5 s",
            ),
            ("{sequence: [{wait: 3 s}, {wait: 3 s}], timeout: 5 s}", "takes 6 s at least"),
            ("{wait: 1 s, timeout: 0 s}", "a timeout of 0 s interrupts everything"),
        ],
    )
    def test_a_timeout_that_always_strikes(self, findings_of, node, message):
        assert message in only(findings_of(sequence(node)), "too-short", "warning").message


class TestWhatIsNeverReached:
    @pytest.mark.parametrize(
        "nodes",
        [("fail: {}", "Beep: {}"), ("{Beep: {}, repeat: forever}", "Beep: {}"),
         ("{sequence: [{Beep: {}}, {fail: {code: X}}]}", "Beep: {}"), ("{Beep: {}, force: failure}", "Beep: {}")],
    )  # fmt: skip
    def test_after_a_node_that_cannot_succeed(self, findings_of, nodes):
        assert only(findings_of(sequence(*nodes)), "unreachable", "warning").line == 6


class TestFieldsHaveUnitsAndLengths:
    @pytest.mark.parametrize(
        ("condition", "code", "message"),
        [
            ("{m.size[0]} > 3 kg", "expression-type", "a length and a mass cannot be compared"),
            ("{m.size[0]} > 3", "expression-type", "a length and an int cannot be compared"),
            ("{m.size[3]} > 3 mm", "no-element", "there is no element 3: this has 3"),
            ("{m.size[-4]} > 3 mm", "no-element", "there is no element -4: this has 3"),
            ("{m.pose[0][4]} > 0", "no-element", "there is no element 4: this has 4"),
            ("{m.push} > 3 mm", "expression-type", "a force and a length cannot be compared"),
            ("{m.pair[2]} > 3 N", "no-element", "there is no element 2: this has 2"),
        ],
    )
    def test_a_wrong_comparison_is_reported(self, measuring, condition, code, message):
        assert only(measuring(condition), code).message == message

    @pytest.mark.parametrize(
        "condition",
        ["{m.size[2]} > 3 mm", "{m.size[-3]} > 3 mm", "{m.pose[0][3]} > 1 mm", "{m.push} > 1 N", "{m.pair[1]} > 1 N",
         "max({m.size[0]}, {m.size[1]}) > 3 cm"],
    )  # fmt: skip
    def test_numbers_and_elements_of_arrays_are_compared(self, measuring, condition):
        assert measuring(condition) == []

    def test_an_array_enters_a_port_for_arrays(self, measuring):
        assert measuring("true", 'Aim: {pose: "{m.pose}"}') == []
        assert measuring("true", 'Lift: {height: "{m.size[0]}", hold: firm}') == []


@pytest.fixture
def measuring(skills):
    """Findings of a condition about `m`, whose fields have units."""

    @dataclass(frozen=True)
    class Measured:
        size: Annotated[NDArray[np.float64], Array(3, of=LENGTH)]
        pose: Annotated[NDArray[np.float64], Array(4, 4)]
        push: Annotated[float, FORCE]
        pair: tuple[Annotated[float, FORCE], Annotated[float, FORCE]]

    class Measure(Skill):
        """Returns values with units."""

        outputs = Ports(m=Measured)

        def run(self, **inputs: object) -> None:
            return None

    known = Registry({**skills, "Measure": Measure})

    def find(condition: str, *more: str):
        body = sequence(
            'Measure: {m: "{m}"}', f'check: "{condition}"', 'check: "{m.push} > 0 N"', *more
        )
        return check(read(HEAD + body, "t.yaml"), known)

    return find


@pytest.mark.parametrize(
    "text", ["\tBeep: {}", "  sequence:\n  \t- Beep: {}", "  Beep: {}\n\t  timeout: 2 s"]
)
def test_a_tab_is_called_by_its_name(findings_of, text):
    found = only(findings_of(f"root:\n{text}\n"), "tab")
    assert found.message == "a tab indents this line, and YAML indents with spaces only"


@pytest.mark.parametrize(
    ("sign", "name"),
    [("\u00a0", "U+00A0 (no-break space)"), ("\u3000", "U+3000 (ideographic space)")],
)
@pytest.mark.parametrize(
    "place",
    ["  Beep:{}{{}}", "{}{}Beep: {{}}", "  sequence:\n    - Beep: {{}}\n      timeout: 2{}s"],
)
def test_a_sign_that_only_looks_like_a_space_is_called_by_its_name_and_replaced(
    findings_of, sign, name, place
):
    wrong, right = (place.format(*[space] * 2) for space in (sign, " "))
    found = only(findings_of(f"root:\n{wrong}\n"), "space")
    assert found.message == f"{name} is no space in YAML: put a space in its place"
    (line,) = [k for k, text in enumerate(wrong.split("\n")) if sign in text]
    fixed = list(wrong.split("\n")[line])
    for edit in found.edits:
        fixed[edit.column - 1] = edit.text
    assert "".join(fixed) == right.split("\n")[line]


def test_a_sign_that_looks_like_a_space_may_stand_in_a_text(findings_of):
    assert findings_of('description: "5\u00a0N\n  and 6\u00a0N"\nroot:\n  Beep: {times: 2}\n') == []
    assert findings_of("description: |\n  5\u00a0N\nroot:\n  Beep: {times: 2}\n") == []
    assert findings_of("# a\u00a0note\nroot:\n  Beep: {times: 2}  # 5\u00a0N\n") == []


def test_a_tab_that_only_stands_between_words_is_no_mistake(findings_of):
    assert findings_of("root:\n  Beep:\t{times: 2}\n") == []
