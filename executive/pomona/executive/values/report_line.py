"""A line of the report of `pomona doctor`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ReportLine:
    """One line of the report: subject, state, finding, and remedy."""

    name: str
    ok: bool
    found: str
    advice: str = ""
    absent: bool = False  # optional and not there

    def __str__(self) -> str:
        line = f"{'–' if self.absent else '✓' if self.ok else '✗'} {self.name:24} {self.found}"
        return line if self.ok or not self.advice else f"{line}\n  → {self.advice}"
