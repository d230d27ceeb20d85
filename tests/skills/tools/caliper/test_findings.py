"""Sentences about an estimate."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.tools.caliper.estimate import estimate
from pomona.tools.caliper.findings import (
    corrected,
    find_error,
    hidden,
    is_proven,
    is_shown,
    known,
    next_picks,
)
from tests.skills.tools.caliper.synthetic import looked, made_picks


def shifted(x: float, count: int = 12, seed: int = 0, y: float = 0.0):
    """Estimate of a camera that sits beside its place [m]."""
    error = np.array([x, y, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    return estimate(made_picks(np.random.default_rng(seed), error, count))


def test_a_camera_that_sits_to_the_left_is_reported_with_numbers():
    finding = find_error(shifted(-6e-3))
    assert finding.is_off
    assert finding.sentence.startswith("The camera sits ")
    assert " mm to the left of where the cell file has it" in finding.sentence
    assert "(12 picks)" in finding.sentence
    assert 5.0 < float(finding.sentence.split()[3]) < 7.0


def test_both_directions_are_named():
    sentence = find_error(shifted(6e-3, y=-5e-3)).sentence
    assert "mm to the right" in sentence
    assert "mm to the top" in sentence


def test_five_picks_show_a_camera_that_is_five_millimetres_off():
    noticed = [find_error(shifted(5e-3, 5, seed)).is_off for seed in range(50)]
    assert np.mean(noticed) > 0.9


def test_a_camera_in_its_place_gives_no_false_alarm():
    alarms = [find_error(shifted(0.0, 5, seed)).is_off for seed in range(200)]
    assert sum(alarms) <= 1
    assert find_error(shifted(0.0)).sentence.startswith("The camera is at most ")


def test_quantities_that_no_pick_shows_are_named_with_the_picks_that_would():
    sentences = list(hidden(shifted(0.0)))
    assert any(
        "place along the view (± 2" in sentence and "grasps tilted by 30°" in sentence
        for sentence in sentences
    )
    assert not any("across the picture" in sentence for sentence in sentences)


def test_a_turn_is_reported_about_its_axis():
    error = np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.radians(2.0), 0.0, 0.0])
    finding = find_error(estimate(made_picks(np.random.default_rng(0), error, 20)))
    assert finding.is_off
    assert "° about the view" in finding.sentence
    assert 1.5 < float(finding.sentence.partition("turned by ")[2].split()[0]) < 2.5


def test_known_and_hidden_directions_together_are_all_of_them():
    for seed in range(5):
        found = estimate(
            made_picks(np.random.default_rng(seed), np.zeros(8), 4 + 10 * seed, tilt=0.5)
        )
        assert len(list(known(found))) + len(list(hidden(found))) == 8


def test_the_picks_that_would_show_more_are_named_in_one_sentence():
    one_way = estimate(made_picks(np.random.default_rng(0), np.zeros(8), 12, azimuth=0.0))
    sentence = next_picks(one_way)
    assert "along the picture's height" in sentence
    assert "grasps turned by 90° about the vertical" in sentence
    every_way = made_picks(np.random.default_rng(0), np.zeros(8), 80, tilt=np.radians(60.0))
    assert next_picks(estimate(every_way)) == ""


def test_a_plain_gripper_alone_gives_no_verdict_on_the_place():
    picks = made_picks(np.random.default_rng(0), np.zeros(8), 9, plain=True)
    finding = find_error(estimate(picks))
    assert not finding.is_off
    assert finding.sentence == "The camera's place is not known from 9 picks."
    with_table = find_error(estimate(looked(picks, np.zeros(8)))).sentence
    assert "not known from 9 picks; it is turned as the cell file has it, within 0." in with_table
    assert "the view" not in with_table
    advice = list(hidden(estimate(looked(picks, np.zeros(8)))))
    assert len(advice) == 6
    assert sum("fingers that feel the touch of each pad would" in line for line in advice) >= 5


def test_the_corrected_pose_puts_the_fruit_where_the_fingers_felt_them():
    found = shifted(7e-3, 40)
    T = corrected(found, np.eye(4))
    at = T[:3, :3] @ (found.centre * (1.0 + found.error[6])) + T[:3, 3]
    assert (at - found.centre)[0] == pytest.approx(7e-3, abs=0.6e-3)


def test_picks_along_one_line_prove_no_place():
    error = np.array([15e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    picks = made_picks(np.random.default_rng(0), error, 3, azimuth=np.pi / 2.0)
    assert not is_proven(estimate(picks))


def test_a_turn_beyond_the_limit_is_not_said_to_be_that_of_the_cell_file():
    turned = np.array([*[0.0] * 3, np.radians(0.8), *[0.0] * 4])
    picks = made_picks(np.random.default_rng(0), turned, 1, plain=True)
    sentence = find_error(estimate(looked(picks, turned))).sentence
    assert "as the cell file has it" not in sentence
    assert "not known from 1 pick, nor its turn about" in sentence


def test_a_right_cell_shows_no_error_in_six_picks():
    shown = [is_shown(shifted(0.0, 6, seed)) for seed in range(40)]
    assert np.mean(shown) <= 0.1
    assert is_shown(shifted(4e-3, 6))
