"""Requests to the operator: run this tree on this cell. A request is a folder that holds a copy of the tree."""

from __future__ import annotations

import difflib
import hashlib
import json
import os
import re
import shlex
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pomona.executive.cell.cell_file import SHIPPED, outline_cell
from pomona.executive.errors import UsageError
from pomona.executive.files import find_cell, find_tree, read_text
from pomona.executive.language.check import read_document
from pomona.executive.language.model import Document
from pomona.executive.recording.index import RunIndex
from pomona.executive.recording.read import read_events
from pomona.executive.running.events import RunStarted
from pomona.executive.terminal.output import json_text
from pomona.executive.values.documents import read_value_file
from pomona.executive.values.findings import Findings
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.plain_text import is_file

PLACE = "approvals"  # folder of the requests, in the folder of records
REQUEST = "request.json"
DIFFERENCE = "difference.patch"
STARTED_BY = "assistant.json"  # beside the record of a run that the door has started
MOST_OPEN = 20  # requests that wait; more would hide each other
MOST_REASON = 1000  # characters


@dataclass(frozen=True, slots=True)
class RunRequest:
    """A request: the tree's copy with its text, the cell's file, and the difference to the run `difference_to`."""

    name: str
    tree: Path
    cell: Path
    seed: int
    settings: Mapping[str, str]
    reason: str
    asked: str
    difference_to: str
    difference: str
    text: str
    version: str  # of all files of the request, and of those that its run reads


class Approvals:
    """The requests in a folder of records. The door writes them; it never starts a run of one."""

    def __init__(self, root: Path, records: Path) -> None:
        """
        Args:
            root: the assistant's folder.
            records: of its runs.
        """
        self._root = root
        self._records = records
        self._place = records / PLACE

    def open(self) -> list[Path]:
        """Return the requests, oldest first."""
        return requests_in(self._records)

    def ask(
        self, tree: str, cell: str, seed: int, settings: Mapping[str, str], reason: str, call: int
    ) -> str:
        """Write a request with copies of the tree and the files that it calls; return its name.

        Args:
            tree, cell: as `WorkFolder.tree` and `WorkFolder.cell` return them.
            call: number in the door's log.

        Raises UsageError: the reason is empty or too long, too many requests wait, or the tree cannot be read.
        """
        if not reason.strip() or len(reason) > MOST_REASON:
            raise UsageError(f"the operator needs a reason, of at most {MOST_REASON} characters")
        if len(self.open()) >= MOST_OPEN:
            raise UsageError(f"{MOST_OPEN} requests wait for the operator: no more are taken")
        path = self._root / tree if tree.startswith("./") else find_tree(tree)
        document = read_document(path)
        request = self._new_place(document.main.name)
        copied = _copy(document, path, request / "tree")
        cell_file = self._root / cell if cell.startswith("./") else find_cell(cell)
        against, difference = self._difference(document.main.name, _texts(path, cell_file))
        (request / DIFFERENCE).write_text(difference, encoding="utf-8")
        about = {
            "tree": str(copied.relative_to(request)),
            "cell": str(cell_file),
            "seed": seed, "settings": dict(settings), "reason": reason, "difference_to": against,
            "asked": datetime.now(UTC).isoformat(timespec="seconds"), "call": call,
        }  # fmt: skip
        (request / REQUEST).write_text(json_text(about, indent=1) + "\n", encoding="utf-8")
        return request.name

    def _new_place(self, tree: str) -> Path:
        numbers = [int(path.name[:4]) for path in self._place.glob("[0-9][0-9][0-9][0-9]_*")]
        place = self._place / f"{max(numbers, default=0) + 1:04d}_{tree[:60]}"
        place.mkdir(parents=True)
        return place

    def _difference(self, name: str, texts: Mapping[str, str]) -> tuple[str, str]:
        """Return the last run of a tree of this name that a person started, or nothing, and the changes since then."""
        against, old = "", dict[str, str]()
        for run in RunIndex(self._records).read():
            folder = self._records / run.run
            if (
                run.tree == name
                and run.state in ("ended", "cut off")
                and not (folder / STARTED_BY).exists()
            ):
                started = next((e for e in read_events(folder) if isinstance(e, RunStarted)), None)
                if started is not None:
                    against = run.run
                    base = os.path.dirname(started.tree_path)
                    read = {**started.tree_files, started.tree_path: started.tree_text}
                    old = {os.path.relpath(path, base): text for path, text in read.items()}
                    old |= {f"cell/{path}": text for path, text in started.cell_files.items()}
                    old[f"cell/{os.path.basename(started.cell_path)}"] = started.cell_text
                    break
        lines = (
            line
            for path in dict.fromkeys((*texts, *old))
            for line in difflib.unified_diff(
                old.get(path, "").splitlines(),
                texts.get(path, "").splitlines(),
                f"{against or 'never run'}/{path}",
                path,
                lineterm="",
            )
        )
        return against, "".join(f"{line}\n" for line in lines)


def _texts(tree: Path, cell: Path) -> dict[str, str]:
    """Return the texts of all files that a run of a tree on a cell reads, by their paths from these two."""
    files = read_document(tree).files
    found = {os.path.relpath(file.source.path, tree.parent): file.source.text for file in files}
    written = read_value_file(cell, Findings(), "a cell file", overrides={}, shipped=SHIPPED)
    texts = {cell.name: read_text(cell)} if written is None else written.files
    return found | {f"cell/{path}": text for path, text in texts.items()}


def _read(tree: Path, cell: Path) -> dict[str, str]:
    """Return `_texts`, and the hashes of all files that they name and of the fruits' meshes and weights, by paths."""
    texts = _texts(tree, cell)
    words = {word for text in texts.values() for word in re.findall(r"[\w./-]+\.\w+", text)}
    named = {folder / word for folder in (tree.parent, cell.parent) for word in words}
    paths = named.union((installed_trees() / "fruits").rglob("*"))
    return texts | {
        str(path): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(paths)
        if is_file(path)
    }


def _copy(document: Document, path: Path, place: Path) -> Path:
    """Copy a tree and the files beside or below it that it calls; return the copied tree."""
    base = path.parent.resolve()
    for file in document.files:
        called = Path(file.source.path).resolve()
        if called.is_relative_to(base):
            target = place / called.relative_to(base)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(file.source.text, encoding="utf-8")
    return place / path.resolve().name


def requests_in(records: Path) -> list[Path]:
    """Return the folders of the requests in a folder of records, oldest first."""
    return sorted(path.parent for path in (records / PLACE).glob(f"*/{REQUEST}"))


def read_request(place: Path) -> RunRequest:
    """Read a request from its folder. Raises UsageError: it cannot be read."""
    try:
        about = json.loads(read_text(place / REQUEST))
        settings = {str(key): str(value) for key, value in about["settings"].items()}
        tree = (place / about["tree"]).resolve()
        cell = Path(about["cell"])
        if not tree.is_relative_to(place.resolve()):
            raise UsageError(f"{place}: no request: its tree lies outside")
        return RunRequest(
            place.name, tree, cell, int(about["seed"]), settings, str(about["reason"]),
            str(about["asked"]), str(about["difference_to"]), read_text(place / DIFFERENCE), read_text(tree),
            _version(place, _read(tree, cell)),
        )  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{place}: no request: {error}") from None


def find_request(records: Path, name: object, version: object) -> RunRequest:
    """Return the request that an operator has read.

    Raises UsageError: there is none of this name, it cannot be read, or it is no longer of this version.
    """
    place = next((place for place in requests_in(records) if place.name == name), None)
    if place is None:
        raise UsageError("there is no such request")
    asked = read_request(place)
    if asked.version != version:
        raise UsageError(f"the request {asked.name} has changed: read it again")
    return asked


def request_facts(records: Path) -> list[dict[str, Any]]:
    """Return all requests as plain values for the page; one that cannot be read has its `problem`."""
    found: list[dict[str, Any]] = []
    for place in requests_in(records):
        try:
            asked = read_request(place)
            outline = outline_cell(asked.cell, Findings())
        except UsageError as error:
            found.append({"name": place.name, "problem": str(error)})
            continue
        kind = outline.kind if outline is not None else "?"
        found.append(
            {**asdict(asked), "tree": asked.tree.stem, "cell": str(asked.cell), "kind": kind}
        )
    return found


def version_of(text: str) -> str:
    """Return the short name of a text's version."""
    return hashlib.sha256(text.encode(errors="replace")).hexdigest()[:16]


def _version(place: Path, read: Mapping[str, str]) -> str:
    """Return the short name of the contents of all files of a request, and of those that its run reads."""
    files = sorted(path for path in place.rglob("*") if path.is_file())
    texts = {str(path.relative_to(place)): read_text(path) for path in files} | dict(read)
    return version_of("".join(f"{path}\0{text}\0" for path, text in texts.items()))


def described(request: RunRequest, records: Path) -> Iterator[str]:
    """Yield the paragraphs of a request for the operator: reason, difference, and the command to start it."""
    yield f"{request.name}: {request.tree.stem} on the cell {request.cell}, asked {request.asked}"
    yield f"reason: {request.reason}"
    known = request.difference_to
    yield (
        f"difference to the run {known}:"
        if known
        else "no person has run a tree of this name; all that it reads:"
    )
    yield request.difference.rstrip() or "none"
    sets = [f"--set={key}={value}" for key, value in request.settings.items()]
    command = [
        "pomona",
        "run",
        str(request.tree),
        f"--cell={request.cell}",
        f"--seed={request.seed}",
        *sets,
    ]
    yield f"to start it: {shlex.join([*command, f'--record={records}'])}"


def dismiss(request: Path) -> None:
    """Remove a request. Raises UsageError: it cannot be removed."""
    try:
        shutil.rmtree(request)
    except OSError as error:
        raise UsageError(f"{request}: {error.strerror}") from error
