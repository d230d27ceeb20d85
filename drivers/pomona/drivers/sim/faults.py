"""A simulated device that can be made to fail, to see that a run ends safely."""

from __future__ import annotations

from pomona.drivers.device import Device
from pomona.drivers.faults import FaultSwitch


class FaultyDevice(Device, FaultSwitch):
    """A simulated device with a switch."""

    def __init__(self, name: str) -> None:
        Device.__init__(self, name)
        FaultSwitch.__init__(self)

    def link(self) -> str:
        return "ok" if self.fault is None else self.fault
