"""Mass of a fruit from its size: the mean of weighed fruit of the model's size, scaled with the volume."""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.fruit import FruitModel


def mass_of(fruit: FruitModel, dimensions: Float64, covariance: Float64) -> tuple[float, float] | None:
    """Return the mass and its standard deviation [kg] by the dimensions, (3,) [m], and their covariance, (3, 3) [m²].

    It is None for a kind without weighed fruit.
    """
    if fruit.mass is None:
        return None
    mass = fruit.mass * float(np.prod(dimensions / fruit.dimensions))
    relative = 1.0 / dimensions  # d(ln m) / d(dimensions)
    return mass, mass * float(np.sqrt(relative @ covariance @ relative + fruit.mass_spread**2))


def mass_model(fruit: FruitModel) -> str:
    """Name the model of the mass for the operator; empty without one."""
    if fruit.mass is None:
        return ""
    size = " x ".join(f"{1e3 * d:.0f}" for d in fruit.dimensions)
    return f"{1e3 * fruit.mass:.0f} g at {size} mm, with the volume, +- {fruit.mass_spread:.0%}"
