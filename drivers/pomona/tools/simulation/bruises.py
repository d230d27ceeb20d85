"""Forces on a simulated fruit beside those that bruise an apple, by Hertz's contact of a ball."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BRUISE_PRESSURE = 0.10e6
"""Largest static pressure of a contact that bruises no apple [Pa]; the flesh fails at 0.29 MPa (ifoodmm 31(5)48)."""

BRUISE_TIME = 0.05
"""Time over which forces are averaged [s]: shorter peaks are those of the engine's solver, not of fruit."""

PAD_MODULUS = 1.0e6
"""Modulus of the contact with a pad [Pa], assumed: 8 N on a fruit of 76 mm give the pressure above."""

HARD_MODULUS = 1.5e6
"""Modulus of the contact with anything hard [Pa], assumed: half of the flesh's 3 MPa."""


@dataclass(slots=True)
class FruitPress:
    """Mean forces on one fruit, and how near they have come to a bruise.

    Attributes:
        pad, beside: mean force of the harder pad, and of everything else [N].
        largest: largest ratio of such a force to the force that bruises.
    """

    pad: float = 0.0
    beside: float = 0.0
    largest: float = 0.0

    def add(self, pad: float, beside: float, radius: float, elapsed: float) -> None:
        """Add the forces [N] on a fruit of this radius [m], `elapsed` [s] after the last ones."""
        weight = elapsed / BRUISE_TIME
        self.pad += weight * (pad - self.pad)
        self.beside += weight * (beside - self.beside)
        self.largest = max(
            self.largest,
            self.pad / bruising_force(radius, PAD_MODULUS),
            self.beside / bruising_force(radius, HARD_MODULUS),
        )


def bruising_force(radius: float, modulus: float) -> float:
    """Return the force at which a ball of this radius [m] has the bruising pressure in its contact [N].

    Args:
        modulus: of the contact, 1 / ((1-ν₁²)/E₁ + (1-ν₂²)/E₂) [Pa].
    """
    return float(np.pi**3 * radius**2 * BRUISE_PRESSURE**3 / (6.0 * modulus**2))
