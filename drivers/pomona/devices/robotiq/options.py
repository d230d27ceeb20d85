"""Options of the gripper in a cell file, and what the models are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pomona.devices.robotiq.codec import SLAVE
from pomona.drivers import (
    HAND_STROKES,
    Address,
    GripperLimits,
    GripperSupervision,
    Surroundings,
    other_fingers,
)
from pomona.executive import (
    FORCE,
    LENGTH,
    TIME,
    Counts,
    Flag,
    Measure,
    Problem,
    Section,
    Text,
    Whole,
    value,
)

URCAP_PORT = 63352


@dataclass(frozen=True, slots=True)
class RobotiqModel:
    """A gripper: stroke [m], slowest and fastest speed [m/s], least and largest force of a finger [N]."""

    stroke: float
    speeds: tuple[float, float]
    forces: tuple[float, float]


MODELS = {
    "hand-e": RobotiqModel(HAND_STROKES["hand-e"], (0.020, 0.150), (20.0, 185.0)),
    "2f-85": RobotiqModel(HAND_STROKES["2f-85"], (0.020, 0.150), (20.0, 235.0)),
    "2f-140": RobotiqModel(HAND_STROKES["2f-140"], (0.030, 0.250), (10.0, 125.0)),
}
"""From Robotiq's data sheets. `linkage.py` has the ways of a 2F's fingertips."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotiqFile:
    """A Robotiq gripper on a serial line (Modbus RTU), or behind the URCap of a Universal Robots controller."""

    model: str = value(Text(*MODELS), help="which gripper it is")
    port: str | None = value(
        Text(), None, "its serial port, of a USB adapter for RS-485; alternatively 'urcap'"
    )
    urcap: tuple[str, int] | None = value(
        Address(URCAP_PORT), None, "HOST of the robot's controller; too slow for closed-loop grips"
    )
    unit: int = value(Whole(1, 247), str(SLAVE), "its Modbus address on the serial line")
    finger_offset: float = value(
        Measure(LENGTH, "0 mm", "500 mm"),
        "0 mm",
        "opening between the pads' faces when the gripper is closed",
    )
    counts: tuple[int, ...] = value(
        Counts(2, 0, 255), (3, 230), "positions of the open and of the closed gripper"
    )
    force: float | None = value(
        Measure(FORCE, "1 N", "300 N"),
        None,
        "limit of one finger's force while it moves; default: the least",
    )
    activate: bool = value(
        Flag(),
        False,
        "activate it in a start with --cleared: the fingers move through their stroke",
    )
    watchdog: float = value(
        Measure(TIME, "30 ms", "1 s"),
        "100 ms",
        "a streamed speed that is not renewed within this time becomes zero",
    )
    silence: float | None = value(
        Measure(TIME, "20 ms", "2 s"),
        None,
        "without a status for this long it is lost; default: 60 ms, URCap 300 ms",
    )
    supervision: GripperSupervision = value(
        Section(GripperSupervision),
        GripperSupervision(),
        "how closely the gripper must follow its commands",
    )

    @property
    def wires(self) -> tuple[str, ...]:
        if self.urcap is not None:
            return (f"{self.urcap[0]}:{self.urcap[1]}",)
        return () if self.port is None else (self.port,)

    @property
    def deadline(self) -> float:
        """Time without a status after which the gripper is lost [s]."""
        return self.silence or (0.06 if self.urcap is None else 0.3)

    @property
    def limits(self) -> GripperLimits:
        """Limits of the gripper: its largest force is the limit set here."""
        model = MODELS[self.model]
        opening = self.finger_offset, self.finger_offset + model.stroke
        step = model.stroke / (self.counts[1] - self.counts[0])
        least, most = model.forces
        return GripperLimits(
            *opening, model.speeds[1], min(max(self.force or least, least), most), least, step
        )

    def problems(self) -> Iterator[Problem]:
        if (self.port is None) == (self.urcap is None):
            yield Problem("port", "the gripper needs either 'port' or 'urcap'")
        if self.unit != SLAVE and self.urcap is not None:
            yield Problem(
                "unit", "behind the URCap a gripper has no Modbus address", "remove 'unit'"
            )
        least, most = MODELS[self.model].forces
        if self.force is not None and not least <= self.force <= most:
            words = f"the fingers of a {self.model} press with {least:g} N at least and {most:g} N at most"
            yield Problem("force", words)
        if self.counts[1] - self.counts[0] < 100:
            yield Problem("counts", "they lie about 227 apart: the open position first")

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        yield from other_fingers(around, self.model, self.finger_offset)

    def known(self) -> Iterator[object]:
        """Yield the limits, which a check of a tree needs."""
        yield self.limits
