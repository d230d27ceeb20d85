"""Interface to joint space for planners and samplers, shorter polylines in it, and the errors of planning.

PlanningError
├── PlanningFailed    there is no path to give; carries a code of the skill Plan, a sentence and data
└── BadRequest        an invalid request: NaN, a wrong number of joints, no such planner
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64


class PlanningError(Exception):
    """Root of this package's errors."""


class PlanningFailed(PlanningError):
    """No path; `code` is one of the failure codes of the skill Plan."""

    def __init__(self, code: str, message: str, data: Mapping[str, object] | None = None) -> None:
        self.code, self.message, self.data = code, message, dict(data or {})
        super().__init__(
            code, message, self.data
        )  # all arguments: it travels between processes by pickle

    def __str__(self) -> str:
        return f"{self.code}: {self.message}"


class BadRequest(PlanningError):
    """A request that cannot be planned in any scene."""


class Space(Protocol):
    """Joint space with its free part; implementations hold robots and obstacles."""

    @property
    def lower(self) -> Float64:
        """Joint limits, shape (dof,) [rad]."""

    @property
    def upper(self) -> Float64:
        """Joint limits, shape (dof,) [rad]."""

    @property
    def endless(self) -> NDArray[np.bool_]:
        """Which joints turn without limits, shape (dof,); `lower` and `upper` are then one turn from zero."""

    def free(self, q: Float64) -> bool:
        """Return True if a configuration is free of collision."""

    def free_between(self, q_a: Float64, q_b: Float64) -> bool:
        """Return True if the straight joint segment is free of collision."""

    def first_blocked(self, path: Float64) -> int | None:
        """Return the number of the first segment of a joint polyline, shape (n, dof), that is not free, or None."""

    def connect(
        self, q_start: Float64, q_goals: Float64, iterations: int, seed: int
    ) -> tuple[Float64 | None, int]:
        """Waypoints, shape (n, dof), from a free start to one of the free goals by RRT-Connect, and the iterations."""

    def explain(self, q: Float64) -> tuple[str, dict[str, object]]:
        """Explain why a configuration is not free: part of a sentence, and data (link, obstacle, distance)."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Limits of a planner's search."""

    iterations: int  # after which it ends; a feasible planner ends earlier, with its first path
    seed: int  # of the random postures
    deadline: float  # on `time.perf_counter`; the last resort
    # path length at which an optimising planner ends: 0 uses all iterations; None for a planner that does not optimise
    good_enough: float | None = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A path that a planner found: waypoints (n, dof), or None, and how much of the budget it took."""

    waypoints: Float64 | None
    iterations: int
    out_of_time: bool


def path_length(waypoints: Float64) -> float:
    """Length of a joint polyline, shape (n, dof) [rad]."""
    return float(np.linalg.norm(np.diff(waypoints, axis=0), axis=1).sum())


def shortcut(space: Space, waypoints: Float64, rng: np.random.Generator) -> Float64:
    """Return a path from a free polyline, shape (n, dof) [rad], that is never longer; its new segments are checked."""
    path = _leave_out_corners(space, waypoints)
    for _ in range(60):  # random cuts of a polyline
        if len(path) < 3:
            break
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        first, second = np.sort(rng.uniform(0.0, along[-1], 2))
        i, j = (
            int(np.clip(np.searchsorted(along, s, side="right") - 1, 0, len(path) - 2))
            for s in (first, second)
        )
        if i == j:
            continue
        a = path[i] + (first - along[i]) / (along[i + 1] - along[i]) * (path[i + 1] - path[i])
        b = path[j] + (second - along[j]) / (along[j + 1] - along[j]) * (path[j + 1] - path[j])
        if space.free_between(a, b):
            path = np.vstack([path[: i + 1], a, b, path[j + 1 :]])
    return _leave_out_corners(space, path)


def _leave_out_corners(space: Space, waypoints: Float64) -> Float64:
    """From each kept corner, go straight to the farthest later one that can be reached."""
    kept = [0]
    here = 0
    while here < len(waypoints) - 1:
        here = next(
            (
                k
                for k in range(len(waypoints) - 1, here + 1, -1)
                if space.free_between(waypoints[here], waypoints[k])
            ),
            here + 1,
        )
        kept.append(here)
    return waypoints[kept]
