"""Directions that picks have shown, and the picks that would show the others."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.tools.caliper.directions import angle_directions, further_picks, place_directions
from pomona.tools.caliper.estimate import estimate
from tests.skills.tools.caliper.synthetic import made_landing, made_picks

NO_ERROR = np.zeros(8)


def found(count: int, **how: float):
    return estimate(made_picks(np.random.default_rng(0), NO_ERROR, count, **how))


def test_only_the_line_along_which_fingers_closed_is_known():
    places = place_directions(found(20, azimuth=0.0))
    assert [place.is_known for place in places] == [True, False, False]
    assert abs(places[0].axis[0]) > 0.99
    assert places[0].std < 1e-3
    assert min(place.std for place in places[1:]) > 10e-3


def test_a_line_between_the_picture_s_sides_is_known_as_such():
    known, *rest = place_directions(found(20, azimuth=np.radians(45.0)))
    assert abs(known.axis @ [np.sqrt(0.5), np.sqrt(0.5), 0.0]) > 0.99
    assert not any(place.is_known for place in rest)


def test_fingers_in_all_azimuths_show_two_lines_and_tilted_ones_the_third():
    level = place_directions(found(30))
    assert [place.is_known for place in level] == [True, True, False]
    assert abs(level[2].axis[2]) > 0.99
    assert all(place.is_known for place in place_directions(found(60, tilt=np.radians(60.0))))


@given(seed=st.integers(0, 10**6), count=st.integers(1, 40))
@settings(max_examples=20, deadline=None)
def test_directions_are_orthonormal_and_say_what_the_covariance_says(seed: int, count: int):
    estimated = estimate(made_picks(np.random.default_rng(seed), NO_ERROR, count, tilt=0.3))
    shift, covariance = estimated.shift
    places = place_directions(estimated)
    axes = np.array([place.axis for place in places])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(axes.T @ [place.value for place in places], shift, atol=1e-12)
    assert sum(place.std**2 for place in places) == pytest.approx(np.trace(covariance))
    assert all(place.is_known == (place.std <= 1e-3) for place in places)
    assert len(angle_directions(estimated)) == 3


def test_the_missing_direction_names_the_grasps_that_would_show_it():
    picks = found(10, azimuth=0.0).used
    assert "turned by 90° about the vertical" in further_picks(np.array([0.0, 1.0, 0.0]), picks)
    assert "turned by 40° about" in further_picks(
        np.array([np.cos(0.75), np.sin(0.75), 0.0]), picks
    )
    assert "tilted by 30°" in further_picks(np.array([0.0, 0.0, 1.0]), picks)
    assert "more picks" in further_picks(np.array([1.0, 0.0, 0.0]), picks)
    assert "feel the touch" in further_picks(np.array([1.0, 0.0, 0.0]), found(3, plain=True).used)
    landings = estimate([made_landing(np.random.default_rng(0), NO_ERROR)]).used
    assert "no finger lands on the fruit before" in further_picks(
        np.array([1.0, 0.0, 0.0]), landings
    )
