"""Behaviour of each word of the language in a running tree."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.executive.language import TreeFileError
from pomona.executive.reasons import reason_of


def move(name, **modifiers):
    rest = "".join(f", {key}: {value}" for key, value in modifiers.items())
    return f"{{MoveTo: {{pose: {name}}}, name: {name}{rest}}}"


def starts(run, *names):
    return [run.skill(f"t/{name}").starts for name in names]


class TestBranches:
    def test_a_sequence_remembers_where_it_is(self, built):
        run = built(f"root: {{sequence: [{move('A')}, {move('B')}]}}")
        assert run.run() == "SUCCESS"
        assert starts(run, "A", "B") == [1, 1]

    def test_a_reactive_sequence_begins_again_each_tick(self, built):
        run = built(
            "root: {reactive_sequence: [{check: '1 == 1'}, {MoveTo: {pose: a}}, {Beep: {}}]}"
        )
        assert run.run() == "SUCCESS"

    def test_a_reactive_sequence_interrupts_the_running_child_when_an_earlier_one_fails(
        self, built
    ):
        watched = "{reactive_sequence: [{check: '{n} == 1'}, {wait: 1 s}]}"
        body = (
            f"root: {{parallel: [{watched}, {{sequence: [{{wait: 100 ms}}, {{set: {{n: 2}}}}]}}]}}"
        )
        with pytest.raises(TreeFileError, match="may not be written yet"):
            built(body)
        run = built(f"root: {{sequence: [{{set: {{n: 1}}}}, {body.removeprefix('root: ')}]}}")
        assert run.run() == "FAILURE"
        assert run.context.clock.now() < 0.2
        assert reason_of(run.tree.root).message == "{n} == 1 is false: n is 2"

    def test_a_fallback_goes_on_until_one_succeeds(self, built):
        run = built(f"root: {{fallback: [{move('A')}, {move('B')}, {move('C')}]}}").script(
            "t/A", "NO_PATH"
        )
        assert run.run() == "SUCCESS"
        assert starts(run, "A", "B", "C") == [1, 1, 0]

    def test_a_fallback_gives_the_reason_of_each_failed_alternative(self, built):
        run = built(f"root: {{fallback: [{move('A')}, {move('B')}]}}")
        run.script("t/A", "NO_PATH").script("t/B", "MOTION_FAILED")
        assert run.run() == "FAILURE"
        reason = reason_of(run.tree.root)
        assert [cause.code for cause in reason.causes] == ["NO_PATH", "MOTION_FAILED"]
        assert reason.code == "MOTION_FAILED"
        assert "none of 2 alternatives" in reason.message

    def test_a_reactive_fallback_gives_way_to_an_earlier_child(self, built):
        body = (
            "root:\n  sequence:\n    - set: {n: 0}\n    - parallel:\n"
            "        - reactive_fallback: [{check: '{n} == 1'}, {wait: 1 s}]\n"
            "        - sequence: [{wait: 100 ms}, {set: {n: 1}}]\n"
        )
        run = built(body)
        assert run.run() == "SUCCESS"
        assert 0.1 <= run.context.clock.now() < 0.2

    def test_a_parallel_succeeds_on_all(self, built):
        run = built("root: {parallel: [{wait: 100 ms}, {wait: 200 ms}]}")
        assert run.run() == "SUCCESS"
        assert run.context.clock.now() == pytest.approx(0.22)

    def test_a_parallel_succeeds_on_one(self, built):
        run = built("root:\n  parallel: [{wait: 100 ms}, {wait: 200 ms}]\n  success_on: one")
        assert run.run() == "SUCCESS"
        assert run.context.clock.now() == pytest.approx(0.12)

    def test_a_parallel_succeeds_on_a_number_of_children(self, built):
        waits = "[{wait: 100 ms}, {wait: 1 s}, {wait: 200 ms}, {wait: 300 ms}]"
        for number, end in ((1, 0.12), (2, 0.22), (3, 0.32), (4, 1.02)):
            run = built(f"root:\n  parallel: {waits}\n  success_on: {number}")
            assert run.run() == "SUCCESS"
            assert run.context.clock.now() == pytest.approx(end)

    def test_a_parallel_succeeds_on_chosen_children(self, built):
        run = built(
            "root:\n  parallel: [{wait: 1 s, name: A}, {wait: 100 ms, name: B}]\n  success_on: [B]"
        )
        assert run.run() == "SUCCESS"
        assert run.context.clock.now() == pytest.approx(0.12)

    def test_a_parallel_fails_with_its_first_failure_and_interrupts_the_rest(self, built):
        run = built(f"root: {{parallel: [{{wait: 1 s}}, {move('A')}]}}").script("t/A", "NO_PATH")
        assert run.run() == "FAILURE"
        assert reason_of(run.tree.root).code == "NO_PATH"


class TestRetry:
    def test_the_number_is_that_of_all_tries(self, built):
        run = built(f"root: {move('A', retry=3)}").script("t", "NO_PATH")
        assert run.run() == "FAILURE"
        assert run.skill("t").starts == 3
        reason = reason_of(run.tree.root)
        assert len(reason.causes) == 3
        assert reason.data == {"attempts": 3, "of": 3}
        assert "all 3 attempts failed" in reason.message

    def test_on_failure_follows_each_failed_try_also_the_last(self, built):
        run = built(f"root: {{MoveTo: {{pose: a}}, retry: 2, on_failure: {move('B')}}}").script(
            "t", "NO_PATH"
        )
        assert run.run() == "FAILURE"
        assert run.skill("t:on_failure").starts == 2

    def test_a_failed_on_failure_ends_the_retry_with_both_reasons(self, built):
        run = built(f"root: {{MoveTo: {{pose: a}}, retry: 5, on_failure: {move('B')}}}")
        run.script("t", "NO_PATH").script("t:on_failure", "MOTION_FAILED")
        assert run.run() == "FAILURE"
        reason = reason_of(run.tree.root)
        assert (reason.code, [c.code for c in reason.causes]) == (
            "MOTION_FAILED",
            ["NO_PATH", "MOTION_FAILED"],
        )

    def test_only_for_some_codes(self, built):
        run = built("root: {MoveTo: {pose: a}, retry: 5, retry_if: failure.code == NO_PATH}")
        run.script("t", "NO_PATH", "MOTION_FAILED")
        assert run.run() == "FAILURE"
        assert run.skill("t").starts == 2
        assert "gave up after attempt 2 of 5" in reason_of(run.tree.root).message

    def test_a_nested_retry_counts_afresh_and_the_outer_one_remembers(self, built):
        run = built(f"root: {{sequence: [{move('A', retry=2)}], retry: 2}}").script(
            "t/A", "NO_PATH"
        )
        assert run.run() == "FAILURE"
        assert run.skill("t/A").starts == 4
        reason = reason_of(run.tree.root)
        assert [len(list(cause.leaves())) for cause in reason.causes] == [2, 2]

    def test_attempts_are_reported_as_they_end(self, built):
        run = built(f"root: {move('A', retry=3)}").script("t", "NO_PATH", None)
        told = []
        run.tree.on_attempt(
            lambda path, attempt, of: told.append((path, attempt.number, attempt.status.name, of))
        )
        run.run()
        assert told == [("t:retry", 1, "FAILURE", 3), ("t:retry", 2, "SUCCESS", 3)]

    def test_interrupting_a_retry_interrupts_its_child(self, built):
        run = built("root: {MoveTo: {pose: a}, retry: 3, timeout: 30 ms}")
        run.tick()
        run.tree.root.stop(type(run.tree.root.status).INVALID)
        assert run.skill("t").status.name == "INVALID"

    def test_the_number_may_come_from_a_port(self, built):
        run = built(
            "root: {sequence: [{set: {n: 1}}, {MoveTo: {pose: a}, name: A, retry: '{n} + 1'}]}"
        )
        run.script("t/A", "NO_PATH").run()
        assert run.skill("t/A").starts == 2

    def test_a_number_below_one_fails(self, built):
        run = built(
            "root: {sequence: [{set: {n: 1}}, {MoveTo: {pose: a}, name: A, retry: '{n} - 1'}]}"
        )
        assert run.run() == "FAILURE"
        assert reason_of(run.tree.root).code == "BAD_VALUE"


class TestOtherModifiers:
    @pytest.mark.parametrize(
        "modifiers", ["invert: true, retry: 3", "repeat: 3", "for_each: [1, 2, 3]"]
    )
    def test_every_try_round_and_item_takes_a_tick(self, built, modifiers):
        run = built(f"root: {{succeed: {{}}, {modifiers}}}")
        assert [run.tick(), run.tick()] == ["RUNNING", "RUNNING"]
        assert run.tick() != "RUNNING"

    @pytest.mark.parametrize(
        ("modifier", "name"),
        [("repeat: 3", "repeat.round"), ("for_each: [a, b]", "for_each.index")],
    )
    def test_loops_count_from_one(self, built, modifier, name):
        run = built(f"root: {{set: {{n: '{{{name}}} * 10'}}, {modifier}}}")
        run.tick()
        assert run.value("/n") == 10
        run.tick()
        assert run.value("/n") == 20

    def test_timeout_interrupts_on_the_runs_clock(self, built):
        run = built("root: {wait: 1 h, timeout: 100 ms}")
        assert run.run() == "FAILURE"
        assert run.context.clock.now() == pytest.approx(0.12)
        reason = reason_of(run.tree.root)
        assert reason.code == "TIMEOUT"
        assert "wait was still running after 0.1 s" in reason.message

    def test_timeout_is_for_each_try(self, built):
        run = built("root: {wait: 1 h, timeout: 100 ms, retry: 3}")
        assert run.run() == "FAILURE"
        assert [cause.code for cause in reason_of(run.tree.root).causes] == ["TIMEOUT"] * 3

    def test_invert(self, built):
        assert built(f"root: {move('A', invert='true')}").script("t", "NO_PATH").run() == "SUCCESS"
        run = built(f"root: {move('A', invert='true')}")
        assert run.run() == "FAILURE"
        assert reason_of(run.tree.root).code == "INVERTED"

    def test_force(self, built):
        assert (
            built(f"root: {move('A', force='success')}").script("t", "NO_PATH").run() == "SUCCESS"
        )
        run = built(f"root: {move('A', force='failure')}")
        assert run.run() == "FAILURE"
        assert reason_of(run.tree.root).code == "FORCED"

    def test_repeat(self, built):
        run = built(f"root: {move('A', repeat=3)}")
        assert run.run() == "SUCCESS"
        assert run.skill("t").starts == 3
        run = built(f"root: {move('A', repeat=3)}").script("t", None, "NO_PATH")
        assert run.run() == "FAILURE"
        assert reason_of(run.tree.root).code == "NO_PATH"

    def test_repeat_for_ever(self, built):
        run = built(f"root: {move('A', repeat='forever')}")
        assert run.tick(200) == "RUNNING"
        assert run.skill("t").starts == 100

    def test_for_each_hands_on_one_item_after_the_other(self, built):
        loop = "{sequence: [{Approach: {grasp: '{item}'}}], name: L, for_each: '{c.grasps}'}"
        run = built(
            "root: {sequence: [{Detect: {fruit: apple, detection: '{d}'}},"
            f" {{Refine: {{detection: '{{d}}', measured: '{{m}}'}}}},"
            f" {{SampleGrasp: {{around: '{{m}}', candidates: '{{c}}'}}}}, {loop}]}}"
        )
        assert run.run() == "SUCCESS"
        assert run.skill("t/L/Approach").starts == 2
        assert run.value("/item").index == 99

    def test_for_each_of_nothing_succeeds(self, built):
        run = built("constants: {none_of_them: []}\nroot: {Beep: {}, for_each: '{none_of_them}'}")
        assert run.run() == "SUCCESS"
        assert run.skill("t").starts == 0

    def test_guard_interrupts(self, built):
        body = (
            "root:\n  sequence:\n    - set: {n: 0}\n    - parallel:\n        - wait: 1 s\n          guard: '{n} == 0'\n"
            "        - sequence: [{wait: 100 ms}, {set: {n: 1}}]\n"
        )
        run = built(body)
        assert run.run() == "FAILURE"
        assert run.context.clock.now() < 0.2
        assert reason_of(run.tree.root).code == "CONDITION_FALSE"

    def test_when_skips_in_a_sequence(self, built):
        run = built(f"root: {{sequence: [{move('A', when='1 == 2')}, {move('B')}]}}")
        assert run.run() == "SUCCESS"
        assert starts(run, "A", "B") == [0, 1]
        assert "skipped: 1 == 2 is false" in run.tree.behaviours["t/A:when"].feedback_message

    def test_when_skips_in_a_fallback_and_the_failure_before_stays_in_sight(self, built):
        body = (
            f"root: {{fallback: [{move('A')}, {move('B', when='failure.code == MOTION_FAILED')}, "
            f"{move('C', when='failure.code == NO_PATH')}]}}"
        )
        run = built(body).script("t/A", "NO_PATH")
        assert run.run() == "SUCCESS"
        assert starts(run, "A", "B", "C") == [1, 0, 1]

    def test_a_fallback_whose_last_child_was_skipped_fails_with_the_failure_before(self, built):
        run = built(f"root: {{fallback: [{move('A')}, {move('B', when='1 == 2')}]}}").script(
            "t/A", "NO_PATH"
        )
        assert run.run() == "FAILURE"
        reason = reason_of(run.tree.root)
        assert (reason.code, [c.code for c in reason.causes]) == ("NO_PATH", ["NO_PATH"])

    def test_modifiers_wrap_in_one_order_however_they_are_written(self, built):
        run = built("root: {MoveTo: {pose: a}, when: 1 == 1, retry: 2, timeout: 1 s, repeat: 2}")
        assert [info.kind for info in run.tree.nodes] == [
            "when",
            "repeat",
            "retry",
            "timeout",
            "skill",
        ]


class TestLeaves:
    def test_check(self, built):
        assert built("root: {check: 2 mm < 1 cm}").run() == "SUCCESS"
        run = built("parameters: {n: {type: int, default: 3}}\nroot: {check: '{n} > 5'}")
        assert run.run() == "FAILURE"
        assert reason_of(run.tree.root).message == "{n} > 5 is false: n is 3"
        assert reason_of(run.tree.root).data == {"n": 3}

    def test_wait_until(self, built):
        later = "{sequence: [{wait: 100 ms}, {set: {n: 1}}]}"
        body = f"root: {{sequence: [{{set: {{n: 0}}}}, {{parallel: [{{wait_until: '{{n}} == 1'}}, {later}]}}]}}"
        assert built(body).run() == "SUCCESS"

    def test_set_computes(self, built):
        run = built(
            "root: {sequence: [{set: {a: 5 mm}}, {set: {b: '{a} * 2 + 1 cm'}}, {check: '{b} == 20 mm'}]}"
        )
        assert run.run() == "SUCCESS"
        assert run.value("/b") == pytest.approx(0.02)

    def test_fail(self, built):
        run = built("root: {fail: {code: TOO_RIPE, message: this one is soft}}")
        assert run.run() == "FAILURE"
        assert (reason_of(run.tree.root).code, reason_of(run.tree.root).message) == (
            "TOO_RIPE",
            "this one is soft",
        )

    def test_succeed(self, built):
        assert built("root: {succeed: {}}").run() == "SUCCESS"


class TestPorts:
    def test_literals_of_every_type(self, built):
        run = built(
            "root: {Aim: {pose: {position: [0.1, 20 cm, 0.3 m], rpy: [0, 0, 90 deg]}, hold: firm, share: 40 %,"
            " grasp: {index: 2, width: 70 mm}}}".replace("share: 40 %,", "share: 0.4,")
        )
        run.run()
        seen = run.skill("t").seen
        expected = np.array([[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]])
        np.testing.assert_allclose(seen["pose"], expected, atol=1e-12)
        assert (seen["share"], seen["hold"].name) == (0.4, "FIRM")
        assert (seen["grasp"].index, seen["grasp"].width) == (2, 0.07)

    def test_plain_literals(self, built):
        values = {
            "3": 3,
            "0.5": 0.5,
            "1e-3": 0.001,
            "no": "no",
            "'3 x'": "3 x",
            "40 %": 0.4,
            "none": None,
            "true": True,
        }
        listed = ", ".join(f"v{number}: {text}" for number, text in enumerate(values))
        run = built(f"root: {{set: {{{listed}}}}}")
        assert run.run() == "SUCCESS"
        assert [run.value(f"/v{number}") for number in range(len(values))] == list(values.values())

    def test_quantities_arrive_in_si(self, built):
        run = built("root: {Retreat: {distance: 12 cm}}")
        run.run()
        assert run.skill("t").seen["distance"] == pytest.approx(0.12)

    def test_unwired_inputs_have_their_default(self, built):
        run = built("root: {MoveTo: {pose: a}}")
        run.run()
        assert run.skill("t").seen == {"pose": "a", "variation": 1}

    def test_a_value_out_of_range_fails_the_skill(self, built):
        run = built("root: {sequence: [{set: {n: 5}}, {Beep: {times: '{n} * 3'}}]}")
        assert run.run() == "FAILURE"
        reason = reason_of(run.tree.root)
        assert (reason.code, reason.message) == (
            "BAD_VALUE",
            "input times is at most 10, 15 is above",
        )

    def test_division_by_zero_fails_the_node(self, built):
        run = built("root: {sequence: [{set: {n: 0}}, {check: '1 / {n} > 0'}]}")
        assert run.run() == "FAILURE"
        assert reason_of(run.tree.root).code == "BAD_VALUE"


class TestSubtrees:
    BODY = """\
root:
  sequence:
    - look: {fruit: apple, detection: "{first}"}
    - look: {fruit: pear, detection: "{second}", far: 3 cm}
    - check: "{first.score} == {second.score}"
subtrees:
  look:
    in: {fruit: text, far: {type: length, default: 1 cm}}
    out: {detection: detection}
    root:
      sequence:
        - Retreat: {distance: "{far}"}
        - Detect: {fruit: "{fruit}", detection: "{found}"}
        - set: {detection: "{found}"}
"""

    def test_each_call_has_names_of_its_own(self, built):
        run = built(self.BODY)
        assert run.run() == "SUCCESS"
        assert {"/first", "/second", "/look/found", "/look#2/found"} <= set(run.tree.board.entries)
        assert run.skill("t/look#2/sequence/Detect").seen["fruit"] == "pear"

    def test_defaults_of_inputs(self, built):
        run = built(self.BODY)
        run.run()
        assert run.skill("t/look/sequence/Retreat").seen["distance"] == pytest.approx(0.01)
        assert run.skill("t/look#2/sequence/Retreat").seen["distance"] == pytest.approx(0.03)

    def test_parameters_of_the_file_are_seen(self, built):
        run = built(
            "parameters: {far: {type: length, default: 4 cm}}\nroot: {back: {}}\n"
            "subtrees: {back: {root: {Retreat: {distance: '{far}'}}}}"
        )
        run.run()
        assert run.skill("t/Retreat").seen["distance"] == pytest.approx(0.04)

    def test_entries_are_stamped_with_their_writer(self, built):
        run = built(self.BODY)
        run.run()
        entry = run.tree.board.get("/first")
        assert entry.writer == "t/look/sequence/set"
        assert entry.tick > 0
        assert entry.time > 0.0


def test_only_a_document_without_errors_is_built(built):
    with pytest.raises(TreeFileError, match="1 error") as raised:
        built("root: {Detekt: {}}")
    assert raised.value.findings[0].code == "unknown-skill"


def test_everything_runs_a_second_time(built, pick_apple):
    run = built(pick_apple)
    assert run.run() == "SUCCESS"
    assert run.run() == "SUCCESS"
