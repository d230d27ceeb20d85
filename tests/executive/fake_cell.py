"""A cell with one device that moves, on a manual clock: enough to test the runner's actions on a cell."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from pomona.executive.cell.cell import Cell
from pomona.executive.cell.device import Device, FaultSwitch
from pomona.executive.cell.services import Services
from pomona.executive.clock import ManualClock
from pomona.executive.lease import command

COASTING = 0.06
"""Seconds that the wheel takes to come to rest: three ticks."""


class Wheel(Device):
    """Turns from `start` until `stop`, and takes a while to come to rest."""

    def __init__(self, clock: ManualClock) -> None:
        super().__init__("wheel")
        self._clock = clock
        self._stopped = -1.0
        self.turning = self.paused = False
        self.log: list[str] = []
        self.trouble: Exception | None = None

    @property
    def coasting(self) -> bool:
        return self._clock.now() < self._stopped + COASTING - 1e-9

    @command
    def start(self) -> None:
        self.log.append("refused" if self.turning else "start")
        self.turning = True

    def stop(self) -> None:
        if self.turning:
            self.turning, self._stopped = False, self._clock.now()
            self.log.append("stop")

    def last_seen(self) -> float:
        return self._clock.now()

    def check(self) -> None:
        if self.trouble is not None:
            raise self.trouble

    def safe_stop(self, reason: str) -> None:
        self.stop()

    def pause(self) -> None:
        self.paused = True

    def resume(self) -> None:
        self.paused = False

    def settled(self) -> bool:
        return not self.coasting and (not self.turning or self.paused)


Wheel.interfaces = (Wheel,)


class WheelServices(Services):
    """Readings of the wheel, and whether somebody has turned it by hand."""

    changed = False

    def compare(self) -> None:
        if self.changed:
            raise RuntimeError("the wheel was turned by hand")

    def readings(self) -> Mapping[str, Mapping[str, Any]]:
        wheel: Any = self.devices["wheel"]
        return {"wheel": {"turning": float(wheel.turning)}}


class FakeCell(Cell):
    """A cell with a wheel, which notes the speeds that it is given."""

    def __init__(self) -> None:
        clock = ManualClock()
        self.wheel = Wheel(clock)
        self.surroundings = WheelServices({"wheel": self.wheel})
        self.faults: dict[str, FaultSwitch] = {}
        self.speeds: list[tuple[float, tuple[type, ...]]] = []
        super().__init__("fake", "mock", clock, {"wheel": self.wheel}, self.surroundings)

    @property
    def switches(self) -> Mapping[str, FaultSwitch]:
        return self.faults

    def set_speed(self, speed: float, of: Collection[type] = ()) -> None:
        self.speeds.append((speed, tuple(of)))
        super().set_speed(speed, of)
