"""A robot's description in MuJoCo's format: the arm of a URDF with a shipped hand on its flange."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from textwrap import indent

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.executive.values.installation import installed_trees, load_mujoco
from pomona.skills.motion.collision.cover import fibonacci_sphere
from pomona.skills.motion.robot.description import Geom
from pomona.tools.kit.cell_folder import inlined
from pomona.tools.own_arm.arm_urdf import UrdfArm

TURNS = 2.0 * np.pi  # range of a joint without limits: one turn to each side [rad]
CORNERS = 400  # directions in which the hull of a mesh is kept: within 0.5 % of its size
TAKEN = (
    "base",
    "tool0",
    "finger_left",
    "finger_right",
    "pad_left",
    "pad_right",
    "gripper",
)  # names of the hand
LAG = 1.0 / 60.0  # of a joint behind its set-point, kv / kp, as the shipped arms have [s]
STIFFNESS = (
    2500.0,
    2300.0,
)  # of a joint: at least [N m/rad], and per inertia [1/s²], as the shipped arms have
SHARE = 0.4  # of a joint's effort that accelerates the arm
# highest acceleration over speed, and jerk over acceleration [1/s]: those of a UR5e
QUICK = 3.0
SHARP = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Drives:
    """Gains and limits of the joints, each of shape (dof,)."""

    stiffness: Float64  # kp [N m/rad]
    armature: Float64  # inertia of the drive [kg m²]
    effort: Float64  # largest torque [N m]
    velocity: Float64  # velocity, acceleration, jerk: limits [rad/s, rad/s², rad/s³]
    acceleration: Float64
    jerk: Float64

    @staticmethod
    def of(arm: UrdfArm, inertia: Float64) -> Drives:
        """Choose drives for the largest inertia that each joint moves, (dof,) [kg m²].

        The acceleration is that of `SHARE` of the stated effort, and at most `QUICK` times the speed.
        """
        armature = np.where(inertia > 0.5, 0.3, 0.1)
        stiffness = np.maximum(STIFFNESS[0], STIFFNESS[1] * (inertia + armature))
        stated = arm.description.velocity
        velocity = np.where(np.isfinite(stated), stated, 2.0)
        most = QUICK * velocity
        effort = np.where(arm.efforts > 0.0, arm.efforts, 2.5 * (inertia + armature) * most)
        acceleration = np.maximum(np.minimum(most, SHARE * effort / (inertia + armature)), 0.5)
        return Drives(stiffness, armature, effort, velocity, acceleration, SHARP * acceleration)


def robot_xml(
    arm: UrdfArm, hand: str, turn: float, drives: Drives, apart: Collection[tuple[str, str]]
) -> str:
    """Return the description.

    Args:
        hand: a shipped hand, such as wsg32.
        turn: of the hand about its approach [rad].
        apart: pairs of bodies that are excluded from contact.
    """
    robots = installed_trees() / "robots"
    file = hand.replace("-", "_")
    body = f'<frame {_pose(arm.T_link_hand @ _about_z(turn))}>\n  <include file="{file}_body.xml"/>\n</frame>\n'
    for link in range(arm.dof, 0, -1):
        body = _link(arm, link, drives, body)
    names = joints(arm)
    text = _TEMPLATE.format(
        source=arm.path.name,
        flange=arm.flange,
        hand=hand,
        velocity=_row(drives.velocity),
        acceleration=_row(drives.acceleration),
        jerk=_row(drives.jerk),
        meshes="".join(
            _mesh(geom, f"shape_{n}_{i}")
            for n, of in enumerate(arm.geoms)
            for i, geom in enumerate(of)
        ),
        base="".join(
            _geom(geom, f"shape_0_{i}", indent_by=6) for i, geom in enumerate(arm.geoms[0])
        ),
        body=indent(body, "      "),
        apart="".join(
            f'    <exclude body1="{one}" body2="{other}"/>\n' for one, other in sorted(apart)
        ),
        actuators="".join(map(_actuator, names, drives.stiffness, drives.effort)),
        file=file,
    )
    return inlined(text, robots)


def bodies(arm: UrdfArm) -> tuple[str, ...]:
    """Names of the base and the moving links, (dof + 1,)."""
    return ("base", *(_own(name) for name in arm.links))


def joints(arm: UrdfArm) -> tuple[str, ...]:
    """Names of the joints, (dof,)."""
    return tuple(_own(name) for name in arm.description.joint_names)


def _own(name: str) -> str:
    return f"arm_{name}" if name in TAKEN else name


_TEMPLATE = """<!-- {source} up to '{flange}', with the hand {hand}: written by `pomona new arm`.

  Chain, limits, masses and shapes are those of the URDF; a mesh stands for its convex hull. README.md lists the values
  that a URDF does not have.
-->
<mujoco model="own_arm">
  <compiler angle="radian" autolimits="true"/>

  <custom>
    <numeric name="arm_velocity" data="{velocity}"/>
    <numeric name="arm_acceleration" data="{acceleration}"/>
    <numeric name="arm_jerk" data="{jerk}"/>
  </custom>

  <asset>
{meshes}  </asset>

  <worldbody>
    <body name="base" gravcomp="1">
{base}{body}    </body>
  </worldbody>

  <contact>
{apart}  </contact>

  <actuator>
{actuators}  </actuator>

  <include file="{file}.xml"/>
</mujoco>
"""


def _actuator(joint: str, stiffness: float, effort: float) -> str:
    gains = (
        f'kp="{stiffness:.5g}" kv="{LAG * stiffness:.5g}" forcerange="-{effort:.5g} {effort:.5g}"'
    )
    return f'    <position name="arm_{joint}" joint="{joint}" {gains}/>\n'


def _link(arm: UrdfArm, link: int, drives: Drives, inside: str) -> str:
    """Return the body of a link, number 1 … dof, with those beyond it."""
    mass = arm.masses[link - 1]
    i = link - 1
    about = arm.description
    lower, upper = (-TURNS, TURNS) if about.endless[i] else (about.lower[i], about.upper[i])
    full = mass.inertia
    inertia = _row([full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2]])
    kind = "slide" if about.sliding[i] else "hinge"
    span = f'range="{lower:.9g} {upper:.9g}" damping="2" armature="{drives.armature[i]:g}"'
    head = (
        f'<body name="{bodies(arm)[link]}" {_pose(about.steps[i])} gravcomp="1">\n'
        f'  <inertial pos="{_row(mass.centre)}" mass="{mass.mass:.6g}" fullinertia="{inertia}"/>\n'
        f'  <joint name="{joints(arm)[i]}" type="{kind}" axis="0 0 1" {span}/>\n'
    )
    shapes = "".join(_geom(geom, f"shape_{link}_{n}") for n, geom in enumerate(arm.geoms[link]))
    return f"{head}{shapes}{indent(inside, '  ')}</body>\n"


def _geom(geom: Geom, name: str, indent_by: int = 2) -> str:
    size = f'mesh="{name}"' if geom.kind == "mesh" else f'size="{_row(geom.size)}"'
    shape = (
        f'<geom name="{name}" class="solid" type="{geom.kind}" {size} {_pose(geom.T_link_geom)}/>'
    )
    return f"{' ' * indent_by}{shape}\n"


def _mesh(geom: Geom, name: str) -> str:
    if geom.kind != "mesh":
        return ""
    middle = geom.vertices.mean(axis=0)
    corners = np.unique(((geom.vertices - middle) @ fibonacci_sphere(CORNERS).T).argmax(axis=0))
    return f'    <mesh name="{name}" vertex="{_row(geom.vertices[corners].ravel())}"/>\n'


def _pose(T: Float64) -> str:
    quat = np.empty(4)
    load_mujoco().mju_mat2Quat(quat, np.ascontiguousarray(T[:3, :3]).ravel())
    return f'pos="{_row(T[:3, 3])}" quat="{_row(quat, 9)}"'


def _row(numbers: object, digits: int = 6) -> str:
    return " ".join(f"{number:.{digits}g}" for number in np.asarray(numbers, dtype=np.float64))


def _about_z(angle: float) -> Float64:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return T
