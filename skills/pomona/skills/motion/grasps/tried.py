"""Which candidates of a fruit have been tried: state across the retries of an attempt."""

from __future__ import annotations

import numpy as np

from pomona.skills.motion.grasp import Grasp
from pomona.skills.perception.measured_fruit import MeasuredFruit

SAME_PLACE = 0.04  # a fruit within this distance of the last one is the same [m]: less than half a fruit


Direction = tuple[float, float]  # tilt and azimuth of an approach, rounded [rad]: the name of a candidate


def direction(grasp: Grasp) -> Direction:
    """Return the direction from which a candidate approaches."""
    return round(grasp.theta, 6), round(grasp.alpha, 6)


class Tried:
    """Remembers attempts at one fruit, and forgets them for the next."""

    def __init__(self) -> None:
        self._fruit: MeasuredFruit | None = None
        self._candidates: set[Direction] = set()
        self.attempt = 0

    @property
    def directions(self) -> frozenset[Direction]:
        """Where this fruit was approached from."""
        return frozenset(self._candidates)

    def begin(self, fruit: MeasuredFruit) -> None:
        """A new attempt at a fruit begins."""
        if self._fruit is None or not same_fruit(self._fruit, fruit):
            self._candidates.clear()
            self.attempt = 0
        self._fruit = fruit
        self.attempt += 1

    def add(self, grasp: Grasp) -> None:
        """A candidate was tried; one of another fruit does not count."""
        if self._fruit is not None and same_fruit(self._fruit, grasp.fruit):
            self._candidates.add(direction(grasp))


def same_fruit(one: MeasuredFruit, other: MeasuredFruit) -> bool:
    """Return True if two measurements are of one fruit: the same kind at the same place."""
    apart = np.linalg.norm(one.T_base_fruit[:3, 3] - other.T_base_fruit[:3, 3])
    return one.fruit.name == other.fruit.name and bool(apart < SAME_PLACE)
