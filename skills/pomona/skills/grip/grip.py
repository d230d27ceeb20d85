"""Phase, reading and problem of a grip, and the samples for viewers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated

from pomona.executive.values.arrays import Float64
from pomona.executive.values.units import FORCE, LENGTH, SPEED, TIME, TORQUE

Newton = Annotated[float, FORCE]

SIDES = ("left", "right")
"""Names of the fingers, in the order of their wrenches."""


class GripPhase(Enum):
    """Phase of a grip; the values are shown to the operator."""

    BIAS = "taking the bias"
    CLOSING = "closing"
    RAMP = "raising the force"
    HOLDING = "holding"
    PIVOTING = "pivoting"
    SLIDING = "letting the pads slide"
    FAILED = "failed"
    ENDED = "ended"


IN_HAND = (GripPhase.HOLDING, GripPhase.PIVOTING, GripPhase.SLIDING)
"""Phases of a held fruit."""


FREEZING = frozenset({"SENSOR_FAULT", "ONE_FINGER"})
"""Problems after which the force of a held fruit never falls again."""

LIES = frozenset({"SENSOR_FAULT", "SENSOR_STALE", "SENSOR_SATURATED", "ONE_FINGER"})
"""Problems of a held fruit that make the readings of the fingers unusable."""


@dataclass(frozen=True, slots=True)
class GripProblem:
    """Problem of a grip.

    Attributes:
        code: NO_CONTACT, ONE_FINGER, OUT_OF_STROKE, FORCE_LIMIT, SENSOR_STALE, SENSOR_SATURATED, SENSOR_FAULT, SLIPPED
            or LOST.
        message: a sentence for the operator.
        stamp: time of detection on the cell's clock [s].
        data: numbers of the sentence.
    """

    code: str
    message: str
    stamp: float
    data: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class GripReading:
    """The grip after the newest sample.

    Attributes:
        stamp: of the sample [s].
        phase: of the grip.
        f_n: measured grip force, 2 * min over the fingers [N].
        finger_forces: pressing force of each finger [N].
        f_ref: grip force that the force loop tracks [N].
        f_least: minimum grip force for the measured load, without margin [N].
        f_t, tau_n: tangential load [N] and torsional load [N·m] of both fingers together.
        slip_speed: estimated speed of the fruit along the pads [m/s].
        slip: estimated slip since the grip holds [m].
        width: opening between the pads' faces [m].
        speed: commanded rate of the opening [m/s]; negative closes.
        saturated: True when a channel of a finger is at the end of its range.
    """

    stamp: Annotated[float, TIME]
    phase: GripPhase
    f_n: Newton
    finger_forces: tuple[Newton, Newton]
    f_ref: Newton
    f_least: Newton
    f_t: Newton
    tau_n: Annotated[float, TORQUE]
    slip_speed: Annotated[float, SPEED]
    slip: Annotated[float, LENGTH]
    width: Annotated[float, LENGTH]
    speed: Annotated[float, SPEED]
    saturated: bool


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
