"""Options of the arm in a cell file."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.drivers import ArmFile
from pomona.executive import TIME, Flag, Measure, Text, value

HOST = Text(pattern=r"[\w.-]+", words="a host: its name or IPv4 address alone, since the ports are fixed")
PORTS = {"command": 502, "report": 30003}
JOINTS = {"xarm5": 5, "xarm6": 6, "xarm7": 7, "lite6": 6, "850": 6}


@dataclass(frozen=True, slots=True, kw_only=True)
class XArmFile(ArmFile):
    """A UFACTORY arm with firmware 1.9.110 or later; nothing moves when the run starts."""

    address: str = value(HOST, help="HOST of the controller")
    model: str = value(Text(*JOINTS), help="which robot must be there")
    enable: bool = value(Flag(), True, "enable the motors and release the brakes when the run starts")
    silence: float = value(
        Measure(TIME, "20 ms", "1 s"), "40 ms", "without an answer, a report or a set-point for this long it is lost"
    )
    servo_lag: float = value(Measure(TIME, "0 s", "300 ms"), "0 s", "delay of servo mode behind set-points: measure it")

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address}:{PORTS['command']}",)

    @property
    def dof(self) -> int:
        return JOINTS[self.model]
