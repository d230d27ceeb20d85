"""A conveyor as a MuJoCo model: the robot, a belt with rails, fruit on it and beside it, boxes.

The belt is a box that stands; MuJoCo's `surfacevel` carries its load (MuJoCo's changelog, 3.11). Fruit that is
not on the belt waits on a shelf behind the robot, which no camera sees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.applications.conveyor.conveyor import Belt
from pomona.drivers import Box
from pomona.executive import Float64
from pomona.tools.simulation import (
    PADS,
    TABLE_FRICTION,
    FruitOnTable,
    FruitShape,
    IntruderSection,
    add_contact_sensors,
    add_fixed,
    add_fruit,
    add_intruder,
    add_lights,
    add_material,
    load_mujoco,
    set_physics,
)

SHELF = (0.0, 1.6)  # place of the first waiting fruit, x and y in the base frame [m]
APART = 0.25  # distance of waiting fruit along x [m]
FLOOR = 0.75  # depth of the floor below the belt [m]
RAIL = 0.02  # height of a rail's box; its upper side lies 10 mm below the surface, so that it guides nothing [m]


@dataclass(frozen=True, slots=True, eq=False)
class BeltModel:
    """The compiled model. Fruit bodies are named fruit_0, fruit_1, …"""

    model: Any
    belt: Belt
    fruits: tuple[FruitOnTable, ...]
    shapes: tuple[FruitShape, ...]
    fixed: tuple[Box, ...]
    intruder: IntruderSection | None


def build_belt_model(
    spec: Any,
    belt: Belt,
    fruits: Sequence[FruitOnTable],
    shapes: Sequence[FruitShape],
    fixed: tuple[Box, ...],
    seed: int,
    intruder: IntruderSection | None = None,
) -> BeltModel:
    """Compile a belt before a robot.

    Args:
        spec: the robot's, which is added to.
        fixed: boxes around the robot: its pedestal, the crates.
        intruder: a person's hand that comes, or None.
    """
    mujoco = load_mujoco()
    rng = np.random.default_rng([seed, 2])
    set_physics(mujoco, spec)
    add_lights(spec, rng)
    add_fixed(mujoco, spec, fixed)
    _add_belt(mujoco, spec, belt, rng)
    for i, (fruit, shape) in enumerate(zip(fruits, shapes, strict=True)):
        add_fruit(mujoco, spec, f"fruit_{i}", fruit, shape, belt.top)
    if intruder is not None:
        add_intruder(mujoco, spec)
    bodies = [f"fruit_{i}" for i in range(len(fruits))]
    others = {f"belt_{i}": (body, "belt") for i, body in enumerate(bodies)}
    others |= {f"{pad}_{body}": (pad, body) for pad in PADS for body in bodies}
    add_contact_sensors(mujoco, spec, ["belt", *bodies], others)
    return BeltModel(spec.compile(), belt, tuple(fruits), tuple(shapes), fixed, intruder)


def _add_belt(mujoco: Any, spec: Any, belt: Belt, rng: np.random.Generator) -> None:
    box = mujoco.mjtGeom.mjGEOM_BOX
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    touch = {"contype": 1, "conaffinity": 3}
    speckled = np.array([0.20, 0.22, 0.22]) * rng.uniform(0.7, 1.6)
    picture = speckled * (1.0 + 0.15 * rng.normal(size=(256, 256)))[..., None]
    add_material(mujoco, spec, "belt", np.clip(picture, 0.0, 1.0), (20.0, 1.0))
    place = belt.T_base_belt[:3, 3]
    world = spec.worldbody
    turn = np.zeros(4)
    mujoco.mju_mat2Quat(turn, belt.T_base_belt[:3, :3].ravel())
    body = world.add_body(name="belt", pos=place, quat=turn)
    size = [belt.length / 2.0, belt.width / 2.0, 0.02]
    rough = {"condim": 6, "friction": TABLE_FRICTION}
    surface = body.add_geom(
        name="belt", type=box, pos=[0.0, 0.0, -0.02], size=size, material="belt", **touch, **rough
    )
    surface.surfacevel = [
        1.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    ]  # a model compiled without one never carries
    for side in (-1.0, 1.0):
        beside = [0.0, side * (belt.width / 2.0 + RAIL), -0.01 - RAIL / 2.0]
        rail = [belt.length / 2.0, 0.9 * RAIL, RAIL / 2.0]
        body.add_geom(type=box, pos=beside, size=rail, rgba=[0.5, 0.5, 0.52, 1.0], **touch)
    floor = world.add_geom(
        name="floor", type=plane, pos=[0.0, 0.0, belt.top - FLOOR], size=[3.0, 3.0, 0.1], **touch
    )
    floor.rgba = [0.3, 0.29, 0.28, 1.0]
    shelf = world.add_body(name="shelf", pos=[SHELF[0] + 1.0, SHELF[1], belt.top - 0.02])
    shelf.add_geom(type=box, size=[2.0, 0.3, 0.02], condim=6, friction=(0.8, 0.02, 0.01), **touch)


def waiting_place(number: int) -> Float64:
    """Return x and y of a waiting fruit, shape (2,) [m]."""
    return np.array([SHELF[0] + APART * number, SHELF[1]])
