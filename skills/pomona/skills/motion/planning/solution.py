"""Result of a planner."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.executive.values.arrays import Float64


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A path that a planner found: waypoints (n, dof), or None, and how much of the budget it took."""

    waypoints: Float64 | None
    iterations: int
    out_of_time: bool
