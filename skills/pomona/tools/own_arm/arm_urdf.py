"""The arm of a URDF as a simulation needs it: chain, shapes, masses and efforts, without any hand of its own."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.errors import UsageError
from pomona.executive.values.arrays import Float64
from pomona.executive.values.installation import load_mujoco
from pomona.executive.values.units import is_number
from pomona.skills.geometry import inverse
from pomona.skills.motion.robot.description import Description, Geom, read_description
from pomona.skills.motion.robot.errors import BadRobotFile
from pomona.skills.motion.robot.urdf import SOFT, leaders, read_urdf
from pomona.tools.own_arm.flange import choose_flange

FEWEST = 6  # joints of an arm that can hold its hand in any pose
LIGHTEST = 0.001  # a link below this has no mass [kg]
HEAVIEST = 2000.0  # no link is heavier [kg]: the largest arms weigh about 10 t in six links
PARALLEL = 0.9  # cosine of the largest angle between the last joint and an axis of the flange: 26°


@dataclass(frozen=True, slots=True, eq=False)
class Mass:
    """A rigid body's mass [kg], centre (3,) [m] and inertia about it (3, 3) [kg m²], in the frame of its link."""

    mass: float
    centre: Float64
    inertia: Float64


LEAST = Mass(
    0.1, np.zeros(3), 1e-4 * np.eye(3)
)  # of a link without mass and shape: that of a small joint


@dataclass(frozen=True, slots=True, eq=False)
class UrdfArm:
    """A serial arm up to its flange; frames of links are those of `Description`."""

    path: Path  # the URDF
    flange: str  # the link that the hand is bolted on
    description: Description  # limits, steps and names of the joints
    links: tuple[str, ...]  # names of the moving links, (dof,)
    geoms: tuple[tuple[Geom, ...], ...]  # collision shapes of the base and each link, (dof + 1,)
    masses: tuple[Mass, ...]  # of each link, (dof,)
    efforts: Float64  # largest torque of each joint, (dof,) [N m or N]; 0 where the file has none
    T_link_hand: (
        Float64  # where the hand is bolted on, in the last link's frame: z along its approach
    )
    assumed: tuple[str, ...]  # sentences about missing values

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.links)


def read_arm(path: Path, flange: str | None = None) -> UrdfArm:
    """Read the arm between a URDF's base and its flange.

    Raises UsageError: the file is no URDF, has no such arm, or a value of it cannot be used; the text has the remedy.
    """
    try:
        root = read_urdf(path)
        if root is None:
            raise UsageError(f"{path}: is no URDF: {_why_not(path)}{_xacro(path)}")
        _judge_masses(path, root)
        end = _flange(path, root, flange)
        description = read_description(path, end)
    except BadRobotFile as error:
        raise UsageError(f"{error}{_xacro(path)}") from error
    dof = len(description.joint_names)
    if dof < FEWEST:
        words = f"{dof} joints lead from the base to '{end}', and an arm needs {FEWEST} to hold its hand in any pose"
        if follow := ", ".join(
            f"'{joint}' follows '{leader}'" for joint, leader in leaders(root).items()
        ):
            words += f"; joints that follow others (mimic) are not among them: {follow}"
        raise UsageError(f"{path}: {words}; --flange LINK names another end")
    return _Reader(path, root, end, description).arm()


def _judge_masses(path: Path, root: ElementTree.Element) -> None:
    for mass in root.iterfind("link/inertial/mass"):
        text = (mass.get("value") or "").strip()
        if is_number(text) and not 0.0 <= float(text) <= HEAVIEST:
            raise UsageError(f"{path}: a link has the mass {text} kg: correct or remove it")


def _flange(path: Path, root: ElementTree.Element, said: str | None) -> str:
    try:
        return choose_flange(root, said)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error


def _why_not(path: Path) -> str:
    """Return why a file has no robot in it."""
    try:
        ElementTree.parse(path)
    except (ElementTree.ParseError, OSError, ValueError) as error:
        return f"it cannot be read as XML: {error}"
    return "it has no element <robot>"


def _xacro(path: Path) -> str:
    written = path.is_file() and b"<xacro:" in path.read_bytes()
    return f"; xacro is expanded first: `xacro {path.name} > arm.urdf`" if written else ""


class _Reader:
    def __init__(
        self, path: Path, root: ElementTree.Element, end: str, description: Description
    ) -> None:
        self.path = path
        self.root = root
        self.end = end
        self.description = description
        mujoco = load_mujoco()
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        spec.compiler.fusestatic = False
        self.model: Any = spec.compile()
        self.at_zero = mujoco.MjData(self.model)
        self.at_zero.qpos[:] = 0.0
        mujoco.mj_kinematics(self.model, self.at_zero)
        self.chain = [self.model.joint(name).id for name in description.joint_names]
        self.T_base_link = [np.eye(4)]
        for step in description.steps:
            self.T_base_link.append(self.T_base_link[-1] @ step)
        self.assumed: list[str] = []
        chain = set(description.joint_names)
        if soft := [
            name for j in root.findall(f"joint[{SOFT}]") if (name := j.get("name", "")) in chain
        ]:
            words = "Ranges end at the soft limits of their safety_controller; its k_position and k_velocity are not used"
            self.assumed.append(f"{words}: {', '.join(soft)}.")

    def arm(self) -> UrdfArm:
        kept = self._kept()
        dof = len(self.chain)
        geoms: list[list[Geom]] = [[] for _ in range(dof + 1)]
        for geom in self.description.geoms:
            body = self.description.bodies[geom.body]
            if body.name in kept:
                geoms[body.link].append(geom)
        masses = tuple(self._mass(link, kept) for link in range(1, dof + 1))
        return UrdfArm(
            path=self.path,
            flange=self.end,
            description=self.description,
            links=tuple(str(self.model.body(self.model.jnt_bodyid[j]).name) for j in self.chain),
            geoms=tuple(map(tuple, geoms)),
            masses=masses,
            efforts=self._efforts(),
            T_link_hand=self._hand(),
            assumed=tuple(self.assumed),
        )

    def _kept(self) -> dict[str, int]:
        """Return the bodies of the arm, with the number of joints that move each: none beyond the flange or a side."""
        kept = {}
        left = []
        for body in range(1, self.model.nbody):
            above: list[int] = []
            at = body
            beyond = False
            while at != 0:
                first = int(self.model.body_jntadr[at])
                above += range(first, first + int(self.model.body_jntnum[at]))
                at = int(self.model.body_parentid[at])
                beyond = beyond or self.model.body(at).name == self.end
            name = str(self.model.body(body).name)
            if beyond or not set(above) <= set(self.chain):
                left.append(name)
            else:
                kept[name] = len(above)
        if left:
            self.assumed.append(
                f"Not taken over, since they hang on the flange or beside the arm: {', '.join(left)}."
            )
        return kept

    def _mass(self, link: int, kept: dict[str, int]) -> Mass:
        """Return the mass of all bodies that move as one link, in its frame; unstated ones are of shapes."""
        bodies = [self.model.body(name).id for name, moved in kept.items() if moved == link]
        masses = np.array([float(self.model.body_mass[body]) for body in bodies])
        to_link = inverse(self.T_base_link[link])
        stated = {
            part.get("name") for part in self.root.iter("link") if part.find("inertial") is not None
        }
        without = [name for name, moved in kept.items() if moved == link and name not in stated]
        if masses.sum() < LIGHTEST:
            self.assumed.append(
                f"The link of '{self.description.joint_names[link - 1]}' has no mass: {LEAST.mass:g} kg."
            )
            return LEAST
        if (
            without
            and masses[[name in without for name in map(self._body_name, bodies)]].sum() > LIGHTEST
        ):
            self.assumed.append(
                f"No mass is stated of {', '.join(without)}: that of water in its shape."
            )
        centres = self.at_zero.xipos[bodies] @ to_link[:3, :3].T + to_link[:3, 3]
        middle = masses @ centres / masses.sum()
        inertia = np.zeros((3, 3))
        for body, mass, centre in zip(bodies, masses, centres, strict=True):
            R = to_link[:3, :3] @ self.at_zero.ximat[body].reshape(3, 3)
            away = centre - middle
            inertia += R @ np.diag(self.model.body_inertia[body]) @ R.T
            inertia += mass * (away @ away * np.eye(3) - np.outer(away, away))
        return Mass(float(masses.sum()), middle, inertia)

    def _body_name(self, body: int) -> str:
        return str(self.model.body(body).name)

    def _efforts(self) -> Float64:
        said = {joint.get("name", ""): joint.find("limit") for joint in self.root.findall("joint")}
        efforts = []
        for name in self.description.joint_names:
            limit = said.get(name)
            try:
                effort = 0.0 if limit is None else float(limit.get("effort", "0"))
            except ValueError:
                effort = 0.0
            efforts.append(effort if np.isfinite(effort) and effort > 0.0 else 0.0)
        return np.array(efforts)

    def _hand(self) -> Float64:
        """Return T_link_hand: z is the flange's axis that is parallel to the last joint."""
        T: Float64 = self.description.T_link_frame[self.end].copy()
        axes = np.abs(T[2, :3])  # each axis along the joint, z of the last link
        along = int(axes.argmax()) if axes.max() > PARALLEL else 2
        if along != 2:
            self.assumed.append(
                f"The hand reaches along the {'xyz'[along]} axis of '{self.end}', the last joint's."
            )
            T[:3, :3] = T[:3, [(along + 1) % 3, (along + 2) % 3, along]]
        return T
