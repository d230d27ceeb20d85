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
NET = 3
FOUND = 1
FORCE = 2
TORQUE = 4
PLACE = 16
"""MuJoCo's contact sensors: one wrench for all contacts in the base frame, and their fields."""


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
    _add_sensors(mujoco, spec, len(fruits))
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


def _add_sensors(mujoco: Any, spec: Any, fruits: int) -> None:
    """Net contacts: pads and fruit with all, fruit with the belt, the robot with the belt, itself and fruit."""
    geom = mujoco.mjtObj.mjOBJ_GEOM
    body = mujoco.mjtObj.mjOBJ_BODY
    subtree = mujoco.mjtObj.mjOBJ_XBODY
    of_arm = {actuator.target for actuator in spec.actuators if actuator.name != "gripper"}
    arm = next(joint.parent.name for joint in spec.joints if joint.name in of_arm)

    def sensor(
        name: str, first: tuple[Any, str], other: tuple[Any, str] | None, fields: int
    ) -> None:
        kind, reference = other or (mujoco.mjtObj.mjOBJ_UNKNOWN, "")
        contact = spec.add_sensor(
            name=name, type=mujoco.mjtSensor.mjSENS_CONTACT, intprm=[fields, NET, 1]
        )
        contact.objtype, contact.objname, contact.reftype, contact.refname = *first, kind, reference

    for pad in PADS:
        sensor(f"wrench_{pad}", (geom, pad), None, FORCE | TORQUE | PLACE)
    sensor("robot_belt", (subtree, arm), (body, "belt"), FOUND | FORCE)
    sensor("robot_robot", (subtree, arm), (subtree, arm), FOUND | FORCE)
    for i in range(fruits):
        sensor(f"belt_{i}", (body, f"fruit_{i}"), (body, "belt"), FOUND | FORCE)
        sensor(f"all_{i}", (body, f"fruit_{i}"), None, FOUND | FORCE)
        sensor(f"robot_fruit_{i}", (subtree, arm), (body, f"fruit_{i}"), FOUND | FORCE)
        for pad in PADS:
            sensor(f"{pad}_fruit_{i}", (geom, pad), (body, f"fruit_{i}"), FOUND | FORCE)


def waiting_place(number: int) -> Float64:
    """Return x and y of a waiting fruit, shape (2,) [m]."""
    return np.array([SHELF[0] + APART * number, SHELF[1]])
