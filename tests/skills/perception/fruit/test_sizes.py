"""Sizes of a kind: against draws of the model, and with too few fruit."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.skills.perception.fruit.sizes import KindSizes, TooFewFruit, learn_sizes

KIND = KindSizes(0.073, 0.07, 0.957, 0.06, looks=1.05, looks_deviation=0.03)
MODEL = 0.88


def drawn(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return true sizes, shown sizes, their deviations, and sines, drawn by the module's model."""
    rng = np.random.default_rng(seed)
    ln_width = np.log(KIND.width) + KIND.width_deviation * rng.normal(size=count)
    ln_ratio = np.log(KIND.height_over_width) + KIND.height_over_width_deviation * rng.normal(
        size=count
    )
    sine, deviation = rng.uniform(0.0, 1.0, count), rng.uniform(0.02, 0.08, count)
    ln_shown = ln_width + 0.5 * sine**2 * (ln_ratio - np.log(MODEL)) + np.log(KIND.looks)
    ln_shown += np.hypot(deviation, KIND.looks_deviation) * rng.normal(size=count)
    return (
        np.exp(np.column_stack([ln_width, ln_width + ln_ratio])),
        np.exp(ln_shown),
        deviation,
        sine,
    )


def test_intervals_hold_their_stated_share_and_errors_are_less_than_without_either_source() -> None:
    true, shown, deviation, sine = drawn(4000, 0)
    found = [KIND.given(*each, MODEL) for each in zip(shown, deviation, sine, strict=True)]
    error = np.array([size for size, _ in found]) - true
    stated = np.sqrt([np.diag(covariance) for _, covariance in found])
    for share, factor in ((0.5, 0.674), (0.9, 1.645)):
        assert (np.abs(error) < factor * stated).mean(axis=0) == pytest.approx(
            [share, share], abs=0.02
        )
    of_kind = np.abs(KIND.width - true[:, 0]).mean()
    of_picture = np.abs(shown / KIND.looks - true[:, 0]).mean()
    assert np.abs(error[:, 0]).mean() < 0.9 * min(of_kind, of_picture)


def test_a_size_that_no_image_shows_is_the_kinds() -> None:
    size, covariance = KIND.given(0.2, 1e3, 1.0, MODEL)
    assert size == pytest.approx([KIND.width, KIND.width * KIND.height_over_width], rel=1e-3)
    assert np.sqrt(covariance[0, 0]) == pytest.approx(KIND.width * KIND.width_deviation, rel=1e-3)


@given(st.floats(0.04, 0.12), st.floats(0.0, 1.0))
def test_an_exact_measurement_along_the_axis_gives_the_width(width: float, ratio: float) -> None:
    exact = KindSizes(0.073, 0.5, 0.9, 0.06)
    size, covariance = exact.given(width, 1e-6, 0.0, 0.5 + ratio)
    assert size == pytest.approx([width, 0.9 * width], rel=1e-5)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12


def test_sizes_are_learnt_from_fruit_that_were_measured() -> None:
    learnt = learn_sizes(*drawn(3000, 1), MODEL)
    for name in (
        "width",
        "width_deviation",
        "height_over_width",
        "height_over_width_deviation",
        "looks",
    ):
        assert getattr(learnt, name) == pytest.approx(getattr(KIND, name), rel=0.05), name
    assert learnt.looks_deviation == pytest.approx(KIND.looks_deviation, abs=0.01)


def test_a_few_fruit_leave_sizes_wider_than_many() -> None:
    few = [learn_sizes(*drawn(8, seed), MODEL).width_deviation for seed in range(200)]
    assert np.sqrt(np.mean(np.square(few))) > 1.03 * KIND.width_deviation


def test_too_few_fruit_and_sizes_that_are_none_are_refused() -> None:
    with pytest.raises(TooFewFruit, match="5 measured fruit"):
        learn_sizes(*drawn(5, 0), MODEL)
    true, shown, deviation, sine = drawn(9, 0)
    shown[3] = np.nan
    with pytest.raises(TooFewFruit, match="leave its fruit out"):
        learn_sizes(true, shown, deviation, sine, MODEL)
