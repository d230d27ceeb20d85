"""The driver `robotiq` of a cell file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from pomona.devices.robotiq.codec import SLAVE
from pomona.devices.robotiq.driver import MODELS, RobotiqGripper, RobotiqOptions
from pomona.devices.robotiq.session import RobotiqSession, RtuSession, UrcapSession
from pomona.devices.suntouch.transport import serial_opener, serial_ports
from pomona.drivers import (
    Address,
    ConnectContext,
    DeviceError,
    DeviceLost,
    GripperSupervision,
    Settings,
    Surroundings,
    driver,
    tcp_opener,
)
from pomona.executive import FORCE, LENGTH, TIME, Counts, Flag, Measure, Problem, Section, Text, Whole, value
from pomona.tools.calibration.described_hand import other_fingers

BAUD = 115200  # of the grippers when they are delivered [bit/s]
URCAP_PORT = 63352


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotiqFile:
    """A Robotiq gripper on a serial line (Modbus RTU), or behind the URCap of a Universal Robots controller."""

    model: str = value(Text(*MODELS), help="which gripper it is")
    port: str | None = value(Text(), None, "its serial port, of a USB adapter for RS-485; alternatively 'urcap'")
    urcap: tuple[str, int] | None = value(
        Address(URCAP_PORT), None, "HOST of the robot's controller; too slow for closed-loop grips"
    )
    unit: int = value(Whole(1, 247), str(SLAVE), "its Modbus address on the serial line")
    finger_offset: float = value(
        Measure(LENGTH, "0 mm", "500 mm"), "0 mm", "opening between the pads' faces when the gripper is closed"
    )
    counts: tuple[int, ...] = value(Counts(2, 0, 255), (3, 230), "positions of the open and of the closed gripper")
    force: float | None = value(
        Measure(FORCE, "1 N", "300 N"), None, "limit of one finger's force while it moves; default: the least"
    )
    activate: bool = value(
        Flag(), False, "activate it in a start with --cleared: the fingers move through their stroke"
    )
    watchdog: float = value(
        Measure(TIME, "30 ms", "1 s"), "100 ms", "a streamed speed that is not renewed within this time becomes zero"
    )
    silence: float | None = value(
        Measure(TIME, "20 ms", "2 s"), None, "without a status for this long it is lost; default: 60 ms, URCap 300 ms"
    )
    supervision: GripperSupervision = value(
        Section(GripperSupervision), GripperSupervision(), "how closely the gripper must follow its commands"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        if self.urcap is not None:
            return (f"{self.urcap[0]}:{self.urcap[1]}",)
        return () if self.port is None else (self.port,)

    @property
    def options(self) -> RobotiqOptions:
        """Options of the driver."""
        silence = self.silence or (0.06 if self.urcap is None else 0.3)
        fingers = self.model, self.finger_offset, (self.counts[0], self.counts[1]), self.force
        return RobotiqOptions(*fingers, self.activate, self.watchdog, silence, self.supervision)

    def problems(self) -> Iterator[Problem]:
        if (self.port is None) == (self.urcap is None):
            yield Problem("port", "the gripper needs either 'port' or 'urcap'")
        if self.unit != SLAVE and self.urcap is not None:
            yield Problem("unit", "behind the URCap a gripper has no Modbus address", "remove 'unit'")
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
        yield self.options.limits


def opener(said: RobotiqFile, context: ConnectContext) -> Callable[[], RobotiqSession]:
    """Return how to open the gripper's wire."""
    if said.urcap is not None:
        open_link = tcp_opener(*said.urcap, context.wires)
        return lambda: UrcapSession(open_link(), context.clock)
    open_port = serial_opener(said.port or "", BAUD, context.wires)
    return lambda: RtuSession(open_port(), context.clock, said.unit)


@driver(RobotiqGripper, RobotiqFile)
def connect(settings: Settings[RobotiqFile], context: ConnectContext) -> RobotiqGripper:
    """Open the gripper that a cell file describes; nothing moves, unless it is activated."""
    said = settings.values
    options = replace(said.options, activate=said.activate and context.cleared)
    gripper = RobotiqGripper(opener(said, context), context.clock, options)
    where: tuple[Any, ...] = (said.port, None, 0, said.unit) if said.urcap is None else (None, *said.urcap)
    gripper.outside_stop = "pomona.devices.robotiq.outside:stop", where
    silent = "port", f"{serial_ports()}; is the gripper powered, with the Modbus address {said.unit} ('unit')?"
    if said.urcap is not None:
        silent = "urcap", "is the Robotiq URCap installed, and no other client connected? is the gripper powered?"
    return settings.opened(gripper, {OSError: silent, DeviceLost: silent, DeviceError: ("model", "")})
