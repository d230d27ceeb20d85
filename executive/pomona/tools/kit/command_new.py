"""`pomona new`: a tree, a package, or a piece of one such as a skill or a node type: typed, tested, ready to run."""

from __future__ import annotations

import argparse
import keyword
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.registry import Registry
from pomona.executive.values.installation import elsewhere, entry_points
from pomona.tools.kit.cell_folder import CAMERA, NONE, PIECES, cell_folder
from pomona.tools.kit.pieces import (
    EMPTY_TREE,
    EXAMPLE_TREE,
    KINDS,
    KINDS_ELSEWHERE,
    OWN_TREE,
    PACKAGE,
    SKILL,
    Piece,
    PieceNames,
    capitals,
)

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    known = _known()
    about = "create a tree, a package, or a part of a package such as a skill"
    parser = subparsers.add_parser("new", help=about)
    parser.add_argument("kind", type=_kind, choices=sorted({*known, "package", "tree"}))
    parser.add_argument("name", help="such as Weigh; of an arm also its URDF: my_arm.urdf")
    about = "folder; an existing package gets the new part, otherwise a package is created"
    parser.add_argument("--into", type=Path, default=Path(), metavar="DIR", help=about)
    devices = "of a cell with these devices, such as"
    for option, metavar, about in (
        ("--arm", "MODEL", f"{devices} ur5e"),
        ("--hand", "MODEL", f"{devices} hand-e; a word that is none lists all"),
        ("--camera", "MODEL", f"{devices} {CAMERA}, or {NONE} ({CAMERA})"),
        ("--flange", "LINK", "of an arm from its URDF: the link that the hand is bolted on"),
    ):
        shown = about if "cell" in known else argparse.SUPPRESS
        parser.add_argument(option, metavar=metavar, help=shown)
    parser.set_defaults(main=main)


def _known() -> Mapping[str, Piece]:
    """Return the kinds that this installation can begin."""
    is_whole = find_spec("pomona.drivers") is not None
    return {**KINDS, **KINDS_ELSEWHERE} if is_whole else KINDS


def _kind(word: str) -> str:
    """Return a kind that this installation can begin, or any other word, which argparse refuses.

    Raises UsageError: the distribution `pomona` begins it, and this is the executive alone.
    """
    if word in KINDS_ELSEWHERE and word not in _known():
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
    names = _names(options.name)
    if options.flange is not None:
        raise UsageError("--flange belongs to `pomona new arm FILE.urdf`")
    if (options.arm, options.hand, options.camera) != (None, None, None):
        return _begin_cell(options, options.into / names.small)
    if options.kind == "package":
        written = begin(options.into / names.small, names.small)
    elif options.kind == "tree":
        piece = OWN_TREE if "MoveTo" in Registry.installed() else EMPTY_TREE
        written = _write(piece.files(names, options.into))
    else:
        _refuse_taken(options.kind, names)
        written = put(_known()[options.kind], names, options.into)
    return _report(written, [_next(written)])


def _begin_cell(options: argparse.Namespace, folder: Path) -> int:
    if options.kind != "cell":
        words = "--arm, --hand and --camera belong to `pomona new cell`"
        raise UsageError(f"{words}, not to {options.kind}")
    camera = CAMERA if options.camera is None else options.camera
    files, commands = cell_folder(folder, options.arm, options.hand, camera)
    if options.camera is None:
        sys.stderr.write(f"camera: {CAMERA}, as none was named; without one: --camera {NONE}\n")
    return _report(_write(files), commands)


def _report(written: list[Path], commands: list[str]) -> int:
    for path in written:
        sys.stdout.write(f"{path}\n")
    sys.stderr.write("next: " + "\n      ".join(commands) + "\n")
    return 0


def _from_file(options: argparse.Namespace) -> tuple[list[Path], list[str]]:
    """Begin a kind from a file; where nothing begins this kind from one, the file is taken for a name."""
    for point in entry_points(group=PIECES, name=options.kind):
        file = Path(options.name)
        begun: tuple[list[Path], list[str]] = point.load()(file, options.into, options)
        return begun
    raise _no_name(options.name)


def _refuse_taken(kind: str, names: PieceNames) -> None:
    """Refuse a name that another package has: a tree that uses it would be refused.

    Raises UsageError: the name is taken.
    """
    name = names.capital if kind == "skill" else names.small
    installed: Mapping[str, Callable[[], Mapping[str, object]]] = {
        "skill": Registry.installed,
        "node": NodeTypes.installed,
    }
    found = installed[kind]().get(name) if kind in installed else None
    if found is not None:
        module = found.__module__ if isinstance(found, type) else type(found).__module__
        words = f"{kind} '{name}' is installed already, in {module}"
        raise UsageError(f"{words}: take another name. Nothing was written.")


def _next(written: list[Path]) -> str:
    """Return the next step: the new names of an installed package are found after it is installed again."""
    code = next((path for path in written if path.suffix == ".py"), None)
    if code is None:
        return f"pomona check {next(path for path in written if path.suffix == '.yaml')}"
    project = next(folder for folder in code.parents if (folder / "pyproject.toml").is_file())
    return f"pip install -e {project}, after which its new names are found; then pytest {project}"


def put(piece: Piece, names: PieceNames, into: Path) -> list[Path]:
    """Write a piece into a folder; code goes into the package that stands there, or into a new one.

    Raises UsageError: a file is there already, or the package is none.
    """
    if not piece.entry:
        return _write(piece.files(names, into))
    written = []
    if not (into / "pyproject.toml").is_file():
        into = into / names.small
        written = begin(into, f"pomona_{names.small}", example=False)
    names = replace(names, module=_module(into))
    written += _write(piece.files(names, into))
    _register(into / "pyproject.toml", *(piece.renamed(text, names) for text in piece.entry))
    return written


def begin(folder: Path, module: str, *, example: bool = True) -> list[Path]:
    """Begin a package; with an example skill and a tree that uses it. Raises UsageError: there is something already."""
    written = _write(PACKAGE.files(PieceNames(module, capitals(module), module), folder))
    if example:
        names = PieceNames(SKILL.name, capitals(SKILL.name), module)
        written += put(SKILL, names, folder) + _write(EXAMPLE_TREE.files(names, folder))
    return written


def _write(files: Mapping[Path, bytes]) -> list[Path]:
    """Write new files, all or none. Raises UsageError: one is there already."""
    taken = [str(path) for path in files if path.exists()]
    if taken:
        raise UsageError(f"{', '.join(taken)} is there already. Nothing was written.")
    for path, data in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return list(files)


def _register(path: Path, group: str, name: str, target: str) -> None:
    """Add an entry point to a pyproject.toml, as text: comments stay."""
    text = path.read_text(encoding="utf-8")
    head = f'[project.entry-points."{group}"]\n'
    line = f'{name} = "{target}"\n'
    if head in text:
        text = text.replace(head, head + line, 1)
    else:
        text = f"{text.rstrip()}\n\n{head}{line}"
    path.write_text(text, encoding="utf-8")


def _module(folder: Path) -> str:
    """Return the package that a project holds: the folder with an `__init__.py` and a `py.typed`."""
    found = [path.parent for path in folder.glob("*/py.typed")]
    found = [module for module in found if (module / "__init__.py").is_file()]
    if len(found) != 1:
        words = "holds no package with __init__.py and py.typed"
        raise UsageError(f"{folder} {words}: `pomona new package` begins one")
    return found[0].name


def _names(name: str) -> PieceNames:
    if not _NAME.fullmatch(name):
        raise _no_name(name)
    small = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()
    if keyword.iskeyword(small) or small in ("pomona", "tests"):
        raise UsageError(f"'{small}' means something else already; take another name")
    return PieceNames(small, capitals(name))


def _no_name(name: str) -> UsageError:
    return UsageError(
        f"'{name}' is not a valid name: letters, digits and _, beginning with a letter"
    )
