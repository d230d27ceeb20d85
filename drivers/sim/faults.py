"""Faults that tests inject into simulated devices, to see that a run ends safely. Nothing but tests calls this."""

from __future__ import annotations

from typing import ClassVar

from drivers.device import Device


class FaultyDevice(Device):
    """A simulated device that can be made to fail on request."""

    known_faults: ClassVar[tuple[str, ...]] = ()

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.fault: str | None = None

    def inject_fault(self, kind: str) -> None:
        """Make the device fail from now on; for tests.

        Raises:
            ValueError: the device has no such fault.
        """
        if kind not in self.known_faults:
            raise ValueError(f"{self.name} has the faults {', '.join(self.known_faults)}, not {kind}")
        self.fault = kind

    def clear_fault(self) -> None:
        """Repair the device; for tests."""
        self.fault = None

    def link(self) -> str:
        return "ok" if self.fault is None else self.fault
