"""The driver `xarm` of a cell file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pomona.devices.xarm.driver import WrongModelError, XArm
from pomona.devices.xarm.stream import XArmOptions
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
from pomona.executive import TIME, Flag, Measure, PathTo, Problem, Section, Text, value

PORTS = {"command": 502, "report": 30003}
JOINTS = {"xarm5": 5, "xarm6": 6, "xarm7": 7, "lite6": 6, "850": 6}


@dataclass(frozen=True, slots=True, kw_only=True)
class XArmFile:
    """A UFACTORY arm with firmware 1.9.110 or later; nothing moves when the run starts."""

    address: str = value(Text(), help="HOST of the controller")
    model: str = value(Text(*JOINTS), help="which robot must be there")
    robot: Path = value(PathTo("file"), help="the robot's description (MJCF or URDF), with its limits")
    enable: bool = value(Flag(), True, "enable the motors and release the brakes when the run starts")
    silence: float = value(
        Measure(TIME, "20 ms", "1 s"), "50 ms", "without an answer, a report or a set-point for this long it is lost"
    )
    servo_lag: float = value(Measure(TIME, "0 s", "300 ms"), "0 s", "delay of servo mode behind set-points: measure it")
    supervision: Supervision = value(
        Section(Supervision), Supervision(), "how closely the arm must follow its commands"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address}:{PORTS['command']}",)

    def problems(self) -> Iterator[Problem]:
        try:
            read_limits(self.robot, JOINTS[self.model])
        except UnusableRobotFile as error:
            yield Problem("robot", str(error))

    def known(self) -> Iterator[object]:
        yield read_limits(self.robot, JOINTS[self.model])


@driver(XArm, XArmFile)
def connect(settings: Settings[XArmFile], context: ConnectContext) -> XArm:
    """Open the arm that a cell file describes."""
    said = settings.values
    options = XArmOptions(said.model, said.enable, said.silence, said.servo_lag, said.supervision)
    limits = read_limits(said.robot, JOINTS[said.model])
    openers = {name: tcp_opener(said.address, port, context.wires) for name, port in PORTS.items()}

    def open_port(name: str) -> Link:
        return openers[name]()

    arm = XArm(open_port, context.clock, said.robot, limits, options)
    try:
        arm.connect()
    except WrongModelError as error:
        raise settings.error(error.message, "model", "is the address that of the right robot?") from error
    except DeviceLost as error:
        hint = f"is the controller on, and do ports {', '.join(map(str, PORTS.values()))} answer at {said.address}?"
        raise settings.error(error.message, "address", hint) from error
    except DeviceError as error:
        raise settings.error(error.message, "address") from error
    arm.outside_stop = "pomona.devices.xarm.outside:stop", (said.address, PORTS["command"])
    arm.start()
    return arm
