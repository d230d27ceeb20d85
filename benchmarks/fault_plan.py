"""Faults that are turned on at given times, or with a delay after the start of a phase of a run."""

from __future__ import annotations

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
    lasts: float | None = None  # seconds until it is cleared, or None for good


class FaultPlan:
    """Turns switches when it is time; call `step` with every step of the world, or as often as faults may come."""

    def __init__(self, faults: Sequence[PlannedFault], switches: Mapping[str, FaultSwitch]) -> None:
        """
        Raises:
            ValueError: a fault names no switch, or none of its faults.
        """
        for fault in faults:
            if fault.switch not in switches:
                raise ValueError(
                    f"there is no switch '{fault.switch}'; there are {', '.join(switches)}"
                )
            known = switches[fault.switch].known_faults
            if fault.kind not in known:
                raise ValueError(
                    f"{fault.switch} has the faults {', '.join(known)}, not '{fault.kind}'"
                )
        self._switches = dict(switches)
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
            if fault.lasts is not None:
                self._clearing.append((now + fault.lasts, fault))
        for due, fault in [entry for entry in self._clearing if entry[0] <= now]:
            self._clearing.remove((due, fault))
            self._switches[fault.switch].clear_fault()
