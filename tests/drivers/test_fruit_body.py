"""The law of bruises against Hertz's own formulas."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.drivers.fruit_body import HARD_MODULUS, PAD_MODULUS, bruising_force


@pytest.mark.parametrize("radius", [0.029, 0.048])
@pytest.mark.parametrize("modulus", [PAD_MODULUS, HARD_MODULUS])
@pytest.mark.parametrize("pressure", [60e3, 100e3])
def test_the_largest_pressure_is_one_and_a_half_times_the_mean_over_hertzs_circle(
    radius: float, modulus: float, pressure: float
) -> None:
    force = bruising_force(pressure, radius, modulus)
    circle = np.pi * (3.0 * force * radius / (4.0 * modulus)) ** (2.0 / 3.0)
    assert 1.5 * force / circle == pytest.approx(pressure)


def test_two_fruits_of_one_size_press_each_other_as_a_hard_plane_does() -> None:
    between = bruising_force(100e3, 0.038 / 2.0, HARD_MODULUS / 2.0)
    assert between == pytest.approx(bruising_force(100e3, 0.038, HARD_MODULUS))
