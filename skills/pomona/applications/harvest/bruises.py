"""Loads that bruise a fruit: static pressure and impact, by Hertz's contact of a ball."""

from __future__ import annotations

import numba


@numba.njit(cache=True)
def peak_pressure(force: float, radius: float, modulus: float) -> float:
    """Return the largest pressure of a ball pressed against a flat body: (6·F·E²/(π³·R²))^(1/3) [Pa].

    Args:
        force: [N]; radius: of the fruit [m]; modulus: of contact, 1/E = (1-ν₁²)/E₁ + (1-ν₂²)/E₂ [Pa].
    """
    return float((6.0 * max(force, 0.0) * modulus**2 / (31.00627668 * radius**2)) ** (1.0 / 3.0))


@numba.njit(cache=True)
def impact_force(impulse: float, mass: float, radius: float, modulus: float) -> float:
    """Return the largest force while an impulse stops a ball of this mass: (4/3·E·√R)^(2/5)·(5/4·m·v²)^(3/5) [N].

    The engine's contacts are stiffer or softer than fruit, so their peaks are meaningless; the change of the fruit's
    momentum is correct.

    Args:
        impulse: [N·s]; mass: [kg]; radius: [m]; modulus: of contact [Pa].
    """
    speed = max(impulse, 0.0) / mass
    return float((4.0 / 3.0 * modulus * radius**0.5) ** 0.4 * (1.25 * mass * speed**2) ** 0.6)
