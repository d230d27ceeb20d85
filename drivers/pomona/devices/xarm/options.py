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
from pomona.executive import TIME, Flag, Measure, Problem, Text, value

HOST = Text(
    pattern=Address.HOST, words="a host: its name or IPv4 address alone, since the ports are fixed"
)
PORTS = {"command": 502, "report": 30003}
LENGTHS = {
    "xarm5": (0.0, 0.2895, 0.3512, 0.076),
    "xarm6": (0.0, 0.2895, 0.0775, 0.0, 0.076),
    "xarm7": (0.0, 0.0, 0.0525, 0.0775, 0.0, 0.076),
    "lite6": (0.0, 0.2002, 0.087, 0.0, 0.0),
    "850": (0.0, 0.39, 0.15, 0.0, 0.0),
}
"""By model: distances between the axes of successive joints [m], of `default_kinematics.yaml` in `xarm_description`."""
JOINTS = {model: len(lengths) + 1 for model, lengths in LENGTHS.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class XArmFile(ArmFile):
    """A UFACTORY arm with firmware 1.9.110 or later; nothing moves when the run starts."""

    address: str = value(HOST, help="HOST of the controller")
    model: str = value(Text(*JOINTS), help="which robot must be there")
    enable: bool = value(
        Flag(), True, "enable the motors and release the brakes when the run starts"
    )
    silence: float = value(
        Measure(TIME, "20 ms", "1 s"),
        "40 ms",
        "without an answer, a report or a set-point for this long it is lost",
    )
    servo_lag: float = value(
        Measure(TIME, "0 s", "300 ms"), "0 s", "delay of servo mode behind set-points: measure it"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address}:{PORTS['command']}",)

    @property
    def dof(self) -> int:
        return JOINTS[self.model]

    @property
    def limits(self) -> ArmLimits:
        """Limits of the joints. Raises UnusableRobotFile."""
        return replace(read_limits(self.robot, self.dof), reaction=self.servo_lag)

    def problems(self) -> Iterator[Problem]:
        unusable = list(ArmFile.problems(self))
        yield from unusable or other_model(self.robot, LENGTHS, self.model)
