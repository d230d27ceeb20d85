"""Which sightings of one frame show fruit that is known already."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from pomona.executive.values.arrays import Float64

GATE = 11.345  # squared Mahalanobis distance of 99 of 100 sightings of one fruit (chi², 3 degrees)

MISPLACED = 0.1
"""Standard deviation of errors outside the covariances, such as the camera's pose and dents, relative to the diameter.
Two sightings reach 0.48 of a diameter at the gate: no two solid fruit are as near to each other."""


def associate(
    known: Sequence[tuple[Float64, Float64]], seen: Sequence[tuple[Float64, Float64]], diameter: float
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
    costs = np.hstack([np.where(distances <= GATE, distances, 1e6), np.full((len(seen), len(seen)), GATE)])
    rows, columns = linear_sum_assignment(costs)
    chosen: list[int | None] = [None] * len(seen)
    for row, column in zip(rows, columns, strict=True):
        if column < len(known):
            chosen[row] = int(column)
    return chosen
