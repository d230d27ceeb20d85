"""Interface to joint space for planners and samplers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64


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

    def connect(self, q_start: Float64, q_goals: Float64, iterations: int, seed: int) -> tuple[Float64 | None, int]:
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
