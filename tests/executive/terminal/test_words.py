"""Figures, durations and reasons as a terminal shows them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from pomona.executive.reasons import Reason
from pomona.executive.terminal.words import (
    at_place,
    figure,
    headline,
    row_of,
    say,
    seconds,
    term,
)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.0, "0 ms"), (0.0123, "12 ms"), (0.0994, "99 ms"), (0.0996, "0.1 s"), (4.26, "4.3 s"), (59.9, "59.9 s"),
        (60.0, "1 min 0 s"), (91.4, "1 min 31 s"), (91.6, "1 min 32 s"), (3600.0, "60 min 0 s"),
    ],
)  # fmt: skip
def test_a_duration_has_a_unit_of_its_size(value: float, words: str) -> None:
    assert seconds(value) == words


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("slip_mm", 0.1392, "slip 0.1392 mm"), ("slip_mm", 0.00049, "slip 0 mm"),
        ("slip_mm", 0.0005, "slip 0.0005 mm"),
        ("slip_mm", -0.00049, "slip 0 mm"), ("height_gained_m", -7.4e-8, "height gained 0 m"),
        ("q_m", 5e-6, "q 5e-06 m"),
        ("least_force_n", 2.5, "minimum grip force 2.5 N"), ("torque_nm", 0.123456, "torque 0.1235 N·m"),
        ("tilt_deg", 0.004, "tilt 0 °"), ("tilt_deg", 0.006, "tilt 0.006 °"), ("turn_rad", 4e-5, "turn 0 rad"),
        ("mass_kg", 6e-5, "mass 6e-05 kg"), ("took_s", 4e-4, "took 0 s"), ("f_n", 6e-4, "f 0.0006 N"),
        ("lifted", True, "lifted: yes"), ("was_lifted", False, "was lifted: no"), ("count", 3, "count 3"),
        ("goal_reached", "no", "goal reached no"), ("point_m", [0.1, 1e-7], "point (0.1, 0) m"),
        ("a_b_c", 1.5, "a b c 1.5"),
        ("size", np.float64(0.25), "size 0.25"), ("point_mm", np.array([1.0, 2.0]), "point (1, 2) mm"),
        ("ratio", 0.0, "ratio 0"), ("gap_mm", math.nan, "gap None mm"),
    ],
)  # fmt: skip
def test_a_figure_has_its_unit_and_no_noise(name: str, value: Any, words: str) -> None:
    assert figure(name, value) == words


@pytest.mark.parametrize(
    ("name", "value", "row"),
    [
        ("slip_mm", 0.1392, ("slip [mm]", "0.1392")), ("lifted", True, ("lifted", "yes")), ("lifted", False,
        ("lifted", "no")),
        ("held_by", "pads", ("held by", "pads")), ("point_m", [1, 2], ("point [m]", None)),
        ("size", math.inf, ("size", None)),
        ("tilt_deg", 1e-3, ("tilt [°]", "0")), ("least_force_n", 12345.6, ("minimum grip force [N]", "1.235e+04")),
    ],
)  # fmt: skip
def test_a_row_has_a_title_and_a_text(name: str, value: Any, row: tuple[str, str | None]) -> None:
    assert row_of(name, value) == row


def test_a_headline_has_the_first_figures_that_are_not_zero() -> None:
    truth = {
        "lifted": True, "slip_mm": 0.0, "words": "no figure", "tilt_deg": 0.001, "at": [1.0], "count": 10, "a": 1,
        "b_n": 20.0, "c": False, "d": 4,
    }  # fmt: skip
    assert headline(truth) == ["lifted: yes", "count 10", "a 1", "b 20 N", "c: no"]
    assert headline({}) == headline({"x": math.nan}) == []


def reason(path: str, code: str, *causes: Reason, **data: Any) -> Reason:
    return Reason(code=code, message="the fruit slipped", node_path=path, data=data, causes=causes)


def test_a_reason_is_told_by_its_last_leaf_and_the_place_of_an_exception() -> None:
    leaf = reason("0/1/Lift", "SLIPPED", place="lift.py:42, in run")
    whole = reason("0", "FAILED", reason("0/0/Plan", "NO_PATH"), leaf)
    assert say(whole) == "Lift SLIPPED: the fruit slipped (lift.py:42, in run)"
    assert say(None) == ""
    assert say(reason("Plan", "NO_PATH")) == "Plan NO_PATH: the fruit slipped"
    assert at_place(leaf) == " (lift.py:42, in run)"
    assert (
        at_place(whole)
        == at_place(reason("a", "B", place=3))
        == at_place(reason("a", "B", place=""))
        == ""
    )
    assert term("size_error") == "size error"
