"""The one folder that an assistant may read and write: names are judged before any file is opened."""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

from pomona.executive.errors import UsageError
from pomona.executive.files import file_kind, find_cell, find_tree, kind_names, read_text
from pomona.executive.language.mocks import MOCKS_KEYS
from pomona.executive.values.findings import Findings, Source, did_you_mean
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.yaml_nodes import YamlMapping, YamlScalar, read_yaml
from pomona.tools.dashboard.approvals import version_of

MOST_TEXT = (
    256 * 1024
)  # largest file that the door reads or writes [bytes]: a tree of 1 000 nodes has 60 kB
MOST_NAME = 200  # characters of a path; file systems allow 255 bytes in each part
WRITTEN = ("tree", "scenario", "mocks")  # kinds of files that the door writes
MOST_LISTED = 500  # files of the folder that are listed, and up to which new ones are written
_WORD = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
_INSTALLED = re.compile(r"[a-z][a-z0-9_]*")
_KEY = re.compile(r"^(\w+)\s*:", re.MULTILINE)  # of a text that is no YAML yet


class WorkFolder:
    """Files of an assistant, in one folder; `records` holds its runs and is never written as a file."""

    def __init__(self, root: Path, records: Path) -> None:
        """
        Args:
            root: the folder.
            records: folder of records, relative to `root` or absolute.

        Raises:
            UsageError: the folder does not exist.
        """
        if root.exists() and not root.is_dir():
            raise UsageError(f"{root}: a file; the door serves a folder: pomona mcp {root.parent}")
        if not root.is_dir():
            raise UsageError(f"{root}: no such folder")
        self.root = root.resolve()
        self.records = (self.root / records).resolve()

    def inside(self, name: str) -> Path:
        """Return the path of a file or folder in the folder, without links.

        Raises UsageError: the name is absolute, leads outside or holds characters that no file's name should have.
        """
        path = Path(name)
        if not name.strip() or len(name) > MOST_NAME or not name.isprintable():
            raise UsageError(
                f"'{_short(name)}' is no file name: 1 to {MOST_NAME} printable characters are allowed"
            )
        if path.is_absolute() or ".." in path.parts or name.startswith(("-", "~")):
            raise UsageError(
                f"'{_short(name)}' is outside the folder: use a path relative to it, without '..'"
            )
        try:
            resolved = (self.root / path).resolve()
        except (OSError, RuntimeError) as error:
            raise UsageError(f"'{_short(name)}' cannot be used: {error}") from None
        if not resolved.is_relative_to(self.root):
            raise UsageError(f"'{_short(name)}' is outside the folder: a link leads there")
        return resolved

    def shown(self, path: Path) -> str:
        """Return the path as an argument of a command that runs in the folder."""
        return f"./{path.relative_to(self.root)}"

    def file(self, name: str) -> Path:
        """Return an existing file. Raises UsageError: there is none, or it is outside the folder."""
        path = self.inside(name)
        if not path.is_file():
            known = did_you_mean(name, self.files())
            raise UsageError(
                f"there is no file '{_short(name)}' in the folder{known and f'; {known}'}"
            )
        return path

    def tree(self, name: str) -> str:
        """Return a tree as an argument of a command: a file in the folder, or the name of an installed tree.

        Raises UsageError: it is neither.
        """
        return find_tree(name).stem if self._is_installed(name) else self.shown(self.file(name))

    def cell(self, name: str) -> str:
        """Return a cell as an argument of a command, as `tree`. Raises UsageError: it is neither."""
        return find_cell(name).stem if self._is_installed(name) else self.shown(self.file(name))

    def _is_installed(self, name: str) -> bool:
        """Return True if a name can only be that of an installed tree or cell."""
        return not self.inside(name).exists() and _INSTALLED.fullmatch(name) is not None

    def scenario(self, name: str) -> str:
        """Return a scenario file as an argument of a command.

        Raises UsageError: it is none, or its tree is neither installed nor inside the folder.
        """
        path = self.file(name)
        root = read_yaml(Source(name, self.read(path)), Findings())
        tree = root.get("tree") if isinstance(root, YamlMapping) else None
        if not isinstance(tree, YamlScalar):
            raise UsageError(f"{name}: no scenario file: it has no 'tree'")
        for base, allowed in (
            (path.parent, self.root),
            (installed_trees(), installed_trees().resolve()),
        ):
            tested = (base / tree.text).resolve()
            if tested.is_file():
                if not tested.is_relative_to(allowed):
                    raise UsageError(
                        f"{name}: its tree '{_short(tree.text)}' is outside the folder"
                    )
                break
        return self.shown(path)

    def record(self, name: str) -> str:
        """Return the name of a record: `last`, or a folder directly in the folder of records.

        Raises UsageError: it is none of these.
        """
        if name == "last":
            return name
        folder = self.records / name
        if not _WORD.fullmatch(name) or folder.is_symlink() or not folder.is_dir():
            raise UsageError(f"there is no record '{_short(name)}': the tool `runs` lists them")
        return name

    def files(self) -> list[str]:
        """Return the YAML files in the folder, without records and links, the first `MOST_LISTED`."""
        found: list[str] = []
        for folder, folders, names in os.walk(self.root):
            folders[:] = sorted(
                f for f in folders if not f.startswith(".") and Path(folder, f) != self.records
            )
            paths = (
                Path(folder, name) for name in sorted(names) if name.endswith((".yaml", ".yml"))
            )
            found += [str(path.relative_to(self.root)) for path in paths if not path.is_symlink()]
            if len(found) > MOST_LISTED:
                return found[:MOST_LISTED]
        return found

    def read(self, path: Path) -> str:
        """Return a text. Raises UsageError: it is too large, or no text."""
        if path.stat().st_size > MOST_TEXT:
            raise UsageError(f"{path.name}: larger than {MOST_TEXT // 1024} KiB")
        return read_text(path)

    def write(self, name: str, text: str, version: str, replace: bool) -> Path:
        """Write a tree or a scenario whole or not at all.

        Args:
            version: of the text that is replaced, as `version_of`; empty for a new file.
            replace: write over any version.

        Raises UsageError: no such file may be written, or the file has changed since that version.
        """
        path = self._writable(name, text)
        with _temporary(path, text) as fresh:
            if path.exists():
                present = version_of(self.read(path))
                if not replace and version != present:
                    why = "has changed since you read it" if version else "exists"
                    raise UsageError(
                        f"{name} {why} (version {present}): read it, then write with this version"
                    )
                os.replace(fresh, path)
            elif len(self.files()) >= MOST_LISTED:
                raise UsageError(
                    f"the folder holds {MOST_LISTED} files already: no new one is written"
                )
            elif version:
                raise UsageError(
                    f"{name} no longer exists: write it without a version to make it again"
                )
            else:
                os.link(
                    fresh, path
                )  # unlike a renaming it does not write over a file that is made meanwhile
        return path

    def _writable(self, name: str, text: str) -> Path:
        """Return the path to write. Raises UsageError: this is no place or no text for a tree or a scenario."""
        path = self.inside(name)
        if path.is_relative_to(self.records) or any(
            part.startswith(".") for part in Path(name).parts
        ):
            raise UsageError(
                f"'{name}' is no place for a tree: records and hidden folders are not written"
            )
        if path.suffix != ".yaml" or (self.root / name).is_symlink() or path.is_dir():
            raise UsageError(f"'{name}' is not written: only regular files that end with .yaml are")
        if len(text.encode(errors="replace")) > MOST_TEXT:
            raise UsageError(f"the text is larger than {MOST_TEXT // 1024} KiB")
        for found in (text, *([self.read(path)] if path.exists() else ())):
            if (kind := kind_of(found)) not in WRITTEN:
                raise UsageError(
                    f"{kind} is not written: only trees ('root:'), scenarios ('cases:') and mocks are"
                )
        return path


def kind_of(text: str) -> str:
    """Return the kind of a file by its keys at the top: tree, scenario, a cell file …"""
    root = read_yaml(Source("text", text), Findings())
    keys = tuple(root.entries) if isinstance(root, YamlMapping) else tuple(_KEY.findall(text))
    if "root" in keys:
        return "tree"
    if "mocks" in keys and set(keys) <= set(MOCKS_KEYS):
        return "mocks"
    return next(
        (name for name in kind_names() if file_kind(name).recognises(keys)),
        "no YAML of a known kind",
    )


@contextlib.contextmanager
def _temporary(path: Path, text: str) -> Iterator[str]:
    """Write a text beside its place, where it is removed if it has not taken that place.

    Raises UsageError: it cannot be written there.
    """
    fresh = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, fresh = tempfile.mkstemp(dir=path.parent, prefix=".")
        with open(handle, "w", encoding="utf-8", newline="") as stream:
            os.fchmod(handle, 0o644)
            stream.write(text)
            stream.flush()
            os.fsync(handle)
        yield fresh
    except OSError as error:
        raise UsageError(f"{path.name} cannot be written: {error.strerror}") from None
    finally:
        if fresh:
            Path(fresh).unlink(missing_ok=True)


def _short(name: str) -> str:
    return ascii(name[:60])[1:-1]
