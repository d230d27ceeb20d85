"""Errors of a cell and its devices.

DriverError
├── CellFileError       the cell file is wrong, with its place
└── DeviceError         a device refused or failed; carries the device's name
    ├── MotionRefused   nothing has moved
    ├── DeviceLost      no answer, or the stream went stale
    └── DeviceFault     the device reports a fault, or its motion or data are implausible
        └── StopFailed  it refused to stop, or goes on
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pomona.executive.values.findings import Finding, format_findings


class DriverError(Exception):
    """Root of everything that drivers raise on purpose."""


class CellFileError(DriverError):
    """A cell file that cannot be used, with everything that was found in it; the first finding's place and words."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        self.findings = tuple(findings)
        first = next((f for f in self.findings if f.severity == "error"), self.findings[0])
        self.path = Path(first.path)
        self.line = first.line
        self.column = first.column
        self.message = first.message
        self.hint = first.hint
        super().__init__(format_findings(self.findings))


class DeviceError(DriverError):
    """A device refused a call or failed."""

    def __init__(self, device: str, message: str) -> None:
        self.device = device
        self.message = message
        super().__init__(f"{device}: {message}")


class MotionRefused(DeviceError):
    """A motion that was not started."""


class DeviceLost(DeviceError):
    """A device that does not answer in time, or whose stream went stale."""


class DeviceFault(DeviceError):
    """A fault that the device reports, or that its driver detects."""


class StopFailed(DeviceFault):
    """A device that refused to stop, or goes on; `earlier` is the problem before that."""

    def __init__(self, device: str, message: str, earlier: DeviceError | None = None) -> None:
        self.earlier: DeviceError | None = (
            earlier.earlier if isinstance(earlier, StopFailed) else earlier
        )
        super().__init__(
            device, message + (f"; before that it {self.earlier.message}" if self.earlier else "")
        )
