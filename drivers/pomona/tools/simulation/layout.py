"""Positions of all objects in the simulated cell, from the cell file and the seed; fruit that touches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from pomona.drivers.errors import UnusableRobotFile
from pomona.drivers.interfaces import Box, FruitKinds
from pomona.drivers.robot_file import read_limits, read_spec
from pomona.executive.cell.registration import Surroundings
from pomona.executive.values.arrays import Float64
from pomona.executive.values.kinds import (
    Flag,
    MappingOf,
    Measure,
    Number,
    OrWord,
    PathTo,
    Row,
    Span,
    Text,
    Whole,
    choose,
)
from pomona.executive.values.sections import Problem, Section, value
from pomona.executive.values.units import ANGLE, LENGTH, MASS
from pomona.tools.simulation.fruit_shape import (
    APPLES,
    SKINS,
    FruitShape,
    UnusableModel,
    make_fruit,
    read_model,
)
from pomona.tools.simulation.gl import load_mujoco
from pomona.tools.simulation.intruder import IntruderSection

SOURCE = "source"  # name of the crate in the workspace from which fruit is taken
PULLED = 1.5  # duration of the pull to a wall [s]
PULL = 0.5  # horizontal pull on a fruit, of its weight: apples roll
AT_WALL = 0.7  # probability that a drawn fruit is drawn along x, and the same along y
LANDED = 5.0  # time in which fruit of the upper layer comes to rest, at most [s]
STILL = 0.02  # largest speed of fruit at rest [m/s, rad/s]
ROOM = 0.009  # floor of a crate for each fruit [m²]: 400 × 300 mm hold 12; with a second layer half as many more
HEAP = 0.03  # distance from the middle of a heap within which fruit begins, before it is pushed apart [m]


@dataclass(frozen=True, slots=True, eq=False)
class Gathering:
    """Where fruit is brought together."""

    T_base_floor: Float64  # middle of the surface below the fruit, (4, 4)
    inside: (
        Float64 | None
    )  # half of the crate's inside along x and y, (2,) [m]; None for a heap on the table
    layers: int = 1  # with 2, a third of the fruit falls on the others


def crate_of(fixed: tuple[Box, ...]) -> Gathering | None:
    """Return the inside of the crate `SOURCE` among fixed obstacles; None without one."""
    boxes = [box for box in fixed if box.name == SOURCE]
    if len(boxes) < 2:
        return None
    floor = boxes[0]
    wall = min(min(box.half_extents) for box in boxes[1:])
    T_base_floor = floor.T_base_box.copy()
    T_base_floor[:3, 3] += T_base_floor[:3, 2] * floor.half_extents[2]
    return Gathering(T_base_floor, np.array(floor.half_extents[:2]) - 2.0 * wall)


def gather(mujoco: Any, model: Any, state: Any, sizes: Float64, how: Gathering, seed: int) -> None:
    """Bring the bodies fruit_0, fruit_1 … together; in a crate half of them are drawn to its walls.

    Args:
        sizes: width and height of each fruit, shape (n, 2) [m].
    """
    rng = np.random.default_rng([seed, 7])
    bodies = [model.body(f"fruit_{i}").id for i in range(len(sizes))]
    radii = sizes[:, 0] / 2.0
    T = how.T_base_floor
    limits = np.full((len(sizes), 2), np.inf) if how.inside is None else how.inside - radii[:, None]
    lower = len(sizes) - (len(sizes) // 3 if how.layers == 2 else 0)
    layers = [_apart(radii[part], limits[part], rng) for part in (slice(lower), slice(lower, None))]
    spots = np.vstack(layers)
    bottoms = np.full(len(sizes), 0.003)
    bottoms[lower:] += sizes[:lower, 1].max()
    for body, spot, bottom, height in zip(bodies, spots, bottoms, sizes[:, 1], strict=True):
        address = model.jnt_qposadr[model.body_jntadr[body]]
        state.qpos[address : address + 3] = T[:3, :3] @ [*spot, height / 2.0 + bottom] + T[:3, 3]
    for k in range(round(LANDED / model.opt.timestep) if lower < len(sizes) else 0):
        mujoco.mj_step(model, state)
        if (
            k % 100 == 99
            and np.abs(state.qvel[model.body_dofadr[bodies][:, None] + range(6)]).max() < STILL
        ):
            break
    if how.inside is None:
        return
    sides = rng.choice([-1.0, 1.0], (len(sizes), 2)) * (rng.random((len(sizes), 2)) < AT_WALL)
    sides[rng.permutation(len(sizes))[max(2, len(sizes) // 2) :]] = 0.0
    pull = PULL * float(np.linalg.norm(model.opt.gravity)) * model.body_mass[bodies]
    for _ in range(round(PULLED / model.opt.timestep)):
        state.xfrc_applied[bodies, :3] = pull[:, None] * (sides @ T[:3, :2].T)
        mujoco.mj_step(model, state)
    state.xfrc_applied[:] = 0.0


def _apart(radii: Float64, limits: Float64, rng: np.random.Generator) -> Float64:
    """Return places of circles that do not overlap, as far as there is room, each within ± its limits (n, 2) [m]."""
    spots = rng.uniform(-1.0, 1.0, limits.shape) * np.where(np.isinf(limits), HEAP, limits)
    for _ in range(2000):
        between = spots[:, None] - spots[None]
        distance = np.linalg.norm(between, axis=2) + 1e-9
        overlap = np.maximum(1.01 * (radii[:, None] + radii[None]) - distance, 0.0)
        np.fill_diagonal(overlap, 0.0)
        if not overlap.any():
            break
        shift = (between / distance[..., None] * (0.25 * overlap[..., None])).sum(axis=1)
        spots = np.clip(spots + shift, -limits, limits)
    return spots


PADS = ("pad_left", "pad_right")
FINGERS = ("finger_left", "finger_right")
NEEDED = {
    "site": ("tcp", "camera", *PADS),
    "geom": PADS,
    "joint": FINGERS,
    "actuator": ("gripper",),
    "numeric": ("arm_velocity", "arm_acceleration", "arm_jerk"),
}
"""Required parts of a robot's file, in addition to its arm's joints with an actuator each."""


def read_robot(path: Path) -> Any:
    """Return it as an `mujoco.MjSpec`. Raises UnusableRobotFile: it cannot be read, or lacks something in `NEEDED`."""
    load_mujoco()  # before the reader does: both renderers must work in one process
    spec = read_spec(path)
    for kind, names in NEEDED.items():
        for name in names:
            if getattr(spec, kind)(name) is None:
                there = f"; a simulated cell needs {', '.join(names)}" if len(names) > 1 else ""
                raise UnusableRobotFile(path, f"has no {kind} named '{name}'{there}")
    return spec


def sag(path: Path, q: Float64) -> float:
    """Return how far the drives give way to the arm's weight in a posture, (dof,) [rad], at most [rad]."""
    model = read_robot(path).compile()
    state = load_mujoco().MjData(model)
    arm = [i for i in range(model.nu) if model.actuator(i).name != "gripper"]
    state.qpos[model.jnt_qposadr[np.sort(model.actuator_trnid[arm, 0])]] = q
    load_mujoco().mj_forward(model, state)
    pull = (state.qfrc_bias - state.qfrc_passive)[model.jnt_dofadr[model.actuator_trnid[arm, 0]]]
    stiffness = -model.actuator_biasprm[arm, 1]  # of a position drive; 0 for a motor
    return float(np.abs(pull[stiffness > 0.0] / stiffness[stiffness > 0.0]).max(initial=0.0))


FRICTION = (0.7, 0.9)  # sliding friction between pads and skin, drawn for each run


@dataclass(frozen=True, slots=True)
class PadTruth:
    """The pads of a simulated hand."""

    friction: float  # sliding friction on fruit
    torsion: float  # torsional friction [m]
    spring: float  # stiffness beside that in the robot's file

    def put(self, spec: Any) -> None:
        """Give them to the robot in a world that is built; a pad's joint has its name."""
        for pad in PADS:
            spec.geom(pad).friction = [self.friction, self.torsion, 0.0001]
        for joint in spec.joints:
            if joint.name in PADS:
                joint.stiffness *= self.spring
                joint.damping *= np.sqrt(self.spring)


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
    shape_noise: float
    centre: Float64  # of its mass, from its middle, (3,) [m]

    def shape(self, seed: int, number: int) -> FruitShape:
        """Draw its shape as the fruit of this number in a run."""
        rng = np.random.default_rng([seed, 5, number])
        return make_fruit(self.model, self.dimensions, self.skin, rng, self.shape_noise)


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
    """The whole table. The first fruit is the target."""

    robot: Path  # MJCF of the robot
    table_z: float  # height of the table's surface in the base frame [m]
    fruits: tuple[FruitOnTable, ...]  # fruits, distractors: the objects on it
    distractors: tuple[Distractor, ...]
    fixed: tuple[
        Box, ...
    ]  # fixed obstacles of the cell file's workspace: the robot's pedestal, a crate
    pads: PadTruth
    intruder: IntruderSection | None = None  # a person's hand that comes into the cell, or None
    # where fruit is brought together before the run; None: each at its place
    gathering: Gathering | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CellFruitSection:
    """A fruit that may lie on the table."""

    model: Path = value(PathTo("folder"), help="folder with its fruit.yaml")
    dimensions: tuple[float, ...] = value(
        Row(Measure(LENGTH, "1 mm", "1 m"), 3), help="width, height, depth"
    )
    mass: float = value(Measure(MASS, "1 g", "5 kg"), help="its own; `weight` varies it")
    skin: str | None = value(Text(*SKINS), None, "how it looks; drawn without one")
    lies: bool = value(Flag(), False, "on its side, as a lemon does")

    def problems(self) -> Iterator[Problem]:
        try:
            read_model(self.model)
        except UnusableModel as error:
            yield Problem("model", str(error))


@dataclass(frozen=True, kw_only=True)
class DrawnOptions:
    """What every simulated world draws for a run: fruit and pads as they are, which no robot is told."""

    robot: Path = value(PathTo("file"), help="MJCF of the robot")
    friction: tuple[float, float] | None = value(
        OrWord(Span(Number(0.01, 5.0)), "auto"),
        "auto",
        f"sliding friction of the pads; 'auto' draws from {FRICTION}",
    )
    torsion: tuple[float, float] = value(
        Span(Measure(LENGTH, "0 mm", "100 mm")),
        "3 mm",
        "of the pads: their largest moment over the force that presses them",
    )
    spring: tuple[float, float] = value(
        Span(Number(0.1, 10.0)), "1", "stiffness of the pads beside that in the robot's file"
    )
    weight: tuple[float, float] = value(
        Span(Number(0.1, 10.0)), "0.95..1.10", "mass of a fruit beside its kind's"
    )
    centre: tuple[float, float] = value(
        Span(Measure(LENGTH, "0 mm", "20 mm")),
        "0 mm",
        "distance of a fruit's centre of mass from its middle, in any direction",
    )
    shape_noise: float = value(
        Number(0.0, 3.0), "1", "how uneven the shape is; 0 gives the CAD model's form"
    )
    intruder: IntruderSection | None = value(
        Section(IntruderSection), None, "a person's hand that comes into the cell"
    )

    def draw_pads(self, rng: np.random.Generator) -> PadTruth:
        """Draw the pads of a run."""
        friction = rng.uniform(*(self.friction or FRICTION))
        return PadTruth(friction, rng.uniform(*self.torsion), rng.uniform(*self.spring))

    def draw_centre(self, rng: np.random.Generator) -> Float64:
        """Draw the centre of mass of a fruit, from its middle, (3,) [m]."""
        way = rng.normal(size=3)
        return rng.uniform(*self.centre) / np.linalg.norm(way) * way


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldOptions(DrawnOptions):
    """MuJoCo's world: a robot, a table, and the objects on it."""

    table_z: float = value(Measure(LENGTH), help="height of the table's surface in the base frame")
    start: str = value(Text(), help="pose of the workspace in which the arm stands")
    fruits: Mapping[str, CellFruitSection] = value(
        MappingOf(Section(CellFruitSection)), help="fruit for the table"
    )
    places: Mapping[str, tuple[float, ...]] = value(
        MappingOf(Row(Measure(LENGTH), 2)), help="where it may lie: x, y in the base frame"
    )
    fruit: str = value(Text(), help="which fruit to pick")
    place: str = value(Text(), help="where it lies")
    others: int = value(Whole(0, 100), "0", "how many other fruits lie at the other places")
    distractors: int = value(Whole(0, 20), "0", "objects that are no fruit")
    skin: str = value(Text("any", *SKINS), "any", "of the target; 'any' draws one")
    mass: float | None = value(
        OrWord(Measure(MASS, "1 g", "5 kg"), "auto"), "auto", "of the target; 'auto' draws one"
    )
    spread: float = value(
        Number(0.0, 0.3), "0", "width and height differ from the kind's by up to this share"
    )
    tilt: float = value(Measure(ANGLE, "0 rad", "180 deg"), "0.1 rad", "largest tilt of a stem")
    jitter: float = value(Measure(LENGTH, "0 mm", "50 mm"), "0 mm", "of a place, in x and y")
    fruits_at: str = value(
        Text("places", "heap", "crate"),
        "places",
        f"where the fruit is: at its places, pulled together among them, or in the crate '{SOURCE}' of the workspace",
    )
    layers: int = value(
        Whole(1, 2), "1", "with 2, a third of the fruit of a heap or a crate falls on the others"
    )
    source_off: tuple[float, ...] = value(
        Row(Measure(LENGTH, "-100 mm", "100 mm"), 2),
        "0 0 mm",
        f"how far the crate '{SOURCE}' stands from its place in the workspace",
    )

    def problems(self) -> Iterator[Problem]:
        for key, word, known in (
            ("fruit", self.fruit, self.fruits),
            ("place", self.place, self.places),
        ):
            if word not in known:
                yield Problem(key, f"it cannot be '{word}'", choose(word, known))
        if self.fruits_at == "places" and self.others > len(self.places) - 1:
            yield Problem(
                "others", f"it is {self.others}, but must be between 0 and {len(self.places) - 1}"
            )
        try:
            read_robot(self.robot)
            read_limits(self.robot)
        except UnusableRobotFile as error:
            yield Problem("robot", str(error))

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        poses = around.workspace.poses if around.workspace else {}
        if self.start not in poses:
            yield Problem("start", f"it cannot be '{self.start}'", choose(self.start, poses))
        elif (
            len(q := poses[self.start]) == len(read_limits(self.robot).lower)
            and (way := sag(self.robot, q)) > 1e-3
        ):
            yield Problem(
                "robot",
                f"its drives give way by {way:.4f} rad to the arm's weight: its motions do not come to rest",
                'write gravcomp="1" on each of its bodies',
            )
        if self.fruits_at == "crate":
            obstacles = () if around.workspace is None else around.workspace.obstacles
            crate = crate_of(obstacles)
            near = get_close_matches(SOURCE, {box.name for box in obstacles}, 1)
            if crate is None:
                hint = f"name: {SOURCE}, wall: 8 mm" + (
                    f" in the obstacle '{near[0]}'" if near else ""
                )
                yield Problem("fruits_at", f"the workspace has no crate '{SOURCE}'", hint)
            elif self.others >= (
                holds := int((2 * self.layers + 2) * np.array(crate.inside).prod() / ROOM)
            ):
                yield Problem(
                    "others", f"the crate holds {holds} fruit in all, not {self.others + 1}"
                )

    def known(self) -> Iterator[object]:
        yield read_limits(self.robot)
        yield FruitKinds((self.fruits[self.fruit].model.name,))


def draw_layout(said: WorldOptions, seed: int, fixed: tuple[Box, ...] = ()) -> Layout:
    """Draw the random parts of the `world:` section of a cell file.

    Args:
        fixed: obstacles of the cell's workspace; the world has them too.
    """
    fixed = tuple(_shifted(box, said.source_off) if box.name == SOURCE else box for box in fixed)
    # One generator per subject, so that a changed option keeps the draws of the others.
    drawn = {
        matter: np.random.default_rng([seed, 1, i])
        for i, matter in enumerate(("places", "scatter", "friction", "centre"))
    }
    rng = drawn["places"]
    spots = [np.array(xy) for xy in said.places.values()]
    gathering = None
    place = list(said.places).index(said.place)
    if said.fruits_at != "places":
        middle = np.eye(4)
        middle[:3, 3] = [*np.mean(spots, axis=0), said.table_z]
        gathering = crate_of(fixed) if said.fruits_at == "crate" else Gathering(middle, None)
        gathering = None if gathering is None else replace(gathering, layers=said.layers)
        spots = [middle[:2, 3]] * (said.others + 1)
        place = 0
    free = [i for i in rng.permutation(len(spots)) if i != place][: said.others]
    target = said.fruits[said.fruit]
    alike = [
        name
        for name, kind in said.fruits.items()
        if name != said.fruit and kind.model == target.model
    ]
    names = alike or [said.fruit]  # the other fruit are of the same kind
    picked = [said.fruit] + [
        names[i % len(names)] for i in rng.permutation(max(said.others, len(names)))[: said.others]
    ]
    fruits = []
    for i, (name, spot) in enumerate(zip(picked, [place, *free], strict=True)):
        kind = said.fruits[name]
        rng = np.random.default_rng([seed, 2, i])
        drawn_mass = kind.mass * rng.uniform(*said.weight)
        skin = str(rng.choice(APPLES))  # drawn for every fruit, so that later draws stay the same
        width, height = np.random.default_rng([seed, 6, i]).uniform(
            1.0 - said.spread, 1.0 + said.spread, 2
        )
        fruits.append(
            FruitOnTable(
                name=name,
                model=kind.model,
                dimensions=np.array(kind.dimensions) * (width, height, width),
                mass=said.mass if i == 0 and said.mass is not None else drawn_mass,
                place=int(spot) + 1,
                xy=spots[spot] + rng.uniform(-said.jitter, said.jitter, 2),
                yaw=rng.uniform(-np.pi, np.pi),
                tilt=rng.uniform(0.0, said.tilt) + (np.pi / 2.0 if kind.lies else 0.0),
                tilt_azimuth=rng.uniform(-np.pi, np.pi),
                skin=said.skin if i == 0 and said.skin != "any" else kind.skin or skin,
                shape_noise=said.shape_noise,
                centre=said.draw_centre(drawn["centre"]),
            )
        )
    return Layout(
        robot=said.robot,
        table_z=said.table_z,
        fruits=tuple(fruits),
        distractors=_scatter(said.distractors, [fruit.xy for fruit in fruits], drawn["scatter"]),
        fixed=fixed,
        pads=said.draw_pads(drawn["friction"]),
        intruder=said.intruder,
        gathering=gathering,
    )


def _shifted(box: Box, off: tuple[float, ...]) -> Box:
    T_base_box = box.T_base_box.copy()
    T_base_box[:2, 3] += off
    return replace(box, T_base_box=T_base_box)


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
            x, y, z = rng.uniform(0.012, 0.035, 3).tolist()
            alike = rng.random() < 0.5
            r, g, b = rng.uniform(
                (0.5, 0.05, 0.05) if alike else 0.05, (0.9, 0.6, 0.2) if alike else 0.9, 3
            ).tolist()
            placed.append(Distractor(shape, (x, y, z), xy, rng.uniform(-np.pi, np.pi), (r, g, b)))
    return tuple(placed)
