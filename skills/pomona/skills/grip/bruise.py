"""What a soft finger's press does to an apple: the pressure in the middle of its contact, and where bruises begin."""

from __future__ import annotations

import math

from pomona.skills.grip.limit_surface import SoftContact, xi

NO_BRUISE = 0.10e6
"""No apple bruises below this pressure [Pa] (Processes 2024, 12, 543)."""


def pressure(f_n: float, contact: SoftContact | None = None) -> float:
    """Highest pressure [Pa] of one finger that presses with `f_n` [N]."""
    contact = contact or SoftContact()
    if f_n <= 0.0:
        return 0.0
    radius = contact.delta * f_n**contact.gamma
    return float(xi(contact.k) * f_n / (math.pi * radius**2))


def bruising_force(contact: SoftContact | None = None) -> float:
    """The force [N] of one finger below which no apple bruises; infinite where pressure never rises with it."""
    contact = contact or SoftContact()
    if contact.gamma >= 0.5:
        return math.inf
    at_1_n = xi(contact.k) / (math.pi * contact.delta**2)
    return float((NO_BRUISE / at_1_n) ** (1.0 / (1.0 - 2.0 * contact.gamma)))
