"""Fault injection: the faults of simulated and emulated devices, of their wires and sensors.

Each component that can fail has a `FaultSwitch`; a cell names them all in `Cell.switches`. Real devices have none.
"""

from __future__ import annotations


class FaultSwitch:
    """Something that can be made to fail in ways that it names, one at a time.

    Attributes:
        fault: the present one, or None.
    """

    known_faults: tuple[str, ...] = ()

    def __init__(self) -> None:
        self.fault: str | None = None

    def inject_fault(self, kind: str) -> None:
        """Fail from now on. Raises ValueError: there is no such fault here."""
        if kind not in self.known_faults:
            raise ValueError(f"there are the faults {', '.join(self.known_faults)}, not {kind}")
        self.fault = kind

    def clear_fault(self) -> None:
        """Clear the fault; its consequences remain."""
        self.fault = None
