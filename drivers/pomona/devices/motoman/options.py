"""Options of the arm in a cell file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from pomona.devices.motoman.codec import Order
from pomona.drivers import Address, ArmFile, ArmLimits, read_limits
from pomona.executive import TIME, Flag, Measure, Problem, Text, Whole, Words, value

MOTION_PORT = 50240  # the state's port is the next one
SHORT = 1.0 / 3.0  # share of `lead` that the queue of a slow arm is long
ORDERS: dict[str, Order] = {
    "fs100": ">",
    "dx100": "<",
    "dx200": "<",
    "yrc1000": "<",
}  # byte order of each controller
# joints by their names on the controller, in the wire's order
SEVEN = tuple("SLEURBT")
SIX = tuple("SLURBT")

POINT_PERIOD = 0.02  # time between points that are sent [s]


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
    def order(self) -> Order:
        """Byte order of the controller."""
        return ORDERS[self.controller]

    @property
    def wire_joints(self) -> tuple[int, ...]:
        """For every joint of the description its place on the wire."""
        return tuple(self.on_wire.index(name) for name in self.joints)

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
        return replace(read_limits(self.robot, self.dof), reaction=SHORT * self.lead + POINT_PERIOD)

    def problems(self) -> Iterator[Problem]:
        if sorted(self.joints) != sorted(self.on_wire):
            yield Problem("joints", f"'joints' must name each of {' '.join(self.on_wire)} once")
        else:
            yield from ArmFile.problems(self)
