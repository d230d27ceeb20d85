"""How a cell file's options become a conveyor: the entry points of this package. The arm's devices are the table's."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from pomona.applications.conveyor.belt_model import build_belt_model, waiting_place
from pomona.applications.conveyor.conveyor import FASTEST, BeltPlace, second_belt
from pomona.applications.conveyor.devices import SimConveyor
from pomona.applications.conveyor.reach_watch import unseen_people
from pomona.applications.conveyor.world import ConveyorWorld, Feed
from pomona.drivers import (
    ConnectContext,
    FruitKinds,
    Settings,
    Surroundings,
    UnusableRobotFile,
    driver,
    read_limits,
)
from pomona.executive import (
    LENGTH,
    SPEED,
    Float64,
    MappingOf,
    Measure,
    Number,
    Problem,
    Section,
    Span,
    Text,
    Whole,
    choose,
    value,
)
from pomona.tools.simulation import (
    APPLES,
    CellFruitSection,
    DrawnOptions,
    FruitOnTable,
    read_robot,
)

TILT = 0.1  # largest tilt of a stem when a fruit is put on the belt [rad]


@dataclass(frozen=True, slots=True, kw_only=True)
class ConveyorOptions(BeltPlace, DrawnOptions):
    """A belt beside a robot, and the fruit that comes on it."""

    start: str = value(Text(), help="pose of the workspace in which the arm stands")
    speed: float = value(
        Measure(SPEED, "0 m/s", f"{FASTEST} m/s"), "0.15 m/s", "of the belt, towards +x"
    )
    gap: tuple[float, float] = value(
        Span(Measure(LENGTH, "0 m", "3 m")), "200 mm..450 mm", "between fruit along the belt"
    )
    lateral: float = value(
        Measure(LENGTH, "0 mm", "100 mm"), "45 mm", "largest distance of fruit from the middle line"
    )
    rolling: float = value(Number(0.0, 1.0), "0", "share of the fruit that comes rolling")
    bodies: int = value(
        Whole(1, 12), "6", "fruit that is there at a time; it comes again once it has left"
    )
    kind: str = value(Text(), "all", "which fruit comes: a name in `fruits`, or all")
    fruits: Mapping[str, CellFruitSection] = value(
        MappingOf(Section(CellFruitSection)), help="fruit for the belt"
    )

    def problems(self) -> Iterator[Problem]:
        try:
            read_robot(self.robot)
            read_limits(self.robot)
        except UnusableRobotFile as error:
            yield Problem("robot", str(error))
        if self.kind not in (*self.fruits, "all"):
            yield Problem(
                "kind", f"it cannot be '{self.kind}'", choose(self.kind, (*self.fruits, "all"))
            )
        if self.lateral > self.width / 2.0:
            yield Problem(
                "lateral",
                f"fruit would come {1e3 * self.lateral:.0f} mm beside the middle, off the belt",
            )

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        poses = around.workspace.poses if around.workspace else {}
        if self.start not in poses:
            yield Problem("start", f"it cannot be '{self.start}'", choose(self.start, poses))
        yield from BeltPlace.fits(self, around)
        yield from unseen_people(around, self.belt)

    def known(self) -> Iterator[object]:
        yield read_limits(self.robot)
        yield FruitKinds(tuple(sorted({section.model.name for section in self.coming.values()})))

    @property
    def coming(self) -> Mapping[str, CellFruitSection]:
        """The kinds of fruit that come."""
        return self.fruits if self.kind == "all" else {self.kind: self.fruits[self.kind]}


@dataclass(frozen=True, slots=True, kw_only=True)
class OnBelt:
    """A device of the simulated belt."""

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        if not around.has(ConveyorWorld):
            yield Problem(
                "driver", "it needs the simulated belt above it", "world: {driver: conveyor, …}"
            )
        yield from second_belt(around)


@driver(ConveyorWorld, ConveyorOptions)
def connect_world(settings: Settings[ConveyorOptions], context: ConnectContext) -> ConveyorWorld:
    """`driver: conveyor`"""
    said = settings.values
    seed = context.seed
    assert context.workspace is not None, "judged when the cell file was read"
    spec = read_robot(said.robot)
    said.draw_pads(np.random.default_rng([seed, 18])).put(spec)
    fruits = draw_fruits(said, seed)
    shapes = [fruit.shape(seed, i) for i, fruit in enumerate(fruits)]
    built = build_belt_model(
        spec, said.belt, fruits, shapes, context.workspace.obstacles, seed, said.intruder
    )
    q_start: Float64 = context.workspace.poses[said.start]
    return ConveyorWorld(
        built, said.robot, q_start, seed, said.speed, Feed(said.gap, said.lateral, said.rolling)
    )


@driver(SimConveyor, OnBelt)
def connect_conveyor(settings: Settings[OnBelt], context: ConnectContext) -> SimConveyor:
    """`driver: sim-conveyor`"""
    world = context.find(ConveyorWorld)
    assert world is not None, "judged when the cell file was read"
    return SimConveyor(world)


def draw_fruits(said: ConveyorOptions, seed: int) -> tuple[FruitOnTable, ...]:
    """Draw the bodies of a run: all kinds in turn, each with its own mass, skin and tilt."""
    kinds = list(said.coming.items())
    turn = np.random.default_rng([seed, 3]).permutation(len(kinds))
    fruits = []
    for i in range(said.bodies):
        name, kind = kinds[turn[i % len(kinds)]]
        rng = np.random.default_rng([seed, 7, i])
        fruits.append(
            FruitOnTable(
                name=name,
                model=kind.model,
                dimensions=np.array(kind.dimensions),
                mass=kind.mass * rng.uniform(*said.weight),
                place=i + 1,
                xy=waiting_place(i),
                yaw=rng.uniform(-np.pi, np.pi),
                tilt=rng.uniform(0.0, TILT) + (np.pi / 2.0 if kind.lies else 0.0),
                tilt_azimuth=rng.uniform(-np.pi, np.pi),
                skin=kind.skin or str(rng.choice(APPLES)),
                shape_noise=said.shape_noise,
                centre=said.draw_centre(rng),
            )
        )
    return tuple(fruits)
