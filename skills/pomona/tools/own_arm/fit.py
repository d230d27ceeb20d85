"""An arm in the shipped cell `sim`: turn of its hand, distances, pedestal, poses, and drives for its masses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pomona.drivers.workspace import ObstacleSection, WorkspaceSection
from pomona.executive.cell.cell_file import CellFile
from pomona.executive.errors import UsageError
from pomona.executive.values.arrays import Float64
from pomona.executive.values.installation import load_mujoco
from pomona.skills.motion.robot import RobotModel
from pomona.tools.own_arm.arm_urdf import UrdfArm
from pomona.tools.own_arm.poses import HOME, OBSERVE, Reached, lowest, never_apart, reach
from pomona.tools.own_arm.robot_xml import Drives, robot_xml

TURNED = (
    0.0,
    np.pi,
    np.pi / 2.0,
    -np.pi / 2.0,
)  # of the hand on the flange, in the order of preference [rad]
NEARER = (1.0, 0.85, 0.7, 0.55)  # shares of the shipped distances from the base, for short arms
TOWARDS = (
    0.0,
    0.25,
    0.5,
    0.75,
    1.0,
)  # alternatives of the rest pose: shares of the way to the observe pose
POSTURES = 64  # postures in which the inertia at each joint is looked up
PEDESTAL = "pedestal"  # the obstacle of the shipped cell on which the base stands
GAP = 0.012  # between the pedestal and the lowest part that moves: the arm's margin of 10 mm, and 2 mm [m]


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """An arm in the shipped cell."""

    turn: float  # of the hand [rad]
    nearer: float  # share of the shipped distances
    apart: frozenset[tuple[str, str]]  # pairs of bodies that are not checked for contact
    obstacles: tuple[
        ObstacleSection, ...
    ]  # those of the shipped cell, the pedestal below all that moves
    reached: Reached
    text: str  # robot.xml


def fit(arm: UrdfArm, hand: str, sim: CellFile) -> Fitted:
    """Return the first distance and the best turn of the hand at which all poses, or most, are reached.

    Raises UsageError: neither home nor observe is reached.
    """
    with TemporaryDirectory() as scratch:
        drives = Drives.of(arm, _inertia(arm, hand, Path(scratch)))
        plain = _model(robot_xml(arm, hand, 0.0, drives, ()), Path(scratch) / "plain.xml")
        apart = never_apart(plain)
        around = _surroundings(sim, lowest(plain))
        texts = {turn: robot_xml(arm, hand, turn, drives, apart) for turn in TURNED}
        models = {
            turn: _model(text, Path(scratch) / f"turned_{n}.xml")
            for n, (turn, text) in enumerate(texts.items())
        }
        best = None
        for nearer in NEARER:
            wanted = _wanted(sim, nearer)
            for turn, model in models.items():
                found = reach(model, around.workspace(), wanted)
                if found.usable and (
                    best is None or len(found.missing) < len(best.reached.missing)
                ):
                    best = Fitted(
                        turn, nearer, frozenset(apart), around.obstacles, found, texts[turn]
                    )
                if best is not None and not best.reached.missing:
                    return best
            if best is not None:
                return best
    words = f"reaches neither the pose home nor observe of the cell sim, even {100 * NEARER[-1]:.0f} % as far from its base"
    raise UsageError(
        f"{arm.path}: with the hand {hand} on '{arm.flange}' it {words}. Is '{arm.flange}' its flange? (--flange LINK)"
    )


def _model(text: str, path: Path) -> RobotModel:
    path.write_text(text, encoding="utf-8")
    return RobotModel.load(path)


def _inertia(arm: UrdfArm, hand: str, scratch: Path) -> Float64:
    """Return the largest inertia that each joint moves, hand included, (dof,) [kg m²]."""
    mujoco = load_mujoco()
    path = scratch / "plain_drives.xml"
    path.write_text(
        robot_xml(arm, hand, 0.0, Drives.of(arm, np.ones(arm.dof)), ()), encoding="utf-8"
    )
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise UsageError(
            f"{arm.path}: MuJoCo cannot use it as an arm: {' '.join(str(error).split())}"
        ) from error
    model.dof_armature[:] = 0.0
    data = mujoco.MjData(model)
    full = np.zeros((model.nv, model.nv))
    most = np.zeros(arm.dof)
    about = arm.description
    for q in np.random.default_rng(0).uniform(
        np.maximum(about.lower, -np.pi), np.minimum(about.upper, np.pi), (POSTURES, arm.dof)
    ):
        data.qpos[: arm.dof] = q
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        most = np.maximum(most, np.diag(full)[: arm.dof])
    return most


def _surroundings(sim: CellFile, lowest_part: float) -> WorkspaceSection:
    """Return those of the shipped cell, with the pedestal below the lowest part that moves [m]."""
    section: WorkspaceSection = sim.section.workspace
    top = min(0.0, lowest_part - GAP)

    def lowered(obstacle: ObstacleSection) -> ObstacleSection:
        if obstacle.name != PEDESTAL:
            return obstacle
        (x, y, z), (length, width, height) = obstacle.centre, obstacle.size
        bottom = z - height / 2.0
        return replace(
            obstacle, centre=(x, y, (top + bottom) / 2.0), size=(length, width, top - bottom)
        )

    if top <= min(box.centre[2] - box.size[2] / 2.0 for box in section.obstacles):
        return replace(
            section, obstacles=tuple(box for box in section.obstacles if box.name != PEDESTAL)
        )
    return replace(section, obstacles=tuple(map(lowered, section.obstacles)))


def _wanted(sim: CellFile, nearer: float) -> Mapping[str, Sequence[Float64]]:
    """Return T_base_tool0 of the poses of the shipped arm, at a share of their distance from the base.

    A rest pose may stand anywhere: that of the shipped arm, or on the way from it to where the camera observes.
    """
    assert sim.section.world is not None, "the shipped cell has one"
    shipped = RobotModel.load(sim.section.world.values.robot)
    poses = {name: shipped.fk(q) for name, q in sim.workspace.poses.items()}
    for T in poses.values():
        T[:2, 3] *= nearer
    observe = poses.pop(OBSERVE)
    wanted: dict[str, Sequence[Float64]] = {
        OBSERVE: [observe],
        **{name: [T] for name, T in poses.items()},
    }
    for share in TOWARDS if HOME in poses else ():
        between = observe.copy()
        between[:3, 3] += (1.0 - share) * (poses[HOME][:3, 3] - observe[:3, 3])
        wanted[HOME] = [*wanted[HOME], between]
    return wanted
