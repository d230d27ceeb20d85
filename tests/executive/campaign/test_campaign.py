"""Campaign files, what survives a kill, and what a report says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.campaign.report import report, wilson
from executive.campaign.run import RESULTS, read_results, run_campaign
from executive.campaign.spec import Campaign, read_campaign
from executive.errors import UsageError

FILE = """
pomona: 1
campaign: demo
tree: pick_apple
cell: sim
repetitions: 2
vary: {fruit: [apple_1, apple_2], place: [1, 2, 3]}
arms:
  refined: {}
  unrefined: {refine: none}
set: {others: 0}
"""


def campaign(tmp_path: Path, text: str = FILE) -> Campaign:
    path = tmp_path / "demo.yaml"
    path.write_text(text)
    return read_campaign(path, None)


def test_every_combination_is_planned_once_with_its_settings(tmp_path: Path) -> None:
    planned = campaign(tmp_path)
    assert len(planned.runs) == 2 * 2 * 3 * 2
    assert len({run.name for run in planned.runs}) == len(planned.runs)
    last = planned.runs[-1]
    assert last.name == "unrefined/fruit=apple_2/place=3/seed=1"
    assert last.order.settings == {"others": "0", "fruit": "apple_2", "place": "3", "refine": "none"}
    assert last.order.seed == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("campaign: [", "not YAML"),
        ("just text", "a campaign is a mapping"),
        (FILE + "vari: {}\n", "unknown key 'vari'"),
        (FILE.replace("campaign: demo", "description: x"), "'campaign' is missing"),
        (FILE.replace("[1, 2, 3]", "3"), "a list of values"),
        (FILE.replace("repetitions: 2", "repetitions: 0"), "at least 1"),
        (FILE.replace("pick_apple", "pick_aple"), "no tree file 'pick_aple'"),
    ],
)
def test_a_wrong_file_is_refused_in_words(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(UsageError, match=expected):
        campaign(tmp_path, text)


def test_one_run_that_cannot_start_never_stops_the_rest_and_is_not_repeated(tmp_path: Path) -> None:
    text = FILE.replace("repetitions: 2", "repetitions: 1").replace(
        "arms:\n  refined: {}\n  unrefined: {refine: none}\n", ""
    )
    planned = campaign(tmp_path, text.replace("others: 0", "no_such_option: 1"))
    first = run_campaign(planned, tmp_path / "out", 1)
    assert [result["outcome"] for result in first.values()] == ["unusable"] * 6
    lines = (tmp_path / "out" / RESULTS).read_text().splitlines()
    assert run_campaign(planned, tmp_path / "out", 1) == first
    assert (tmp_path / "out" / RESULTS).read_text().splitlines() == lines


def test_a_result_that_was_cut_off_by_a_kill_is_run_again(tmp_path: Path) -> None:
    (tmp_path / RESULTS).write_text(json.dumps({"name": "a", "outcome": "success"}) + "\n" + '{"name": "b", "outc')
    assert list(read_results(tmp_path)) == ["a"]


def result(name: str, fruit: str, place: str, lifted: bool, **more: Any) -> dict[str, Any]:
    reason = None if lifted else {"code": "LOST", "message": "it slipped"}
    return {
        "name": name, "arm": "refined", "varied": {"fruit": fruit, "place": place}, "reason": reason,
        "outcome": "success" if lifted else "failure", "truth": {"lifted": lifted}, "attempts": [], **more,
    }  # fmt: skip


def test_the_report_counts_what_the_world_says_not_what_the_tree_says(tmp_path: Path) -> None:
    lied = {**result("c", "apple_2", "1", False), "outcome": "success", "reason": None}
    results = [result("a", "apple_1", "1", True), result("b", "apple_1", "2", False), lied]
    text = report(campaign(tmp_path), results)
    assert "1/3 = 33 %" in text
    assert "| LOST | 1 | b: it slipped |" in text
    assert "| NOT_LIFTED | 1 |" in text


@given(of=st.integers(1, 5000), data=st.data())
def test_wilsons_interval_holds_the_rate_and_stays_within_0_and_1(of: int, data: st.DataObject) -> None:
    successes = data.draw(st.integers(0, of))
    low, high = wilson(successes, of)
    assert 0.0 <= low <= successes / of + 1e-12
    assert successes / of - 1e-12 <= high <= 1.0
