"""All fruit of one look, measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pomona.skills.perception import Detection, MeasuredFruit, RefineError, measure

OVERLAP = 0.6
"""Share of the sum of two fruit's mean radii; middles that are nearer show that one took the depth of the other. Fruit
that touches is apart by the sum."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenFruit:
    """One fruit of a look."""

    detection: Detection
    measured: MeasuredFruit | None  # None where the measurement failed
    why: str = ""  # the reason of a failed measurement, for the operator


@dataclass(frozen=True, slots=True, eq=False)
class FruitScene:
    """Fruit of one look; fruit that was not measured is an obstacle by its cells."""

    fruit: tuple[SeenFruit, ...]

    @property
    def measured(self) -> tuple[MeasuredFruit, ...]:
        """The measured fruit."""
        return tuple(seen.measured for seen in self.fruit if seen.measured is not None)

    @property
    def sentence(self) -> str:
        """Text for the operator."""
        failed = [seen.why for seen in self.fruit if seen.measured is None]
        return "; ".join((f"{len(self.measured)} of {len(self.fruit)} fruit measured", *failed))

    def with_neighbours(self, chosen: MeasuredFruit) -> MeasuredFruit:
        """Return a fruit of this scene with all others beside it."""
        return replace(chosen, beside=tuple(other for other in self.measured if other is not chosen))


def measure_all(detections: Sequence[Detection], table_z: float | None) -> FruitScene:
    """Measure each detection; of two that overlap, the one whose depth agrees less is no measurement."""
    seen = [_measure(detection, table_z) for detection in detections]
    for i, one in enumerate(seen):
        for k in range(i):
            if one.measured is not None and (other := seen[k].measured) is not None and overlap(one.measured, other):
                worse = i if one.measured.inlier_ratio < other.inlier_ratio else k
                seen[worse] = SeenFruit(seen[worse].detection, None, "its depth is that of another fruit")
                one = seen[i]
    return FruitScene(tuple(seen))


def overlap(one: MeasuredFruit, other: MeasuredFruit) -> bool:
    """Return True if two measured fruit cannot both be where they were measured."""
    apart = float(np.linalg.norm(one.T_base_fruit[:3, 3] - other.T_base_fruit[:3, 3]))
    return apart < OVERLAP * float(one.dimensions.mean() + other.dimensions.mean()) / 2.0


def _measure(detection: Detection, table_z: float | None) -> SeenFruit:
    try:
        return SeenFruit(detection, measure(detection, table_z=table_z))
    except RefineError as problem:
        return SeenFruit(detection, None, str(problem))
