"""`pomona new cell NAME --arm … --hand … --camera …`: a real cell, its emulated twin, a simulated one, its robot."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from string import Template
from textwrap import indent

from pomona.executive.errors import UsageError
from pomona.executive.values.installation import entry_points, installed_trees
from pomona.executive.values.kinds import choose
from pomona.tools.kit.cell_piece import GROUP, CellPiece

CAMERA, NONE = (
    "d435i",
    "none",
)  # without `--camera`, since no shipped tree picks blind; and `--camera none`
_INCLUDE = re.compile(r'^[ \t]*<include file="([^"]+)"/>.*\n', re.MULTILINE)
_ROOT = re.compile(r"</?mujoco[^>]*>\n?")
WORLD_CAMERA = "127.0.0.1:41001"  # of the emulated world, which always has a camera

FILES = {
    "cell.yaml": """# The real cell: $devices. Fill in `options` and `workspace`; README.md lists the calibrations.
# `emulated.yaml` is the same cell without devices: it takes arm, gripper and workspace from this file.
name: $name
kind: real
record: required              # no run without its record: when the disk is full, the cell goes to its safe state

options:                      # addresses: fill in yours
$addresses

workspace:                    # in the base frame; keys beside `include` override it, such as table_z and poses
  include: $workspace

devices:
$real
""",
    "emulated.yaml": """# The twin of cell.yaml: the real drivers on emulated devices, on virtual time.
name: ${name}_emulated
kind: emulated

options:
  fruit: apple_1          # which fruit to pick: apple_1 … apple_5
  place: 3                # where it lies: 1 … 5
  others: 0
  distractors: 2
$twin_addresses

score: {include: sim.yaml#score}

workspace: {include: cell.yaml#workspace}

world:
  driver: emulated-world
  cell: simulated.yaml
  options: {fruit: "{fruit}", place: "{place}", others: "{others}", distractors: "{distractors}"}
  arm: "{arm}"
  controller: $controller
  gripper: "{gripper}"
  hand: $hand
  camera: "{camera}"

devices:
$twin
""",
    "simulated.yaml": """# The simulated cell with this robot: table and fruit of the shipped cell `sim`.
include: sim.yaml
name: ${name}_simulated

world:
  include: sim.yaml#world
  robot: robot.xml

workspace: {include: cell.yaml#workspace}

devices:
$simulated
""",
    "README.md": """# $name: $devices

| file | content |
|---|---|
| cell.yaml | the real cell: addresses, surroundings, devices |
| emulated.yaml | its twin: the same drivers on emulated devices |
| simulated.yaml | the simulated cell behind the twin |
| robot.xml | description of the robot: limits, shapes, camera |

Nothing here was measured on your devices.

## Due before the first motion

$due

## Commands

The doctor connects, reads rates, calibrations and limits, and moves nothing:

    pomona doctor --cell cell.yaml

A pick on the twin:

$commands
""",
}

COMMON = (
    "`workspace` in cell.yaml: table height, bounds, obstacles and poses of your cell.",
    "robot.xml: compare fingers, camera mount and masses with yours.",
)


def begin_cell(
    folder: Path, arm: str | None, hand: str | None, camera: str = CAMERA
) -> tuple[list[Path], list[str]]:
    """Write the folder of a cell; its name is that of the cell.

    Returns its files, and the next commands.
    Raises UsageError: an unknown device, no shipped robot, or there is something already. Nothing is written then.
    """
    if arm is None or hand is None:
        raise UsageError(f"a cell of devices needs --arm and --hand: {_possible(_pieces())}")
    pieces = _pieces()
    arm, hand = _choose(pieces, "arm", arm, "--arm"), _choose(pieces, "gripper", hand, "--hand")
    camera = camera if camera == NONE else _choose(pieces, "camera", camera, "--camera")
    chosen = [pieces[name] for name in (arm, hand, camera) if name != NONE]
    robot = _robot(arm, hand)
    if not robot.is_file():
        raise UsageError(
            f"no robot description of {arm} with {hand} is shipped: {_possible(pieces)}"
        )
    if folder.exists():
        raise UsageError(f"{folder} is there already. Nothing was written.")
    words = {"name": folder.name, "devices": f"{arm}, {hand}, camera {camera}", **_words(chosen)}
    texts = {name: Template(text).substitute(words) for name, text in FILES.items()}
    texts["robot.xml"] = composed(robot)
    folder.mkdir(parents=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts], _commands(chosen, folder)


def composed(robot: Path) -> str:
    """Return a robot's description with the files of its hand in the places of their `include`."""
    return inlined(robot.read_text("utf-8"), robot.parent)


def inlined(text: str, folder: Path) -> str:
    """Return a description with the contents of files of a folder in the places of their `include`."""

    def content(include: re.Match[str]) -> str:
        return _ROOT.sub("", (folder / include[1]).read_text("utf-8"))

    return _INCLUDE.sub(content, text)


def shipped_hand(hand: str) -> str:
    """Return the block `devices:` of a simulated cell with a shipped hand. Raises UsageError: there is none."""
    pieces = _pieces()
    piece = pieces[_choose(pieces, "gripper", hand, "--hand")]
    blocks = {
        name: f"include: sim.yaml#devices/{name}"
        for name in ("arm", "gripper", "fingers", "hands", "camera")
    }
    blocks["gripper"] = piece.simulated
    return (
        "\ndevices:\n"
        + _lines(f"{role}:\n{indent(text.strip(), '  ')}" for role, text in blocks.items())
        + "\n"
    )


def _pieces() -> dict[str, CellPiece]:
    return {
        point.name: point.load()
        for point in sorted(entry_points(group=GROUP), key=lambda point: point.name)
    }


def _choose(pieces: Mapping[str, CellPiece], role: str, word: str, option: str) -> str:
    """Return the piece's name; case, hyphens and underscores of the word are free: 2F-85, hand_e, xarm-6."""
    known = [name for name, piece in pieces.items() if piece.role == role]
    for name in known:
        if re.sub("[-_ ]", "", name) == re.sub("[-_ ]", "", word.lower()):
            return name
    other = _other() if role == "arm" else ""
    raise UsageError(
        f"{option}: no '{word}' is known here ({choose(word, known)}{other}). Nothing was written."
    )


def _other() -> str:
    """Return the way to arms that no description is shipped of; empty where nothing makes one."""
    there = entry_points(group="pomona.new_from_file", name="arm")
    return (
        "; any other arm: `pomona new arm ITS.urdf` makes its robot.xml and a simulated cell"
        if there
        else ""
    )


def _robot(arm: str, hand: str) -> Path:
    return installed_trees() / "robots" / f"{arm}_{hand}.xml".replace("-", "_")


def _possible(pieces: Mapping[str, CellPiece]) -> str:
    """Return the arms and hands that a shipped description has, and the way to others."""
    arms, hands = (
        [name for name, piece in pieces.items() if piece.role == role]
        for role in ("arm", "gripper")
    )
    pairs = [
        f"--arm {arm} --hand {hand}"
        for arm in arms
        for hand in hands
        if _robot(arm, hand).is_file()
    ]
    return f"possible are {'; '.join(pairs)}{_other()}. Nothing was written."


def _words(chosen: list[CellPiece]) -> dict[str, str]:
    arm, hand, *_ = chosen
    twins = {piece.role: piece.twin_address for piece in (arm, hand)}
    every = [each for piece in chosen for each in (piece, *piece.beside)]
    blocks = {
        "real": [(piece.role, piece.device) for piece in every],
        "twin": [
            (piece.role, piece.twin or f"include: cell.yaml#devices/{piece.role}")
            for piece in every
        ],
        "simulated": [(piece.role, piece.simulated) for piece in every],
    }
    if len(chosen) < 3:  # the emulated world shows a camera
        blocks["simulated"].append(("camera", "include: sim.yaml#devices/camera"))
    return {
        "addresses": _lines(
            _option(piece.role, piece.address, piece.address_help)
            for piece in chosen
            if piece.address
        ),
        "twin_addresses": _lines(
            f"{role}: {text}" for role, text in (twins | {"camera": WORLD_CAMERA}).items()
        ),
        "workspace": arm.workspace,
        "controller": arm.emulator,
        "hand": hand.emulator,
        "due": "\n".join(
            f"- [ ] {text}" for text in (*COMMON, *(text for piece in every for text in piece.due))
        ),
        "commands": indent("\n".join(_commands(chosen, Path())[:2]), "    "),
        **{
            name: _lines(f"{role}:\n{indent(text.strip(), '  ')}" for role, text in of)
            for name, of in blocks.items()
        },
    }


def _option(role: str, address: str, about: str) -> str:
    return f"{f'{role}: {address}':<26}  # {about}"


def _lines(texts: Iterable[str]) -> str:
    return indent("\n".join(texts), "  ")


def _commands(chosen: list[CellPiece], folder: Path) -> list[str]:
    """Return three commands: two on the twin, and the doctor's on the real cell."""
    real, twin = (shlex.quote(str(folder / name)) for name in ("cell.yaml", "emulated.yaml"))
    doctor = f"pomona doctor --cell {real}"
    if len(chosen) < 3:  # no tree that is shipped picks without a camera
        return [f"pomona check {twin}", f"pomona doctor --cell {twin}", doctor]
    settings = "".join(
        f' --set {name}="{text}"'
        for piece in chosen
        for name, text in (part.split("=") for part in piece.settings)
    )
    words = f"pick_apple_plain --cell {twin}{settings}"
    return [f"pomona check {words}", f"pomona run {words}", doctor]
