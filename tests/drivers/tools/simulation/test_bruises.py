"""Forces that bruise: against Hertz's own formulas."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.skills.grip.limit_surface import bruising_force as gripped
from pomona.tools.simulation.bruises import (
    BRUISE_PRESSURE,
    HARD_MODULUS,
    PAD_MODULUS,
    FruitPress,
    bruising_force,
)


@pytest.mark.parametrize("radius", [0.029, 0.038, 0.048])
@pytest.mark.parametrize("modulus", [PAD_MODULUS, HARD_MODULUS])
def test_the_largest_pressure_is_one_and_a_half_times_the_mean_over_hertzs_circle(radius, modulus):
    force = bruising_force(radius, modulus)
    circle = np.pi * (3.0 * force * radius / (4.0 * modulus)) ** (2.0 / 3.0)
    assert 1.5 * force / circle == pytest.approx(BRUISE_PRESSURE)


@pytest.mark.parametrize("modulus", [PAD_MODULUS, HARD_MODULUS])
def test_a_grip_is_limited_by_the_law_that_scores_it(modulus):
    assert gripped(0.038, modulus) == pytest.approx(bruising_force(0.038, modulus))


def test_a_force_that_lasts_bruises_and_a_short_peak_does_not():
    limit = bruising_force(0.038, PAD_MODULUS)
    lasting, peak = FruitPress(), FruitPress()
    for look in range(50):
        lasting.add(1.01 * limit, 0.0, 0.038, 0.01)
        peak.add(3.0 * limit if look == 10 else 0.0, 0.0, 0.038, 0.01)
    assert lasting.largest > 1.0
    assert peak.largest < 1.0
