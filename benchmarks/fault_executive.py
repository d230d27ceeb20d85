"""Faults of the program: threads that outlive their skill, commands in the safe state, a clock that goes back."""

from __future__ import annotations

import contextlib
from typing import Any, ClassVar

import numpy as np

from pomona.drivers.interfaces import Arm, Gripper, Trajectory
from pomona.executive.cell.device import FaultSwitch
from pomona.executive.errors import NotOwnerError
from pomona.executive.running.requests import AnswerRefusedError
from pomona.executive.running.runner import Runner
from pomona.tools.simulation.world import SimClock

EVERY = 5
"""World steps between two commands of a thread: 10 ms."""
OPENING = 0.05
"""Speed at which it opens the fingers [m/s]."""
TURN, TURNING = 0.2, 1.0
"""Its motion turns joint 1 by so much [rad] in so much time [s]."""
BACK = 5.0
"""Step of the clock [s]."""


class Leftovers(FaultSwitch):
    """A thread that a skill has left behind, with the handles that the skill had.

    Faults: `commands_arm` and `opens_fingers` with the handle of a skill that has ended; `opens_latched` with the
    gripper itself, after a safe stop of the operator.
    """

    known_faults = ("commands_arm", "opens_fingers", "opens_latched")

    def __init__(self, runner: Runner, cell: Any) -> None:
        super().__init__()
        self._runner, self._cell = runner, cell
        self._steps = 0
        self.handles: dict[type, Any] = {}
        self.refused = 0

    def remember(self, node: str) -> None:
        """Take the handles of a skill that runs now: the first one that moves a device."""
        for skill in self._runner.tree.skills:
            if skill.path == node:
                claimed = set(skill.claims()) & {Arm, Gripper}
                self.handles |= {
                    one: skill.device(one) for one in claimed if one not in self.handles
                }

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        if kind == "opens_latched":
            self._runner.safe_stop("fault matrix")

    def step(self) -> None:
        """Called with every step of the world."""
        self._steps += 1
        if self.fault is None or self._steps % EVERY:
            return
        try:
            match self.fault:
                case "commands_arm":
                    arm = self.handles[Arm]
                    arm.follow(_turn(arm.state().q))
                case "opens_fingers":
                    self.handles[Gripper].set_speed(OPENING)
                case _:
                    self._cell.device(Gripper).set_speed(OPENING)
        except NotOwnerError:
            self.refused += 1


class Operator(FaultSwitch):
    """Actions of an operator, sensible or not; each kind is a list of moments after its beginning [s] and actions."""

    schedules: ClassVar[dict[str, list[tuple[float, str]]]] = {
        "pauses": [(0.0, "pause"), (1.5, "resume")],
        "pauses_briefly": [
            (0.12 * n + late, act)
            for n in range(5)
            for late, act in ((0.0, "pause"), (0.06, "resume"))
        ],
        "steps": [(0.0, "pause"), *((0.5 + 0.1 * n, "step") for n in range(10)), (2.0, "resume")],
        "slows": [(0.0, "slow"), (2.0, "full")],
        "hurries": [(0.05 * n, ("slow", "full")[n % 2]) for n in range(20)],
        "acknowledges": [(0.0, "acknowledge")],
        "stops": [(0.0, "stop")],
        "stops_paused": [(0.0, "pause"), (0.8, "stop")],
        "safe_stops": [(0.0, "safe_stop")],
        "safe_stops_paused": [(0.0, "pause"), (0.8, "safe_stop"), (0.82, "resume")],
    }
    known_faults = tuple(schedules)

    def __init__(self, runner: Runner) -> None:
        super().__init__()
        self._runner = runner
        self._due: list[tuple[float, str]] = []

    def begin(self, kind: str, now: float) -> None:
        """Act from now on."""
        self._due = [(now + after, action) for after, action in self.schedules[kind]]

    def step(self, now: float) -> None:
        """Called with every step of the world."""
        if self.fault is not None and not self._due:
            self.begin(self.fault, now)
            self.fault = None
        while self._due and now >= self._due[0][0]:
            self._act(self._due.pop(0)[1])

    def _act(self, action: str) -> None:
        runner, who = self._runner, "fault matrix"
        with contextlib.suppress(AnswerRefusedError):  # a pause that has ended
            match action:
                case "resume" | "step":
                    getattr(runner, action)(runner.pause_number, who)
                case "slow" | "full":
                    runner.set_speed(0.1 if action == "slow" else 1.0, who)
                case _:
                    getattr(runner, action)(who)


class SteppedBack(FaultSwitch):
    """The clock of a simulated world.

    Attributes:
        back: by how much it has been set back [s].
    """

    known_faults = ("steps_back",)

    def __init__(self, clock: SimClock, timestep: float) -> None:
        super().__init__()
        self._clock, self._timestep = clock, timestep
        self.back = 0.0

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        steps = round(BACK / self._timestep)
        self._clock.steps -= steps
        self.back += steps * self._timestep


def _turn(q: np.ndarray) -> Trajectory:
    """Joint 1 turns from rest to rest."""
    s = np.linspace(0.0, 1.0, 100)
    way = np.outer([TURN], np.eye(q.size)[0])
    shapes = (
        s**3 * (10 - 15 * s + 6 * s**2),
        30 * s**2 * (1 - s) ** 2,
        60 * s * (1 - s) * (1 - 2 * s),
    )
    path, rate, acceleration = (
        shape[:, None] * way / TURNING**power for power, shape in enumerate(shapes)
    )
    return Trajectory(s * TURNING, q + path, rate, acceleration)
