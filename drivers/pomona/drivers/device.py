"""Context in which a robot's device is connected, and the names of `pomona.executive.cell.device`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from pomona.drivers.hand_memory import HandMemory, memory_of
from pomona.drivers.interfaces import Workspace
from pomona.executive.cell import device
from pomona.executive.cell.device import Device as Device, World as World


@dataclass(slots=True)
class ConnectContext(device.ConnectContext):
    """Context of a connection: see `pomona.executive.cell.device.ConnectContext`.

    Attributes:
        hand: memory of an emulated world's hand; None where the hand is real.
    """

    workspace: Workspace | None = None
    hand: HandMemory | None = None

    def hand_memory(self, wires: Iterable[str]) -> HandMemory:
        """Return the memory of the hand at the end of these wires."""
        return memory_of(wires) if self.hand is None else self.hand
