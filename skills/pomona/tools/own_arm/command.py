"""`pomona new arm FILE.urdf`: a simulated cell around another arm, in which it picks a fruit."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pomona.drivers.interfaces import Workspace
from pomona.executive.cell.cell_file import CellFile, read_cell_file
from pomona.executive.errors import UsageError
from pomona.executive.values.arrays import Float64
from pomona.executive.values.installation import import_under, installed_trees
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.robot.errors import RobotError
from pomona.tools.kit.cell_folder import shipped_hand
from pomona.tools.own_arm.arm_urdf import UrdfArm, read_arm
from pomona.tools.own_arm.poses import Reached, always_touching, reach
from pomona.tools.own_arm.robot_xml import Drives, robot_xml

HAND = "wsg32"  # without --hand
TURNED = (0.0, np.pi, np.pi / 2.0, -np.pi / 2.0)  # of the hand on the flange, in the order of preference [rad]
NEARER = (1.0, 0.85, 0.7, 0.55)  # shares of the shipped distances from the base, for short arms
POSTURES = 64  # postures in which the inertia at each joint is looked up
ABOVE = 0.05  # height of a fruit's middle above the table [m]


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    """How an arm stands in the shipped cell."""

    turn: float  # of the hand [rad]
    nearer: float  # share of the shipped distances
    reached: Reached
    text: str  # robot.xml


def begin_arm(file: Path, into: Path, options: argparse.Namespace) -> tuple[list[Path], list[str]]:
    """Write the folder of a simulated cell with the arm of a URDF and a shipped hand.

    Returns its files, and the next commands.
    Raises UsageError: the file or the hand cannot be used, the arm is too short, or there is something already. Nothing
    is written then.
    """
    hand = options.hand or HAND
    devices = shipped_hand(hand)
    folder = into / _name(file)
    if not file.is_file():
        raise UsageError(f"{file}: there is no such file. Nothing was written.")
    if folder.exists():
        raise UsageError(f"{folder} is there already. Nothing was written.")
    arm = read_arm(file, options.flange)
    cells = installed_trees() / "cells"
    sim = read_cell_file(cells / "sim.yaml")
    try:
        fitted = _fit(arm, hand, sim)
    except RobotError as error:
        raise UsageError(f"{file}: {error}. Nothing was written.") from error
    texts = {
        "robot.xml": fitted.text,
        "cell.yaml": _cell(folder.name, arm, hand, devices, fitted, sim),
        "README.md": _page(folder.name, arm, hand, fitted),
    }
    folder.mkdir(parents=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts], _commands(folder / "cell.yaml")


def _name(file: Path) -> str:
    words = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in file.stem.lower())
    return words.strip("_") or "own_arm"


def _fit(arm: UrdfArm, hand: str, sim: CellFile) -> _Fitted:
    """Return the first distance and the best turn of the hand at which all poses, or most, are reached."""
    with TemporaryDirectory() as scratch:
        drives = Drives.of(arm, _inertia(arm, hand, Path(scratch)))
        plain = _model(robot_xml(arm, hand, 0.0, drives, ()), Path(scratch) / "plain.xml")
        apart = always_touching(plain)
        texts = {turn: robot_xml(arm, hand, turn, drives, apart) for turn in TURNED}
        models = {turn: _model(text, Path(scratch) / f"turned_{n}.xml") for n, (turn, text) in enumerate(texts.items())}
        best = None
        for nearer in NEARER:
            wanted = _wanted(sim, nearer)
            for turn, model in models.items():
                found = reach(model, sim.workspace, wanted)
                if found.usable and (best is None or len(found.missing) < len(best.reached.missing)):
                    best = _Fitted(turn, nearer, found, texts[turn])
                if best is not None and not best.reached.missing:
                    return best
            if best is not None:
                return best
    words = f"reaches neither the pose home nor observe of the cell sim, even {100 * NEARER[-1]:.0f} % as far from its base"
    raise UsageError(f"{arm.path}: with the hand {hand} on '{arm.flange}' it {words}. Is '{arm.flange}' its flange? (--flange LINK)")


def _model(text: str, path: Path) -> RobotModel:
    path.write_text(text, encoding="utf-8")
    return RobotModel.load(path)


def _inertia(arm: UrdfArm, hand: str, scratch: Path) -> Float64:
    """Return the largest inertia that each joint moves, hand included, (dof,) [kg m²]."""
    mujoco = import_under("mujoco", MUJOCO_GL="disable")
    path = scratch / "plain_drives.xml"
    path.write_text(robot_xml(arm, hand, 0.0, Drives.of(arm, np.ones(arm.dof)), ()), encoding="utf-8")
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise UsageError(f"{arm.path}: MuJoCo cannot use it as an arm: {' '.join(str(error).split())}") from error
    model.dof_armature[:] = 0.0
    data, full, most = mujoco.MjData(model), np.zeros((model.nv, model.nv)), np.zeros(arm.dof)
    about = arm.description
    for q in np.random.default_rng(0).uniform(np.maximum(about.lower, -np.pi), np.minimum(about.upper, np.pi), (POSTURES, arm.dof)):
        data.qpos[: arm.dof] = q
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        most = np.maximum(most, np.diag(full)[: arm.dof])
    return most


def _wanted(sim: CellFile, nearer: float) -> Mapping[str, Float64]:
    """Return T_base_tool0 of the poses of the shipped arm, at a share of their distance from the base."""
    workspace: Workspace = sim.workspace
    shipped = RobotModel.load(sim.section.world.values.robot)
    poses = {name: shipped.fk(q) for name, q in workspace.poses.items()}
    poses = {name: poses[name] for name in sorted(poses, key=lambda name: name != "observe")}  # the first is tried first
    for T in poses.values():
        T[:2, 3] *= nearer
    return poses


def _cell(name: str, arm: UrdfArm, hand: str, devices: str, fitted: _Fitted, sim: CellFile) -> str:
    lines = [
        f"# The simulated cell with the arm of {arm.path.name}: table and fruit of the shipped cell `sim`.",
        "include: sim.yaml",
        f"name: {name}",
        "",
        "world:",
        "  include: sim.yaml#world",
        "  robot: robot.xml",
    ]
    if fitted.nearer < 1.0:
        lines.append(f"  places:                 # {100 * fitted.nearer:.0f} % as far from the base as in sim.yaml")
        places = sim.section.world.values.places
        lines += [f"    {n}: {fitted.nearer * x:.3f} {fitted.nearer * y:.3f} m" for n, (x, y) in places.items()]
    lines += ["", "workspace:", "  include: sim.yaml#workspace", "  poses:                  # joints from the base to the wrist"]
    lines += [f"    {pose}: {' '.join(f'{angle:.4f}' for angle in q)} rad" for pose, q in fitted.reached.postures.items()]
    return "\n".join(lines) + "\n" + devices


def _page(name: str, arm: UrdfArm, hand: str, fitted: _Fitted) -> str:
    missing = fitted.reached.missing
    notes = [
        f"The hand {hand} is bolted on '{arm.flange}', turned by {np.degrees(fitted.turn):.0f}° about its approach.",
        "Accelerations, jerks, gains and armatures of the joints: a URDF has none of them.",
        *(["Places of fruit and poses are nearer to the base than in `sim`: the arm is shorter."] if fitted.nearer < 1.0 else []),
        *([f"Out of reach, so left out: {', '.join(missing)}."] if missing else []),
        *arm.assumed,
    ]
    return _PAGE.format(name=name, source=arm.path.name, notes="\n".join(f"- {note}" for note in notes), commands="\n".join(f"    {command}" for command in _commands(Path("cell.yaml"))))


def _commands(cell: Path) -> list[str]:
    return [f"pomona {word} pick_apple --cell {shlex.quote(str(cell))}{more}" for word, more in (("check", ""), ("run", " --seed 3"))]


_PAGE = """# {name}: the arm of {source} in a simulated cell

| file | content |
|---|---|
| cell.yaml | the simulated cell: poses by inverse kinematics |
| robot.xml | chain, limits, masses and shapes of the URDF, with the hand |

## Assumed, so to be compared with your arm

{notes}

## Commands

{commands}

A driver of the real arm takes `robot.xml` as its `robot:`: `pomona new arm NAME` begins one.
"""
