"""The simulated world as a MuJoCo model: the robot's own file, a table, fruit and distractors around it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.drivers.interfaces import Box
from pomona.executive.values.arrays import Float64
from pomona.executive.values.later import Later
from pomona.tools.simulation.fruit_shape import FruitShape
from pomona.tools.simulation.gl import load_mujoco
from pomona.tools.simulation.intruder import IntruderSection, add_intruder
from pomona.tools.simulation.layout import (
    PADS,
    Distractor,
    FruitOnTable,
    Gathering,
    Layout,
    PadTruth,
    read_robot,
)

cv2: Any = Later("cv2")

TIMESTEP = 0.002  # step of the physics [s]; contact, sensing and force control share it

TABLE_FRICTION = (0.6, 0.005, 0.0005)
LINING = (
    0.8,
    0.02,
    0.01,
)  # friction of fixed objects: a crate is lined with foam, on which fruit does not roll
OFFSCREEN = (1280, 960)  # width and height of the largest image that can be drawn [px]


@dataclass(frozen=True, slots=True, eq=False)
class SimScene:
    """The compiled model with the indices of its parts. Fruit bodies are named fruit_0, fruit_1, …"""

    model: Any
    fruits: tuple[FruitOnTable, ...]
    shapes: tuple[FruitShape, ...]
    fixed: tuple[Box, ...]
    pads: PadTruth
    table_z: float
    intruder: IntruderSection | None = None
    gathering: Gathering | None = None

    @property
    def dof(self) -> int:
        """Number of the arm's joints: all that have an actuator, but the fingers."""
        return int(self.model.nu) - 1


def build_scene(layout: Layout, seed: int) -> SimScene:
    """Compile the model. Raises UnusableRobotFile: the robot's file cannot be read, or lacks something in `NEEDED`."""
    mujoco = load_mujoco()
    rng = np.random.default_rng([seed, 2])
    spec = read_robot(layout.robot)
    set_physics(mujoco, spec)
    add_lights(spec, rng)
    _add_table(mujoco, spec, layout.table_z, rng)
    add_fixed(mujoco, spec, layout.fixed)
    layout.pads.put(spec)
    shapes = []
    for i, fruit in enumerate(layout.fruits):
        shapes.append(fruit.shape(seed, i))
        add_fruit(mujoco, spec, f"fruit_{i}", fruit, shapes[-1], layout.table_z)
    for i, distractor in enumerate(layout.distractors):
        _add_distractor(mujoco, spec, f"distractor_{i}", distractor, layout.table_z)
    numbered = {"fruit": layout.fruits, "distractor": layout.distractors}
    touched = [f"{kind}_{i}" for kind, all_ in numbered.items() for i in range(len(all_))]
    fixed_bodies = [f"fixed_{name}" for name in fixed_names(layout.fixed)]
    add_contact_sensors(mujoco, spec, ["table", *fixed_bodies, *touched], {})
    if layout.intruder is not None:
        add_intruder(mujoco, spec)
    return SimScene(
        spec.compile(),
        layout.fruits,
        tuple(shapes),
        layout.fixed,
        layout.pads,
        layout.table_z,
        layout.intruder,
        layout.gathering,
    )


def set_physics(mujoco: Any, spec: Any) -> None:
    """Settings with which a held fruit creeps by micrometres a second and contact forces stay true."""
    option = spec.option
    option.timestep = TIMESTEP
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 1000.0
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.tolerance = 1e-10
    option.noslip_iterations = 0
    spec.memory = 16 << 20


def add_lights(spec: Any, rng: np.random.Generator) -> None:
    """Dim lights without shadows: shadows cost four times the picture."""
    head = spec.visual.headlight
    strength = rng.uniform(0.85, 1.1)
    head.ambient = [0.42 * strength] * 3
    head.diffuse = [0.10] * 3
    head.specular = [0.0] * 3
    for azimuth, share in ((rng.uniform(-np.pi, np.pi), 0.42), (rng.uniform(-np.pi, np.pi), 0.18)):
        light = spec.worldbody.add_light()
        light.pos = [1.2 * np.cos(azimuth), 1.2 * np.sin(azimuth) - 0.4, 1.8]
        light.dir = [-0.5 * np.cos(azimuth), -0.5 * np.sin(azimuth), -0.8]
        light.castshadow = False
        warm = rng.uniform(0.92, 1.0)
        light.diffuse = [
            share * strength,
            share * strength * (1.0 + warm) / 2.0,
            share * strength * warm,
        ]
        light.specular = [0.25 * share] * 3
    spec.visual.quality.offsamples = 0  # depth at pixel centres, not a mean over an edge
    spec.visual.global_.offwidth, spec.visual.global_.offheight = OFFSCREEN
    spec.visual.map.znear, spec.visual.map.zfar = 0.02, 6.0
    spec.stat.extent, spec.stat.center = 1.0, [0.0, -0.4, 0.0]


def _add_table(mujoco: Any, spec: Any, table_z: float, rng: np.random.Generator) -> None:
    hue = np.array(
        ((0.62, 0.58, 0.52), (0.45, 0.47, 0.50), (0.66, 0.52, 0.38), (0.72, 0.71, 0.68))[
            rng.integers(4)
        ]
    )
    colour = hue * rng.uniform(0.85, 1.1)
    stretch = rng.uniform(1.0, 12.0)
    grain = cv2.GaussianBlur(rng.normal(size=(512, 512)), (0, 0), sigmaX=stretch, sigmaY=1.2)
    shade = 1.0 + 0.05 * grain / grain.std() + 0.02 * rng.normal(size=(512, 512))
    add_material(mujoco, spec, "table", np.clip(colour * shade[..., None], 0.0, 1.0), (1.0, 1.0))
    world = spec.worldbody
    table = world.add_body(name="table", pos=[0.0, -0.35, table_z - 0.02])
    table.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.65, 0.55, 0.02],
        material="table",
        contype=1,
        conaffinity=3,
        condim=6,
        friction=TABLE_FRICTION,
    )
    floor = np.array([0.30, 0.29, 0.28]) * rng.uniform(0.7, 1.2)
    world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0.0, 0.0, table_z - 0.75],
        size=[3.0, 3.0, 0.1],
        rgba=[*floor, 1.0],
        contype=1,
        conaffinity=3,
    )


def add_fixed(mujoco: Any, spec: Any, fixed: tuple[Box, ...]) -> None:
    """One body for all boxes of a name."""
    bodies: dict[str, Any] = {}
    for box in fixed:
        if box.name not in bodies:
            bodies[box.name] = spec.worldbody.add_body(name=f"fixed_{box.name}")
        bodies[box.name].add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=box.T_base_box[:3, 3],
            quat=quaternion(mujoco, box.T_base_box),
            size=box.half_extents,
            rgba=[0.3, 0.3, 0.32, 1.0],
            contype=1,
            conaffinity=3,
            condim=6,
            friction=LINING,
        )


def add_fruit(
    mujoco: Any, spec: Any, name: str, fruit: FruitOnTable, shape: FruitShape, table_z: float
) -> None:
    """A free body whose frame is the fruit's object frame; its convex hull touches, its skin is seen."""
    mesh = spec.add_mesh(name=name)
    mesh.uservert, mesh.userface = shape.vertices.ravel(), shape.faces.ravel()
    mesh.usertexcoord, mesh.userfacetexcoord = shape.uv.ravel(), shape.faces.ravel()
    add_material(mujoco, spec, name, shape.texture / 255.0, (1.0, 1.0))
    T_base_fruit = standing_pose(fruit, table_z + fruit.dimensions[1] / 2.0 + 0.004)
    body = spec.worldbody.add_body(
        name=name, pos=T_base_fruit[:3, 3], quat=quaternion(mujoco, T_base_fruit)
    )
    body.add_freejoint(name=name)
    touch = {"contype": 1, "conaffinity": 3, "condim": 6, "friction": TABLE_FRICTION}
    shown = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": 2}
    kind = mujoco.mjtGeom.mjGEOM_MESH
    parts = 1 + fruit.centre.any()  # half of the mass lies twice as far away as its centre
    mass = fruit.mass / parts
    body.add_geom(name=name, type=kind, meshname=name, mass=mass, group=3, **touch)
    body.add_geom(name=f"{name}_skin", type=kind, meshname=name, material=name, **shown)
    if parts > 1:
        still = {"contype": 0, "conaffinity": 0, "mass": mass, "group": 3}
        body.add_geom(size=[1e-3] * 3, pos=parts * fruit.centre, **still)
    if shape.stem is not None:
        twig = spec.add_mesh(name=f"{name}_stem")
        twig.uservert, twig.userface = shape.stem[0].ravel(), shape.stem[1].ravel()
        twig.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        body.add_geom(
            name=f"{name}_stem",
            type=kind,
            meshname=f"{name}_stem",
            rgba=[0.30, 0.20, 0.10, 1.0],
            **shown,
        )


def _add_distractor(
    mujoco: Any, spec: Any, name: str, distractor: Distractor, table_z: float
) -> None:
    kinds = {
        "box": mujoco.mjtGeom.mjGEOM_BOX,
        "ball": mujoco.mjtGeom.mjGEOM_SPHERE,
        "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    }
    a, b, c = distractor.size
    size, rest = {"box": ([a, b, c], c), "ball": ([b, 0.0, 0.0], b), "cylinder": ([a, c, 0.0], c)}[
        distractor.shape
    ]
    body = spec.worldbody.add_body(
        name=name,
        pos=[*distractor.xy, table_z + rest + 0.0005],
        quat=[np.cos(distractor.yaw / 2.0), 0.0, 0.0, np.sin(distractor.yaw / 2.0)],
    )
    body.add_freejoint(name=name)
    body.add_geom(
        name=name,
        type=kinds[distractor.shape],
        size=size,
        rgba=[*distractor.colour, 1.0],
        contype=1,
        conaffinity=3,
        condim=6,
        friction=(0.6, 0.01, 0.01),
        density=600.0,
    )


def add_material(
    mujoco: Any, spec: Any, name: str, picture: Float64, repeat: tuple[float, float]
) -> None:
    """A dull material with a texture of its own: `picture` (h, w, 3), 0..1, `repeat` times along x and y."""
    rows, columns = picture.shape[:2]
    texture = spec.add_texture(
        name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=columns, height=rows, nchannel=3
    )
    texture.data = (picture * 255.0).astype(np.uint8).tobytes()
    material = spec.add_material(name=name, specular=0.25, shininess=0.3, texrepeat=repeat)
    roles = [""] * int(mujoco.mjtTextureRole.mjNTEXROLE)
    roles[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name
    material.textures = roles


def fixed_names(fixed: tuple[Box, ...]) -> tuple[str, ...]:
    """Return the names of fixed objects, each once, in order."""
    return tuple(dict.fromkeys(box.name for box in fixed))


def container_of(fixed: tuple[Box, ...], p: Float64, radius: float) -> str:
    """Return the name of the crate that a fruit lies in, or nothing; a crate's first box is its floor.

    `p` is the fruit's middle in the base frame, shape (3,) [m]; its lowest point must be below the crate's rim.
    """
    for name in fixed_names(fixed):
        boxes = [box for box in fixed if box.name == name]
        T_floor_base = np.linalg.inv(boxes[0].T_base_box)
        x, y, z = T_floor_base[:3] @ np.append(p, 1.0)
        rim = max(
            float((T_floor_base @ box.T_base_box)[2, 3]) + box.half_extents[2] for box in boxes
        )
        above = abs(x) < boxes[0].half_extents[0] and abs(y) < boxes[0].half_extents[1]
        if len(boxes) > 1 and above and 0.0 < z < rim + radius:
            return name
    return ""


def add_contact_sensors(
    mujoco: Any, spec: Any, touched: Sequence[str], others: Mapping[str, tuple[str, str]]
) -> None:
    """Add net contact sensors, summed by the engine: pads with all, the robot with itself and with bodies.

    Args:
        touched: names of those bodies.
        others: two bodies or pads, by the name of a further sensor.
    """
    of_arm = {actuator.target for actuator in spec.actuators if actuator.name != "gripper"}
    # joints come from base to tool
    arm = next(joint.parent.name for joint in spec.joints if joint.name in of_arm)
    kind = mujoco.mjtObj
    kinds = {arm: kind.mjOBJ_XBODY, **dict.fromkeys(PADS, kind.mjOBJ_GEOM), "": kind.mjOBJ_UNKNOWN}
    pairs = {
        **{f"wrench_{pad}": (pad, "") for pad in PADS},
        **{f"robot_{body}": (arm, body) for body in touched},
        "robot_robot": (arm, arm),
        **others,
    }
    for name, (first, other) in pairs.items():
        # found and force, or force, torque and place; one wrench for all contacts, in the global frame
        fields = 3 if other else 22
        spec.add_sensor(
            name=name,
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=kinds.get(first, kind.mjOBJ_BODY),
            objname=first,
            reftype=kinds.get(other, kind.mjOBJ_BODY),
            refname=other,
            intprm=[fields, 3, 1],
        )


def standing_pose(fruit: FruitOnTable, height: float) -> Float64:
    """T_base_fruit (4, 4) of a fruit that stands on its calyx, stem up, a little tilted, its centre at `height` [m]."""
    c = np.cos(fruit.yaw)
    s = np.sin(fruit.yaw)
    upright = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    )
    axis = np.array([np.cos(fruit.tilt_azimuth), np.sin(fruit.tilt_azimuth), 0.0])
    lean, _ = cv2.Rodrigues(axis * fruit.tilt)
    T = np.eye(4)
    T[:3, :3] = lean @ upright
    T[:3, 3] = [*fruit.xy, height]
    return T


def quaternion(mujoco: Any, T: Float64) -> Float64:
    """Of a transform (4, 4), as MuJoCo writes it: w, x, y, z (4,)."""
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, T[:3, :3].ravel())
    return quat
