"""`pomona new arm FILE.urdf`: a simulated cell around another arm, in which it picks a fruit."""

from __future__ import annotations

import argparse
import shlex
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

from pomona.drivers.workspace import ObstacleSection
from pomona.executive.cell.cell_file import CellFile, read_cell_file
from pomona.executive.errors import UsageError
from pomona.executive.values.installation import installed_trees
from pomona.skills.motion.robot.errors import RobotError
from pomona.tools.kit.cell_folder import shipped_hand
from pomona.tools.own_arm.arm_urdf import UrdfArm, read_arm
from pomona.tools.own_arm.fit import Fitted, fit
from pomona.tools.own_arm.robot_xml import bodies

HAND = "wsg32"  # without --hand


def begin_arm(file: Path, into: Path, options: argparse.Namespace) -> tuple[list[Path], list[str]]:
    """Write the folder of a simulated cell with the arm of a URDF and a shipped hand.

    Returns its files, and the next commands.
    Raises UsageError: the file or the hand cannot be used, the arm is too short, or there is something already. Nothing
    is written then.
    """
    if options.arm is not None or options.camera is not None:
        raise UsageError("--arm and --camera belong to `pomona new cell`. Nothing was written.")
    hand = options.hand or HAND
    devices = shipped_hand(hand)
    folder = into / _name(file)
    if not file.is_file():
        raise UsageError(f"{file}: there is no such file. Nothing was written.")
    if folder.exists():
        raise UsageError(f"{folder} is there already. Nothing was written.")
    sys.stderr.write(f"reading {file}\n")
    arm = read_arm(file, options.flange)
    sim = read_cell_file(installed_trees() / "cells" / "sim.yaml")
    words = f"{arm.dof} joints up to '{arm.flange}'; trying where the hand {hand} reaches the poses of the cell sim"
    sys.stderr.write(f"{words}: up to a minute\n")
    try:
        fitted = fit(arm, hand, sim)
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
    words = "".join(
        letter if letter.isascii() and letter.isalnum() else "_" for letter in file.stem.lower()
    )
    return words.strip("_") or "own_arm"


def _cell(name: str, arm: UrdfArm, hand: str, devices: str, fitted: Fitted, sim: CellFile) -> str:
    lines = [
        f"# The simulated cell with the arm of {arm.path.name}: table and fruit of the shipped cell `sim`.",
        "include: sim.yaml",
        f"name: {name}",
        "",
        "world:",
        "  include: sim.yaml#world",
        "  robot: robot.xml",
    ]
    if fitted.nearer < 1.0 and sim.section.world is not None:
        lines.append(
            f"  places:                 # {100 * fitted.nearer:.0f} % as far from the base as in sim.yaml"
        )
        places = sim.section.world.values.places
        lines += [
            f"    {n}: {fitted.nearer * x:.3f} {fitted.nearer * y:.3f} m"
            for n, (x, y) in places.items()
        ]
    lines += [
        "",
        "workspace:",
        "  include: sim.yaml#workspace",
        "  obstacles:",
        *map(_obstacle, fitted.obstacles),
        "  poses:                  # joints from the base to the wrist",
    ]
    lines += [
        f"    {pose}: {' '.join(f'{angle:.4f}' for angle in q)} rad"
        for pose, q in fitted.reached.postures.items()
    ]
    return "\n".join(lines) + "\n" + devices


def _obstacle(box: ObstacleSection) -> str:
    centre, size = (" ".join(f"{x:.4g}" for x in numbers) for numbers in (box.centre, box.size))
    wall = "" if box.wall is None else f", wall: {box.wall:.4g} m"
    return f"    - {{name: {box.name}, centre: {centre} m, size: {size} m{wall}}}"


def _page(name: str, arm: UrdfArm, hand: str, fitted: Fitted) -> str:
    missing = fitted.reached.missing
    chain = (*bodies(arm), "tool0")
    beside = set(pairwise(chain))
    far = [
        f"{a} and {b}"
        for a, b in sorted(fitted.apart)
        if {a, b} <= set(chain) and (a, b) not in beside
    ]
    notes = [
        f"The hand {hand} is bolted on '{arm.flange}', turned by {np.degrees(fitted.turn):.0f}° about its approach.",
        "Accelerations, jerks, gains and armatures of the joints: a URDF has none of them.",
        *(
            ["Places of fruit and poses are nearer to the base than in `sim`: the arm is shorter."]
            if fitted.nearer < 1.0
            else []
        ),
        *(
            [
                f"Not checked for contact, since their hulls touch in most postures: {'; '.join(far)}."
            ]
            if far
            else []
        ),
        *([f"Out of reach, so left out: {', '.join(missing)}."] if missing else []),
        *arm.assumed,
    ]
    return _PAGE.format(
        name=name,
        source=arm.path.name,
        notes="\n".join(f"- {note}" for note in notes),
        commands="\n".join(f"    {command}" for command in _commands(Path("cell.yaml"))),
    )


def _commands(cell: Path) -> list[str]:
    return [
        f"pomona {word} pick_apple --cell {shlex.quote(str(cell))}{more}"
        for word, more in (("check", ""), ("run", " --seed 3"))
    ]


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
