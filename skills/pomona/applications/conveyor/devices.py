"""The simulated belt behind the interface, with its faults."""

from __future__ import annotations

import numpy as np

from pomona.applications.conveyor.conveyor import BELT, SILENCE, ConveyorState
from pomona.applications.conveyor.world import ConveyorWorld
from pomona.drivers import DeviceLost
from pomona.tools.simulation import FaultyDevice

COUNT = 1e-4  # travel of one count of the encoder [m]: a wheel of 200 mm with 2000 counts a turn
OVER = 0.1  # time over which the encoder's speed is measured [s]
WRONG = 1.1  # factor on the travel with the fault wrong_scale
CREEP = 0.05  # rate at which a creeping belt slows down [m/s²]
JUMP = 0.03  # distance by which a jumping belt carries its load at once [m]


class SimConveyor(FaultyDevice):
    """The simulated belt and its encoder. In the safe state the belt stops with the arm, and does not start again.

    Faults: of the belt `stop`, `jump` (its load is 30 mm further at once), `creep` (it slows down to a tenth); of the
    encoder `lost`, `backwards`, `wrong_scale` (a tenth more than the truth).
    """

    interfaces = BELT
    known_faults = ("stop", "jump", "creep", "lost", "backwards", "wrong_scale")

    def __init__(self, world: ConveyorWorld) -> None:
        super().__init__("conveyor")
        self.belt = world.built.belt
        self._world = world
        self._counted = [(world.clock.now(), 0.0)]
        self._usual = world.wanted_speed
        self._stopped = False
        world.after_step.append(self._count)

    def travelled(self) -> ConveyorState | None:
        (before, start), (stamp, position) = self._counted[0], self._counted[-1]
        speed = 0.0 if stamp <= before else (position - start) / (stamp - before)
        return ConveyorState(stamp, position, speed)

    def last_seen(self) -> float | None:
        return self._counted[-1][0]

    def check(self) -> None:
        silent = self._world.clock.now() - self._counted[-1][0]
        if silent > SILENCE:
            raise DeviceLost(self.name, f"its encoder sent nothing for {1e3 * silent:.0f} ms")

    def stop(self) -> bool:
        self._stopped = True
        self._world.wanted_speed = 0.0
        return True

    def safe_stop(self, reason: str) -> None:
        """Stop the belt. A line's own control starts it again, not an acknowledgement."""
        self.stop()

    def settled(self) -> bool:
        return not self._stopped or self._world.speed == 0.0

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        if kind == "stop":
            self._world.wanted_speed = 0.0
        elif kind == "jump":
            self._world.jump(JUMP)

    def clear_fault(self) -> None:
        super().clear_fault()
        self._world.wanted_speed = 0.0 if self._stopped else self._usual

    def _count(self) -> None:
        now = self._world.clock.now()
        if self.fault == "creep" and not self._stopped:
            self._world.wanted_speed = max(
                0.1 * self._usual, self._world.wanted_speed - CREEP * 0.002
            )
        if self.fault == "lost" or now - self._counted[-1][0] < 0.0099:
            return
        scale = {"backwards": -1.0, "wrong_scale": WRONG}.get(self.fault or "", 1.0)
        position = COUNT * float(np.floor(scale * self._world.travelled / COUNT))
        self._counted.append((now, position))
        while now - self._counted[0][0] > OVER + 1e-9:
            self._counted.pop(0)
