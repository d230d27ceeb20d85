"""Measured fruit beside calipers: pairs by boxes, figures, and the sizes of the kind."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from pomona.applications.inventory.calipers import (
    CaliperedFruit,
    UnusableCalipers,
    compare,
    figures,
    learn,
    written,
)
from pomona.skills.perception.fruit.sizes import KindSizes, TooFewFruit
from tests.skills.applications.inventory.drawn_fruit import APPLE, LOOKED, found

KIND = KindSizes(0.073, 0.07, 0.957, 0.06, looks=1.05, looks_deviation=0.03)
BOX = 10.0, 20.0, 40.0, 50.0


def by_hand(
    width: float = 0.075,
    height: float = 0.07,
    name: str = "7",
    frame: str = "a",
    box: tuple[float, float, float, float] = BOX,
) -> CaliperedFruit:
    return CaliperedFruit(frame, name, box, np.array([width, height]))


def test_a_find_is_the_fruit_whose_box_it_overlaps_by_half() -> None:
    near, far = (12.0, 20.0, 42.0, 50.0), (30.0, 20.0, 60.0, 50.0)
    other = by_hand(name="8", box=far)
    (pair,) = compare([found()], [other, by_hand(box=near)])
    assert pair.true.name == "7"


def test_of_two_finds_of_one_fruit_the_surest_counts_and_other_frames_do_not() -> None:
    finds = [found(1), found(2), found(1, label="b"), found(3, None)]
    pairs = compare(finds, [by_hand()])
    assert [(pair.fruit.number, pair.fruit.detection.frame.label) for pair in pairs] == [(1, "a")]


@pytest.mark.parametrize(
    ("true", "words"),
    [
        (by_hand(frame="b"), "no measured fruit has its box in the table"),
        (by_hand(7.5e-3, 7e-3), "width_mm is 0.1 times what the camera saw"),
    ],
)
def test_calipers_that_fit_no_find_are_refused(true: CaliperedFruit, words: str) -> None:
    with pytest.raises(UnusableCalipers, match=words):
        compare([found()], [true])


def test_figures_are_bias_mean_error_and_how_often_intervals_hold() -> None:
    labels = ("a", "b")
    finds = [found(1, (0.080, 0.07), "a"), found(1, (0.074, 0.07), "b")]
    pairs = compare(finds, [by_hand(frame=label) for label in labels])
    assert figures(pairs) == (
        "2 measured fruit beside calipers; width: bias +2.0 mm, mean error 3.0 mm, 90 % intervals hold 50%; "
        "height: bias +0.0 mm, mean error 0.0 mm, 90 % intervals hold 100%"
    )


def drawn(count: int, looks: int = 1) -> list:
    """Pairs of fruit that are drawn from `KIND`, each seen in so many frames."""
    rng = np.random.default_rng(0)
    model = float(APPLE.dimensions[1] / APPLE.dimensions[[0, 2]].mean())
    finds, calipered = [], []
    for number in range(count):
        width = np.log(KIND.width) + KIND.width_deviation * rng.normal()
        ratio = np.log(KIND.height_over_width) + KIND.height_over_width_deviation * rng.normal()
        size = float(np.exp(width)), float(np.exp(width + ratio))
        for look in range(looks):
            sine = rng.uniform(0.1, 1.0)
            seen = width + 0.5 * sine**2 * (ratio - np.log(model)) + np.log(KIND.looks)
            shown = np.exp(seen + np.hypot(LOOKED, KIND.looks_deviation) * rng.normal())
            label = f"{number}_{look}"
            finds.append(found(1, size, label, float(shown), sine))
            calipered.append(by_hand(*size, str(number), label))
    return compare(finds, calipered)


def test_the_sizes_of_a_kind_are_found_again() -> None:
    sizes, words = learn(drawn(400))
    assert sizes.width == pytest.approx(KIND.width, rel=0.02)
    assert sizes.height_over_width == pytest.approx(KIND.height_over_width, rel=0.02)
    assert sizes.looks == pytest.approx(KIND.looks, rel=0.01)
    assert sizes.width_deviation == pytest.approx(KIND.width_deviation, rel=0.15)
    assert words.startswith("sizes of 400 fruit; ")


def test_several_looks_at_one_fruit_are_one_fruit() -> None:
    with pytest.raises(TooFewFruit):
        learn(drawn(6, looks=3))  # one is left out in turn
    assert learn(drawn(7, looks=3))[1].startswith("sizes of 7 fruit")


def test_what_is_written_is_a_block_of_a_fruit_file() -> None:
    block = yaml.safe_load(written(KIND))
    assert block == {
        "width": "73.00 mm", "width_deviation": 0.07, "height_over_width": 0.957,
        "height_over_width_deviation": 0.06, "looks": 1.05, "looks_deviation": 0.03,
    }  # fmt: skip
