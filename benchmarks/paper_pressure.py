"""Pressure in the middle of a soft finger's contact."""

from __future__ import annotations

import math

from skills.grip.limit_surface import SoftContact, xi

NO_BRUISE = 0.10e6
"""No apple bruises below this pressure [Pa] (Processes 2024, 12, 543)."""


def pressure(f_n: float, contact: SoftContact | None = None) -> float:
    """Highest pressure [Pa] of one finger that presses with `f_n` [N]."""
    contact = contact or SoftContact()
    if f_n <= 0.0:
        return 0.0
    radius = contact.delta * f_n**contact.gamma
    return float(xi(contact.k) * f_n / (math.pi * radius**2))
