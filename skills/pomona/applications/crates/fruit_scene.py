"""All fruit of one look, measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pomona.drivers import Box
from pomona.executive import Float64
from pomona.skills.motion import fruit_points
from pomona.skills.perception import Detection, MeasuredFruit, RefineError, measure

OVERLAP = 0.6
"""Share of the sum of two fruit's mean radii; middles that are nearer show that one took the depth of the other. Fruit
that touches is apart by the sum."""
HIGH = 0.02
"""Height of a fruit's lowest point over the floor from which another fruit must carry it [m]: fruit that stands was
measured up to 4 mm off, and a fruit that leans on a wall or a neighbour stands up to 5 mm high."""
LOWER = 0.03
BESIDE = 0.012
"""A fruit that carries another one has its middle lower by this, and touches it within this gap [m]."""
WHOLE = 0.9
"""Share of its pixels with agreeing depth of a fruit that lies on others: nothing hides it. In four simulated heaps of
two layers 8 such fruits had 0.93 to 0.99, and partly hidden fruit 0.30 to 0.9."""


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
        failed = Counter(seen.why for seen in self.fruit if seen.measured is None)
        reasons = (why if times == 1 else f"{times} times: {why}" for why, times in failed.items())
        return "; ".join((f"{len(self.measured)} of {len(self.fruit)} fruit measured", *reasons))

    def with_neighbours(self, chosen: MeasuredFruit) -> MeasuredFruit:
        """Return a fruit of this scene with all others beside it."""
        return replace(
            chosen, beside=tuple(other for other in self.measured if other is not chosen)
        )


def measure_all(
    detections: Sequence[Detection], table_z: float | None, obstacles: Sequence[Box] = ()
) -> FruitScene:
    """Measure each detection; a measurement that others contradict is none.

    Of two fruits that overlap, one took the depth of the other: the one whose depth agrees less. A fruit in the air
    that is partly hidden did, too: fruit that lies on others is seen whole.

    Args:
        table_z: height of the table in the base frame [m]; None where it is not known.
        obstacles: boxes of the cell file, whose top faces are floors, too.
    """
    seen = [_measure(detection, table_z) for detection in detections]
    for i, one in enumerate(seen):
        for k in range(i):
            if (
                one.measured is not None
                and (other := seen[k].measured) is not None
                and overlap(one.measured, other)
            ):
                worse = i if one.measured.inlier_ratio < other.inlier_ratio else k
                seen[worse] = SeenFruit(
                    seen[worse].detection, None, "its depth is that of another fruit"
                )
                one = seen[i]
    for i, one in enumerate(seen):
        others = [
            other.measured for other in seen if other.measured is not None and other is not one
        ]
        if table_z is None or one.measured is None or one.measured.inlier_ratio >= WHOLE:
            continue
        if in_the_air(one.measured, others, table_z, obstacles):
            why = "nothing carries it where it was measured: its depth is that of another fruit"
            seen[i] = SeenFruit(one.detection, None, why)
    return FruitScene(tuple(seen))


def in_the_air(
    fruit: MeasuredFruit,
    others: Sequence[MeasuredFruit],
    table_z: float,
    obstacles: Sequence[Box] = (),
) -> bool:
    """Return True if neither the table, nor a box, nor another fruit carries a fruit where it was measured."""
    p = fruit.T_base_fruit[:3, 3]
    radius = float(fruit.dimensions.mean()) / 2.0
    floors = [table_z, *(top for box in obstacles if (top := _top_below(box, p)) is not None)]
    if float(fruit_points(fruit)[:, 2].min()) < max(floors) + HIGH:
        return False
    return not any(
        other.T_base_fruit[2, 3] < p[2] - LOWER
        and np.linalg.norm(other.T_base_fruit[:3, 3] - p)
        < radius + float(other.dimensions.mean()) / 2.0 + BESIDE
        for other in others
    )


def _top_below(box: Box, p: Float64) -> float | None:
    """Return the height of a box's top in the base frame [m]; None where it is not below a place, shape (3,) [m]."""
    T = box.T_base_box
    half = np.array(box.half_extents)
    top = float(T[2, 3] + np.abs(T[2, :3]) @ half)
    middle = np.array([*p[:2], T[2, 3]]) - T[:3, 3]
    return top if top < p[2] and bool((np.abs(T[:3, :3].T @ middle) <= half).all()) else None


def overlap(one: MeasuredFruit, other: MeasuredFruit) -> bool:
    """Return True if two measured fruit cannot both be where they were measured."""
    apart = float(np.linalg.norm(one.T_base_fruit[:3, 3] - other.T_base_fruit[:3, 3]))
    return apart < OVERLAP * float(one.dimensions.mean() + other.dimensions.mean()) / 2.0


def _measure(detection: Detection, table_z: float | None) -> SeenFruit:
    try:
        return SeenFruit(detection, measure(detection, table_z=table_z))
    except RefineError as problem:
        return SeenFruit(detection, None, str(problem))
