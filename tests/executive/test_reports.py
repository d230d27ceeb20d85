"""What a report says of attempts and figures is what happened."""

from __future__ import annotations

import pytest
from recorded_events import started

from pomona.executive.reasons import Reason
from pomona.executive.running.events import AttemptEnded, Event, HandChanged, RunEnded
from pomona.executive.terminal.explain import explain
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.summary import Summary
from pomona.executive.terminal.words import figure

NODES = (
    {"path": "pick", "parent": None, "name": "pick", "type": "sequence"},
    {"path": "pick/Look:retry", "parent": "pick", "name": "retry", "type": "retry"},
    {"path": "pick/Look", "parent": "pick/Look:retry", "name": "Look", "type": "sequence"},
    {"path": "pick/Look/Attempt:retry", "parent": "pick/Look", "name": "retry", "type": "retry"},
    {"path": "pick/Look/Attempt", "parent": "pick/Look/Attempt:retry", "name": "Attempt", "type": "sequence"},
    {"path": "pick/Look/Attempt/Lift", "parent": "pick/Look/Attempt", "name": "Lift", "type": "Lift"},
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
    RunEnded(4.0, 200, "success", None, 200, 4.0, 1.0, {"lifted": True, "drops": 1, "height_gained_m": -7.4e-08}),
)


def said(capsys: pytest.CaptureFixture[str]) -> list[str]:
    summary = Summary()
    for event in RUN:
        summary.on_event(event)
    summary.print(Screen(width=200), None)
    return capsys.readouterr().out.splitlines()


def test_an_attempt_that_is_called_the_first_three_times_is_told_apart(capsys: pytest.CaptureFixture[str]) -> None:
    told = [" ".join(line.split()) for line in said(capsys) if line.split()[0] == "attempt"]
    assert told == [
        "attempt ✗ 1 of 8 in look 1, at 1.00 s Lift LOST: it slipped",
        "attempt ✗ 1 of 8 in look 2 of 3, at 2.00 s Lift LOST: it slipped",
        "attempt ✗ 1 of 8 in look 3 of 3, at 3.00 s Lift LOST: it slipped",
        "attempt ✓ 2 of 8 in look 3 of 3, at 4.00 s",
    ]
    text = " ".join(explain(RUN))
    assert "Attempt 1 of 8 (Attempt, in look 2 of 3) ended at 2.0 s" in text


def test_the_headline_counts_the_outermost_attempts(capsys: pytest.CaptureFixture[str]) -> None:
    assert "succeeded on attempt 3 of 3" in said(capsys)[0]
    assert "on the third attempt of 3" in explain(RUN)[0]


def test_the_worlds_score_is_told_as_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    (truth,) = (line for line in said(capsys) if "truth" in line)
    assert "drops 1" in truth
    assert "height gained 0 m" in truth
    assert "e-08" not in " ".join(explain(RUN))


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


def test_what_came_between_the_fingers_and_went_is_told() -> None:
    felt = [
        HandChanged(0.0, 0, ""),
        HandChanged(2.5, 125, "something is between the fingers"),
        HandChanged(3.5, 175, ""),
    ]
    text = " ".join(explain([*RUN[:4], *felt, *RUN[4:]]))
    assert "The fingers felt: at 2.5 s something is between the fingers, at 3.5 s nothing any more." in text
    assert "The fingers felt" not in " ".join(explain([*RUN[:4], felt[0], *RUN[4:]]))
