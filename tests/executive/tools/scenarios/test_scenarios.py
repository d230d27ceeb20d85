"""Scenario files: a tree's logic, tested without any cell."""

from __future__ import annotations

import jsonschema
import pytest
import yaml

from pomona.executive.language import TreeFileError
from pomona.executive.language.mocks import read_mocks
from pomona.executive.language.read import read
from pomona.tools.scenarios.run_scenario import run_scenario
from pomona.tools.scenarios.scenario import SCENARIO_FILES, read_scenario


@pytest.fixture
def scenario(tmp_path, skills, pick_apple):
    (tmp_path / "pick_apple.yaml").write_text(pick_apple)

    def make(cases):
        return read_scenario(
            f"pomona: 1\ntree: pick_apple.yaml\n{cases}", tmp_path / "s.yaml", skills
        )

    return make


def codes(scenario):
    return [finding.code for finding in scenario.findings]


CASES = """\
mocks: {Refine: {after: 200 ms}}
cases:
  - name: all goes well
    never: [Retreat]
    calls: {Detect: 1, Plan: 1}
  - name: a second plan for some failures
    mocks: {Plan: [NO_PATH, success]}
    visits: [fallback/Plan#2]
  - name: no second plan for others, and a retreat after each attempt
    set: {attempts: 2}
    mocks:
      Attempt/fallback/Plan: {code: GOAL_IN_COLLISION, message: the table is in the way}
    expect: {status: failure, code: GOAL_IN_COLLISION, node: fallback/Plan}
    never: [Follow]
    calls: {Retreat: 2, SampleGrasp: 2}
  - name: a slow detection times out
    set: {looks: 1}
    mocks: {Detect: {status: running}}
    expect: {status: failure, code: TIMEOUT}
  - name: the third look finds something
    mocks: {Detect: [{code: NO_FRUIT, calls: 2}, success]}
    calls: {MoveTo: 3}
"""


class TestRunning:
    def test_a_mock_may_stand_for_a_skill_that_the_tree_declares(self, tmp_path, skills):
        tree = "pomona: 1\ntree: t\nskills: {Job: {in: [n], out: [m]}}\nroot: {Job: {n: 1, m: '{m}'}, timeout: 2 s}\n"
        (tmp_path / "t.yaml").write_text(tree)
        cases = (
            "cases:\n  - {name: ends before, mocks: {Job: {after: 1.99 s, outputs: {m: 3}}}, expect: success}\n"
            "  - {name: ends in time, mocks: {Job: {after: 2 s}}, expect: success}\n"
            "  - {name: ends late, mocks: {Job: {after: 2.1 s}}, expect: {status: failure, code: TIMEOUT}}\n"
        )
        scenario = read_scenario(f"pomona: 1\ntree: t.yaml\n{cases}", tmp_path / "s.yaml", skills)
        assert codes(scenario) == []
        assert [r.problems for r in run_scenario(scenario, skills).cases] == [(), (), ()]

    def test_all_cases_pass(self, scenario, skills):
        result = run_scenario(scenario(CASES), skills)
        assert [(r.case.name, r.problems) for r in result.cases if not r.passed] == []
        assert len(result.cases) == 5

    def test_durations_pass_on_the_simulated_clock(self, scenario, skills):
        result = run_scenario(scenario(CASES), skills)
        assert result.cases[0].time == pytest.approx(0.2)

    def test_nodes_that_were_never_reached_are_reported(self, scenario, skills):
        coverage = run_scenario(scenario("cases: [{name: one}]"), skills).coverage
        unreached = [info.path for info in coverage.unreached()]
        assert "pick_apple/Attempt:on_failure" in unreached
        assert "pick_apple/Attempt/Lift" not in unreached
        assert ("pick_apple/Attempt/Lift", "failure") in [
            (i.path, end) for i, end in coverage.ends_never_seen()
        ]
        assert 0.5 < coverage.share() < 1.0

    @pytest.mark.parametrize(
        ("case", "problem"),
        [
            ("{mocks: {Detect: NO_FRUIT}}", "expected success, got failure: NO_FRUIT"),
            (
                "{mocks: {Detect: NO_FRUIT}, expect: {code: NO_FRAME}}",
                "expected the failure NO_FRAME",
            ),
            ("{mocks: {Detect: NO_FRUIT}, expect: {node: Refine}}", "expected Refine to fail"),
            ("{expect: failure}", "expected failure, got success"),
            ("{visits: [Retreat]}", "'Retreat' was never reached"),
            ("{never: [Lift]}", "'Lift' was reached"),
            ("{calls: {Lift: 2}}", "'Lift' started 1 times, expected 2"),
            ("{mocks: {MoveTo: running}, limit: 1 s}", "got still running after 1 s"),
        ],
    )
    def test_differences_are_reported(self, scenario, skills, case, problem):
        result = run_scenario(scenario(f"cases: [{case}]"), skills)
        assert not result.cases[0].passed
        assert problem in result.cases[0].problems[0]

    def test_outputs_of_mocks_are_seen_by_conditions(self, tmp_path, skills):
        (tmp_path / "t.yaml").write_text(
            "pomona: 1\ntree: t\nroot:\n  sequence:\n    - Detect: {fruit: apple, detection: '{d}'}\n"
            "    - Refine: {detection: '{d}', measured: '{m}'}\n    - check: '{m.inlier_ratio} > 0.6'\n"
        )
        text = (
            "pomona: 1\ntree: t.yaml\ncases:\n  - mocks: {Refine: {outputs: {measured: {inlier_ratio: 0.7}}}}\n"
            "  - {mocks: {Refine: {outputs: {measured: {inlier_ratio: 0.5}}}}, expect: {code: CONDITION_FALSE}}\n"
            "  - {expect: {code: BAD_VALUE}}\n"
        )
        result = run_scenario(read_scenario(text, tmp_path / "s.yaml", skills), skills)
        assert [r.problems for r in result.cases] == [(), (), ()]
        assert "add it to the mock's outputs" in result.cases[2].reason.message


class TestReading:
    @pytest.mark.parametrize(
        ("case", "code"),
        [
            ("{mocks: {Plna: success}}", "unknown-node"),
            ("{mocks: {Plan: NO_PAHT}}", "unknown-code"),
            ("{mocks: {Plan: {stauts: success}}}", "unknown-key"),
            ("{mocks: {Plan: {status: perhaps}}}", "value"),
            ("{mocks: {Plan: {after: 3}}}", "value"),
            ("{mocks: {Plan: {outputs: {way: 1}}}}", "unknown-port"),
            ("{mocks: {Plan: {outputs: {path: {length: 1}}}}}", "unknown-field"),
            ("{expect: maybe}", "value"),
            ("{visits: [Retreet]}", "unknown-node"),
            ("{calls: {Lift: often}}", "value"),
            ("{limit: 3}", "value"),
            ("{nam: x}", "unknown-key"),
            ("7", "shape"),
            ("{set: {atempts: 2}}", "unknown-setting"),
            ("{set: {attempts: 2 mm}}", "value"),
            ("{set: {attempts: 0}}", "value"),
            ("{mocks: {Plan: {calls: 0}}}", "range"),
            ("{expect: {node: Retreet}}", "unknown-node"),
            ("{answers: {Plan: yes}}", "unknown-node"),
        ],
    )
    def test_mistakes_are_findings(self, scenario, case, code):
        assert codes(scenario(f"cases: [{case}]")) == [code]

    def test_a_code_by_its_name_of_the_version_before(self, scenario):
        found = scenario("cases: [{mocks: {Lift: FELL}}]").findings
        assert [(f.code, f.hint) for f in found] == [("removed", "it is called 'DROPPED' now")]

    def test_a_scenario_with_mistakes_is_not_run(self, scenario, skills):
        with pytest.raises(TreeFileError):
            run_scenario(scenario("cases: [{expect: maybe}]"), skills)

    def test_a_tree_that_is_not_there(self, tmp_path, skills):
        found = read_scenario(
            "pomona: 1\ntree: none.yaml\ncases: [{}]", tmp_path / "s.yaml", skills
        )
        assert codes(found) == ["file"]

    def test_mocks_alone(self, scenario, skills):
        document = scenario("cases: []").document
        mocks, findings = read_mocks(
            "mocks: {Plan: [NO_PATH, success]}", "m.yaml", document, skills
        )
        assert findings == []
        assert [result.status for result in mocks.results["Plan"]] == ["failure", "success"]


ASKING = """\
pomona: 1
tree: asking
root:
  sequence:
    - retry: 3
      sequence:
        - ask: Is it ripe?
          name: Ripe
          choices: [ripe, unripe]
          answer: said
          within: 5 s
        - check: "{said} == ripe"
"""


class TestAnswers:
    @pytest.fixture
    def asked(self, tmp_path, skills):
        (tmp_path / "asking.yaml").write_text(ASKING)

        def make(case):
            return read_scenario(f"tree: asking.yaml\ncases: [{case}]", tmp_path / "s.yaml", skills)

        return make

    @pytest.mark.parametrize(
        "case",
        [
            "{answers: {Ripe: ripe}, calls: {Ripe: 1}}",
            "{answers: {Ripe: [unripe, ripe]}, calls: {Ripe: 2}}",
            "{answers: {Ripe: unripe}, calls: {Ripe: 3}, expect: {code: CONDITION_FALSE}}",
            "{expect: {code: NOBODY_TO_ASK, node: Ripe}}",
        ],
    )
    def test_questions_are_answered_in_their_order_and_the_last_answer_stays(
        self, asked, skills, case
    ):
        result = run_scenario(asked(case), skills)
        assert [r.problems for r in result.cases] == [()]

    @pytest.mark.parametrize(
        ("answers", "code"),
        [
            ("{Rip: ripe}", "unknown-node"),
            ("{Ripe: rippe}", "value"),
            ("{Ripe: []}", "empty"),
            ("[ripe]", "shape"),
        ],
    )
    def test_answers_to_nothing_and_wrong_ones_are_findings(self, asked, answers, code):
        assert codes(asked(f"{{answers: {answers}}}")) == [code]


@pytest.mark.parametrize("case", [
    "{answers: {Plan: approve}}",
    "{answers: {Plan: refuse}, expect: {code: NOT_APPROVED}}",
    "{expect: {code: NOBODY_TO_ASK}}",
])  # fmt: skip
def test_somebody_approves_a_node_by_its_name(tmp_path, skills, case):
    (tmp_path / "t.yaml").write_text(
        "pomona: 1\ntree: t\nroot: {wait: 1 s, name: Plan, approve: true}\n"
    )
    result = run_scenario(
        read_scenario(f"tree: t.yaml\ncases: [{case}]", tmp_path / "s.yaml", skills), skills
    )
    assert [r.problems for r in result.cases] == [()]


def test_everything_wrong_with_a_scenario_is_found_at_once_with_its_place(
    tmp_path, skills, pick_apple
):
    (tmp_path / "pick_apple.yaml").write_text(pick_apple)
    text = (
        "tree: pick_apple.yaml\nmock: {}\nmocks:\n  Plna: success\n  Plan: {after: 3}\ncases:\n  - limit: 7\n"
        "    visits: [Retreet]\n  - name: a\n    mocks: {Plan: [success, NO_PAHT]}\n    expects: failure\n"
    )
    found = read_scenario(text, tmp_path / "s.yaml", skills).findings
    assert [(f.line, f.column, f.code) for f in found] == [
        (2, 1, "unknown-key"),
        (4, 3, "unknown-node"),
        (5, 17, "value"),
        (7, 12, "value"),
        (8, 14, "unknown-node"),
        (10, 29, "unknown-code"),
        (11, 5, "unknown-key"),
    ]
    assert [f.hint for f in found if f.code.startswith("unknown")] == [
        f"did you mean '{word}'?" for word in ("mocks", "Plan", "Retreat", "NO_PATH", "expect")
    ]


def test_a_scenario_without_a_case_is_refused(scenario):
    assert codes(scenario("cases: []")) == ["shape"]
    assert not jsonschema.Draft202012Validator(SCENARIO_FILES.schema()).is_valid(
        {"tree": "t.yaml", "cases": []}
    )


def test_schema_and_reader_take_the_same(scenario):
    taken = jsonschema.Draft202012Validator(SCENARIO_FILES.schema())
    cases = [
        "{name: x, set: {attempts: 2}, mocks: {Plan: [NO_PATH, {status: running, after: 2 s}]}, expect: failure}",
        "{expect: {code: NO_PATH, node: Plan}, visits: Retreat, never: [Lift], calls: {Plan: 2}, limit: 3 s}",
        "{mocks: {Plan: {after: 3}}}",
        "{mocks: {Plan: {stauts: success}}}",
        "{expect: maybe}",
        "{calls: {Lift: often}}",
        "{limit: 3}",
        "7",
    ]
    for case in cases:
        value = yaml.safe_load(f"tree: pick_apple.yaml\ncases: [{case}]")
        assert taken.is_valid(value) == (codes(scenario(f"cases: [{case}]")) == []), case


def test_a_file_of_mocks_holds_nothing_else(skills, pick_apple):
    document = read(pick_apple, "t.yaml")
    wrong = (
        ("mocks: {}\nfoo: 1\n", "unknown-key"),
        ("plan: NO_PATH\n", "unknown-key"),
        ("{}", "missing-key"),
    )
    for text, code in wrong:
        _, findings = read_mocks(text, "m.yaml", document, skills)
        assert code in [finding.code for finding in findings], text


def test_calls_are_counted_over_all_nodes_of_a_skill(built, skills):
    body = "root: {sequence: [{MoveTo: {pose: a}, name: A}, {MoveTo: {pose: b}, name: B}]}"
    document = read("pomona: 1\ntree: t\n" + body, "t.yaml")
    mocks, findings = read_mocks("mocks: {MoveTo: [success, NO_PATH]}", "m.yaml", document, skills)
    assert findings == []
    assert built(body, mocks=mocks).run() == "FAILURE"
