"""The filter of a fruit on a belt: properties, and honest ellipses with a bias that changes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.applications.conveyor.track_filter import (
    BIAS,
    BIAS_TIME,
    CARRIED,
    FREE,
    ROLLING,
    SIGMA,
    MotionModel,
    begin,
    predict,
    update,
)

models = st.sampled_from([FREE, CARRIED, ROLLING])
times = st.floats(0.0, 5.0)


def prediction_error(model: MotionModel, encoder: bool, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Error and covariance of a place half a second ahead, level, of a fruit that moves as its model has it.

    It was measured for a second at 30 Hz, with noise and with a bias that wanders.
    """
    rng, dt, speed = np.random.default_rng(seed), 1.0 / 30.0, 0.3
    own = rng.normal(0.0, 1e-3, 2) if encoder else np.array([speed, 0.0])
    place, bias, state = np.zeros(2), rng.normal(0.0, BIAS, 2), None
    for k in range(46):
        t, travelled = k * dt, speed * k * dt if encoder else 0.0
        if k:
            place = place + own * dt + [speed * dt if encoder else 0.0, 0.0]
            own = own + rng.normal(0.0, model.wander * np.sqrt(dt), 2)
        if k > 30:
            continue
        keeps = np.exp(-dt / BIAS_TIME)
        bias = keeps * bias + rng.normal(0.0, BIAS * np.sqrt(1.0 - keeps**2), 2)
        seen = np.append(place + bias + rng.normal(0.0, SIGMA, 2), 0.04)
        state = (
            begin(t, travelled, seen, model)
            if state is None
            else update(predict(state, t, travelled, model), seen)[0]
        )
    assert state is not None
    ahead = predict(state, 1.5, speed * 1.5 if encoder else 0.0, model)
    return ahead.place[:2] - place, ahead.place_covariance[:2, :2]


@given(models, times, st.floats(-1.0, 1.0))
@settings(max_examples=50, deadline=None)
def test_a_prediction_never_becomes_surer_of_the_place_and_its_covariance_stays_one(
    model: MotionModel, ahead: float, speed: float
) -> None:
    state = begin(1.0, 0.2, np.array([0.1, 0.0, 0.04]), model)
    later = predict(state, 1.0 + ahead, 0.2 + speed * ahead, model)
    assert np.linalg.eigvalsh(later.P - later.P.T) == pytest.approx(np.zeros(9))
    assert np.linalg.eigvalsh(later.P).min() > -1e-12
    assert (np.diag(later.place_covariance) >= np.diag(state.place_covariance) - 1e-15).all()
    assert later.place[0] == pytest.approx(0.1 + speed * ahead)


@given(models, times, times)
@settings(max_examples=50, deadline=None)
def test_two_predictions_one_after_the_other_are_the_same_as_one(
    model: MotionModel, first: float, then: float
) -> None:
    state = begin(0.0, 0.0, np.array([0.1, 0.0, 0.04]), model)
    at_once = predict(state, first + then, 0.0, model)
    in_two = predict(predict(state, first, 0.0, model), first + then, 0.0, model)
    assert in_two.x == pytest.approx(at_once.x, abs=1e-12)
    assert pytest.approx(at_once.P, rel=1e-6, abs=1e-12) == in_two.P


@given(models, st.floats(-5e-3, 5e-3))
@settings(max_examples=50, deadline=None)
def test_a_measurement_makes_the_state_surer_and_lies_between_expectation_and_measurement(
    model: MotionModel, off: float
) -> None:
    expected = predict(begin(0.0, 0.0, np.array([0.1, 0.0, 0.04]), model), 0.1, 0.0, model)
    state, square, _ = update(expected, expected.place + np.array([off, 0.0, 0.0]))
    assert np.trace(state.place_covariance) <= np.trace(expected.place_covariance)
    assert square >= 0.0
    low, high = sorted((expected.place[0], expected.place[0] + off))
    assert low - 1e-12 <= state.place[0] <= high + 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("model", "encoder"), [(FREE, False), (CARRIED, True)])
def test_ninety_percent_ellipses_half_a_second_ahead_hold_nine_of_ten_fruit(
    model: MotionModel, encoder: bool
) -> None:
    errors = [prediction_error(model, encoder, seed) for seed in range(200)]
    held = np.mean([off @ np.linalg.solve(P, off) < 4.605 for off, P in errors])
    assert 0.85 <= held <= 0.95


def test_the_encoder_makes_the_prediction_surer() -> None:
    sizes = [
        np.trace(prediction_error(model, encoder, 3)[1])
        for model, encoder in ((FREE, False), (CARRIED, True))
    ]
    assert sizes[1] < 0.5 * sizes[0]


def test_a_wrong_stamp_of_the_joints_shows_in_the_innovation() -> None:
    """20 ms at 0.3 m/s are 6 mm, which come and go with the hand's motion."""
    state, rng, squares = (
        begin(0.0, 0.0, np.array([0.0, 0.0, 0.04]), CARRIED),
        np.random.default_rng(2),
        [],
    )
    for k in range(1, 40):
        t, hand = k / 30.0, 0.3 * min(max(k / 30.0 - 0.5, 0.0), 0.3)
        late = 0.3 * 0.020 if 0.5 < t < 0.8 else 0.0
        place = np.array([0.2 * t + late, 0.0, 0.04]) + rng.normal(0.0, SIGMA, 3)
        state, square, _ = update(predict(state, t, 0.2 * t, CARRIED), place)
        squares.append((t, square, hand))
    before = np.mean([s for t, s, _ in squares if 0.2 < t < 0.5])
    assert before < 3.0
    assert max(s for t, s, _ in squares if 0.5 < t < 0.6) > 30.0
