"""Phase, reading and problem of a grip, the samples for viewers, and the errors.

GripError
├── UnusableRate        a sensor that is too slow or too fast
└── UnfitSensor         a sensor that is too coarse, too constant or repeats itself
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated

from pomona.executive.values.arrays import Float64
from pomona.executive.values.units import FORCE, LENGTH, SPEED, TIME, TORQUE

Newton = Annotated[float, FORCE]

SIDES = ("left", "right")  # names of the fingers, in the order of their wrenches


class GripPhase(Enum):
    """Phase of a grip as records have it and the operator sees it: that of a `GripMode`."""

    BIAS = "taking the bias"
    CLOSING = "closing"
    RAMP = "raising the force"
    HOLDING = "holding"
    SLIDING = "letting the pads slide"
    FAILED = "failed"
    ENDED = "ended"


class GripMode(Enum):
    """State of a grip's one state machine; docs/architecture.md has the diagram."""

    BIAS = "taking the bias"
    CLOSING = "closing"
    RAMP = "raising the force to its initial value"
    STANDING = "holding a fruit that stands on the table"
    LIFTING = "taking the load over from the table"
    CARRIED = "carrying the fruit"
    CATCHING = "catching a fruit that was hit"
    SLIDING = "letting the pads slide"
    FAILED = "failed before the fruit was held"
    ENDED = "ended"

    @property
    def phase(self) -> GripPhase:
        """The phase that this mode belongs to."""
        return GripPhase.HOLDING if self in HELD else GripPhase[self.name]


HELD = (
    GripMode.STANDING,
    GripMode.LIFTING,
    GripMode.CARRIED,
    GripMode.CATCHING,
)  # modes of `HOLDING`
HANGING = (GripMode.CARRIED, GripMode.CATCHING)  # modes of a fruit that hangs in the fingers
LIFTED = HELD[1:]  # modes of a fruit that its support bears no longer, or not alone
IN_HAND = (*HELD, GripMode.SLIDING)  # modes of a fruit in hand


FREEZING = frozenset(
    {"SENSOR_FAULT", "ONE_FINGER"}
)  # problems after which the force of a held fruit never falls again

LIES = frozenset({"SENSOR_FAULT", "SENSOR_STALE", "SENSOR_SATURATED", "ONE_FINGER"})
"""Problems of a held fruit that make the readings of the fingers unusable."""


@dataclass(frozen=True, slots=True)
class GripProblem:
    """Problem of a grip."""

    # NO_CONTACT, ONE_FINGER, OUT_OF_STROKE, FORCE_LIMIT, SENSOR_STALE, SENSOR_SATURATED, SENSOR_FAULT, SLIPPED or LOST
    code: str
    message: str  # a sentence for the operator
    stamp: float  # time of detection on the cell's clock [s]
    data: Mapping[str, float] = field(default_factory=dict)  # numbers of the sentence


@dataclass(frozen=True, slots=True)
class GripReading:
    """The grip after the newest sample."""

    stamp: Annotated[float, TIME]  # of the sample [s]
    phase: GripPhase  # of the grip
    f_n: Newton  # measured grip force, 2 * min over the fingers [N]
    finger_forces: tuple[Newton, Newton]  # pressing force of each finger [N]
    f_ref: Newton  # grip force that the force loop tracks [N]
    f_least: Newton  # minimum grip force for the measured load, without margin [N]
    f_t: Newton  # f_t, tau_n: tangential load [N] and torsional load [N·m] of both fingers together
    tau_n: Annotated[float, TORQUE]
    slip_speed: Annotated[float, SPEED]  # estimated speed of the fruit along the pads [m/s]
    slip: Annotated[float, LENGTH]  # estimated slip since the grip holds [m]
    width: Annotated[float, LENGTH]  # opening between the pads' faces [m]
    speed: Annotated[float, SPEED]  # commanded rate of the opening [m/s]; negative closes
    saturated: bool  # True when a channel of a finger is at the end of its range


@dataclass(frozen=True, slots=True, eq=False)
class GripSamples:
    """Samples of a grip over time, each of shape (n,); units as in `GripReading`."""

    t: Float64
    f_n: Float64
    f_ref: Float64
    f_least: Float64
    f_t: Float64
    slip_speed: Float64
    width: Float64


class GripError(Exception):
    """Root of these errors."""


class UnusableRate(GripError):
    """The sample rate of a force sensor is too low or too high for a grip."""

    def __init__(self, rate: float, rates: tuple[float, float]) -> None:
        self.rate = rate
        self.rates = rates
        super().__init__(
            f"the force sensor gives {rate:g} samples a second; a grip needs {rates[0]:g} to {rates[1]:g}: set the"
            " sensor's rate in the cell file"
        )


class UnfitSensor(GripError):
    """The samples with nothing touching show that a force sensor cannot control a grip.

    Attributes:
        measured, expected: value and bound of the faulty quantity, in SI units.
    """

    def __init__(self, message: str, measured: float, expected: float) -> None:
        self.measured = measured
        self.expected = expected
        super().__init__(message)
