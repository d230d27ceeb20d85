"""The `pads:` among the devices of a cell file: what the fingers' pads are, and their friction on each kind of fruit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pomona.drivers.interfaces import OTHER_FRUIT, PadContact, Pads
from pomona.executive.cell.device import Device
from pomona.executive.cell.registration import Settings, driver
from pomona.executive.values.kinds import MappingOf, Measure, Number, Span, Text
from pomona.executive.values.sections import Problem, value
from pomona.executive.values.units import LENGTH, STIFFNESS

UNMEASURED = "2.99 mm"
"""Radius of the contact of pads that nobody twisted: their torsion is 1.9 mm of their friction, as of the stiffest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PadOptions:
    """Pads of the fingers, and their friction on fruit."""

    friction: Mapping[str, tuple[float, float]] = value(
        MappingOf(Span(Number(0.05, 3.0))),
        help="range of the coefficient, by the fruit's kind; 'any' for all other kinds",
    )
    delta: float = value(
        Measure(LENGTH, "0.1 mm", "20 mm"), UNMEASURED, "radius of a pad's contact at 1 N"
    )
    gamma: float = value(Number(0.0, 1.0), "0", "exponent of that radius over the force")
    measured: str = value(Text(), "", "how delta and gamma were, where they give more torsion")
    stiffness: float = value(
        Measure(STIFFNESS, "100 N/m", "100 kN/m"),
        help="rise of the grip force over the closing of the fingers",
    )

    def problems(self) -> Iterator[Problem]:
        if not self.measured and (self.delta > LENGTH.parse(UNMEASURED) or self.gamma):
            yield Problem(
                "delta",
                f"without a measurement a grip relies on {UNMEASURED} at any force",
                "measured: when and how; see pomona calibrate grip",
            )
        if OTHER_FRUIT not in self.friction:
            yield Problem(
                "friction", f"'{OTHER_FRUIT}' is missing: the friction on all other fruit"
            )


class FingerPads(Device):
    """Pads with the declared values; nothing is connected."""

    interfaces = (Pads,)

    def __init__(self, name: str, options: PadOptions) -> None:
        super().__init__(name)
        self._options = options

    def on(self, kind: str) -> PadContact:
        pads = self._options
        low, high = pads.friction.get(kind, pads.friction[OTHER_FRUIT])
        mu = 0.5 * (low + high)
        return PadContact(mu, high / mu - 1.0, pads.delta, pads.gamma, pads.stiffness)


@driver(FingerPads, PadOptions)
def connect(settings: Settings[PadOptions], context: Any) -> FingerPads:
    """`driver: pads`"""
    return FingerPads(settings.name, settings.values)
