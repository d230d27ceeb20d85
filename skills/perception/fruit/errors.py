"""What can go wrong with the fruit catalogue.

FruitError
├── UnknownFruit      no such name in the catalogue
└── BadFruitFile      a fruit.yaml, or the mesh it names, that cannot be read
"""

from __future__ import annotations

from pathlib import Path


class FruitError(Exception):
    """Root of this package's errors."""


class UnknownFruit(FruitError):
    """The catalogue has no fruit of this name."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name, self.known = name, known
        super().__init__(f"no fruit named {name!r}; the catalogue has {', '.join(known) or 'none'}")


class BadFruitFile(FruitError):
    """A fruit's file that cannot be used."""

    def __init__(self, path: Path, problem: str) -> None:
        self.path, self.problem = path, problem
        super().__init__(f"{path}: {problem}")
