"""A fruit as a body: its meshes, the pressure that it bears, and the force with which a contact has that pressure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from pomona.executive.values.kinds import Measure, PathTo
from pomona.executive.values.sections import value
from pomona.executive.values.units import PRESSURE

UNKNOWN_PRESSURE = 100e3
"""Allowed pressure on fruit whose kind declares none, or is unknown [Pa]: assumed as for an apple."""

PAD_MODULUS = 1.0e6
"""Modulus of the contact with a pad [Pa], assumed: 8 N on an apple of 76 mm give its allowed pressure."""

HARD_MODULUS = 1.5e6
"""Modulus of the contact with anything hard [Pa], assumed: half of an apple's flesh. Between two fruits of one size
radius and modulus are half as large: the same force bruises."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FruitBody:
    """The values of a fruit.yaml that robot and simulated world share."""

    mesh: Path = value(
        PathTo("file"), help="the flesh without stem: a closed mesh in metres, normals outwards"
    )
    stem: Path | None = value(PathTo("file"), None, "the stem, for pictures only")
    pressure: float = value(
        Measure(PRESSURE, "1 kPa", "10 MPa"),
        f"{UNKNOWN_PRESSURE:.0f} Pa",
        "of a contact, up to which the fruit is not bruised",
    )


def bruising_force(pressure: float, radius: float, modulus: float = PAD_MODULUS) -> float:
    """Return the force from which a contact bruises a ball [N], by Hertz.

    Args:
        pressure: that the fruit bears [Pa].
        radius: of the ball [m].
        modulus: of the contact, 1 / ((1-ν₁²)/E₁ + (1-ν₂²)/E₂) [Pa].
    """
    return math.pi**3 * radius**2 * pressure**3 / (6.0 * modulus**2)
