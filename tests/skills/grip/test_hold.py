"""Whether something else carries a held fruit, by the load along the pads."""

from __future__ import annotations

import numpy as np

from pomona.skills.grip.hold import FloorWatch
from pomona.skills.grip.pads import MIRROR


def wrenches(*load: float) -> np.ndarray:
    """Both fingers bear half of a load along x and y of the left pad's frame [N]."""
    left = np.array([0.5 * load[0], 0.5 * load[1], -2.0, 0.0, 0.0, 0.0])
    return np.array([left, MIRROR * left])


def look(watch: FloorWatch, *load: float, samples: int = 3) -> bool:
    return [watch.look(wrenches(*load)) for _ in range(samples)][-1]


def test_a_load_that_goes_away_or_turns_round_is_carried() -> None:
    for floor in ((1.1, 0.0), (0.0, 0.0), (-3.0, 0.0), (1.5, 0.5)):
        watch = FloorWatch(0.35)
        assert not look(watch, 1.5, 0.0)
        assert look(watch, *floor), floor


def test_two_samples_are_no_contact() -> None:
    watch = FloorWatch(0.35)
    look(watch, 1.5, 0.0)
    assert not look(watch, 0.0, 0.0, samples=2)
    assert not look(watch, 1.5, 0.0)


def test_a_load_that_grows_is_borne_by_the_grip() -> None:
    watch = FloorWatch(0.35)
    look(watch, 1.5, 0.0)
    assert not look(watch, 2.5, 0.0)
    assert look(watch, 0.0, 0.0)
    assert look(watch, 1.5, 0.0)
    assert not look(watch, 2.5, 0.0)


def test_a_fruit_without_weight_is_carried_by_any_contact() -> None:
    watch = FloorWatch(0.35)
    look(watch, 0.0, 0.0)
    assert look(watch, 0.0, -0.5)
