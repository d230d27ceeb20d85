"""The driver `motoman` of a cell file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from pomona.devices.motoman.codec import Order
from pomona.devices.motoman.driver import MotomanArm
from pomona.devices.motoman.stream import SHORT, MotomanOptions
from pomona.drivers import (
    Address,
    ArmFile,
    ArmLimits,
    ConnectContext,
    DeviceLost,
    Settings,
    driver,
    read_limits,
    tcp_opener,
)
from pomona.executive import TIME, Flag, Measure, Problem, Text, Whole, Words, value

MOTION_PORT = 50240  # the state's port is the next one
ORDERS: dict[str, Order] = {
    "fs100": ">",
    "dx100": "<",
    "dx200": "<",
    "yrc1000": "<",
}  # byte order of each controller
SEVEN, SIX = (
    tuple("SLEURBT"),
    tuple("SLURBT"),
)  # joints by their names on the controller, in the wire's order


@dataclass(frozen=True, slots=True, kw_only=True)
class MotomanFile(ArmFile):
    """A Yaskawa arm behind MotoROS; the servos come on when the run starts, the arm stands still."""

    address: tuple[str, int] = value(
        Address(MOTION_PORT),
        help="HOST or HOST:PORT of the motion connection; the state's port is the next",
    )
    controller: str = value(Text(*ORDERS), help="which gives the byte order")
    joints: tuple[str, ...] = value(
        Words(*SEVEN, once=False),
        SEVEN,
        "the description's joints, by their names on the controller",
    )
    group: int = value(Whole(0, 3), 0, "control group of the arm")
    servo_on: bool = value(Flag(), True, "switch the servos on when the run starts")
    point_period: float = value(
        Measure(TIME, "8 ms", "200 ms"), "20 ms", "time between points that are sent"
    )
    lead: float = value(
        Measure(TIME, "30 ms", "700 ms"), "150 ms", "how far ahead of the arm points are sent"
    )
    silence: float = value(
        Measure(TIME, "30 ms", "1 s"), "90 ms", "without feedback for this long the arm is lost"
    )

    @property
    def on_wire(self) -> tuple[str, ...]:
        """The controller's joints, in the order of its messages."""
        return SEVEN if len(self.joints) == 7 else SIX

    @property
    def wires(self) -> tuple[str, ...]:
        host, port = self.address
        return (f"{host}:{port}",)

    @property
    def dof(self) -> int:
        return len(self.joints)

    @property
    def limits(self) -> ArmLimits:
        """Limits of the joints; the stop of a slow arm takes effect behind the points in the controller's queue."""
        return replace(
            read_limits(self.robot, self.dof), reaction=SHORT * self.lead + self.point_period
        )

    def problems(self) -> Iterator[Problem]:
        if sorted(self.joints) != sorted(self.on_wire):
            yield Problem("joints", f"'joints' must name each of {' '.join(self.on_wire)} once")
        else:
            yield from ArmFile.problems(self)


@driver(MotomanArm, MotomanFile)
def connect(settings: Settings[MotomanFile], context: ConnectContext) -> MotomanArm:
    """Open the arm that a cell file describes."""
    said = settings.values
    host, port = said.address
    options = MotomanOptions(
        order=ORDERS[said.controller],
        group=said.group,
        wire_joints=tuple(said.on_wire.index(name) for name in said.joints),
        servo_on=said.servo_on,
        point_period=said.point_period,
        lead=said.lead,
        silence=said.silence,
        supervision=said.supervision,
    )
    openers = {
        "state": tcp_opener(host, port + 1, context.wires),
        "motion": tcp_opener(host, port, context.wires),
    }
    arm = MotomanArm(lambda name: openers[name](), context.clock, said.robot, said.limits, options)
    try:
        arm.connect()
    except DeviceLost as error:
        hint = f"is the controller on, and does MotoROS listen on {host}:{port} and {port + 1}?"
        raise settings.error(error.message, "address", hint) from error
    arm.outside_stop = (
        "pomona.devices.motoman.outside:stop",
        (host, port, options.order, options.group),
    )
    arm.start()
    return arm
