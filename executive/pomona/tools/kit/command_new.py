"""`pomona new`: a tree, a package, or a piece of one such as a skill or a node type: typed, tested, ready to run."""

from __future__ import annotations

import argparse
import keyword
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from string import Template
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.registry import Registry
from pomona.executive.values.installation import elsewhere, entry_points
from pomona.tools.kit.cell_folder import CAMERA, NONE, begin_cell
from pomona.tools.kit.package import EMPTY_TREE, OWN_TREE, PACKAGE, TREE
from pomona.tools.kit.piece import Piece

GROUP = "pomona.new"
FROM_FILE = "pomona.new_from_file"  # a kind that is begun from a file: (file, folder, options) -> files, next commands
KINDS_ELSEWHERE = (
    "arm",
    "cell",
    "driver",
    "fruit",
    "gripper",
)  # kinds of the distribution `pomona` that the executive alone lacks
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    kinds = sorted({point.name for point in entry_points(group=GROUP)} | {"package", "tree"})
    parser = subparsers.add_parser(
        "new", help="create a tree, a package, or a part of a package such as a skill"
    )
    parser.add_argument("kind", type=_kind, choices=kinds)
    parser.add_argument("name", help="such as Weigh; of an arm also its URDF: my_arm.urdf")
    about = "folder; an existing package gets the new part, otherwise a package is created"
    parser.add_argument("--into", type=Path, default=Path(), metavar="DIR", help=about)
    for option, about in (
        ("arm", "ur5e"),
        ("hand", "hand-e; a word that is none lists all"),
        ("camera", f"{CAMERA}, or {NONE} ({CAMERA})"),
    ):
        shown = (
            f"of a cell with these devices, such as {about}"
            if "cell" in kinds
            else argparse.SUPPRESS
        )
        parser.add_argument(f"--{option}", metavar="MODEL", help=shown)
    about = (
        "of an arm from its URDF: the link that the hand is bolted on"
        if "cell" in kinds
        else argparse.SUPPRESS
    )
    parser.add_argument("--flange", metavar="LINK", help=about)
    parser.set_defaults(main=main)


def _kind(word: str) -> str:
    """Return a kind that this installation can begin, or any other word, which argparse refuses.

    Raises UsageError: the distribution `pomona` begins it, and this is the executive alone.
    """
    if word in KINDS_ELSEWHERE and not entry_points(group=GROUP, name=word):
        raise UsageError(f"pomona new {word}: {elsewhere('this kind')}")
    return word


def main(options: argparse.Namespace) -> int:
    """Write the new files.

    Raises UsageError: the options do not fit, something is there already, or the folder takes no files.
    """
    try:
        return _begin(options)
    except OSError as error:
        place = Path(error.filename or options.into)
        if place == Path(options.name):  # of a kind that is begun from a file
            raise
        advice = "`--into DIR` names a folder that takes new files"
        raise UsageError(f"{place} cannot be written: {error.strerror}; {advice}") from error


def _begin(options: argparse.Namespace) -> int:
    if Path(options.name).suffix:  # no name, but a file
        written, commands = _from_file(options)
        return _report(written, commands)
    words, commands = _words(options.name), []
    if options.flange is not None:
        raise UsageError("--flange belongs to `pomona new arm FILE.urdf`")
    if (options.arm, options.hand, options.camera) != (None, None, None):
        if options.kind != "cell":
            raise UsageError(
                f"--arm, --hand and --camera belong to `pomona new cell`, not to {options.kind}"
            )
        camera = CAMERA if options.camera is None else options.camera
        written, commands = begin_cell(
            options.into / words["name"], options.arm, options.hand, camera
        )
        if options.camera is None:
            sys.stderr.write(f"camera: {CAMERA}, as none was named; without one: --camera {NONE}\n")
    elif options.kind == "package":
        written = begin(options.into / words["name"], words["name"])
    elif options.kind == "tree":
        written = _write(
            OWN_TREE if "MoveTo" in Registry.installed() else EMPTY_TREE, words, options.into
        )
    else:
        _refuse_taken(options.kind, words)
        (point,) = entry_points(group=GROUP, name=options.kind)
        written = put(point.load(), words, options.into)
    return _report(written, commands or [_next(written)])


def _report(written: list[Path], commands: list[str]) -> int:
    for path in written:
        sys.stdout.write(f"{path}\n")
    sys.stderr.write("next: " + "\n      ".join(commands) + "\n")
    return 0


def _from_file(options: argparse.Namespace) -> tuple[list[Path], list[str]]:
    """Begin a kind from a file. Raises UsageError: no file begins this kind."""
    for point in entry_points(group=FROM_FILE, name=options.kind):
        begun: tuple[list[Path], list[str]] = point.load()(
            Path(options.name), options.into, options
        )
        return begun
    raise UsageError(
        f"'{options.name}' is not a valid name: letters, digits and _, beginning with a letter"
    )


def _refuse_taken(kind: str, words: Mapping[str, str]) -> None:
    """Refuse a name that another package has: a tree that uses it would be refused.

    Raises UsageError: the name is taken.
    """
    name = words["Name"] if kind == "skill" else words["name"]
    taken: Mapping[str, object] = {}
    if kind == "skill":
        taken = Registry.installed()
    elif kind == "node":
        taken = NodeTypes.installed()
    found = taken.get(name)
    if found is not None:
        module = found.__module__ if isinstance(found, type) else type(found).__module__
        raise UsageError(
            f"{kind} '{name}' is installed already, in {module}: take another name. Nothing was written."
        )


def _next(written: list[Path]) -> str:
    """Return the next step: the new names of an installed package are found after it is installed again."""
    code = next((path for path in written if path.suffix == ".py"), None)
    if code is not None:
        project = next(folder for folder in code.parents if (folder / "pyproject.toml").is_file())
        return (
            f"pip install -e {project}, after which its new names are found; then pytest {project}"
        )
    return f"pomona check {next(path for path in written if path.suffix == '.yaml')}"


def put(piece: Piece, words: Mapping[str, str], into: Path) -> list[Path]:
    """Write a piece into a folder; code goes into the package that stands there, or into a new one.

    Raises UsageError: a file is there already, or the package is none.
    """
    if piece.entry is None:
        return _write(piece, words, into)
    written = []
    if not (into / "pyproject.toml").is_file():
        into = into / words["name"]
        written = begin(into, f"pomona_{words['name']}", example=False)
    module = _module(into)
    filled = {**words, "module": module}
    written += _write(piece, filled, into)
    _register(into / "pyproject.toml", *(Template(text).substitute(filled) for text in piece.entry))
    return written


def begin(folder: Path, module: str, *, example: bool = True) -> list[Path]:
    """Begin a package; with an example skill and a tree that uses it. Raises UsageError: there is something already."""
    words = {"name": module, "Name": _capitals(module), "module": module}
    written = _write(PACKAGE, words, folder)
    if example:
        (point,) = entry_points(group=GROUP, name="skill")
        skill = {"name": "hover", "Name": "Hover"}
        written += put(point.load(), skill, folder) + _write(TREE, {**words, **skill}, folder)
    return written


def _write(piece: Piece, words: Mapping[str, str], into: Path) -> list[Path]:
    texts = {
        into / Template(path).substitute(words): Template(text).substitute(words).encode()
        for path, text in piece.files.items()
    }
    texts |= {into / Template(path).substitute(words): make() for path, make in piece.data.items()}
    taken = [str(path) for path in texts if path.exists()]
    if taken:
        raise UsageError(f"{', '.join(taken)} is there already. Nothing was written.")
    for path, text in texts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text)
    return list(texts)


def _register(path: Path, group: str, name: str, target: str) -> None:
    """Add an entry point to a pyproject.toml, as text: comments stay."""
    text, head = path.read_text(encoding="utf-8"), f'[project.entry-points."{group}"]\n'
    line = f'{name} = "{target}"\n'
    text = (
        text.replace(head, head + line, 1) if head in text else f"{text.rstrip()}\n\n{head}{line}"
    )
    path.write_text(text, encoding="utf-8")


def _module(folder: Path) -> str:
    """Return the package that a project holds: the folder with an `__init__.py` and a `py.typed`."""
    found = sorted(
        path.parent.name
        for path in folder.glob("*/py.typed")
        if (path.parent / "__init__.py").is_file()
    )
    if len(found) != 1:
        raise UsageError(
            f"{folder} holds no package with __init__.py and py.typed: `pomona new package` begins one"
        )
    return found[0]


def _words(name: str) -> dict[str, str]:
    if not _NAME.fullmatch(name):
        raise UsageError(
            f"'{name}' is not a valid name: letters, digits and _, beginning with a letter"
        )
    small = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()
    if keyword.iskeyword(small) or small in ("pomona", "tests"):
        raise UsageError(f"'{small}' means something else already; take another name")
    return {"name": small, "Name": _capitals(name)}


def _capitals(name: str) -> str:
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))
