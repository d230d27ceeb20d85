"""A cell with one device that moves, on a manual clock: enough to test the runner's actions on a cell."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, TypeVar, cast

from pomona.executive.clock import ManualClock
from pomona.executive.lease import command

T = TypeVar("T")


COASTING = 0.06
"""Seconds that the wheel takes to come to rest: three ticks."""


class Wheel:
    """Turns from `start` until `stop`, and takes a while to come to rest."""

    def __init__(self, clock: ManualClock) -> None:
        self._clock = clock
        self._stopped = -1.0
        self.turning = False
        self.log: list[str] = []

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


class FakeCell:
    """The interface `pomona.executive.running.cell.Cell`."""

    name, kind = "fake", "mock"
    record_required = False
    heartbeat_deadline = 1.0

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.wheel = Wheel(self.clock)
        self.latched: str | None = None
        self.paused = False
        self.fault: Exception | None = None
        self.changed = False
        self.hand: str | None = None
        self.closed = False
        self.shown: dict[str, Any] = {}
        self.switches: dict[str, Any] = {}
        self.full_speed_only: tuple[str, ...] = ()
        self.speeds: list[tuple[float, tuple[type, ...]]] = []

    def set_speed(self, speed: float, of: Collection[type] = ()) -> None:
        self.speeds.append((speed, tuple(of)))

    def interfaces(self) -> tuple[type, ...]:
        return (Wheel,)

    def device(self, interface: type[T]) -> T:
        return cast(T, {Wheel: self.wheel}[interface])

    def links(self) -> Mapping[str, str]:
        return {"wheel": "ok"}

    def last_seen(self) -> Mapping[str, float]:
        return {"wheel": self.clock.now()}

    def pictures(self) -> Mapping[str, Any]:
        return self.shown

    def readings(self) -> Mapping[str, Mapping[str, Any]]:
        return {"wheel": {"turning": float(self.wheel.turning)}}

    def check(self) -> None:
        if self.fault is not None:
            raise self.fault

    def safe_stop(self, reason: str) -> Mapping[str, str]:
        self.latched = self.latched or reason
        self.wheel.stop()
        return {}

    def acknowledge(self) -> None:
        self.latched = None

    def pause(self) -> None:
        self.paused = True

    def resume(self) -> None:
        if self.changed:
            raise RuntimeError("the wheel was turned by hand")
        self.paused = False

    def in_hand(self) -> str | None:
        return self.hand

    def outside_stops(self) -> Mapping[str, Any]:
        return {}

    def settled(self) -> bool:
        return not self.wheel.coasting and (not self.wheel.turning or self.paused)

    def truth(self, reported: Mapping[str, object] | None = None) -> Mapping[str, Any] | None:
        return None

    def close(self) -> None:
        self.closed = True
