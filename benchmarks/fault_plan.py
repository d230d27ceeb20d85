"""Faults that are turned on at given times, or with a delay after the start of a phase of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pomona.executive.cell.device import FaultSwitch


@dataclass(frozen=True, slots=True)
class PlannedFault:
    """A fault and its start."""

    switch: str  # as the cell names it
    kind: str  # one of the switch's faults
    after: float = (
        0.0  # seconds after the phase has begun; of the cell's clock when there is no phase
    )
    phase: str | None = (
        None  # a name that the observer of the run gives to a stage of it; None for the start of time
    )
    lasts: float = math.inf  # seconds until it is cleared


class FaultPlan:
    """Turns switches when it is time; call `step` with every step of the world, or as often as faults may come."""

    def __init__(self, faults: Sequence[PlannedFault], switches: Mapping[str, FaultSwitch]) -> None:
        """Raises ValueError: a fault has a switch that is not there."""
        for fault in faults:
            if fault.switch not in switches:
                raise ValueError(f"'{fault.switch}' is no switch; take one of {sorted(switches)}")
        self._switches = switches
        self._waiting = [fault for fault in faults if fault.phase is not None]
        self._due = [(fault.after, fault) for fault in faults if fault.phase is None]
        self._clearing: list[tuple[float, PlannedFault]] = []
        self.injected: list[tuple[float, PlannedFault]] = []
        """Started faults with their times."""

    def begin(self, phase: str, now: float) -> None:
        """A phase of the run begins; only the first time counts."""
        self._due += [(now + fault.after, fault) for fault in self._waiting if fault.phase == phase]
        self._waiting = [fault for fault in self._waiting if fault.phase != phase]

    def step(self, now: float) -> None:
        """Turn the faults that are due."""
        for due, fault in [entry for entry in self._due if entry[0] <= now]:
            self._due.remove((due, fault))
            self._switches[fault.switch].inject_fault(fault.kind)
            self.injected.append((now, fault))
            self._clearing.append((now + fault.lasts, fault))
        for due, fault in [entry for entry in self._clearing if entry[0] <= now]:
            self._clearing.remove((due, fault))
            self._switches[fault.switch].clear_fault()
