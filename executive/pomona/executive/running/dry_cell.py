"""A cell with nothing in it: for dry runs, in which mocks stand in for all skills."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypeVar

from pomona.executive.clock import Clock, ManualClock
from pomona.executive.running.cell import FaultSwitch
from pomona.executive.values.arrays import UInt8

T = TypeVar("T")


class DryCell:
    """Implements `pomona.executive.running.cell.Cell` without a device."""

    name, kind = "dry", "mock"
    record_required = False
    heartbeat_deadline = 1.0

    def __init__(self) -> None:
        self.clock: Clock = ManualClock()
        self.latched: str | None = None

    def interfaces(self) -> tuple[type, ...]:
        return ()

    def device(self, interface: type[T]) -> T:
        raise KeyError(f"a dry run has no {interface.__name__}")

    def links(self) -> Mapping[str, str]:
        return {}

    def last_seen(self) -> Mapping[str, float]:
        return {}

    def pictures(self) -> Mapping[str, tuple[UInt8, float]]:
        return {}

    def readings(self) -> Mapping[str, Mapping[str, Any]]:
        return {}

    def check(self) -> None:
        """Nothing can be lost."""

    def safe_stop(self, reason: str) -> Mapping[str, str]:
        self.latched = self.latched or reason
        return {}

    def acknowledge(self) -> None:
        self.latched = None

    def pause(self) -> None:
        """Nothing moves."""

    def resume(self) -> None:
        """Nothing was stopped."""

    full_speed_only: tuple[str, ...] = ()

    def set_speed(self, speed: float, of: Collection[type] = ()) -> None:
        """Nothing moves."""

    def in_hand(self) -> None:
        return None

    def outside_stops(self) -> Mapping[str, tuple[str, Sequence[Any]]]:
        return {}

    @property
    def switches(self) -> Mapping[str, FaultSwitch]:
        return {}

    def settled(self) -> bool:
        return True

    def truth(self, reported: Mapping[str, object] | None = None) -> None:
        return None

    def close(self) -> None:
        """Nothing is open."""
