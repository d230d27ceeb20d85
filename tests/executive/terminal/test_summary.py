"""The summary of a run: whose time it was, what was shown, and every figure of its last line."""

from __future__ import annotations

from pathlib import Path

import pytest
from recorded_events import started

from pomona.executive.reasons import Reason
from pomona.executive.running.events import (
    AttemptEnded,
    Computed,
    Event,
    NodeChanged,
    PortWritten,
    Published,
    RunEnded,
)
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.summary import MOST_COLUMNS, MOST_ROWS, Summary
from pomona.executive.views import TableView

NODES = (
    {"path": "pick", "parent": None, "name": "pick"},
    {"path": "pick/Try:retry", "parent": "pick", "name": "Try"},
    {"path": "pick/Look", "parent": "pick/Try:retry", "name": "Look"},
    {"path": "pick/Lift", "parent": "pick/Try:retry", "name": "Lift"},
)
LOST = Reason("pick/Lift", "LOST", "it slipped", {"n": 1})
WHY = Reason("pick", "LOST", "a child failed", {}, (LOST,))


def change(t: float, path: str, status: str) -> NodeChanged:
    return NodeChanged(t, 0, path, status, "", 1)


def summary(*events: Event, **about: object) -> Summary:
    made = Summary()
    for event in (
        started(nodes=NODES, tree="pick", seed=7, run="r1", cell="desk", **about),
        *events,
    ):
        made.on_event(event)
    return made


def printed(made: Summary, capsys: pytest.CaptureFixture[str], **how: object) -> list[str]:
    made.print(Screen(width=200), how.pop("record", None), **how)
    return capsys.readouterr().out.splitlines()


def ended(outcome: str, reason: Reason | None = None, truth: object = None) -> RunEnded:
    return RunEnded(4.0, 9, outcome, reason, 9, 4.0000004, 1.2344, truth)


RUN = (
    change(0.0, "pick", "RUNNING"),
    change(0.5, "pick/Look", "RUNNING"),
    change(1.0, "pick/Look", "RUNNING"),
    change(1.5, "pick/Look", "SUCCESS"),
    change(1.5, "pick/Look", "SUCCESS"),
    change(2.0, "pick/Lift", "RUNNING"),
    change(3.99, "pick/Lift", "FAILURE"),
    Computed(1.0, 2, "pick/Look", "segment", 0.25),
    Computed(1.1, 2, "pick/Look", "segment", 0.25),
    Computed(2.0, 3, "elsewhere", "plan", 2.0),
    AttemptEnded(4.0, 9, "pick/Try:retry", 2, 3, False, WHY),
    PortWritten(1.5, 2, "pick/fruit", object(), "pick/Look", "an apple", {"n": 3}),
    PortWritten(1.5, 2, "pick/bare", object(), "pick/Look"),
)


def test_the_last_line_holds_the_run_its_attempts_and_the_leaves_times() -> None:
    record = Path("some/run")
    chain = {"node": "pick/Lift", "code": "LOST", "message": "it slipped", "data": {"n": 1}}
    found = summary(*RUN, ended("failure", WHY, {"lifted": False})).as_json(record)
    assert found["reason"].pop("chain")["causes"][0]["code"] == "LOST"
    assert found["attempts"][0]["reason"].pop("chain")["code"] == "LOST"
    assert found == {
        "outcome": "failure",
        "reason": chain,
        "run": "r1",
        "record": str(record),
        "tree": "pick",
        "cell": "desk",
        "seed": 7,
        "ticks": 9,
        "time_s": 4.0,
        "wall_s": 1.234,
        "attempts": [
            {
                "node": "pick/Try:retry",
                "number": 2,
                "of": 3,
                "within": "",
                "succeeded": False,
                "reason": chain,
            }
        ],
        "robot_time_s": {"Look": 1.0, "Lift": 1.99},
        "compute_s": {"Look": 0.5, "elsewhere": 2.0},
        "values": {"fruit": {"n": 3}},
        "account": None,
        "truth": {"lifted": False},
    }
    bare = summary(ended("success")).as_json(None)
    assert (bare["record"], bare["reason"], bare["truth"]) == (None, None, None)


def test_the_page_for_people_says_the_longest_first(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    truth = {"lifted": True, "drops": 0, "bruises": [], "depth_m": None, "T_base_fruit": [1.0]}
    made = summary(
        *RUN, change(3.0, "pick/Look", "RUNNING"), change(3.009, "pick/Look", "SUCCESS"),
        ended("failure", WHY, truth),
        preparation=2.0, cell_kind="simulated",
    )  # fmt: skip
    (tmp_path / "picture.png").touch()
    lines = [" ".join(line.split()) for line in printed(made, capsys, record=tmp_path, whole=True)]
    assert lines == [
        "✗ pick failed: Lift LOST: it slipped "
        "4.0 s simulated; 1.2 s to run, 2.0 s to prepare, 3.2 s in all, seed 7",
        "fruit an apple",
        "try ✗ 2 of 3, at 4.00 s Lift LOST: it slipped",
        "truth lifted: yes drops 0",
        "time Lift 2.0 s Look 1.0 s",
        "computing 2.5 s in all: elsewhere 2.0 s Look 0.5 s",
        f"record {tmp_path} (picture: {tmp_path}/picture.png)",
    ]
    few = printed(made, capsys, record=tmp_path / "other")
    assert [" ".join(line.split()) for line in few[3:]] == [
        "truth lifted: yes",
        *lines[4:6],
        f"record {tmp_path / 'other'}",
    ]


def test_little_is_said_of_a_run_in_which_little_happened(
    capsys: pytest.CaptureFixture[str],
) -> None:
    short = change(1.0, "pick/Look", "RUNNING"), change(1.0099, "pick/Look", "SUCCESS")
    first = AttemptEnded(1.0, 1, "pick/Try:retry", 1, 3, True)
    made = summary(*short, first, ended("success", truth={}), cell_kind="real")
    assert [" ".join(line.split()) for line in printed(made, capsys)] == [
        "✓ pick succeeded on attempt 1 of 3 4.0 s on the cell's clock; 1.2 s to run, seed 7"
    ]
    assert made.sentence() == "pick succeeded on attempt 1 of 3"


@pytest.mark.parametrize(
    ("outcome", "words"),
    [("success", "succeeded"), ("stopped", "stopped: Lift LOST: it slipped"),
     ("error", "ended in the safe state: Lift LOST: it slipped")],
)  # fmt: skip
def test_an_end_has_its_sign_and_words(
    outcome: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    made = summary(ended(outcome, WHY))
    assert made.sentence() == f"pick {words}"
    assert printed(made, capsys)[0][0] == ("✓" if outcome == "success" else "■")


def test_a_table_is_cut_and_says_by_how_much(capsys: pytest.CaptureFixture[str]) -> None:
    names = tuple(f"c{n}" for n in range(MOST_COLUMNS + 1))
    wide = TableView(names, ((*["1"] * MOST_COLUMNS, "last"),), "wide one")
    long = TableView(("number",), tuple((f"row {n}",) for n in range(MOST_ROWS + 2)))
    for views, said in (
        ([wide], ["1 more columns"]),
        ([long], ["2 more rows"]),
        ([TableView(("number",), (("row 1",),))], []),
    ):
        shown = [Published(1.0, 1, "pick/Look", f"t{n}", view) for n, view in enumerate(views)]
        lines = printed(summary(*shown, ended("success")), capsys)
        text = " ".join(" ".join(lines).split())
        assert [words for words in ("1 more columns", "2 more rows") if words in text] == said
        assert "last" not in text
        assert f"row {MOST_ROWS}" not in text
        assert ("writes all" in text) is bool(said)


def attempt(path: str, number: int, of: int, succeeded: bool = False) -> AttemptEnded:
    return AttemptEnded(1.0, 1, path, number, of, succeeded)


def test_attempts_within_others_say_which_and_the_outermost_counts() -> None:
    parents = {"a": None, "a/Out:retry": "a", "a/Out/s": "a/Out:retry", "a/Out/In:retry": "a/Out/s"}
    nodes = tuple(
        {"path": path, "parent": parent, "name": path} for path, parent in parents.items()
    )
    outer, inner = "a/Out:retry", "a/Out/In:retry"
    made = Summary()
    for event in (
        started(nodes=nodes, tree="a"),
        attempt(inner, 1, 1, True),
        attempt(outer, 1, 2),
        attempt(inner, 1, 1, True),
        attempt(outer, 2, 2),  # the last one: what follows is another round
        attempt(inner, 1, 1),
        attempt(outer, 1, 2, True),
        attempt(inner, 1, 1, True),
        ended("success"),
    ):
        made.on_event(event)
    assert made.within() == ["out 1", "", "out 2 of 2", "", "out 1 of 2", "", "out 1 of 2"]
    last = made.last_attempt()
    assert last is not None
    assert last.path == outer
    assert made.sentence() == "a succeeded on attempt 1 of 2"


def test_a_table_stands_under_its_caption_with_figures_to_the_right(
    capsys: pytest.CaptureFixture[str],
) -> None:
    view = TableView(("size", "n"), (("7", "12"),), "two fruits")
    shown = printed(summary(Published(1.0, 1, "x", "t", view), ended("success")), capsys)
    assert [line.rstrip() for line in shown[1:]] == ["two fruits", "size   n", "   7  12"]
