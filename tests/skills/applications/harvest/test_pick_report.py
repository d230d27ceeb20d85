"""The report of `make orchard`: shares of what the walls' truth counted, and the reasons of what was left."""

from __future__ import annotations

import pytest

from benchmarks import orchard_pick
from benchmarks.orchard_pick import group_of, pick_wall, report, seeds_of, share


def wall(seed, **truth):
    counted = {
        "apples": 20,
        "reachable": 12,
        "gripped": 10,
        "detached": 9,
        "picked": 8,
        "dropped": 1,
    }
    counted |= {
        "knocked_off": 1,
        "bruised": 2,
        "stems_torn": 0,
        "stem_force_median_n": 3.0,
        "numbers": "digest",
    }
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


def test_the_shares_are_given_for_each_foliage(tmp_path):
    leafy = wall(102, picked=4, gripped=8) | {
        "leaves": 1.0,
        "outcome": "error",
        "reason": "gripper: a push",
    }
    page = report([wall(101), leafy], tmp_path)
    assert (
        "| 0 | 1 | 8 of 10 (49% to 94%) | 8 of 12 (39% to 86%) | 8 of 20 (22% to 61%) | 2 of 20 | 1 of 9 | 12.5 | 1 |"
        in page
    )
    assert (
        "| 1 | 1 | 4 of 8 (22% to 78%) | 4 of 12 (14% to 61%) | 4 of 20 (8% to 42%) | 2 of 20 | 1 of 9 | 25.0 | 0 |"
        in page
    )


def test_each_stop_begins_with_the_apples_that_the_stops_before_left(monkeypatch):
    stops = [
        {
            "apples": 12,
            "picked": 1,
            "which_gone": "0,10",
            "which_gripped": "0,1",
            "which_bruised": "10",
            "knocked_off": 1,
        },
        {
            "apples": 10,
            "picked": 1,
            "which_gone": "1",
            "which_gripped": "1,3",
            "which_bruised": "3",
            "knocked_off": 0,
        },
        {
            "apples": 9,
            "picked": 0,
            "which_gone": "none",
            "which_gripped": "none",
            "which_bruised": "3",
            "knocked_off": 0,
        },
    ]
    forces = [(2.0, 5.0), (4.0, 4.5), (None, None)]
    asked = []

    def run(cell, seed, settings):
        truth = stops[len(asked)] | {
            "dropped": 0,
            "stems_torn": 0,
            "numbers": "digest",
            "which_reachable": "0,1,3",
        }
        truth["stem_force_median_n"], truth["stem_force_p95_n"] = forces[len(asked)]
        asked.append((cell, seed, settings))
        tally = {"left": [{"why": f"stop {len(asked)}"}]}
        truth["detached"] = truth["picked"]
        return {"truth": truth, "outcome": "success", "time_s": 10.0, "values": {"tally": tally}}

    monkeypatch.setattr(orchard_pick, "pick_from", run)
    found = pick_wall("orchard", 207, 0.5, (-350, 0, 350), ("--set", "wind=1"))
    assert [settings for _, _, settings in asked] == [
        [
            "--set",
            "leaves=0.5",
            "--set",
            f"stop={stop} mm",
            "--set",
            f"without={gone}",
            "--set",
            "wind=1",
        ]
        for stop, gone in ((-350, "none"), (0, "0,10"), (350, "0,1,10"))
    ]
    truth = found["truth"]
    assert (truth["apples"], truth["picked"], truth["detached"], truth["knocked_off"]) == (
        12,
        2,
        2,
        1,
    )
    assert (truth["reachable"], truth["gripped"], truth["bruised"]) == (3, 3, 2)
    assert (truth["stem_force_median_n"], truth["stem_force_p95_n"]) == (3.0, 5.0)
    assert (found["time_s"], found["picked_at"]) == (30.0, [1, 1, 0])
    assert found["left"] == ["stop 1", "stop 2", "stop 3"]


def test_one_stop_is_compared_with_several(tmp_path):
    several = wall(101, picked=11) | {"cell": "orchard", "stops": [-350, 0, 350]}
    page = report([several, wall(101)], tmp_path)
    assert page.startswith("# Simulated: 20 apples of 1 fruit walls")
    assert "| cell orchard, stops at 0 mm: walls 101 | 8 of 20 | 40% | 22% to 61% |" in page
    assert (
        "| cell orchard, stops at -350, 0, 350 mm: walls 101 | 11 of 20 | 55% | 34% to 74% |"
        in page
    )
    assert "Cell orchard, stops at -350, 0, 350 mm.\n" in report([several], tmp_path)


def test_more_apples_than_the_lower_bound_are_counted():
    assert share("x", 3, 2) == "| x | 3 of 2 | 150% | 34% to 100% |"


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
