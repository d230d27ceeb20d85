"""Contents of a robot's file: a serial chain to the tool, the gripper's sliding fingers, and collision geometry.

MuJoCo compiles MJCF and URDF alike; everything is read from the compiled model with all joints at zero, so any way of
writing the file (nested defaults, offsets of joints, Euler angles) gives the same description.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.installation import load_mujoco
from pomona.executive.values.read_only import ReadOnly
from pomona.skills.geometry import inverse
from pomona.skills.motion.robot.errors import BadRobotFile
from pomona.skills.motion.robot.urdf import leaders, read_urdf, seen_only

mujoco = load_mujoco()

ENDLESS = 32.0 * np.pi  # position limit of a joint that has none: 16 turns from its zero [rad]

# speed of a joint that no arm reaches [rad/s]: small ones turn their wrists at 20 rad/s
QUICKEST = 50.0

# pads that are nearer to each other than this touch when the fingers are closed [m]
TOUCHING = 1e-6

KINDS = ("sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")


@dataclass(frozen=True, slots=True, eq=False)
class Geom(ReadOnly):
    """One convex collision shape."""

    name: str  # in the file, or the body's name and a number
    body: int  # index of its body in `Description.bodies`
    kind: str  # one of `KINDS`; a mesh stands for its convex hull
    size: Float64  # half-lengths as MuJoCo has them: radius; radius and half length along z; or three half-extents [m]
    T_link_geom: Float64  # pose in the frame of the link that carries the body, fingers closed
    vertices: Float64  # of a mesh, in the geom's frame, shape (n, 3) [m]; empty for primitives


@dataclass(frozen=True, slots=True, eq=False)
class Body(ReadOnly):
    """A rigid part with collision geometry."""

    name: str  # in the file
    link: int  # the link of the chain that carries it; 0 never moves
    slide: Float64  # shift per metre of gripper opening in the link's frame, shape (3,); zero for all but fingers
    group: str  # "arm", "gripper" (parts fixed on the flange) or "fingers"
    parent: str  # name of the body it is attached to


@dataclass(frozen=True, slots=True, eq=False)
class Description(ReadOnly):
    """A robot as its file describes it. Frames of links are those of `pomona.skills.motion.robot.model`."""

    path: Path  # the file
    joint_names: tuple[str, ...]  # from base to tool
    steps: Float64  # pose of each joint in the frame of the link before it, shape (dof, 4, 4)
    sliding: NDArray[np.bool_]  # which joints shift instead of turn, shape (dof,)
    endless: NDArray[np.bool_]  # which joints turn without limits, shape (dof,)
    lower: Float64  # lower, upper: position limits, shape (dof,) [rad or m]; `ENDLESS` for a joint without limits
    upper: Float64
    velocity: Float64  # velocity, acceleration, jerk: limits, shape (dof,); infinite where the file states none
    acceleration: Float64
    jerk: Float64
    T_link_frame: Mapping[
        str, Float64
    ]  # poses of named sites and bodies on the last link in its frame, fingers closed
    bodies: tuple[Body, ...]  # bodies, geoms: collision geometry
    geoms: tuple[Geom, ...]
    excluded: frozenset[
        frozenset[str]
    ]  # pairs of bodies (by name) that the file excludes from contact
    # width_min, width_max: range of the gripper's opening [m]; both 0 without sliding fingers and pad sites
    width_min: float
    width_max: float


def read_description(path: Path, tool: str = "tool0") -> Description:
    """Read an MJCF or URDF file; the chain is the joints between its base and the site or body `tool`.

    Raises BadRobotFile: the file does not compile, or lacks the tool, joints or geometry that are needed.
    """
    if not path.is_file():
        raise BadRobotFile(path, "there is no such file")
    urdf = read_urdf(path)
    try:
        text = None if urdf is None else ElementTree.tostring(urdf, encoding="unicode")
        spec = (
            mujoco.MjSpec.from_file(str(path)) if text is None else mujoco.MjSpec.from_string(text)
        )
        spec.compiler.fusestatic = False  # a URDF's fixed frames (tool0, tcp) must survive
        compiled = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise BadRobotFile(
            path,
            f"MuJoCo cannot compile it: {' '.join(str(error).split()).removeprefix('Error: ')}",
        ) from error
    return _Reader(path, compiled, tool, urdf).description()


class _Reader:
    """Reads one compiled model; lives for one call of `read_description`."""

    def __init__(self, path: Path, model: Any, tool: str, urdf: ElementTree.Element | None) -> None:
        self.path = path
        self.model = model
        self.urdf = urdf
        self.at_zero = mujoco.MjData(model)
        self.at_zero.qpos[:] = 0.0
        mujoco.mj_kinematics(model, self.at_zero)
        self.tool_body = self._body_of_frame(tool)
        self.chain_bodies = self._ancestors(self.tool_body)
        self.joints = [
            joint for body in reversed(self.chain_bodies) for joint in self._joints_of(body)
        ]
        self._check_chain(tool)
        self.T_base_link = self._link_frames()
        self.width_min, self.width_max, self.slides = self._gripper()

    def description(self) -> Description:
        steps = np.array(
            [inverse(a) @ b for a, b in zip(self.T_base_link, self.T_base_link[1:], strict=False)]
        )
        dof = len(self.joints)
        limited = self.model.jnt_limited[self.joints].astype(bool)
        ranges = np.where(limited[:, None], self.model.jnt_range[self.joints], (-ENDLESS, ENDLESS))
        bodies, geoms = self._collision_geometry()
        return Description(
            path=self.path,
            joint_names=tuple(self._name("joint", j) for j in self.joints),
            steps=np.ascontiguousarray(steps),
            sliding=np.array([self._is_slide(j) for j in self.joints]),
            endless=~limited,
            lower=ranges[:, 0].copy(),
            upper=ranges[:, 1].copy(),
            velocity=self._numeric("arm_velocity", dof, self._urdf_velocities()),
            acceleration=self._numeric("arm_acceleration", dof, np.full(dof, np.inf)),
            jerk=self._numeric("arm_jerk", dof, np.full(dof, np.inf)),
            T_link_frame=self._frames_on_last_link(),
            bodies=bodies,
            geoms=geoms,
            excluded=self._excluded(),
            width_min=self.width_min,
            width_max=self.width_max,
        )

    # ------------------------------------------------------------------------------------------------- chain

    def _name(self, kind: str, index: int) -> str:
        name: str = getattr(self.model, kind)(index).name
        return name or f"{kind}_{index}"

    def _body_of_frame(self, name: str) -> int:
        for kind in (mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_BODY):
            index = mujoco.mj_name2id(self.model, kind, name)
            if index >= 0:
                return (
                    int(self.model.site_bodyid[index])
                    if kind == mujoco.mjtObj.mjOBJ_SITE
                    else int(index)
                )
        raise BadRobotFile(self.path, f"has no site or body named '{name}'")

    def _ancestors(self, body: int) -> list[int]:
        """Return the body, its parent, … without the world."""
        path = []
        while body != 0:
            path.append(body)
            body = int(self.model.body_parentid[body])
        return path

    def _joints_of(self, body: int) -> list[int]:
        first = int(self.model.body_jntadr[body])
        return list(range(first, first + int(self.model.body_jntnum[body])))

    def _is_slide(self, joint: int) -> bool:
        return bool(self.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE)

    def _check_chain(self, tool: str) -> None:
        if not self.joints:
            raise BadRobotFile(self.path, f"has no joint between the base and '{tool}'")
        for joint in self.joints:
            problem = self._problem_of(joint)
            if problem:
                raise BadRobotFile(self.path, f"the joint '{self._name('joint', joint)}' {problem}")

    def _problem_of(self, joint: int) -> str:
        """Return the reason why a joint of the chain cannot be planned with, or an empty text."""
        limited, (lower, upper) = self.model.jnt_limited[joint], self.model.jnt_range[joint]
        if self.model.jnt_type[joint] in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            return "neither turns nor slides about one axis"
        if self.urdf is not None and self._name("joint", joint) not in {
            j.get("name") for j in self.urdf.iter("joint")
        }:
            return "is part of a planar one; those of an arm turn or slide"  # MuJoCo makes three joints of it
        if limited and not (np.isfinite(lower) and np.isfinite(upper)):
            return "has limits that are not finite"
        if not limited and self._is_slide(joint):
            return "slides and needs a range"
        most, unit = (
            (10.0, "m: is it in millimetres?")
            if self._is_slide(joint)
            else (ENDLESS, "rad: is it in degrees?")
        )
        if max(-lower, upper) > most:
            return f"has a range up to {max(-lower, upper):g} {unit}"
        leader = self._leader_of(joint)
        return (
            f"follows '{leader}'; the joints of an arm must move independently of each other"
            if leader
            else ""
        )

    def _leader_of(self, joint: int) -> str:
        """Return the name of the joint that another one follows (`mimic`, `equality`), or an empty text."""
        for k in range(self.model.neq):
            of_joints = self.model.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT
            if of_joints and self.model.eq_obj1id[k] == joint and self.model.eq_obj2id[k] >= 0:
                return self._name("joint", int(self.model.eq_obj2id[k]))
        return leaders(self.urdf).get(self._name("joint", joint), "")

    def _link_frames(self) -> list[Float64]:
        """Frames of all links at zero: origin at the joint's anchor, z along its axis."""
        frames = [np.eye(4)]
        for joint in self.joints:
            z = self.at_zero.xaxis[joint] / np.linalg.norm(self.at_zero.xaxis[joint])
            x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
            x /= np.linalg.norm(x)
            frame = np.eye(4)
            frame[:3, 0], frame[:3, 1], frame[:3, 2] = x, np.cross(z, x), z
            frame[:3, 3] = self.at_zero.xanchor[joint]
            frames.append(frame)
        return frames

    def _link_of_body(self, body: int) -> int:
        """Return the number of chain joints that move a body."""
        while body != 0:
            if body in self.chain_bodies:
                above = self.chain_bodies[self.chain_bodies.index(body) :]
                return sum(len(self._joints_of(b)) for b in above)
            body = int(self.model.body_parentid[body])
        return 0

    def _pose_in_link(self, link: int, position: Float64, rotation: Float64) -> Float64:
        T_base = np.eye(4)
        T_base[:3, :3], T_base[:3, 3] = rotation.reshape(3, 3), position
        return inverse(self.T_base_link[link]) @ T_base

    def _frames_on_last_link(self) -> dict[str, Float64]:
        last = len(self.joints)
        frames = {}
        for body in range(1, self.model.nbody):
            if self._link_of_body(body) == last:
                pose = self._pose_in_link(last, self.at_zero.xpos[body], self.at_zero.xmat[body])
                frames[self._name("body", body)] = pose
        for site in range(self.model.nsite):
            if self._link_of_body(int(self.model.site_bodyid[site])) == last:
                pose = self._pose_in_link(
                    last, self.at_zero.site_xpos[site], self.at_zero.site_xmat[site]
                )
                frames[self._name("site", site)] = pose
        return frames

    # ---------------------------------------------------------------------------------------------- gripper

    def _gripper(self) -> tuple[float, float, dict[int, Float64]]:
        """Range of the opening and, by joint, the shift of a finger per metre of opening in the last link's frame.

        The opening is the distance between the two pad sites. Slide joints with a spring are soft pads, not fingers.
        """
        pads = [
            site for site in range(self.model.nsite) if self._name("site", site).startswith("pad_")
        ]
        if len(pads) != 2:
            return 0.0, 0.0, {}
        apart = self.at_zero.site_xpos[pads[0]] - self.at_zero.site_xpos[pads[1]]
        closed = float(np.linalg.norm(apart))
        signs = {
            joint: sign
            for sign, pad in zip((1.0, -1.0), pads, strict=True)
            for joint in self._fingers(pad)
        }
        if closed < TOUCHING:  # pads that meet have no direction; they part along it
            middles = {joint: float(self.model.jnt_range[joint].mean()) for joint in signs}
            apart = sum((signs[j] * middles[j] * self.at_zero.xaxis[j] for j in signs), np.zeros(3))
        length = float(np.linalg.norm(apart))
        gains = {
            j: signs[j] * float(self.at_zero.xaxis[j] @ apart) / length
            for j in signs
            if length > 0.0
        }
        total = sum(gains.values())
        if not gains or total <= 0.0:
            return closed, closed, {}
        R_link_base = self.T_base_link[-1][:3, :3].T
        slides = {joint: R_link_base @ self.at_zero.xaxis[joint] / total for joint in gains}
        lower, upper = np.array([self.model.jnt_range[joint] for joint in gains]).T
        return closed + total * float(lower.max()), closed + total * float(upper.min()), slides

    def _fingers(self, pad: int) -> list[int]:
        """Return the sliding joints between a pad and the arm that no spring holds."""
        found = []
        for body in self._ancestors(int(self.model.site_bodyid[pad])):
            if body in self.chain_bodies:
                break
            slides = [joint for joint in self._joints_of(body) if self._is_slide(joint)]
            found += [joint for joint in slides if self.model.jnt_stiffness[joint] == 0.0]
        return found

    def _slide_of_body(self, body: int) -> Float64:
        slide = np.zeros(3)
        for above in self._ancestors(body):
            for joint in self._joints_of(above):
                slide = slide + self.slides.get(joint, np.zeros(3))
        return slide

    # --------------------------------------------------------------------------------------------- geometry

    def _collision_geometry(self) -> tuple[tuple[Body, ...], tuple[Geom, ...]]:
        numbers: dict[int, int] = {}
        bodies: list[Body] = []
        geoms: list[Geom] = []
        for index in range(self.model.ngeom):
            if self.model.geom_contype[index] == 0 and self.model.geom_conaffinity[index] == 0:
                continue
            body = int(self.model.geom_bodyid[index])
            if body not in numbers:
                numbers[body] = len(bodies)
                bodies.append(self._body(body))
            geoms.append(self._geom(index, numbers[body], bodies[numbers[body]]))
        if not any(body.link > 0 for body in bodies):
            raise BadRobotFile(self.path, "has no collision geometry on any moving link")
        shown = seen_only(self.urdf)
        if shown:
            words = f"the link '{shown[0]}' has visual geometry and no collision geometry"
            raise BadRobotFile(
                self.path, f"{words}: copy its <visual> to <collision>, or remove the <visual>"
            )
        return tuple(bodies), tuple(geoms)

    def _body(self, body: int) -> Body:
        slide = self._slide_of_body(body)
        fixed_on_flange = self.tool_body in self._ancestors(body) and (
            body != self.tool_body or not self._joints_of(body)
        )
        group = "fingers" if slide.any() else "gripper" if fixed_on_flange else "arm"
        parent = self._name("body", int(self.model.body_parentid[body]))
        return Body(self._name("body", body), self._link_of_body(body), slide, group, parent)

    def _geom(self, index: int, number: int, body: Body) -> Geom:
        kind = mujoco.mjtGeom(self.model.geom_type[index]).name.removeprefix("mjGEOM_").lower()
        name = self.model.geom(index).name or f"{body.name}/{index}"
        if kind not in KINDS:
            raise BadRobotFile(
                self.path, f"collision geom '{name}' is a {kind}; use {', '.join(KINDS)}"
            )
        vertices = np.empty((0, 3))
        if kind == "mesh":
            mesh = int(self.model.geom_dataid[index])
            first = int(self.model.mesh_vertadr[mesh])
            count = int(self.model.mesh_vertnum[mesh])
            vertices = np.array(self.model.mesh_vert[first : first + count], dtype=np.float64)
        pose = self._pose_in_link(
            body.link, self.at_zero.geom_xpos[index], self.at_zero.geom_xmat[index]
        )
        return Geom(name, number, kind, np.array(self.model.geom_size[index]), pose, vertices)

    def _excluded(self) -> frozenset[frozenset[str]]:
        signatures = np.asarray(self.model.exclude_signature)[: self.model.nexclude]
        return frozenset(
            frozenset((self._name("body", int(s) >> 16), self._name("body", int(s) & 0xFFFF)))
            for s in signatures
        )

    # ----------------------------------------------------------------------------------------------- limits

    def _numeric(self, name: str, dof: int, otherwise: Float64) -> Float64:
        index = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
        if index < 0:
            return otherwise
        values = np.array(self.model.numeric(index).data, dtype=np.float64)
        if values.shape != (dof,) or not np.all(np.isfinite(values)) or np.any(values <= 0.0):
            raise BadRobotFile(
                self.path,
                f"numeric '{name}' must hold {dof} positive numbers, not {values.tolist()}",
            )
        return values

    def _urdf_velocities(self) -> Float64:
        """Velocity limits of a URDF, which MuJoCo does not keep; infinite in an MJCF."""
        joints = [] if self.urdf is None else self.urdf.findall("joint")
        stated = {joint.get("name", ""): joint for joint in joints}
        names = [self._name("joint", j) for j in self.joints]
        return np.array(
            [
                self._urdf_velocity(name, stated[name]) if name in stated else np.inf
                for name in names
            ]
        )

    def _urdf_velocity(self, name: str, joint: ElementTree.Element) -> float:
        """Return the velocity limit of a URDF's joint; infinite for a continuous one that states none.

        Raises BadRobotFile: a limit is missing, no finite number, reversed, or no speed. MuJoCo ignores such limits.
        """
        limit = joint.find("limit")
        endless = joint.get("type") == "continuous"
        said = {} if limit is None else limit.attrib
        values = {"velocity": np.inf} if endless else {}
        for key in ("velocity",) if endless else ("lower", "upper", "velocity"):
            if key not in said and not endless:
                raise BadRobotFile(self.path, f"the joint '{name}' lacks the limit '{key}'")
            if key in said:
                values[key] = _finite(said[key])
                if np.isnan(values[key]):
                    raise BadRobotFile(
                        self.path, f"the joint '{name}': {key} = '{said[key]}' is no finite number"
                    )
        if not endless and values["lower"] >= values["upper"]:
            words = f"needs a range; {values['lower']:g} … {values['upper']:g} is none"
            raise BadRobotFile(self.path, f"the joint '{name}' {words}")
        if values["velocity"] <= 0.0:
            raise BadRobotFile(
                self.path, f"the joint '{name}': velocity = '{said['velocity']}' is not positive"
            )
        if QUICKEST < values["velocity"] < np.inf:
            unit = (
                "m/s: is it in millimetres?"
                if joint.get("type") == "prismatic"
                else "rad/s: is it in degrees?"
            )
            words = f"velocity = '{said['velocity']}' is more than {QUICKEST:g} {unit}"
            raise BadRobotFile(self.path, f"the joint '{name}': {words}")
        return values["velocity"]


def _finite(text: str) -> float:
    """Return the number; NaN for a text that is no finite one."""
    try:
        return float(text) if np.isfinite(float(text)) else np.nan
    except ValueError:
        return np.nan
