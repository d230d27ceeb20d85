"""A joint space of two joints with discs in it, solved in closed form: no robot, no map."""

import time
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from pomona.drivers.interfaces import ArmLimits
from pomona.skills.motion.planning.ompl_planners import solve_by_ompl
from pomona.skills.motion.planning.space import Effort

LIMITS = ArmLimits(
    lower=np.full(2, -2.0),
    upper=np.full(2, 2.0),
    velocity=np.full(2, 3.0),
    acceleration=np.full(2, 10.0),
    jerk=np.full(2, 100.0),
)


@dataclass
class DiscWorld:
    """Free outside of all discs, given as rows (x, y, radius)."""

    discs: np.ndarray
    lower: np.ndarray = field(default_factory=lambda: LIMITS.lower)
    upper: np.ndarray = field(default_factory=lambda: LIMITS.upper)
    endless: np.ndarray = field(default_factory=lambda: np.zeros(2, np.bool_))
    asked: int = 0

    def distance_to_segment(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        d = b - a
        along = np.clip(((self.discs[:, :2] - a) @ d) / max(d @ d, 1e-12), 0.0, 1.0)
        return np.linalg.norm(a + along[:, None] * d - self.discs[:, :2], axis=1) - self.discs[:, 2]

    def free(self, q: np.ndarray) -> bool:
        return self.free_between(q, q)

    def free_between(self, q_a: np.ndarray, q_b: np.ndarray) -> bool:
        self.asked += 1
        return bool((self.distance_to_segment(q_a, q_b) > 0.0).all())

    def first_blocked(self, path: np.ndarray) -> int | None:
        return next(
            (k for k, (a, b) in enumerate(pairwise(path)) if not self.free_between(a, b)), None
        )

    def connect(
        self, q_start: np.ndarray, q_goals: np.ndarray, iterations: int, seed: int
    ) -> tuple[np.ndarray | None, int]:
        """By OMPL: this project's own grows in compiled code among real robots only."""
        found = solve_by_ompl(
            self,
            q_start,
            q_goals,
            "RRTConnect",
            Effort(iterations, seed, time.perf_counter() + 10.0, None),
        )
        return found.waypoints, found.iterations

    def explain(self, q: np.ndarray) -> tuple[str, dict[str, object]]:
        nearest = int(self.distance_to_segment(q, q).argmin())
        return f"the point is inside disc {nearest}", {"obstacle": f"disc {nearest}"}


def wall_with_gap(gap: float) -> DiscWorld:
    """A wall along y at x = 0, with a gap of a width at y = 1.2."""
    y = np.arange(-2.2, 2.3, 0.04)
    y = y[np.abs(y - 1.2) > gap / 2.0 + 0.1]
    return DiscWorld(np.stack([np.zeros_like(y), y, np.full_like(y, 0.1)], axis=1))


def closed_wall() -> DiscWorld:
    """A wall along y at x = 0 without a gap."""
    y = np.arange(-2.2, 2.3, 0.04)
    return DiscWorld(np.stack([np.zeros_like(y), y, np.full_like(y, 0.1)], axis=1))
