"""`pomona new cell NAME --arm … --hand … --camera …`: a real cell, its emulated twin, a simulated one, its robot."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping
from itertools import product
from pathlib import Path
from string import Template
from textwrap import indent

from pomona.executive.cell.cell_piece import CellPiece
from pomona.executive.errors import UsageError
from pomona.executive.values.installation import entry_points, installed_trees
from pomona.executive.values.kinds import choose
from pomona.tools.kit.pieces import TEMPLATES

PIECES = "pomona.cell_pieces"  # entry points: devices, and as `arm` the maker of a cell around the arm of a file
CAMERA = "d435i"  # without `--camera`, since no shipped tree picks blind
NONE = "none"
_INCLUDE = re.compile(r'^[ \t]*<include file="([^"]+)"/>.*\n', re.MULTILINE)
_ROOT = re.compile(r"</?mujoco[^>]*>\n?")
WORLD_CAMERA = "127.0.0.1:41001"  # of the emulated world, which always has a camera

FILES = ("cell.yaml", "emulated.yaml", "simulated.yaml", "README.md")
_BLOCK = re.compile(r"^  # (\$\w+)$", re.MULTILINE)  # stands for lines of a template

COMMON = (
    "`workspace` in cell.yaml: table height, bounds, obstacles and poses of your cell.",
    "robot.xml: compare fingers, camera mount and masses with yours.",
)


def cell_folder(
    folder: Path, arm: str | None, hand: str | None, camera: str = CAMERA
) -> tuple[dict[Path, bytes], list[str]]:
    """Return the files of a cell, whose name is that of the folder, and the next commands.

    Raises UsageError: an unknown device, no shipped robot, or the folder is there already.
    """
    pieces = _pieces()
    if arm is None or hand is None:
        raise UsageError(f"a cell of devices needs --arm and --hand: {_possible(pieces)}")
    arm = _choose(pieces, "arm", arm, "--arm")
    hand = _choose(pieces, "gripper", hand, "--hand")
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
    texts = {name: _filled(name, words) for name in FILES}
    texts["robot.xml"] = inlined(robot.read_text("utf-8"), robot.parent)
    return {folder / name: text.encode() for name, text in texts.items()}, _commands(chosen, folder)


def _filled(name: str, words: Mapping[str, str]) -> str:
    text = (TEMPLATES / "devices" / name).read_text("utf-8")
    return Template(_BLOCK.sub(r"\1", text)).substitute(words)


def inlined(text: str, folder: Path) -> str:
    """Return a description with the contents of files of a folder in the places of their `include`."""

    def content(include: re.Match[str]) -> str:
        return _ROOT.sub("", (folder / include[1]).read_text("utf-8"))

    return _INCLUDE.sub(content, text)


def shipped_hand(hand: str) -> str:
    """Return the block `devices:` of a simulated cell with a shipped hand. Raises UsageError: there is none."""
    pieces = _pieces()
    names = ("arm", "gripper", "fingers", "hands", "camera")
    blocks = {name: f"include: sim.yaml#devices/{name}" for name in names}
    blocks["gripper"] = pieces[_choose(pieces, "gripper", hand, "--hand")].simulated
    return f"\ndevices:\n{_blocks(blocks)}\n"


def _pieces() -> dict[str, CellPiece]:
    points = sorted(entry_points(group=PIECES), key=lambda point: point.name)
    return {point.name: point.load() for point in points if point.name != "arm"}


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
    if not entry_points(group=PIECES, name="arm"):
        return ""
    return "; any other arm: `pomona new arm ITS.urdf` makes its robot.xml and a simulated cell"


def _robot(arm: str, hand: str) -> Path:
    return installed_trees() / "robots" / f"{arm}_{hand}.xml".replace("-", "_")


def _possible(pieces: Mapping[str, CellPiece]) -> str:
    """Return the arms and hands that a shipped description has, and the way to others."""
    pairs = [
        f"--arm {arm} --hand {hand}"
        for arm, hand in product(pieces, pieces)
        if (pieces[arm].role, pieces[hand].role) == ("arm", "gripper")
        and _robot(arm, hand).is_file()
    ]
    return f"possible are {'; '.join(pairs)}{_other()}. Nothing was written."


def _words(chosen: list[CellPiece]) -> dict[str, str]:
    arm, hand, *_ = chosen
    every = [each for piece in chosen for each in (piece, *piece.beside)]
    due = (*COMMON, *(text for piece in every for text in piece.due))
    twins = {"arm": arm.twin_address, "gripper": hand.twin_address, "camera": WORLD_CAMERA}
    there = [piece for piece in chosen if piece.address]
    # the emulated world shows a camera
    simulated = {"camera": "include: sim.yaml#devices/camera"} if len(chosen) < 3 else {}
    return {
        "addresses": _lines(_option(p.role, p.address, p.address_help) for p in there),
        "twin_addresses": _lines(f"{role}: {text}" for role, text in twins.items()),
        "workspace": arm.workspace,
        "controller": arm.emulator,
        "hand": hand.emulator,
        "due": "\n".join(f"- [ ] {text}" for text in due),
        "commands": indent("\n".join(_commands(chosen, Path())[:2]), "    "),
        "real": _blocks({p.role: p.device for p in every}),
        "twin": _blocks({p.role: p.twin or f"include: cell.yaml#devices/{p.role}" for p in every}),
        "simulated": _blocks({p.role: p.simulated for p in every} | simulated),
    }


def _blocks(devices: Mapping[str, str]) -> str:
    return _lines(f"{role}:\n{indent(text.strip(), '  ')}" for role, text in devices.items())


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
    values = [value.replace("=", '="', 1) for piece in chosen for value in piece.settings]
    settings = "".join(f' --set {value}"' for value in values)
    words = f"pick_apple_plain --cell {twin}{settings}"
    return [f"pomona check {words}", f"pomona run {words}", doctor]
