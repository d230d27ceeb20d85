"""Options of the arm in a cell file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from pomona.drivers import (
    Address,
    ArmFile,
    ArmLimits,
    other_model,
    read_limits,
)
from pomona.executive import RATE, TIME, Flag, Measure, Problem, Text, value

HOST = Text(
    pattern=Address.HOST, words="a host: its name or IPv4 address alone, since the ports are fixed"
)
SURE = 0.02  # a knot is in the script within this time [s]: two cycles of a CB3, and the network
SERVO_LAG = 0.03  # of servoj: its lookahead time in the script [s]
PORTS = {"rtde": 30004, "script": 30002, "dashboard": 29999}
LENGTHS = {
    "ur3e": (0.0, 0.24355, 0.2132, 0.0, 0.0),
    "ur5e": (0.0, 0.425, 0.3922, 0.0, 0.0),
    "ur10e": (0.0, 0.6127, 0.57155, 0.0, 0.0),
    "ur16e": (0.0, 0.4784, 0.36, 0.0, 0.0),
    "ur20": (0.0, 0.862, 0.7287, 0.0, 0.0),
    "ur30": (0.0, 0.637, 0.5037, 0.0, 0.0),
    "ur3": (0.0, 0.24365, 0.21325, 0.0, 0.0),
    "ur5": (0.0, 0.425, 0.39225, 0.0, 0.0),
    "ur10": (0.0, 0.612, 0.5723, 0.0, 0.0),
    "ur7e": (0.0, 0.425, 0.3922, 0.0, 0.0),
    "ur12e": (0.0, 0.6127, 0.57155, 0.0, 0.0),
    "ur15": (0.0, 0.6475, 0.5164, 0.0, 0.0),
}
"""By model [m]: `default_kinematics.yaml` of UR's package of descriptions; UR7e, UR12e and UR15 by UR's table of DH
parameters, which agrees with the centres of mass in that package. None were found of a UR18."""
MODELS = (*LENGTHS, "ur18")

POINT_PERIOD = 0.02  # time between points that are sent [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class UrFile(ArmFile):
    """A Universal Robots arm under PolyScope 3.12 or 5.6 and later; nothing moves when the run starts."""

    address: str = value(HOST, help="HOST of the controller")
    model: str = value(Text(*MODELS), help="which robot must be there")
    power_on: bool = value(Flag(), True, "power the arm and release its brakes when the run starts")
    rate: float = value(
        Measure(RATE, "50 Hz", "500 Hz"), "125 Hz", "packages per second from the controller"
    )
    lead: float = value(
        Measure(TIME, "60 ms", "500 ms"), "120 ms", "how far ahead of the arm points are sent"
    )
    silence: float = value(
        Measure(TIME, "20 ms", "1 s"), "50 ms", "without a package for this long the arm is lost"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address}:{PORTS['rtde']}",)

    @property
    def limits(self) -> ArmLimits:
        """Limits of the joints. Raises UnusableRobotFile."""
        return replace(read_limits(self.robot, self.dof), reaction=SURE + POINT_PERIOD + SERVO_LAG)

    def problems(self) -> Iterator[Problem]:
        unusable = list(ArmFile.problems(self))
        yield from unusable or other_model(self.robot, LENGTHS, self.model)
