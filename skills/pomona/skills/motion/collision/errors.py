"""Errors of building or querying a collision world.

CollisionError
└── UnknownObstacle    a name that no obstacle has
"""

from __future__ import annotations


class CollisionError(Exception):
    """Root of this package's errors."""


class UnknownObstacle(CollisionError):
    """A name that no obstacle of the world has."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name, self.known = name, known
        super().__init__(f"no obstacle is named '{name}'; there are {', '.join(known)}")
