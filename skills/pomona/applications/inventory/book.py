"""All fruit so far: one identity each, however many frames show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from pomona.applications.inventory.fusion import FusedSize, SizeOfLooks
from pomona.applications.inventory.sighting import Sighting
from pomona.executive import Float64


@dataclass(slots=True, eq=False)
class KnownFruit:
    """One fruit and all its sightings."""

    number: int  # its identity, counted from 1
    scene: int  # in which it was seen; places in different scenes are unrelated
    sightings: list[Sighting]  # in the order of the frames, with places in the scene's frame
    place: Float64  # by all of them, shape (3,) [m]
    place_covariance: Float64  # of it, shape (3, 3) [m²]
    size: FusedSize | None = None  # from all its measurements; None without any
    _looks: SizeOfLooks = field(default_factory=SizeOfLooks)

    @property
    def score(self) -> float:
        """The surest sighting's."""
        return max(sighting.score for sighting in self.sightings)

    @property
    def why(self) -> str:
        """Why it was not measured, of its surest sighting; empty when it was."""
        return "" if self.size is not None else max(self.sightings, key=lambda s: s.score).why

    def see(self, sighting: Sighting) -> None:
        """Count one more sighting in."""
        own, new = np.linalg.inv(self.place_covariance), np.linalg.inv(sighting.place_covariance)
        covariance = np.linalg.inv(own + new)
        self.place = covariance @ (own @ self.place + new @ sighting.p_base)
        self.place_covariance = covariance
        self._count(sighting)

    def _count(self, sighting: Sighting) -> None:
        self.sightings.append(sighting)
        if sighting.dimensions is not None and sighting.size_covariance is not None:
            self._looks.add(sighting.dimensions, sighting.size_covariance, sighting.R_base_fruit)
            self.size = self._looks.fused()

    @classmethod
    def first(cls, number: int, scene: int, sighting: Sighting) -> KnownFruit:
        """Return a fruit that was not seen before."""
        fruit = cls(number, scene, [], sighting.p_base, sighting.place_covariance)
        fruit._count(sighting)
        return fruit


@dataclass(slots=True)
class FruitBook:
    """Every fruit that was seen, with its identity."""

    fruit: list[KnownFruit] = field(default_factory=list)  # by their numbers
    scenes: int = 0  # how many scenes there are so far

    def add_frame(
        self, sightings: Sequence[Sighting], T_scene_base: Float64 | None, deviation: float = 0.0
    ) -> list[int]:
        """Add all sightings of one frame; return the number of the fruit that each one shows.

        Measured sightings are assigned first: the distances of the others are estimates by their size in the picture.

        Args:
            T_scene_base: from the frame's base frame to that of the newest scene, shape (4, 4); None begins a new
                scene, since the camera's motion is unknown.
            deviation: standard deviation of that, at the fruit [m].
        """
        if T_scene_base is None or not self.scenes:
            self.scenes += 1
        T = np.eye(4) if T_scene_base is None else T_scene_base
        numbers = [0] * len(sightings)
        here = [fruit for fruit in self.fruit if fruit.scene == self.scenes - 1]
        for measured in (True, False):
            some = [
                k
                for k, sighting in enumerate(sightings)
                if (sighting.dimensions is not None) == measured
            ]
            if not some:
                continue
            seen = [_uncertain(sightings[k].moved(T), deviation) for k in some]
            diameter = float(seen[0].fruit.dimensions.mean())
            shown = associate(
                [(fruit.place, fruit.place_covariance) for fruit in here],
                [(sighting.p_base, sighting.place_covariance) for sighting in seen],
                diameter,
            )
            for k, sighting, which in zip(some, seen, shown, strict=True):
                if which is None:
                    self.fruit.append(
                        KnownFruit.first(len(self.fruit) + 1, self.scenes - 1, sighting)
                    )
                    numbers[k] = len(self.fruit)
                else:
                    here[which].see(sighting)
                    numbers[k] = here[which].number
            taken = {which for which in shown if which is not None}
            here = [fruit for index, fruit in enumerate(here) if index not in taken]
        return numbers


def _uncertain(sighting: Sighting, deviation: float) -> Sighting:
    covariance = sighting.place_covariance + deviation**2 * np.eye(3)
    return replace(sighting, place_covariance=covariance, outline=np.empty((0, 2)))


GATE = 11.345  # squared Mahalanobis distance of 99 of 100 sightings of one fruit (chi², 3 degrees)

MISPLACED = 0.1
"""Standard deviation of errors outside the covariances, such as the camera's pose and dents, relative to the diameter.
Two sightings reach 0.48 of a diameter at the gate: no two solid fruit are as near to each other."""


def associate(
    known: Sequence[tuple[Float64, Float64]],
    seen: Sequence[tuple[Float64, Float64]],
    diameter: float,
) -> list[int | None]:
    """Return for each sighting of one frame the known fruit that it shows, by its place; None where it is new.

    Both are places, (3,) [m], with covariances, (3, 3) [m²]. Two sightings in one frame are two fruit. The sum of
    squared Mahalanobis distances is the least possible, where a new fruit counts as the gate.
    """
    if not known or not seen:
        return [None] * len(seen)
    places, spreads = (np.array(values) for values in zip(*known, strict=True))
    own = 2.0 * (MISPLACED * diameter) ** 2 * np.eye(3)
    distances = np.empty((len(seen), len(known)))
    for row, (p, covariance) in enumerate(seen):
        apart = places - p
        distances[row] = np.einsum(
            "ni,ni->n", apart, np.linalg.solve(spreads + covariance + own, apart[..., None])[..., 0]
        )
    costs = np.hstack(
        [np.where(distances <= GATE, distances, 1e6), np.full((len(seen), len(seen)), GATE)]
    )
    rows, columns = linear_sum_assignment(costs)
    chosen: list[int | None] = [None] * len(seen)
    for row, column in zip(rows, columns, strict=True):
        if column < len(known):
            chosen[row] = int(column)
    return chosen
