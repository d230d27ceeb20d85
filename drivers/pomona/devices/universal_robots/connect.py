"""The driver `universal-robots` of a cell file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pomona.devices.universal_robots.dashboard import WrongArmError
from pomona.devices.universal_robots.driver import UrArm
from pomona.devices.universal_robots.stream import UrOptions
from pomona.drivers import (
    ConnectContext,
    DeviceError,
    DeviceLost,
    Link,
    Settings,
    Supervision,
    UnusableRobotFile,
    driver,
    read_limits,
    tcp_opener,
)
from pomona.executive import RATE, TIME, Flag, Measure, PathTo, Problem, Section, Text, value

PORTS = {"rtde": 30004, "script": 30002, "dashboard": 29999}
MODELS = ("ur3e", "ur5e", "ur7e", "ur10e", "ur12e", "ur16e", "ur15", "ur18", "ur20", "ur30", "ur3", "ur5", "ur10")


@dataclass(frozen=True, slots=True, kw_only=True)
class UrFile:
    """A Universal Robots arm under PolyScope 3.12 or 5.6 and later; nothing moves when the run starts."""

    address: str = value(Text(), help="HOST of the controller")
    model: str = value(Text(*MODELS), help="which robot must be there")
    robot: Path = value(PathTo("file"), help="the robot's description (MJCF or URDF), with its limits")
    power_on: bool = value(Flag(), True, "power the arm and release its brakes when the run starts")
    rate: float = value(Measure(RATE, "50 Hz", "500 Hz"), "125 Hz", "packages per second from the controller")
    point_period: float = value(Measure(TIME, "8 ms", "100 ms"), "20 ms", "time between points that are sent")
    lead: float = value(Measure(TIME, "60 ms", "500 ms"), "120 ms", "how far ahead of the arm points are sent")
    silence: float = value(Measure(TIME, "20 ms", "1 s"), "50 ms", "without a package for this long the arm is lost")
    supervision: Supervision = value(
        Section(Supervision), Supervision(), "how closely the arm must follow its commands"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address}:{PORTS['rtde']}",)

    def problems(self) -> Iterator[Problem]:
        try:
            read_limits(self.robot, 6)
        except UnusableRobotFile as error:
            yield Problem("robot", str(error))
        if self.lead >= 30 * self.point_period:
            yield Problem("lead", "the controller keeps 30 points: a longer 'point_period' or a shorter 'lead' fits")

    def known(self) -> Iterator[object]:
        yield read_limits(self.robot, 6)


@driver(UrArm, UrFile)
def connect(settings: Settings[UrFile], context: ConnectContext) -> UrArm:
    """Open the arm that a cell file describes."""
    said = settings.values
    options = UrOptions(
        said.model, said.power_on, said.rate, said.point_period, said.lead, said.silence, said.supervision
    )
    limits = read_limits(said.robot, 6)
    openers = {name: tcp_opener(said.address, port, context.wires) for name, port in PORTS.items()}

    def open_port(name: str) -> Link:
        return openers[name]()

    arm = UrArm(open_port, context.clock, said.robot, limits, options)
    try:
        arm.connect()
    except WrongArmError as error:
        raise settings.error(error.message, "model", "is the address that of the right robot?") from error
    except DeviceLost as error:
        hint = f"is the controller on, and do ports {', '.join(map(str, PORTS.values()))} answer at {said.address}?"
        raise settings.error(error.message, "address", hint) from error
    except DeviceError as error:
        raise settings.error(error.message, "address") from error
    arm.outside_stop = "pomona.devices.universal_robots.outside:stop", (said.address, PORTS["dashboard"])
    arm.start()
    return arm
