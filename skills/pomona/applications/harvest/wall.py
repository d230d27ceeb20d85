"""A fruit wall drawn by seed: trunk, laterals on their tiers, spurs, fruit singly and in clusters, leaves, wires.

Everything is in the base frame of the arm that stands before it, in the shape in which it hangs at rest.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from pomona.applications.harvest.numbers import WallNumbers
from pomona.applications.harvest.strength import Strength, draw_strength
from pomona.executive import Float64

SEGMENTS = 6
"""Hinge pairs of a lateral: with them its deflection is within 1 % of the beam's."""
HALF_WIDTH, TRUNK_TOP, GROUND = 0.55, 1.15, -0.75
"""Of the segment that is picked, beside the arm's middle; height of the trunk's end, and of the ground [m]."""
GAP = 2e-3
"""Nothing is drawn nearer to a fruit than this: overlaps would break stems [m]."""
STEM_SEAT = 0.44
"""A stem ends so far above its fruit's middle, over the fruit's height: in its cavity."""
NUB = 6e-3
"""Fruit of a cluster hang so far beside the spur's end [m]."""
TRIES = 400


@dataclass(frozen=True, slots=True, eq=False)
class Lateral:
    """A branch along a line from `start` in `direction` (unit), tapering between two diameters [m]."""

    start: Float64
    direction: Float64
    length: float
    diameters: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Spur:
    """A short twig on a lateral, `s` from its base, in `direction` (unit) [m]."""

    lateral: int
    s: float
    start: Float64
    direction: Float64
    length: float
    diameter: float

    @property
    def tip(self) -> Float64:
        """Where the stems sit, (3,) [m]."""
        return self.start + self.length * self.direction


@dataclass(frozen=True, slots=True, eq=False)
class HangingFruit:
    """A fruit on its stem."""

    spur: int  # its number
    anchor: Float64  # where the stem sits on the spur [m]
    T_base_fruit: (
        Float64  # object frame, y down along the stem; dimensions (d_x, d_y, d_z) [m]; mass [kg]
    )
    dimensions: Float64
    mass: float
    stem: float  # length of the visible stem [m]
    strength: Strength  # of the stem
    cluster: int  # number of fruit on the spur
    number: int = 0  # as drawn: it stays when others are taken away

    @property
    def lever(self) -> float:
        """From the anchor to the fruit's middle [m]."""
        return float(np.linalg.norm(self.T_base_fruit[:3, 3] - self.anchor))

    @property
    def radius(self) -> float:
        """Half of the largest diameter [m]."""
        return float(self.dimensions.max()) / 2.0


@dataclass(frozen=True, slots=True, eq=False)
class TreeLeaf:
    """A plate on a petiole, at `s` of a lateral or of a spur: x along petiole and blade, z its upper face."""

    lateral: int
    spur: int | None
    s: float
    start: Float64
    R_base_leaf: Float64
    petiole: float
    length: float


@dataclass(frozen=True, slots=True, eq=False)
class TrellisWire:
    """A trellis wire along x at y and z [m]."""

    y: float
    z: float


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """All of it. `trunk`: x, y and radius; `height`: of the base over the place for which walls are drawn [m]."""

    numbers: WallNumbers
    seed: int
    trunk: tuple[float, float, float]
    wires: tuple[TrellisWire, ...]
    laterals: tuple[Lateral, ...]
    spurs: tuple[Spur, ...]
    fruits: tuple[HangingFruit, ...]
    leaves: tuple[TreeLeaf, ...]
    height: float = 0.0

    @property
    def ground(self) -> float:
        """Height of the ground [m]."""
        return GROUND - self.height

    @property
    def trunk_top(self) -> float:
        """Height of the trunk's end [m]."""
        return TRUNK_TOP - self.height

    def without(self, gone: Collection[int]) -> Wall:
        """Return the wall when fruit of these numbers are gone. The wood keeps the shape in which it carried them."""
        return replace(self, fruits=tuple(each for each in self.fruits if each.number not in gone))

    def seen_from(self, stop: float, height: float) -> Wall:
        """Return the same wall before a base that stands elsewhere: `stop` along x and `height` along z [m]."""
        by = np.array([-stop, 0.0, -height])
        up = np.eye(4)
        up[:3, 3] = by
        x, y, radius = self.trunk
        return replace(
            self,
            trunk=(x - stop, y, radius),
            wires=tuple(replace(each, z=each.z - height) for each in self.wires),
            laterals=tuple(replace(each, start=each.start + by) for each in self.laterals),
            spurs=tuple(replace(each, start=each.start + by) for each in self.spurs),
            fruits=tuple(
                replace(each, anchor=each.anchor + by, T_base_fruit=up @ each.T_base_fruit)
                for each in self.fruits
            ),
            leaves=tuple(replace(each, start=each.start + by) for each in self.leaves),
            height=self.height + height,
        )


def draw_wall(
    numbers: WallNumbers,
    seed: int,
    distance: float = 0.68,
    fruit: int | None = None,
    leaves: float = 1.0,
) -> Wall:
    """Draw a wall.

    Args:
        numbers: properties of its parts.
        seed: of everything; the wood and the fruit do not depend on how many leaves there are.
        distance: of the trunk before the arm's axis, along -y [m].
        fruit: number of fruit; drawn if omitted. Fewer hang if no more fit.
        leaves: share of the full foliage.
    """
    rng = np.random.default_rng([seed, 11])
    trunk = (
        float(rng.uniform(-0.12, 0.12)),
        -distance,
        float(rng.uniform(*numbers.trunk_diameter)) / 2.0,
    )
    tiers = [0.40 + k * numbers.wire_spacing for k in (-1, 0, 1)]
    wires = tuple(
        TrellisWire(
            trunk[1] + float(rng.choice([-1.0, 1.0])) * (trunk[2] + numbers.wire_diameter / 2.0), z
        )
        for z in tiers
    )
    laterals = _draw_laterals(numbers, trunk, tiers, rng)
    least, most = map(int, numbers.fruit_count)
    count = int(rng.integers(least, most + 1)) if fruit is None else fruit
    spurs, fruits = _hang_fruit(numbers, trunk, wires, laterals, count, rng)
    drawn = _draw_leaves(numbers, laterals, spurs, fruits, np.random.default_rng([seed, 12]))
    kept = np.random.default_rng([seed, 13]).random(len(drawn)) < leaves
    return Wall(
        numbers,
        seed,
        trunk,
        wires,
        laterals,
        spurs,
        fruits,
        tuple(x for x, k in zip(drawn, kept, strict=True) if k),
    )


def _draw_laterals(
    numbers: WallNumbers,
    trunk: tuple[float, float, float],
    tiers: list[float],
    rng: np.random.Generator,
) -> tuple[Lateral, ...]:
    """One to each side of each tier, and some more between them."""
    count = int(rng.integers(int(numbers.laterals[0]), int(numbers.laterals[1]) + 1))
    places = [(z, side) for z in tiers for side in (-1.0, 1.0)]
    places += [
        (tiers[rng.integers(3)] + 0.13, float(rng.choice([-1.0, 1.0])))
        for _ in range(count - len(places))
    ]
    laterals = []
    for z, side in places[:count]:
        bow, rise = np.radians(rng.uniform(-12.0, 12.0)), np.radians(rng.uniform(-2.0, 14.0))
        direction = np.array(
            [side * np.cos(rise) * np.cos(bow), np.cos(rise) * np.sin(bow), np.sin(rise)]
        )
        start = (
            np.array([trunk[0], trunk[1], z + rng.uniform(-0.03, 0.03)])
            + 0.8 * trunk[2] * direction
        )
        room = HALF_WIDTH - side * trunk[0]
        length = min(float(rng.uniform(*numbers.lateral_length)), room)
        ends = (float(rng.uniform(*numbers.lateral_base)), float(rng.uniform(*numbers.lateral_tip)))
        laterals.append(Lateral(start, direction, length, ends))
    return tuple(laterals)


def _hang_fruit(
    numbers: WallNumbers,
    trunk: tuple[float, float, float],
    wires: tuple[TrellisWire, ...],
    laterals: tuple[Lateral, ...],
    count: int,
    rng: np.random.Generator,
) -> tuple[tuple[Spur, ...], tuple[HangingFruit, ...]]:
    """Spurs with their fruit, one after the other where there is room."""
    wood: list[tuple[Float64, Float64, float]] = [
        (each.start, each.start + each.length * each.direction, max(each.diameters) / 2.0)
        for each in laterals
    ]
    x, y, radius = trunk
    wood.append((np.array([x, y, GROUND]), np.array([x, y, TRUNK_TOP]), radius))
    thin = numbers.wire_diameter / 2.0
    wood += [
        (np.array([-1.0, wire.y, wire.z]), np.array([1.0, wire.y, wire.z]), thin) for wire in wires
    ]
    spurs: list[Spur] = []
    fruits: list[HangingFruit] = []
    share = np.array([each.length for each in laterals]) / sum(each.length for each in laterals)
    for _ in range(TRIES):
        if len(fruits) >= count:
            break
        spur = _draw_spur(numbers, laterals, int(rng.choice(len(laterals), p=share)), rng)
        size = int(
            np.searchsorted(np.cumsum([numbers.cluster_three, numbers.cluster_two]), rng.random())
        )
        hung = _hang_cluster(numbers, spur, len(spurs), min(3 - size, count - len(fruits)), rng)
        stem = (spur.start, spur.tip, spur.diameter / 2.0)
        if all(
            _is_clear(each, [*fruits, *(o for o in hung if o is not each)], wood, stem)
            for each in hung
        ) and all(_beside(each.T_base_fruit[:3, 3], *stem) > each.radius + GAP for each in fruits):
            spurs.append(spur)
            fruits += hung
            wood.append(stem)
    return tuple(spurs), tuple(replace(each, number=i) for i, each in enumerate(fruits))


def _draw_spur(
    numbers: WallNumbers, laterals: tuple[Lateral, ...], on: int, rng: np.random.Generator
) -> Spur:
    """Across its lateral, in any direction but upwards, a little towards the lateral's tip."""
    lateral = laterals[on]
    s = float(rng.uniform(0.10, 0.97)) * lateral.length
    turn = np.radians(rng.uniform(-110.0, 110.0))
    across = np.cross(lateral.direction, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    down = np.cross(across, lateral.direction)
    down *= -np.sign(down[2])
    direction = np.cos(turn) * down + np.sin(turn) * across + 0.4 * lateral.direction
    direction /= np.linalg.norm(direction)
    length, diameter = (
        float(rng.uniform(*numbers.spur_length)),
        float(rng.uniform(*numbers.spur_diameter)),
    )
    return Spur(on, s, lateral.start + s * lateral.direction, direction, length, diameter)


def _hang_cluster(
    numbers: WallNumbers, spur: Spur, index: int, size: int, rng: np.random.Generator
) -> list[HangingFruit]:
    """Return fruit around the spur's end: alone with a small lean, together as far apart as their bodies ask for."""
    azimuth = rng.uniform(-np.pi, np.pi)
    diameter = rng.uniform(*numbers.fruit_diameter, size)
    fruits = []
    for k in range(size):
        height = float(diameter[k] * rng.uniform(*numbers.fruit_height))
        dimensions = np.array([diameter[k], height, diameter[k]])
        stem = float(rng.uniform(*numbers.stem_length))
        lever = stem + STEM_SEAT * height
        turn = azimuth + 2.0 * np.pi * k / size
        aside = np.array([np.cos(turn), np.sin(turn), 0.0])
        lean = float(rng.uniform(*numbers.stem_lean))
        if size > 1:
            apart = (diameter.max() / 2.0 + GAP) / np.sin(np.pi / size) - NUB
            lean = float(np.arcsin(np.clip(apart / lever, 0.0, 0.95)))
        along = np.sin(lean) * aside - np.cos(lean) * np.array([0.0, 0.0, 1.0])
        anchor = spur.tip + (NUB * aside if size > 1 else 0.0)
        T = np.eye(4)
        T[:3, :3] = _frame(along, rng.uniform(-np.pi, np.pi))
        T[:3, 3] = anchor + lever * along
        mass = float(numbers.fruit_density * np.pi / 6.0 * dimensions.prod())
        fruits.append(
            HangingFruit(
                index, anchor, T, dimensions, mass, stem, draw_strength(numbers, rng), size
            )
        )
    return fruits


def _frame(along: Float64, yaw: float) -> Float64:
    """Axes of a fruit whose y points along its stem."""
    first = np.cross(along, [1.0, 0.0, 0.0] if abs(along[0]) < 0.8 else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(first, along)
    x = np.cos(yaw) * first + np.sin(yaw) * second
    return np.stack([x, along, np.cross(x, along)], axis=1)


def _is_clear(
    fruit: HangingFruit,
    others: list[HangingFruit],
    wood: list[tuple[Float64, Float64, float]],
    own: tuple[Float64, Float64, float],
) -> bool:
    """Return True if nothing overlaps the fruit, as a ball of its largest diameter."""
    p = fruit.T_base_fruit[:3, 3]
    if abs(p[0]) > HALF_WIDTH + 0.1:
        return False
    if any(
        np.linalg.norm(p - o.T_base_fruit[:3, 3]) < fruit.radius + o.radius + 0.5 * GAP
        for o in others
    ):
        return False
    return all(_beside(p, *each) > fruit.radius + GAP for each in [*wood, own])


def _beside(p: Float64, a: Float64, b: Float64, radius: float) -> float:
    """Return the distance of a point from a capsule [m]."""
    along = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return float(np.linalg.norm(p - a - along * (b - a))) - radius


def _draw_leaves(
    numbers: WallNumbers,
    laterals: tuple[Lateral, ...],
    spurs: tuple[Spur, ...],
    fruits: tuple[HangingFruit, ...],
    rng: np.random.Generator,
) -> list[TreeLeaf]:
    """Along the laterals and around the spurs; none whose blade's middle lies in a fruit."""
    places: list[tuple[int, int | None, float, Float64]] = []
    for i, lateral in enumerate(laterals):
        for s in (
            rng.uniform(0.08, 1.0, round(numbers.leaves_per_metre * lateral.length))
            * lateral.length
        ):
            places.append((i, None, float(s), lateral.start + s * lateral.direction))
    for k, spur in enumerate(spurs):
        for s in rng.uniform(0.5, 1.0, round(numbers.leaves_per_spur)) * spur.length:
            places.append((spur.lateral, k, float(s), spur.start + s * spur.direction))
    centres = np.array([each.T_base_fruit[:3, 3] for each in fruits]).reshape(-1, 3)
    radii = np.array([each.radius for each in fruits])
    leaves = []
    for lateral_of, spur_of, s, start in places:
        for _ in range(8):
            azimuth, rise, roll = (
                rng.uniform(-np.pi, np.pi),
                rng.normal(-0.25, 0.45),
                rng.normal(0.0, 0.6),
            )
            x = np.array(
                [np.cos(rise) * np.cos(azimuth), np.cos(rise) * np.sin(azimuth), np.sin(rise)]
            )
            level = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
            y = np.cos(roll) * level + np.sin(roll) * np.cross(x, level)
            petiole, length = (
                float(rng.uniform(*numbers.petiole_length)),
                float(rng.uniform(*numbers.leaf_length)),
            )
            middle = start + (petiole + 0.5 * length) * x
            if np.all(np.linalg.norm(centres - middle, axis=1) > radii):
                leaves.append(
                    TreeLeaf(
                        lateral_of,
                        spur_of,
                        s,
                        start,
                        np.stack([x, y, np.cross(x, y)], axis=1),
                        petiole,
                        length,
                    )
                )
                break
    return leaves
