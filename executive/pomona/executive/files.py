"""Trees and cells by path or name, and the kinds of files that `pomona check` and `pomona schema` know."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Protocol

from pomona.executive.errors import UsageError
from pomona.executive.values.findings import Findings, did_you_mean
from pomona.executive.values.installation import entry_points, installed_trees
from pomona.executive.values.plain_text import NotUtf8Error, exists, is_file, read_plain_text
from pomona.executive.values.removed import removed


def find_tree(name: str) -> Path:
    """Find a tree file by path or name. Raises UsageError: there is none; the text lists the existing ones."""
    return _find(name, "tree", installed_trees())


def find_cell(name: str) -> Path:
    """Find a cell file by path or name. Raises UsageError: there is none; the text lists the existing ones."""
    return _find(name, "cell", installed_trees() / "cells")


def default_name(kind: str) -> str:
    """Return the default that the installed trees define: a "tree", a "cell", "hazards", …."""
    content = tomllib.loads((installed_trees() / "defaults.toml").read_text(encoding="utf-8"))
    return str(content[kind])


def read_text(path: Path) -> str:
    """Return a text file. Raises UsageError: it cannot be read, or is not UTF-8."""
    try:
        return read_plain_text(path)
    except NotUtf8Error as error:
        before = error.object[: error.start]
        place = f"{path}:{before.count(10) + 1}:{len(before) - before.rfind(10)}"
        raise UsageError(f"{place}: not a text file ({error})") from error
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def write_text(text: str, path: Path | None, replaces: str = "") -> None:
    """Write a text file, or to standard output when there is no path.

    Args:
        replaces: beginning of the files that may be replaced, which a program has written; by default none.

    Raises UsageError: it cannot be written, or another file is there.
    """
    text = text if text.endswith("\n") else text + "\n"
    if path is None:
        # In a terminal a document is filtered like everything, into a file or a pipe it goes as it is.
        getattr(sys.stdout, "write_document", sys.stdout.write)(text)
        return
    try:
        if is_file(path) and not (replaces and read_text(path).startswith(replaces)):
            raise UsageError(
                f"{path} exists, and nothing is overwritten: name another file, or move it away"
            )
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def _sort_of(path: Path) -> str:
    kinds = {"a folder": path.is_dir, "a pipe": path.is_fifo, "a socket": path.is_socket}
    return next((kind for kind, it_is in kinds.items() if it_is()), "a device")


def _find(name: str, kind: str, folder: Path) -> Path:
    given = Path(name)
    if is_file(given):
        return given
    installed = folder / f"{name.removesuffix('.yaml')}.yaml"
    if given.name == name and is_file(
        installed
    ):  # also beside a folder of this name: the cell `frames` beside frames
        return installed
    if exists(given):
        raise UsageError(f"{name}:1:1: a {kind} must be a regular file, this is {_sort_of(given)}")
    if given.is_symlink():
        raise UsageError(f"{name}: this link leads to no file")
    if gone := removed(kind, given.stem):
        raise UsageError(f"no {kind} file '{name}': {gone}")
    known = sorted(path.stem for path in folder.glob("*.yaml"))
    lost = next(path for path in (*reversed(given.parents), given) if not exists(path))
    beside = did_you_mean(lost.name, (path.name for path in lost.parent.glob("*")))
    if given.name != name:
        raise UsageError(
            f"no {kind} file '{name}': {lost} does not exist{f'; {beside}' if beside else ''}"
        )
    hint = (given.suffix and beside) or did_you_mean(given.stem, known)
    raise UsageError(
        f"no {kind} file '{name}'; {f'{hint} ' if hint else ''}installed: {', '.join(known) or 'none'}"
    )


class FileKind(Protocol):
    """Files of one kind."""

    def recognises(self, keys: Collection[str]) -> bool:
        """Return True if a file with these keys at its top is one."""

    def check(self, path: Path, findings: Findings) -> None:
        """Everything that is wrong with a file."""

    def schema(self) -> Mapping[str, Any]:
        """Return the JSON Schema of such files."""


def kind_names() -> tuple[str, ...]:
    """Return the installed kinds."""
    return tuple(sorted(point.name for point in entry_points(group="pomona.files")))


def file_kind(name: str) -> FileKind:
    """Return an installed kind by its name. Raises KeyError: there is none."""
    for point in entry_points(group="pomona.files", name=name):
        kind: FileKind = point.load()
        return kind
    raise KeyError(name)
