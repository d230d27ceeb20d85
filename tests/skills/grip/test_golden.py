"""The controller behaves as recorded: commands and readings of scripted grips and of a few lifts."""

from __future__ import annotations

import json
from typing import Any

import pytest

from benchmarks.grasp_golden import FIGURES, TESTED, run

RECORDED: dict[str, dict[str, Any]] = json.loads(FIGURES.read_text("utf-8"))


def test_every_draw_is_recorded() -> None:
    assert tuple(RECORDED) == TESTED


@pytest.mark.parametrize("name", TESTED)
def test_a_grip_goes_as_recorded(name: str) -> None:
    """The digests are for `make grasp-golden` on one machine; here only rounded figures count."""
    found, recorded = run(name), RECORDED[name]
    assert (found["phase"], found["codes"]) == (recorded["phase"], recorded["codes"])
    share = (
        0.005 if name.startswith("springs") else 0.03
    )  # contacts amplify the last bit, springs do not
    for figure in ("commands", "closed_mm_at_50_hz", "highest_reference_n", "last_reference_n"):
        assert found[figure] == pytest.approx(recorded[figure], rel=share, abs=0.02), figure


def test_a_digest_changes_with_the_last_bit_of_a_command() -> None:
    first, again = run("springs plain"), run("springs plain")
    assert first["digest"] == again["digest"]
    assert first["digest"] != run("springs push")["digest"]
