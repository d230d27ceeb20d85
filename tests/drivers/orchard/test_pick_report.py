"""The report of `make orchard`: shares of what the walls' truth counted, and the reasons of what was left."""

from __future__ import annotations

import pytest

from benchmarks.orchard_pick import group_of, report, seeds_of, share


def wall(seed, **truth):
    counted = {"apples": 20, "reachable": 12, "gripped": 10, "detached": 9, "picked": 8, "dropped": 1}
    counted |= {"knocked_off": 1, "bruised": 2, "stems_torn": 0, "stem_force_median_n": 3.0, "numbers": "digest"}
    why = "gave up after attempt 1 of 3; the last: all 200 grasps are ruled out: 200 unreachable"
    return {
        "seed": seed, "leaves": 0.0, "commit": "abc", "outcome": "success", "reason": "", "time_s": 100.0,
        "left": [why], "truth": counted | truth,
    }  # fmt: skip


def test_shares_sum_the_walls_and_the_title_names_the_simulation_and_the_apples(tmp_path):
    page = report([wall(101), wall(102, picked=4)], tmp_path)
    assert page.startswith("# Simulated: 40 apples of 2 fruit walls")
    assert "| in the bin, of those that both pads gripped | 12 of 20 | 60% | 39% to 78% |" in page
    assert "Time per apple in the bin: 16.7 s" in page
    assert "| no free grasp | 2 |" in page
    assert (tmp_path / "picked.png").stat().st_size > 1000


def test_a_share_of_nothing_has_no_value():
    assert share("x", 0, 0) == "| x | 0 of 0 | – | 0% to 100% |"


@pytest.mark.parametrize(
    ("why", "group"),
    [
        ("the stem held rolls of 140° and -140° and a pull of 8 N", "stem held"),
        ("the fruit was lost on the way down: it presses on neither finger", "lost"),
        ("something new", "something new"),
    ],
)
def test_reasons_are_grouped(why, group):
    assert group_of(why) == group


def test_walls_are_named_by_a_range_or_one_by_one():
    assert seeds_of("101..103") == [101, 102, 103]
    assert seeds_of("101,105") == [101, 105]
