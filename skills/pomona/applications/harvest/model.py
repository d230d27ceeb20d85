"""A fruit wall as a MuJoCo model, around a robot or alone.

Wood: hinge chains of `wood.hinge_chain`. A stem: three stiff slides and a ball joint where it sits on the spur; stem
and fruit are one body, and the break sets these joints' stiffness and damping to zero. A leaf: a plate on one hinge.
The springs of bending parts are set so that the drawn shape is the equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.applications.harvest.scenery import Scenery, leaf_mesh
from pomona.applications.harvest.wall import SEGMENTS, STEM_SEAT, HangingFruit, TreeLeaf, Wall
from pomona.applications.harvest.wood import Chain, hinge_chain, spur_stiffness
from pomona.drivers import Box
from pomona.executive import Float64
from pomona.tools.simulation import (
    PADS,
    FruitShape,
    add_fixed,
    add_lights,
    add_material,
    load_mujoco,
    quaternion,
    set_physics,
)

Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

WOOD_CONTACT = {"solref": (0.004, 1.0), "solimp": (0.99, 0.999, 0.001, 0.5, 2.0), "priority": 1}
"""With the engine's defaults a bar passed through a light branch at 10 N."""
FRUIT_CONTACT = {"solref": (0.006, 1.0), "solimp": (0.95, 0.99, 0.001, 0.5, 2.0)}
ROBOT, FRUIT = 2, 1
"""Collision bits: wood and wires collide with both, leaves with the robot alone."""
BARK = (0.36, 0.27, 0.20, 1.0)
LEAF_THICKNESS = 3e-3
"""Thickness of a leaf for contacts with the hand [m]; thinner plates would pass through it in one step."""
LEAF_SIZES = 4
"""Meshes that leaves share."""


@dataclass(frozen=True, slots=True, eq=False)
class WallModel:
    """The compiled model and where things are in it. Arrays have a row a fruit, a lateral or a leaf.

    Attributes:
        fruit_bodies, fruit_geoms: shape (n,).
        stretch, swing: first degree of freedom of a fruit's slides and of its ball joint, shape (n,).
        rest_moment: of the ball joints, in the fruit's frame, in which the stem grew, shape (n, 3) [N·m].
        strengths: pull, twist, bend, tear, shape (n, 4).
        lateral_dofs: of each lateral's hinges, shape (laterals, 2·SEGMENTS).
        leaf_dofs: of the leaves' hinges.
        wooden: whether a geom is wood, wired: whether it is a wire, robotic: whether it belongs to the robot.
    """

    wall: Wall
    model: Any
    shapes: tuple[FruitShape, ...]
    fixed: tuple[Box, ...]
    fruit_bodies: Index
    fruit_geoms: Index
    stretch: Index
    swing: Index
    rest_moment: Float64
    strengths: Float64
    lateral_dofs: Index
    leaf_dofs: Index
    lateral_of_geom: Index
    wooden: Flags
    wired: Flags
    robotic: Flags


@dataclass(slots=True)
class _Building:
    """State shared by the parts of the model."""

    mujoco: Any
    spec: Any
    wall: Wall
    trunk: Any
    laterals: list[tuple[Chain, list[Any], Float64]] = field(default_factory=list)
    spurs: list[tuple[Any, Float64]] = field(default_factory=list)


def build_wall_model(
    wall: Wall,
    shapes: tuple[FruitShape, ...],
    spec: Any = None,
    fixed: tuple[Box, ...] = (),
    scenery: Scenery | None = None,
) -> WallModel:
    """Compile a wall.

    Args:
        shapes: of its fruit.
        spec: of the robot that stands before it, which is added to; without one the wall is alone.
        fixed: boxes around the robot: its pedestal, the bin.
        scenery: visible objects without contacts: neighbours' foliage, the sky.
    """
    mujoco = load_mujoco()
    alone = spec is None
    spec = mujoco.MjSpec() if alone else spec
    set_physics(mujoco, spec)
    spec.memory = 96 << 20
    add_lights(spec, np.random.default_rng([wall.seed, 14]))
    add_fixed(mujoco, spec, fixed)
    trunk = _add_trunk(mujoco, spec, wall)
    building = _Building(mujoco, spec, wall, trunk)
    for i in range(len(wall.laterals)):
        _add_lateral(building, i)
    for i in range(len(wall.spurs)):
        _add_spur(building, i)
    for fruit, shape in zip(wall.fruits, shapes, strict=True):
        _add_fruit(building, fruit, shape)
    _add_leaves(building)
    if scenery is not None:
        scenery.add_to(mujoco, spec)
    if not alone:
        _add_pad_sensors(mujoco, spec)
    return _finished(mujoco, spec.compile(), wall, shapes, fixed)


def _add_trunk(mujoco: Any, spec: Any, wall: Wall) -> Any:
    """Trunk, wires and ground. A wire gives way across its line, whole, as a stretched one does at its middle."""
    x, y, radius = wall.trunk
    ground = spec.worldbody.add_geom(
        name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, pos=[0.0, 0.0, wall.ground]
    )
    ground.size, ground.rgba, ground.contype, ground.conaffinity = (
        [4.0, 4.0, 0.1],
        [0.25, 0.30, 0.14, 1.0],
        1,
        3,
    )
    trunk = spec.worldbody.add_body(name="trunk")
    _capsule(
        trunk,
        "trunk",
        [x, y, wall.ground],
        [x, y, wall.trunk_top],
        radius,
        wall.numbers.wood_friction,
    )
    numbers = wall.numbers
    damping = 2.0 * numbers.wood_damping * np.sqrt(numbers.wire_stiffness * numbers.wire_mass)
    for i, wire in enumerate(wall.wires):
        body = spec.worldbody.add_body(name=f"trellis_{i}", pos=[0.0, wire.y, wire.z], gravcomp=1.0)
        for axis, direction in (("y", [0.0, 1.0, 0.0]), ("z", [0.0, 0.0, 1.0])):
            joint = body.add_joint(
                name=f"trellis_{i}_{axis}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction
            )
            joint.stiffness[0], joint.damping[0] = numbers.wire_stiffness, damping
        radius = numbers.wire_diameter / 2.0
        rod = _capsule(
            body, f"wire_{i}", [-1.5, 0.0, 0.0], [1.5, 0.0, 0.0], radius, 0.3, numbers.wire_mass
        )
        rod.rgba = [0.55, 0.55, 0.56, 1.0]
    return trunk


def _capsule(
    body: Any, name: str, start: Any, end: Any, radius: float, friction: float, mass: float = 0.0
) -> Any:
    """Return a piece of wood that touches robot and fruit."""
    geom = body.add_geom(
        name=name, type=load_mujoco().mjtGeom.mjGEOM_CAPSULE, fromto=[*start, *end], rgba=BARK
    )
    geom.size = [radius, 0.0, 0.0]
    geom.mass, geom.contype, geom.conaffinity, geom.condim = mass, 0, ROBOT | FRUIT, 3
    geom.friction = [friction, 0.005, 0.0005]
    for key, value in WOOD_CONTACT.items():
        setattr(geom, key, value)
    return geom


def _hinges(body: Any, name: str, stiffness: float, damping: float, armature: float) -> None:
    """A pair, across the body's x axis."""
    for axis, direction in (("y", [0.0, 1.0, 0.0]), ("z", [0.0, 0.0, 1.0])):
        joint = body.add_joint(
            name=f"{name}_{axis}", type=load_mujoco().mjtJoint.mjJNT_HINGE, axis=direction
        )
        joint.stiffness[0], joint.damping[0], joint.armature = stiffness, damping, armature


def _add_lateral(building: _Building, i: int) -> None:
    """A chain of bodies; each begins at its hinges, the last ends at the tip."""
    wall, lateral = building.wall, building.wall.laterals[i]
    numbers = wall.numbers
    chain = hinge_chain(lateral.length, lateral.diameters, numbers.wood_modulus, SEGMENTS)
    damping = 2.0 * numbers.wood_damping / _loaded_frequency(wall, i, chain)
    R = _along(lateral.direction)
    ends = [*chain.hinges[1:], lateral.length]
    body, at, bodies = building.trunk, lateral.start + chain.hinges[0] * lateral.direction, []
    name = f"lateral_{i}"
    _capsule(
        building.trunk,
        f"{name}_stub",
        lateral.start,
        at,
        lateral.diameters[0] / 2.0,
        numbers.wood_friction,
    )
    for k, (begin, end) in enumerate(zip(chain.hinges, ends, strict=True)):
        turned = _quat(building, R) if k == 0 else [1.0, 0.0, 0.0, 0.0]
        body = body.add_body(
            name=f"{name}_{k}",
            pos=at if k == 0 else [chain.hinges[1] - chain.hinges[0], 0, 0],
            quat=turned,
        )
        _hinges(
            body,
            f"{name}_{k}",
            chain.stiffness[k],
            damping * chain.stiffness[k],
            numbers.hinge_armature,
        )
        radius = float(chain.diameter((begin + end) / 2.0)) / 2.0
        mass = chain.mass(numbers.wood_density, begin, end)
        _capsule(
            body, f"{name}_{k}", [0, 0, 0], [end - begin, 0, 0], radius, numbers.wood_friction, mass
        )
        bodies.append(body)
    building.laterals.append((chain, bodies, R))


def _loaded_frequency(wall: Wall, i: int, chain: Chain) -> float:
    """Of a lateral's first mode with its fruit and its own weight [rad/s]."""
    middles = np.linspace(0.05, 1.0, 12) * chain.length
    own = [
        chain.mass(wall.numbers.wood_density, s - chain.length / 24.0, s + chain.length / 24.0)
        for s in middles
    ]
    hung = [
        (wall.spurs[each.spur].s, each.mass)
        for each in wall.fruits
        if wall.spurs[each.spur].lateral == i
    ]
    at = np.array([*middles, *(s for s, _ in hung)])
    return chain.first_frequency(at, np.array([*own, *(mass for _, mass in hung)]))


def _on_lateral(building: _Building, lateral: int, s: float) -> tuple[Any, Float64, Float64]:
    """The body that carries a point of a lateral, the point in its frame, and the frame's rotation in the base."""
    chain, bodies, R = building.laterals[lateral]
    k = int(np.searchsorted(chain.hinges, s)) - 1
    if k < 0:
        place = building.wall.laterals[lateral]
        return building.trunk, place.start + s * place.direction, np.eye(3)
    return bodies[k], np.array([s - chain.hinges[k], 0.0, 0.0]), R


def _add_spur(building: _Building, i: int) -> None:
    spur, numbers = building.wall.spurs[i], building.wall.numbers
    parent, at, R = _on_lateral(building, spur.lateral, spur.s)
    R_spur = _along(spur.direction)
    body = parent.add_body(name=f"spur_{i}", pos=at, quat=_quat(building, R.T @ R_spur))
    stiffness = spur_stiffness(spur.length, spur.diameter, numbers.wood_modulus)
    mass = numbers.wood_density * np.pi / 4.0 * spur.diameter**2 * spur.length
    load = sum(each.mass for each in building.wall.fruits if each.spur == i) or mass
    damping = 2.0 * numbers.wood_damping * np.sqrt(stiffness * load) * spur.length
    _hinges(body, f"spur_{i}", stiffness, damping, numbers.hinge_armature)
    _capsule(
        body,
        f"spur_{i}",
        [0, 0, 0],
        [spur.length, 0, 0],
        spur.diameter / 2.0,
        numbers.wood_friction,
        mass,
    )
    building.spurs.append((body, R_spur))


def _add_fruit(building: _Building, fruit: HangingFruit, shape: FruitShape) -> None:
    mujoco, spec, numbers, name = (
        building.mujoco,
        building.spec,
        building.wall.numbers,
        f"fruit_{fruit.number}",
    )
    mesh = spec.add_mesh(name=name)
    mesh.uservert, mesh.userface = shape.vertices.ravel(), shape.faces.ravel()
    mesh.usertexcoord, mesh.userfacetexcoord = shape.uv.ravel(), shape.faces.ravel()
    add_material(mujoco, spec, name, shape.texture / 255.0, (1.0, 1.0))
    parent, R_spur = building.spurs[fruit.spur]
    spur, T = building.wall.spurs[fruit.spur], fruit.T_base_fruit
    at = R_spur.T @ (T[:3, 3] - spur.start)
    body = parent.add_body(name=name, pos=at, quat=_quat(building, R_spur.T @ T[:3, :3]))
    anchor = [0.0, -fruit.lever, 0.0]
    inertia = 0.4 * fruit.mass * fruit.radius**2 + fruit.mass * fruit.lever**2
    for axis, direction in (("x", [1.0, 0, 0]), ("z", [0, 0, 1.0]), ("y", [0, 1.0, 0])):
        slide = body.add_joint(
            name=f"{name}_{axis}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction, pos=anchor
        )
        slide.stiffness[0] = numbers.stem_stretch
        slide.damping[0] = (
            2.0 * numbers.stem_stretch_damping * np.sqrt(numbers.stem_stretch * fruit.mass)
        )
    ball = body.add_joint(name=f"{name}_ball", type=mujoco.mjtJoint.mjJNT_BALL, pos=anchor)
    k = fruit.strength.stiffness
    ball.stiffness[0] = k
    ball.damping[0] = (
        2.0 * numbers.stem_swing_damping * np.sqrt((k + 9.81 * fruit.mass * fruit.lever) * inertia)
    )
    kind = mujoco.mjtGeom.mjGEOM_MESH
    touch = body.add_geom(
        name=name, type=kind, meshname=name, mass=fruit.mass, group=3, **FRUIT_CONTACT
    )
    touch.contype, touch.conaffinity, touch.condim = FRUIT, ROBOT | FRUIT, 3
    touch.friction = [numbers.fruit_friction, 0.005, 0.0005]
    shown = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": 2}
    body.add_geom(name=f"{name}_skin", type=kind, meshname=name, material=name, **shown)
    seat = STEM_SEAT * float(fruit.dimensions[1])
    for owner, start, end, label, alpha in (
        (body, [0.0, -seat, 0.0], anchor, "stem", 1.0),
        (
            parent,
            R_spur.T @ (fruit.anchor - spur.start),
            at - 0.9 * seat * (R_spur.T @ T[:3, 1]),
            "torn",
            0.0,
        ),
    ):
        stem = owner.add_geom(
            name=f"{name}_{label}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*start, *end],
            **shown,
        )
        stem.size, stem.rgba = [numbers.stem_diameter / 2.0, 0.0, 0.0], [0.30, 0.24, 0.10, alpha]
    spec.add_exclude(bodyname1=name, bodyname2=f"spur_{fruit.spur}")


def _add_leaves(building: _Building) -> None:
    mujoco, spec, wall = building.mujoco, building.spec, building.wall
    numbers = wall.numbers
    sizes = np.linspace(*numbers.leaf_length, LEAF_SIZES)
    for k, length in enumerate(sizes):
        vertices, faces = leaf_mesh(float(length), numbers.leaf_width)
        mesh = spec.add_mesh(name=f"leaf_{k}")
        mesh.uservert, mesh.userface = vertices.ravel(), faces.ravel()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    greens = np.random.default_rng([wall.seed, 15])
    for i, leaf in enumerate(wall.leaves):
        _add_leaf(building, i, leaf, int(np.argmin(np.abs(sizes - leaf.length))), greens)


def _add_leaf(
    building: _Building, i: int, leaf: TreeLeaf, size: int, greens: np.random.Generator
) -> None:
    mujoco, wall = building.mujoco, building.wall
    numbers = wall.numbers
    if leaf.spur is None:
        parent, at, R = _on_lateral(building, leaf.lateral, leaf.s)
    else:
        (parent, R), at = building.spurs[leaf.spur], np.array([leaf.s, 0.0, 0.0])
    body = parent.add_body(name=f"leaf_{i}", pos=at, quat=_quat(building, R.T @ leaf.R_base_leaf))
    width = numbers.leaf_width * leaf.length
    mass = numbers.leaf_mass * np.pi / 4.0 * width * leaf.length
    middle = leaf.petiole + leaf.length / 2.0
    inertia = mass * (middle**2 + leaf.length**2 / 16.0)
    k = numbers.wood_modulus * np.pi / 4.0 * numbers.petiole_radius**4 / leaf.petiole
    hinge = body.add_joint(name=f"leaf_{i}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 1.0, 0.0])
    hinge.stiffness[0], hinge.damping[0] = k, 2.0 * numbers.leaf_damping * np.sqrt(k * inertia)
    plate = body.add_geom(
        name=f"leaf_{i}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=[middle, 0.0, 0.0], group=3
    )
    plate.size, plate.mass = [0.42 * leaf.length, 0.38 * width, LEAF_THICKNESS / 2.0], mass
    plate.contype, plate.conaffinity, plate.condim = 0, ROBOT, 1
    shade = greens.uniform(0.75, 1.15)
    shown = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": 2}
    colour = [0.20 * shade * greens.uniform(0.8, 1.3), 0.38 * shade, 0.12 * shade, 1.0]
    kind = mujoco.mjtGeom.mjGEOM_MESH
    body.add_geom(
        name=f"leaf_{i}_blade",
        type=kind,
        meshname=f"leaf_{size}",
        pos=[leaf.petiole, 0, 0],
        rgba=colour,
        **shown,
    )
    stalk = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, 0, leaf.petiole, 0, 0],
        rgba=colour,
        **shown,
    )
    stalk.size = [numbers.petiole_radius, 0.0, 0.0]


def _add_pad_sensors(mujoco: Any, spec: Any) -> None:
    """Net contact wrench of each pad: force, torque and point, in the global frame."""
    for pad in PADS:
        spec.add_sensor(
            name=f"wrench_{pad}",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=pad,
            reftype=mujoco.mjtObj.mjOBJ_UNKNOWN,
            refname="",
            intprm=[2 | 4 | 16, 3, 1],
        )


def _finished(
    mujoco: Any, model: Any, wall: Wall, shapes: tuple[FruitShape, ...], fixed: tuple[Box, ...]
) -> WallModel:
    """Set the springs so that the drawn shape is the equilibrium, and find everything's numbers."""
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    bias = state.qfrc_bias
    fruits, names = (
        [each.number for each in wall.fruits],
        [model.geom(g).name for g in range(model.ngeom)],
    )
    for j in range(model.njnt):
        joint, dof, address = model.joint(j), int(model.jnt_dofadr[j]), int(model.jnt_qposadr[j])
        if not joint.name.startswith(("lateral_", "spur_", "fruit_", "leaf_")):
            continue
        stiffness = float(joint.stiffness[0])
        if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_BALL:
            turn = bias[dof : dof + 3] / stiffness
            angle = float(np.linalg.norm(turn))
            quat = np.array(
                [np.cos(angle / 2.0), *(np.sin(angle / 2.0) * turn / max(angle, 1e-12))]
            )
            model.qpos_spring[address : address + 4] = quat
        else:
            model.qpos_spring[address] = model.qpos0[address] + bias[dof] / stiffness
    swing = np.array([int(model.joint(f"fruit_{i}_ball").dofadr[0]) for i in fruits], np.int64)
    lateral = np.full(model.ngeom, -1, np.int64)
    for g, name in enumerate(names):
        if name.startswith("lateral_"):
            lateral[g] = int(name.split("_")[1])
        elif name.startswith("spur_"):
            lateral[g] = wall.spurs[int(name.split("_")[1])].lateral
    robot = (
        model.body("tool0").rootid[0]
        if "tool0" in {model.body(b).name for b in range(model.nbody)}
        else -1
    )
    return WallModel(
        wall=wall,
        model=model,
        shapes=shapes,
        fixed=fixed,
        fruit_bodies=np.array([model.body(f"fruit_{i}").id for i in fruits], np.int64),
        fruit_geoms=np.array([model.geom(f"fruit_{i}").id for i in fruits], np.int64),
        stretch=np.array([int(model.joint(f"fruit_{i}_x").dofadr[0]) for i in fruits], np.int64),
        swing=swing,
        rest_moment=np.array([bias[d : d + 3] for d in swing]).reshape(-1, 3),
        strengths=np.array([each.strength.row() for each in wall.fruits]).reshape(-1, 4),
        lateral_dofs=np.array(
            [
                [
                    int(model.joint(f"lateral_{i}_{k}_{axis}").dofadr[0])
                    for k in range(SEGMENTS)
                    for axis in "yz"
                ]
                for i in range(len(wall.laterals))
            ]
        ),
        leaf_dofs=np.array(
            [int(model.joint(f"leaf_{i}").dofadr[0]) for i in range(len(wall.leaves))], np.int64
        ),
        lateral_of_geom=lateral,
        wooden=np.array([n.startswith(("lateral_", "spur_", "trunk")) for n in names]),
        wired=np.array([n.startswith("wire_") for n in names]),
        robotic=model.body_rootid[model.geom_bodyid] == robot,
    )


def _along(direction: Float64) -> Float64:
    """Return a rotation whose x axis is the direction."""
    side = np.cross([0.0, 0.0, 1.0], direction)
    side = side / np.linalg.norm(side) if np.linalg.norm(side) > 1e-6 else np.array([0.0, 1.0, 0.0])
    return np.stack([direction, side, np.cross(direction, side)], axis=1)


def _quat(building: _Building, R: Float64) -> Float64:
    T = np.eye(4)
    T[:3, :3] = R
    return quaternion(building.mujoco, T)
