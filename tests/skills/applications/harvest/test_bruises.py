import numpy as np
import pytest

from pomona.applications.harvest.bruises import impact_force, peak_pressure
from pomona.skills.grip.limit_surface import NO_BRUISE, PAD_MODULUS, bruising_force


def test_peak_pressure_is_one_and_a_half_times_the_mean_over_hertzs_circle():
    force, radius, modulus = 8.0, 0.038, 1.0e6
    area = np.pi * (3.0 * force * radius / (4.0 * modulus)) ** (2.0 / 3.0)
    assert peak_pressure(force, radius, modulus) == pytest.approx(1.5 * force / area)


def test_an_impacts_peak_conserves_energy():
    """At the peak the ball stands: 2/5·K·δ^(5/2) = m·v²/2 with F = K·δ^(3/2), K = 4/3·E·√R."""
    mass, speed, radius, modulus = 0.17, 0.5, 0.038, 1.5e6
    stiffness = 4.0 / 3.0 * modulus * np.sqrt(radius)
    depth = (1.25 * mass * speed**2 / stiffness) ** 0.4
    assert impact_force(mass * speed, mass, radius, modulus) == pytest.approx(
        stiffness * depth**1.5
    )


def test_pads_bruise_from_eight_newtons_as_the_numbers_say(numbers):
    assert peak_pressure(8.0, 0.038, numbers.modulus_pad) == pytest.approx(
        numbers.bruise_pressure, rel=0.05
    )


def test_a_grip_stops_at_the_force_of_the_same_law():
    for radius in (0.029, 0.038, 0.048):
        assert peak_pressure(bruising_force(radius), radius, PAD_MODULUS) == pytest.approx(
            NO_BRUISE
        )


def test_foam_saves_a_fall_that_wood_does_not(numbers):
    impulse = 0.17 * np.sqrt(2.0 * 9.81 * 0.012)
    foam, hard = (
        impact_force(impulse, 0.17, 0.038, e)
        for e in (numbers.modulus_lining, numbers.modulus_hard)
    )
    assert foam < numbers.bruise_impact < hard
