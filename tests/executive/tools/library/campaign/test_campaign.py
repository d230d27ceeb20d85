"""Campaign files, results after a kill, and the contents of a report."""

from __future__ import annotations

import json
import random
import re
import resource
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from hypothesis import given, settings, strategies as st

from pomona.executive.errors import UsageError
from pomona.executive.values.findings import Findings
from pomona.tools.library.campaign.command_campaign import report_name, subset
from pomona.tools.library.campaign.document import to_html, to_markdown
from pomona.tools.library.campaign.report import report, say
from pomona.tools.library.campaign.run import (
    RESULTS,
    finished_runs,
    read_results,
    run_campaign,
    succeeded,
)
from pomona.tools.library.campaign.spec import (
    CAMPAIGN_FILES,
    Campaign,
    judge_campaign,
    read_campaign,
)
from pomona.tools.library.campaign.statistics import mean
from pomona.tools.library.pool import OrderLost, OrderTooLong

FILE = """
pomona: 1
campaign: demo
tree: pick_apple
cell: sim
seeds: 2
vary: {fruit: [apple_1, apple_2], place: [1, 2, 3]}
arms:
  refined: {}
  unrefined: {set: {refine: none}, seeds: 1, only: {place: [2]}}
  paper: {tree: pick_apple_paper, seeds: [7]}
set: {others: 0}
"""


SPREADS = ", ".join(str(k) for k in range(1001))


def campaign(tmp_path: Path, text: str = FILE) -> Campaign:
    path = tmp_path / "demo.yaml"
    path.write_text(text)
    return read_campaign(path)


class Here:
    """An engine without processes; `answer` stands in for the run."""

    workers = 1

    def __init__(self, answer: Callable[[int], Any]) -> None:
        self.answer, self.asked = answer, 0

    def map(
        self, function: Callable[..., Any], orders: Sequence[tuple[Any, ...]], limit: float
    ) -> Iterator[tuple[int, Any]]:
        for index in range(len(orders)):
            self.asked += 1
            yield index, self.answer(index)


def test_every_combination_is_planned_once_with_its_settings(tmp_path: Path) -> None:
    planned = campaign(tmp_path)
    names = [run.name for run in planned.runs]
    assert len(set(names)) == len(names) == 2 * 6 + 2 + 6
    by_name = {run.name: run.order for run in planned.runs}
    assert by_name["refined/fruit=apple_1/place=2/seed=1001"].settings == {
        "others": "0",
        "fruit": "apple_1",
        "place": "2",
    }
    assert by_name["unrefined/fruit=apple_2/place=2/seed=4000"].settings["refine"] == "none"
    assert by_name["paper/fruit=apple_2/place=3/seed=7"].tree.stem == "pick_apple_paper"


def test_all_arms_meet_the_same_seeds_and_every_combination_has_seeds_of_its_own(
    tmp_path: Path,
) -> None:
    planned = campaign(tmp_path, FILE.replace(", seeds: 1, only: {place: [2]}", ""))
    seeds = {
        arm: {
            (run.number, *run.varied.values()): run.order.seed
            for run in planned.runs
            if run.arm == arm
        }
        for arm in planned.arms
    }
    assert seeds["refined"] == seeds["unrefined"]
    assert len(set(seeds["refined"].values())) == 12
    assert set(seeds["paper"].values()) == {7}


def test_a_campaign_that_is_stopped_early_has_as_many_runs_of_every_combination(
    tmp_path: Path,
) -> None:
    numbers = [run.number for run in campaign(tmp_path).runs]
    assert numbers == sorted(numbers)


@pytest.mark.parametrize(
    ("text", "place", "expected"),
    [
        ("campaign: [", "2:1", "not YAML"),
        ("just text", "1:1", "a campaign file is a mapping"),
        (FILE + "vari: {}\n", "13:1", "no setting 'vari'"),
        (FILE.replace("campaign: demo", "description: x"), "2:1", "needs 'campaign'"),
        (FILE.replace("[1, 2, 3]", "3"), "7:42", "a list of values"),
        (FILE.replace("[1, 2, 3]", "[1, 1]"), "7:46", "given twice"),
        (FILE.replace("seeds: 2", "seeds: 0"), "6:8", "a count from 1"),
        (FILE.replace("seeds: 2", "seeds: [1, -4]"), "6:12", "must be between 0"),
        (
            FILE.replace("tree: pick_apple\n", "tree: pick_aple\n"),
            "4:7",
            "no tree file 'pick_aple'",
        ),
        (FILE.replace("{others: 0}", "{other: 0}"), "12:7", "did you mean 'others'"),
        (FILE.replace("refine: none", "refined: none"), "10:21", "did you mean 'refine'"),
        (FILE.replace("only: {place", "onyl: {place"), "10:46", "no setting 'onyl'"),
        (
            FILE.replace("{place: [2]}", "{place: [4]}"),
            "10:61",
            "'vary' gives 'place' no value '4'",
        ),
        (FILE + "score: {figurs: [slip_mm]}\n", "13:9", "did you mean 'figures'"),
        (
            FILE.replace("[1, 2, 3]", "[77]").replace(", only: {place: [2]}", ""),
            "7:43",
            "it cannot be '77'",
        ),
        (FILE.replace("{others: 0}", "{friction: -1}"), "12:17", "must be between"),
        (FILE.replace("{others: 0}", "{radius: 12}"), "12:15", "lacks a unit"),
        (
            FILE.replace("seeds: 2", "seeds: 1000").replace("[1, 2, 3]", f"[{SPREADS}]"),
            "2:1",
            "runs; a campaign has at most",
        ),
        (FILE.replace("seeds: 2", "seeds: " + "[" * 90 + "]" * 90), r"6:\d+", "levels deep"),
    ],
)
def test_a_wrong_file_is_refused_with_line_and_column(
    tmp_path: Path, text: str, place: str, expected: str
) -> None:
    with pytest.raises(UsageError, match=f"demo.yaml:{place}: error.*(?s:.*){re.escape(expected)}"):
        campaign(tmp_path, text)


def test_a_key_that_varies_must_be_known(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match=r"demo.yaml:7:8: error\[unknown-setting\].*neither the tree"
    ):
        campaign(
            tmp_path, FILE.replace("{fruit:", "{friut:").replace("tree: pick_apple_paper, ", "")
        )


def test_a_real_cell_has_no_campaign_since_no_operator_acknowledges_between_its_runs(
    tmp_path: Path,
) -> None:
    (tmp_path / "bench.yaml").write_text("name: bench\nkind: real\nclock: manual\ndevices: {}\n")
    (tmp_path / "t.yaml").write_text("pomona: 1\ntree: t\nroot: {wait: 20 ms}\n")
    with pytest.raises(UsageError, match=r"error\[real-cell\].*'bench' is a real cell"):
        campaign(tmp_path, "pomona: 1\ncampaign: demo\ntree: t.yaml\ncell: bench.yaml\nseeds: 2\n")


def test_one_run_that_goes_wrong_never_stops_the_rest_and_is_not_repeated(tmp_path: Path) -> None:
    answers = [{"outcome": "success"}, OrderLost("died"), OrderTooLong("late"), ValueError("wrong")]
    engine = Here(lambda index: answers[min(index, 3)])
    planned = campaign(tmp_path)
    first = run_campaign(planned, tmp_path / "out", engine)
    codes = [(result.get("reason") or {}).get("code") for result in first.values()]
    assert codes[:4] == [None, "WORKER_DIED", "TIMEOUT", "ValueError"]
    assert len(first) == engine.asked == len(planned.runs)
    lines = (tmp_path / "out" / RESULTS).read_text().splitlines()
    assert run_campaign(planned, tmp_path / "out", engine) == first
    assert (tmp_path / "out" / RESULTS).read_text().splitlines() == lines


def test_a_result_that_was_cut_off_by_a_kill_is_run_again_and_spoils_no_other(
    tmp_path: Path,
) -> None:
    planned = campaign(tmp_path)
    engine = Here(lambda index: {"outcome": "success"})
    run_campaign(planned.only(planned.runs[:2]), tmp_path, engine)
    with (tmp_path / RESULTS).open("a") as stream:
        stream.write('{"name": "refined/fru')
    assert len(read_results(tmp_path)) == 2
    run_campaign(planned.only(planned.runs[:3]), tmp_path, engine)
    assert [json.loads(line)["name"] for line in (tmp_path / RESULTS).read_text().splitlines()] == [
        run.name for run in planned.runs[:3]
    ]


def test_a_changed_byte_and_a_line_of_anything_else_count_for_nothing_and_are_named(
    tmp_path: Path,
) -> None:
    planned = campaign(tmp_path)
    run_campaign(
        planned.only(planned.runs[:3]), tmp_path, Here(lambda index: {"outcome": "success"})
    )
    good, path, rng = read_results(tmp_path), tmp_path / RESULTS, random.Random(2)
    content = path.read_bytes()
    for number in range(100):
        at = rng.randrange(len(content) - 1)
        path.write_bytes(
            content[:at] + bytes([content[at] ^ rng.randrange(1, 256)]) + content[at + 1 :]
        )
        told: list[str] = []
        found = read_results(tmp_path, told.append)
        assert len(told) >= 1, number
        assert found.items() <= good.items()
    for line in (
        b"[1, 2]", b"7", b"garbage", b"null", b'{"name": 3}', b"\xff\xfe\x00", b'{"name": "a"}', b"[" * 9000,
        b'{"name":"a","arm":"b","varied":[],"number":0,"fingerprint":"c","outcome":"success"}',
    ):  # fmt: skip
        path.write_bytes(line + b"\n" + content)
        told = []
        assert read_results(tmp_path, told.append) == good
        assert len(told) == 1
        assert told[0].startswith(f"{path}:1: ")


def test_a_full_disk_ends_a_campaign_in_words_and_it_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        sys, "dont_write_bytecode", True
    )  # Python itself leaves half a compiled file on a full disk
    planned = campaign(tmp_path)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def answer(index: int) -> Any:
        if index == 2:
            resource.setrlimit(
                resource.RLIMIT_FSIZE, ((tmp_path / "out" / RESULTS).stat().st_size + 40, limits[1])
            )
        return {"outcome": "success"}

    try:
        with pytest.raises(UsageError, match=r"results.jsonl: a result cannot be written: "):
            run_campaign(planned, tmp_path / "out", Here(answer))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    engine = Here(lambda _index: {"outcome": "success"})
    assert len(run_campaign(planned, tmp_path / "out", engine)) == len(planned.runs)
    assert engine.asked == len(planned.runs) - 2


def test_results_of_other_settings_are_not_taken_for_this_campaigns(tmp_path: Path) -> None:
    run_campaign(campaign(tmp_path), tmp_path / "out", Here(lambda index: {"outcome": "success"}))
    changed = campaign(tmp_path, FILE.replace("others: 0", "others: 2"))
    with pytest.raises(UsageError, match="with another tree, cell or setting"):
        finished_runs(changed, tmp_path / "out")


def test_two_campaigns_never_write_one_folder(tmp_path: Path) -> None:
    planned = campaign(tmp_path)

    def again(_index: int) -> Any:
        with pytest.raises(UsageError, match="another campaign is writing there"):
            run_campaign(planned, tmp_path / "out", Here(lambda index: {}))
        return {"outcome": "success"}

    run_campaign(planned.only(planned.runs[:1]), tmp_path / "out", Here(again))


@pytest.mark.parametrize(
    ("seeds", "only", "name"),
    [
        (None, [], "report"),
        (None, ["arm=measured"], "report_only_arm_measured"),
        (2, ["arm=measured", "place=a/b"], "report_seeds_2_arm_measured_place_a_b"),
    ],
)
def test_the_report_of_a_part_stands_beside_that_of_all(
    seeds: int | None, only: list[str], name: str
) -> None:
    assert report_name(seeds, only) == name


def test_of_few_runs_a_figure_has_no_interval() -> None:
    assert say(mean([13.0, 14.2])) == "13.6"
    assert "…" in say(mean([13.0, 14.2, 13.1, 13.7, 13.3]))


@pytest.mark.parametrize("again", [False, True])
def test_a_campaign_whose_results_are_removed_ends_in_words(tmp_path: Path, again: bool) -> None:
    planned, engine = campaign(tmp_path), Here(lambda index: {"outcome": "success"})

    def remove(result: dict[str, Any], done: int, _of: int) -> None:
        if done == 2:
            shutil.rmtree(tmp_path / "out")
            if again:  # by another campaign
                other = Here(lambda index: {"outcome": "failure"})
                run_campaign(planned.only(planned.runs[:1]), tmp_path / "out", other)

    with pytest.raises(UsageError, match=r"results\.jsonl: a result cannot be written: "):
        run_campaign(planned, tmp_path / "out", engine, remove)
    assert engine.asked == 3
    left = list(read_results(tmp_path / "out").values())
    assert [result["outcome"] for result in left] == (["failure"] if again else [])


def test_a_part_of_a_campaign_is_named_by_seeds_and_values(tmp_path: Path) -> None:
    planned = campaign(tmp_path)
    assert {run.number for run in subset(planned, 1, [])} == {0}
    some = subset(planned, None, ["arm=refined", "place=1", "place=2"])
    assert {(run.arm, run.varied["place"]) for run in some} == {("refined", "1"), ("refined", "2")}
    for wrong in (["place"], ["plaec=1"], ["place=9"]):
        with pytest.raises(UsageError, match="--only"):
            subset(planned, None, wrong)


def result(name: str, fruit: str, place: str, lifted: bool, **more: Any) -> dict[str, Any]:
    reason = None if lifted else {"code": "LOST", "message": "it slipped"}
    return {
        "name": name, "arm": "refined", "varied": {"fruit": fruit, "place": place}, "reason": reason, "number": 0,
        "outcome": "success" if lifted else "failure", "truth": {"lifted": lifted, "slip_mm": 0.5}, "attempts": [],
        "account": {"success": "held"},
        "commit": "abc", **more,
    }  # fmt: skip


def test_the_report_counts_the_truth_and_not_the_trees_result(tmp_path: Path) -> None:
    lied = {**result("c", "apple_2", "1", False), "outcome": "success", "reason": None}
    results = [result("a", "apple_1", "1", True), result("b", "apple_1", "2", False), lied]
    document = report(campaign(tmp_path), results, "benchmarks/pick.yaml")
    text, page = to_markdown(document), to_html(document)
    assert "1/3 = 33.3 %" in text
    assert "| LOST | 1 | refined | it slipped |" in text
    assert "| FALSE_SUCCESS | 1 |" in text
    assert "commit `abc`" in text
    assert "slip [mm]" in text
    assert page.count("<table>") == 4
    assert "<script" not in page
    assert "http" not in re.sub(r'(xmlns(:\w+)?|rdf:\w+)="[^"]*"', "", page)


def test_arms_are_compared_on_the_same_seeds(tmp_path: Path) -> None:
    arms = [
        {**result("x", "apple_1", "2", False), "arm": "unrefined"},
        result("y", "apple_1", "2", True),
    ]
    text = to_markdown(report(campaign(tmp_path), arms, "pick.yaml"))
    assert (
        "on the same 1 combinations and seeds: 1 succeeded only with the first, 0 only with the second"
        in text
    )


def test_without_a_simulated_world_the_trees_word_counts() -> None:
    held = {"success": "held"}
    assert succeeded({"outcome": "success", "account": held, "truth": None})
    assert succeeded({"outcome": "success", "account": held, "truth": {"lifted": True}})
    assert not succeeded({"outcome": "success", "account": held, "truth": {"lifted": False}})
    assert not succeeded({"outcome": "partial", "account": held, "truth": {"lifted": True}})


def test_every_mistake_of_every_arm_is_found_before_the_first_run(tmp_path: Path) -> None:
    text = FILE.replace("refined: {}", "refined: {set: {friction: -1, attempts: many}}").replace(
        "3]}", "88]}"
    )
    with pytest.raises(UsageError) as error:
        campaign(tmp_path, text)
    places = re.findall(r"demo\.yaml:(\d+:\d+): error", str(error.value))
    assert places == ["7:49", "9:29", "9:43"]
    assert "Nothing was run" in str(error.value)


def test_an_unknown_setting_hides_no_other_mistake(tmp_path: Path) -> None:
    text = FILE.replace("{others: 0}", "{others: many, nonsense: 3, jitter: 15}").replace(
        "[2]}", "[9]}"
    )
    findings = Findings()
    path = tmp_path / "demo.yaml"
    path.write_text(text)
    assert judge_campaign(path, findings) is None
    found = [(finding.line, finding.code) for finding in findings.sorted()]
    unknown = (12, "unknown-setting")  # for each of two trees
    assert found == [(10, "unknown-value"), (12, "value"), unknown, unknown, (12, "value")]


def test_an_unusable_value_hides_neither_a_wrong_tree_and_cell_nor_a_wrong_setting(
    tmp_path: Path,
) -> None:
    unusable = FILE.replace("seeds: 2", "seeds: -1")
    files = unusable.replace("tree: pick_apple\n", "tree: pick_aple\n").replace(
        "cell: sim", "cell: simm"
    )
    with pytest.raises(UsageError) as error:
        campaign(tmp_path, files)
    assert all(
        words in str(error.value) for words in ("'pick_aple'", "'simm'", "'seeds' is a count")
    )
    with pytest.raises(UsageError, match="'seeds' is a count") as error:
        campaign(tmp_path, unusable.replace("others: 0", "othrs: 0"))
    assert "has a setting 'othrs'" in str(error.value)


def test_a_campaign_uses_the_score_of_the_cell_unless_its_file_names_another(
    tmp_path: Path,
) -> None:
    assert campaign(tmp_path).score.figures[0] == "position_error_mm"
    other = campaign(tmp_path, FILE + "score: {figures: [bruise_kpa]}\n")
    assert other.score.figures[:2] == ("bruise_kpa", "position_error_mm")


def test_schema_and_reader_accept_the_same() -> None:
    schema = CAMPAIGN_FILES.schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    texts = [path.read_text() for path in (Path(__file__).parents[5] / "benchmarks").glob("*.yaml")]
    shipped = [text for text in texts if "\ncampaign:" in text]
    assert len(shipped) >= 8
    for text in (FILE, *shipped):
        jsonschema.validate(yaml.safe_load(text), schema)
    for wrong in (
        FILE.replace("seeds: 2", "seeds: 0"),
        FILE.replace("[1, 2, 3]", "[]"),
        FILE + "vari: {}\n",
    ):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(yaml.safe_load(wrong), schema)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    st.integers(0, len(FILE) - 1),
    st.integers(0, 12),
    st.text("abz:{}[]-0.\"'#&*!|>%@\n\t, é", max_size=4),
)
def test_a_damaged_campaign_has_findings_with_places_or_is_a_campaign(
    tmp_path: Path, at: int, length: int, inserted: str
) -> None:
    path = tmp_path / "demo.yaml"
    path.write_text(FILE[:at] + inserted + FILE[at + length :])
    findings = Findings()
    judge_campaign(path, findings)
    assert all(found.line >= 1 and found.column >= 1 for found in findings.sorted())
