"""Attempts and figures of a report are those of the run."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from recorded_events import started

from pomona.executive.reasons import Reason, failure_codes
from pomona.executive.registry import Registry
from pomona.executive.running.events import (
    AttemptEnded,
    Event,
    HandChanged,
    NodeChanged,
    OperatorActed,
    RunEnded,
    SafeStopped,
    TickOverran,
)
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.summary import Summary
from pomona.executive.terminal.words import figure, row_of
from pomona.tools.dashboard.explain import explain
from pomona.tools.library.campaign.report import title

NODES = (
    {"path": "pick", "parent": None, "name": "pick", "type": "sequence"},
    {"path": "pick/Look:retry", "parent": "pick", "name": "retry", "type": "retry"},
    {"path": "pick/Look", "parent": "pick/Look:retry", "name": "Look", "type": "sequence"},
    {"path": "pick/Look/Attempt:retry", "parent": "pick/Look", "name": "retry", "type": "retry"},
    {
        "path": "pick/Look/Attempt",
        "parent": "pick/Look/Attempt:retry",
        "name": "Attempt",
        "type": "sequence",
    },
    {
        "path": "pick/Look/Attempt/Lift",
        "parent": "pick/Look/Attempt",
        "name": "Lift",
        "type": "Lift",
    },
)
LOST = Reason("pick/Look/Attempt/Lift", "LOST", "it slipped")


def attempt(t: float, path: str, number: int, of: int, succeeded: bool = False) -> Event:
    return AttemptEnded(t, int(t * 50), path, number, of, succeeded, None if succeeded else LOST)


RUN = (
    started(nodes=NODES),
    attempt(1.0, "pick/Look/Attempt:retry", 1, 8),
    attempt(1.0, "pick/Look:retry", 1, 3),
    attempt(2.0, "pick/Look/Attempt:retry", 1, 8),
    attempt(2.0, "pick/Look:retry", 2, 3),
    attempt(3.0, "pick/Look/Attempt:retry", 1, 8),
    attempt(4.0, "pick/Look/Attempt:retry", 2, 8, True),
    attempt(4.0, "pick/Look:retry", 3, 3, True),
    RunEnded(
        4.0,
        200,
        "success",
        None,
        200,
        4.0,
        1.0,
        {"lifted": True, "drops": 1, "height_gained_m": -7.4e-08},
    ),
)


def said(capsys: pytest.CaptureFixture[str]) -> list[str]:
    summary = Summary()
    for event in RUN:
        summary.on_event(event)
    summary.print(Screen(width=200), None)
    return capsys.readouterr().out.splitlines()


def test_attempts_with_the_same_number_are_distinguished(
    capsys: pytest.CaptureFixture[str],
) -> None:
    told = [" ".join(line.split()) for line in said(capsys) if line.split()[0] == "attempt"]
    assert told == [
        "attempt ✗ 1 of 8 in look 1, at 1.00 s Lift LOST: it slipped",
        "attempt ✗ 1 of 8 in look 2 of 3, at 2.00 s Lift LOST: it slipped",
        "attempt ✗ 1 of 8 in look 3 of 3, at 3.00 s Lift LOST: it slipped",
        "attempt ✓ 2 of 8 in look 3 of 3, at 4.00 s",
    ]
    text = " ".join(explain(RUN))
    assert "At 2.0 s attempt 1 of 8 (Attempt, in look 2 of 3) ended" in text


def test_the_headline_counts_the_outermost_attempts(capsys: pytest.CaptureFixture[str]) -> None:
    assert "succeeded on attempt 3 of 3" in said(capsys)[0]
    assert "on the third attempt of 3" in explain(RUN)[0]


def test_a_single_attempt_is_not_counted(capsys: pytest.CaptureFixture[str]) -> None:
    summary = Summary()
    for event in (RUN[0], attempt(1.0, "pick/Look:retry", 1, 1, True), RUN[-1]):
        summary.on_event(event)
    summary.print(Screen(width=200), None)
    assert "succeeded   " in capsys.readouterr().out


def test_a_comparison_has_words_units_and_no_figure_finer_than_measured() -> None:
    assert row_of("height_gained_m", -7.7e-08) == ("height gained [m]", "0")
    assert row_of("slip_mm", 0.77551) == ("slip [mm]", "0.7755")
    assert row_of("lifted", False) == ("lifted", "no")
    assert row_of("fruit", "apple_1") == ("fruit", "apple_1")
    assert row_of("dimensions_m", [0.1, 0.2]) == ("dimensions [m]", None)
    assert row_of("drops", None) == ("drops", None)


def test_a_key_of_records_is_shown_as_the_term_of_the_glossary() -> None:
    assert figure("least_force_n", 2.0) == "minimum grip force 2 N"
    assert title("least_force_n") == "minimum grip force [N]"


def test_the_worlds_score_is_reported_unchanged(capsys: pytest.CaptureFixture[str]) -> None:
    (truth,) = (line for line in said(capsys) if "truth" in line)
    assert "drops 1" in truth
    assert "lifted: yes" in truth
    assert "height gained" not in truth, "what is 0 is left out"
    assert "e-08" not in " ".join(explain(RUN))


def test_a_summary_shows_the_first_five_figures_and_the_sheet_of_a_run_all(
    capsys: pytest.CaptureFixture[str],
) -> None:
    score = {
        "lifted": True,
        "drops": 0,
        "fruit": "apple_1",
        **{f"part_{n}_mm": float(n) for n in range(1, 9)},
    }
    summary = Summary()
    for event in (*RUN[:-1], replace(RUN[-1], truth={**score, "collided_with": []})):
        summary.on_event(event)
    for whole, names in ((False, range(1, 5)), (True, range(1, 9))):
        summary.print(Screen(width=300), None, whole=whole)
        (truth,) = (line for line in capsys.readouterr().out.splitlines() if "truth" in line)
        assert re.findall(r"part \d", truth) == [f"part {n}" for n in names]
        assert ("apple_1" in truth) == ("drops 0" in truth) == whole
        assert "collided" not in truth


def test_times_are_those_of_the_run_of_its_preparation_and_of_both(
    capsys: pytest.CaptureFixture[str],
) -> None:
    summary = Summary()
    for event in (replace(RUN[0], preparation=20.0), *RUN[1:]):
        summary.on_event(event)
    summary.print(Screen(width=200), None)
    out = capsys.readouterr().out
    assert "4.0 s simulated; 1.0 s to run, 20.0 s to prepare, 21.0 s in all, seed 3" in out
    assert not [line for line in out.splitlines() if line.split() == ["time"]], (
        "no node took any time"
    )


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("height_gained_m", 0.14989, "height gained 0.1499 m"), ("height_gained_m", -7.4e-08, "height gained 0 m"),
        ("slip_mm", -0.0, "slip 0 mm"), ("slip_mm", 0.1392, "slip 0.1392 mm"),
        ("peak_force_n", 8.083, "peak force 8.083 N"), ("lifted", False, "lifted: no"), ("drops", 2, "drops 2"),
        ("dimensions_m", [0.089, 1e-9], "dimensions (0.089, 0) m"),
        ("ratio", 3e-9, "ratio 3e-09"),
    ],
)  # fmt: skip
def test_no_figure_is_finer_than_anything_measures(name: str, value: object, words: str) -> None:
    assert figure(name, value) == words


LIFT = "pick/Look/Attempt/Lift"


def test_finger_contact_is_reported_when_a_skill_has_ended_and_not_while_it_grips() -> None:
    felt = [
        NodeChanged(2.0, 100, LIFT, "RUNNING", "", 1),
        HandChanged(2.1, 105, "something is between the fingers"),
        HandChanged(2.2, 110, "the grip force fell below 0.2 N: the fruit may have been lost"),
        HandChanged(2.3, 115, "something is between the fingers"),
        NodeChanged(2.5, 125, LIFT, "SUCCESS", "", 1),
        NodeChanged(3.0, 150, LIFT, "RUNNING", "", 2),
        HandChanged(3.5, 175, ""),
        NodeChanged(3.6, 180, LIFT, "FAILURE", "", 2, LOST),
    ]
    text = " ".join(explain([*RUN[:4], *felt, *RUN[4:]]))
    assert re.findall(r"At \S+ s finger contact changed: [^.]*", text) == [
        "At 2.3 s finger contact changed: something is between the fingers",
        "At 3.5 s finger contact changed: no contact",
    ]
    assert "the fingers felt" not in " ".join(
        explain([*RUN[:4], HandChanged(0.0, 0, ""), *RUN[4:]])
    )


HEAVY = Reason(LIFT, "TOO_HEAVY", "put back", {"limit_n": 14.0, "wanted_n": 20.7})


def test_three_sentences_give_event_cause_and_remedy() -> None:
    failed = NodeChanged(3.5, 175, LIFT, "FAILURE", "", 1, HEAVY)
    late = TickOverran(0.2, 10, LIFT, 1.2, 0.1)
    run = (RUN[0], late, failed, RunEnded(5.2, 260, "failure", HEAVY, 260, 5.2, 1.0, {"drops": 1}))
    what, why, remedy = explain(run, whole=False)
    assert what.endswith("on 9 September 2001 at 01:46. It failed after 5.2 s.")
    assert why == "The reason, at 3.5 s: Lift failed with TOO_HEAVY: put back."
    assert remedy.startswith("Remedy: none needed if `max_force` is right")
    whole = explain(run)
    assert whole[:3] == [what, why, remedy]
    assert "Figures: limit 14 N, wanted 20.7 N." in whole[3]
    assert "kept the tick waiting" in " ".join(whole[3:])


def test_of_a_stopped_run_the_moments_are_listed_in_the_order_of_time() -> None:
    reason = Reason("", "SAFE_STOP", "Ada pressed SAFE STOP")
    run = (
        RUN[0],
        NodeChanged(1.0, 50, LIFT, "RUNNING", "", 1),
        OperatorActed(0.0, 0, "command line", "break", "before Lift"),
        TickOverran(2.0, 100, LIFT, 0.9, 0.1),
        TickOverran(2.5, 125, LIFT, 1.9, 0.1),
        OperatorActed(3.0, 150, "Ada", "safe_stop"),
        SafeStopped(3.0, 150, "Ada pressed SAFE STOP"),
        NodeChanged(3.1, 155, LIFT, "INVALID", "", 1),
        OperatorActed(3.4, 170, "Ada", "acknowledge"),
        RunEnded(3.1, 155, "stopped", reason, 155, 3.1, 1.0, None),
    )
    what, why, remedy, *rest = explain(run)
    assert what.endswith("It was stopped after 3.1 s.")
    assert why == "The reason, at 3.0 s, while Lift was running: SAFE_STOP: Ada pressed SAFE STOP."
    assert "--recover" in remedy
    (moments,) = (paragraph for paragraph in rest if "Ada: acknowledge" in paragraph)
    times = [float(t) for t in re.findall(r"At (\d\.\d) s", moments)]
    assert times == [0.0, 2.5, 3.0, 3.0, 3.4], "of the late ticks the longest is told"
    assert "Ticks that waited 0.5 s or longer: 2." in moments
    assert "Ada: safe stop" in moments


@pytest.mark.parametrize("cell", ["none", "dry"])
def test_a_run_without_a_cell_names_none(cell: str) -> None:
    assert explain([started(cell=cell, cell_kind="mock")])[0].startswith(
        "pick ran without a cell, with seed 3"
    )


def test_a_skill_that_a_stop_interrupted_has_not_failed() -> None:
    why = explain(
        (
            RUN[0],
            NodeChanged(1.0, 50, LIFT, "RUNNING", "", 1),
            SafeStopped(2.1, 105, "the process was terminated"),
            RunEnded(
                2.1,
                105,
                "stopped",
                Reason(LIFT, "SAFE_STOP", "the process was terminated"),
                105,
                2.1,
                1.0,
                None,
            ),
        )
    )[1]
    assert (
        why
        == "The reason, at 2.1 s, while Lift was running: SAFE_STOP: the process was terminated."
    )


def test_every_failure_code_that_can_occur_has_a_meaning_and_a_remedy() -> None:
    of_skills = {
        code
        for skill in Registry.installed().values()
        if skill.__module__.startswith("pomona.")
        for code in skill.failures
    }
    of_the_language = {
        "BAD_VALUE", "CONDITION_FALSE", "DONE_IN_PART", "UNVERIFIED", "EXCEPTION", "FAILED", "FORCED", "INTERRUPTED",
        "INVERTED", "NOBODY_TO_ASK",
        "NOT_APPROVED", "NO_ANSWER", "NO_RECORD", "SAFE_STOP", "STOPPED", "TIMEOUT",
    }  # fmt: skip
    of_shipped_trees = {"NO_ORDER", "PLC_FAULT"}  # `fail` of pick_for_plc
    described = failure_codes()
    assert of_skills | of_the_language | of_shipped_trees == described.keys()
    for code in described.values():
        for sentence in (code.meaning, code.remedy):
            assert sentence.strip()
            assert len(sentence.split()) <= 25, sentence
            assert not sentence.endswith("."), sentence
