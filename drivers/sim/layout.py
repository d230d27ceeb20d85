"""What stands where in the simulated cell, as the cell file says and the seed draws."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.cell_file import Settings
from drivers.interfaces import Box, Float64
from drivers.sim.fruit_shape import APPLES, SKINS

FRICTION = (0.7, 0.9)
"""Sliding friction between pads and skin, drawn for each run."""


@dataclass(frozen=True, slots=True, eq=False)
class FruitOnTable:
    """One fruit: kind, size (d_x, d_y, d_z) [m], mass [kg], place on the table (x, y) [m], yaw and tilt of its stem,
    skin, and how far its shape is from a body of revolution, as a multiple of an ordinary apple's."""

    name: str
    model: Path
    dimensions: Float64
    mass: float
    place: int
    xy: Float64
    yaw: float
    tilt: float
    tilt_azimuth: float
    skin: str
    lumps: float


@dataclass(frozen=True, slots=True, eq=False)
class Distractor:
    """An object that is no fruit: shape box, ball or cylinder, half sizes [m], place (x, y) [m], colour RGB."""

    shape: str
    size: tuple[float, float, float]
    xy: Float64
    yaw: float
    colour: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """The whole table. The first fruit is the target.

    Attributes:
        robot: MJCF of the robot.
        table_z: height of the table's surface in the base frame [m].
        fruits, distractors: what stands on it.
        fixed: what the cell file's workspace says is fixed: the robot's pedestal, a crate.
        friction: sliding friction of the pads.
        torsion: torsional friction of the pads [m].
    """

    robot: Path
    table_z: float
    fruits: tuple[FruitOnTable, ...]
    distractors: tuple[Distractor, ...]
    fixed: tuple[Box, ...]
    friction: float
    torsion: float


def read_layout(settings: Settings, seed: int, fixed: tuple[Box, ...] = ()) -> Layout:
    """Read the `world:` section of a cell file and draw what it leaves to chance.

    Args:
        settings: the section.
        seed: of the draws.
        fixed: obstacles of the cell's workspace; the world has them too.

    Raises:
        CellFileError: a value is missing or wrong.
    """
    # One generator per matter, so that changing one option leaves what was drawn for the others.
    drawn = {matter: np.random.default_rng([seed, 1, i]) for i, matter in enumerate(("places", "scatter", "friction"))}
    rng = drawn["places"]
    kinds = settings.section("fruits")
    places = settings.section("places")
    spots = [places.vector(name, 2, "length") for name in places.names()]
    target = settings.choice("fruit", kinds.names())
    place = places.names().index(settings.choice("place", places.names()))
    others = settings.integer("others", 0, 0, len(spots) - 1)
    free = [i for i in rng.permutation(len(spots)) if i != place][:others]
    kind_of = {name: kinds.section(name).file("model") for name in kinds.names()}
    alike = [name for name in kinds.names() if name != target and kind_of[name] == kind_of[target]]
    names = alike or [target]  # what else lies there is fruit of the same kind
    picked = [target] + [names[i % len(names)] for i in rng.permutation(max(others, len(names)))[:others]]
    skin = settings.choice("skin", ("any", *SKINS), "any")
    automatic = settings.text("friction", "auto") == "auto"
    friction = FRICTION if automatic else settings.span("friction")
    mass = settings.number("mass", "mass", 0.0, 0.0, 5.0)
    tilt = settings.number("tilt", "angle", 0.1, 0.0, np.pi)
    jitter = settings.number("jitter", "length", 0.0, 0.0, 0.05)
    weight = settings.span("weight", default=(0.95, 1.10))
    spread = settings.number("spread", default=0.0, low=0.0, high=0.3)
    lumps = settings.number("lumps", default=1.0, low=0.0, high=3.0)
    fruits = []
    for i, (name, spot) in enumerate(zip(picked, [place, *free], strict=True)):
        kind = kinds.section(name)
        rng = np.random.default_rng([seed, 2, i])
        drawn_mass = kind.number("mass", "mass", low=1e-3) * rng.uniform(*weight)
        drawn_skin = kind.choice("skin", SKINS, str(rng.choice(APPLES)))
        model = kind.file("model")
        if not (model / "fruit.yaml").is_file():
            raise kind.error(f"{model} holds no fruit.yaml", "model")
        width, height = np.random.default_rng([seed, 6, i]).uniform(1.0 - spread, 1.0 + spread, 2)
        dimensions = kind.vector("dimensions", 3, "length") * (width, height, width)
        lies = kind.boolean("lies", False)
        kind.finish()
        fruits.append(
            FruitOnTable(
                name=name,
                model=model,
                dimensions=dimensions,
                mass=mass if i == 0 and mass > 0.0 else drawn_mass,
                place=int(spot) + 1,
                xy=spots[spot] + rng.uniform(-jitter, jitter, 2),
                yaw=rng.uniform(-np.pi, np.pi),
                tilt=rng.uniform(0.0, tilt) + (np.pi / 2.0 if lies else 0.0),
                tilt_azimuth=rng.uniform(-np.pi, np.pi),
                skin=skin if i == 0 and skin != "any" else drawn_skin,
                lumps=lumps,
            )
        )
    count = settings.integer("distractors", 0, 0, 20)
    return Layout(
        robot=settings.file("robot"),
        table_z=settings.number("table_z", "length"),
        fruits=tuple(fruits),
        distractors=_scatter(count, [fruit.xy for fruit in fruits], drawn["scatter"]),
        fixed=fixed,
        friction=float(drawn["friction"].uniform(*friction)),
        torsion=settings.number("torsion", "length", 0.003, 0.0, 0.1),
    )


def _scatter(count: int, taken: list[Float64], rng: np.random.Generator) -> tuple[Distractor, ...]:
    """Objects of fruitlike and unfruitlike colours, 150 mm and more away from fruit, the base, and each other."""
    taken = [*taken, np.zeros(2)]
    placed: list[Distractor] = []
    while len(placed) < count:
        xy = rng.uniform((-0.42, -0.68), (0.42, -0.15))
        clear = 0.15
        if all(np.hypot(*(xy - other)) > clear for other in taken):
            taken.append(xy)
            shape = str(rng.choice(["box", "ball", "cylinder"]))
            half = rng.uniform(0.012, 0.035, 3)
            fruitlike = rng.random() < 0.5
            colour = rng.uniform((0.5, 0.05, 0.05), (0.9, 0.6, 0.2)) if fruitlike else rng.uniform(0.05, 0.9, 3)
            placed.append(
                Distractor(
                    shape,
                    (float(half[0]), float(half[1]), float(half[2])),
                    xy,
                    rng.uniform(-np.pi, np.pi),
                    (float(colour[0]), float(colour[1]), float(colour[2])),
                )
            )
    return tuple(placed)
