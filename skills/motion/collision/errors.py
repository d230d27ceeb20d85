"""What can go wrong when a collision world is built or asked.

CollisionError
├── UnknownObstacle    a name that no obstacle has
└── BadTrajectory      a path or trajectory that is malformed or violates the joint limits
"""

from __future__ import annotations


class CollisionError(Exception):
    """Root of this package's errors."""


class UnknownObstacle(CollisionError):
    """A name that no obstacle of the world has."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name, self.known = name, known
        super().__init__(f"no obstacle is named '{name}'; there are {', '.join(known)}")


class BadTrajectory(CollisionError):
    """A path or trajectory that must not be executed, whatever the world looks like."""

    def __init__(self, problem: str, sample: int) -> None:
        self.problem, self.sample = problem, sample
        super().__init__(f"sample {sample} of the trajectory: {problem}")
