"""How a cell file's options become a fruit wall: the entry point of this package. The devices are the table's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.applications.harvest.model import build_wall_model
from pomona.applications.harvest.numbers import read_numbers
from pomona.applications.harvest.scenery import Scenery
from pomona.applications.harvest.wall import Wall, draw_wall
from pomona.applications.harvest.world import FruitWallWorld
from pomona.drivers import (
    CellFileError,
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
    Measure,
    Number,
    OrWord,
    PathTo,
    Problem,
    Span,
    Text,
    Whole,
    choose,
    value,
)
from pomona.tools.simulation import (
    FRICTION,
    PADS,
    SKINS,
    FruitShape,
    UnusableModel,
    make_fruit,
    read_model,
    read_robot,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FruitWallOptions:
    """A fruit wall before a robot, drawn by the run's seed."""

    robot: Path = value(PathTo("file"), help="MJCF of the robot")
    numbers: Path = value(PathTo("file"), help="properties of wood, stems, fruit, leaves and wind")
    model: Path = value(PathTo("folder"), help="folder of the fruit, with its fruit.yaml")
    start: str = value(Text(), help="pose of the workspace in which the arm stands")
    distance: float = value(
        Measure(LENGTH, "300 mm", "3 m"), "680 mm", "of the trunk from the arm's axis, along -y"
    )
    stop: float = value(
        Measure(LENGTH, "-1 m", "1 m"), "0 mm", "of the base along the row, from its middle"
    )
    height: float = value(
        Measure(LENGTH, "-0.5 m", "0.5 m"), "0 mm", "of the base over its usual place"
    )
    apples: int | None = value(
        OrWord(Whole(1, 60), "auto"), "auto", "how many hang; auto draws from the numbers"
    )
    without: str = value(
        Text(pattern="none|[0-9]+(,[0-9]+)*", words="none, or numbers such as 3,7"),
        "none",
        "numbers of gone fruit",
    )
    leaves: float = value(Number(0.0, 1.0), "1", "share of the full foliage")
    behind: int = value(Whole(0, 5000), "2400", "leaves of the rows behind, which are only seen")
    wind: float = value(Number(0.0, 3.0), "0", "over the numbers' own strength; 0 is calm")
    skin: str = value(Text(*SKINS), "red", "of all fruit")
    friction: tuple[float, float] | None = value(
        OrWord(Span(Number(0.01, 5.0)), "auto"),
        "auto",
        f"sliding friction of the pads; 'auto' draws from {FRICTION}",
    )
    torsion: float = value(
        Measure(LENGTH, "0 mm", "100 mm"), "3 mm", "torsional friction of the pads over sliding"
    )

    def problems(self) -> Iterator[Problem]:
        try:
            read_robot(self.robot)
            read_limits(self.robot)
        except UnusableRobotFile as error:
            yield Problem("robot", str(error))
        try:
            read_numbers(self.numbers)
        except CellFileError as error:
            yield Problem("numbers", str(error))
        try:
            read_model(self.model)
        except UnusableModel as error:
            yield Problem("model", str(error))

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        poses = around.workspace.poses if around.workspace else {}
        if self.start not in poses:
            yield Problem("start", f"it cannot be '{self.start}'", choose(self.start, poses))

    def known(self) -> Iterator[object]:
        yield read_limits(self.robot)
        yield FruitKinds((self.model.name,))


@driver(FruitWallWorld, FruitWallOptions)
def connect_world(settings: Settings[FruitWallOptions], context: ConnectContext) -> FruitWallWorld:
    """`driver: fruit-wall`"""
    said, seed = settings.values, context.seed
    assert context.workspace is not None, "judged when the cell file was read"
    numbers, _ = read_numbers(said.numbers)
    drawn = draw_wall(numbers, seed, said.distance, said.apples, said.leaves)
    gone = {int(each) for each in said.without.split(",") if each != "none"}
    if max(gone, default=0) >= len(drawn.fruits):
        raise settings.error(
            f"the wall has the apples 0 to {len(drawn.fruits) - 1}, not {max(gone)}", "without"
        )
    wall = drawn.without(gone).seen_from(said.stop, said.height)
    spec = read_robot(said.robot)
    friction = float(np.random.default_rng([seed, 18]).uniform(*(said.friction or FRICTION)))
    for pad in PADS:
        spec.geom(pad).friction = [friction, said.torsion, 0.0001]
    shapes = wall_shapes(wall, said.model, said.skin)
    built = build_wall_model(
        wall, shapes, spec, context.workspace.obstacles, Scenery(wall, said.behind)
    )
    return FruitWallWorld(built, said.robot, context.workspace.poses[said.start], seed, said.wind)


def wall_shapes(wall: Wall, model: Path, skin: str) -> tuple[FruitShape, ...]:
    """Skins and meshes of a wall's fruit."""
    return tuple(
        make_fruit(
            model, fruit.dimensions, skin, np.random.default_rng([wall.seed, 5, fruit.number])
        )
        for fruit in wall.fruits
    )
