"""Errors of the fruit catalogue.

FruitError
├── UnknownFruit      no such name in the catalogue
└── BadFruitFile      a fruit.yaml, or the mesh it names, that cannot be read
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pomona.executive.values.findings import Finding, did_you_mean, format_findings


class FruitError(Exception):
    """Root of this package's errors."""


class UnknownFruit(FruitError):
    """The catalogue has no fruit of this name."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name, self.known = name, known
        hint = did_you_mean(name, known)
        there = f"the catalogue has {', '.join(known) or 'none'}"
        super().__init__(f"no fruit named '{name}'; {hint + ' ' if hint else ''}{there}")


class BadFruitFile(FruitError):
    """A fruit file that cannot be used, with everything that was found in it."""

    def __init__(self, path: Path, findings: Sequence[Finding]) -> None:
        self.path, self.findings = path, tuple(findings)
        super().__init__(format_findings(self.findings))
