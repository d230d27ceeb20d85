"""Requests to the operator: run this tree on this cell. A request is a folder that holds a copy of the tree."""

from __future__ import annotations

import difflib
import json
import shlex
import shutil
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

from pomona.executive.errors import UsageError
from pomona.executive.files import find_tree, read_text
from pomona.executive.language.documents import read_document
from pomona.executive.language.model import Document
from pomona.executive.recording.read import read_events
from pomona.executive.running.events import RunStarted
from pomona.executive.terminal.filtered import json_text
from pomona.tools.assistants.work_folder import WorkFolder
from pomona.tools.library.index import RunIndex

PLACE = "approvals"  # folder of the requests, in the folder of records
REQUEST, DIFFERENCE = "request.json", "difference.patch"
MOST_OPEN = 20  # requests that wait; more would hide each other
MOST_REASON = 1000  # characters


class Approvals:
    """The requests in a folder of records. The door writes them; it never starts a run of one."""

    def __init__(self, folder: WorkFolder) -> None:
        self._folder, self._place = folder, folder.records / PLACE

    def open(self) -> list[Path]:
        """Return the requests, oldest first."""
        return sorted(path.parent for path in self._place.glob(f"*/{REQUEST}"))

    def ask(self, tree: str, options: Sequence[str], cell: str, reason: str, call: int) -> str:
        """Write a request with copies of the tree and the files that it calls; return its name.

        Args:
            tree: as `WorkFolder.tree` returns it.
            options: of `pomona run`, for the command that the operator sees.
            call: number in the door's log.

        Raises UsageError: the reason is empty or too long, too many requests wait, or the tree cannot be read.
        """
        if not reason.strip() or len(reason) > MOST_REASON:
            raise UsageError(f"the operator needs a reason, of at most {MOST_REASON} characters")
        if len(self.open()) >= MOST_OPEN:
            raise UsageError(f"{MOST_OPEN} requests wait for the operator: no more are taken")
        path = self._folder.root / tree if tree.startswith("./") else find_tree(tree)
        document = read_document(path)
        request = self._new_place(document.main.name)
        copied = _copy(document, path, request / "tree")
        against, difference = self._difference(document)
        (request / DIFFERENCE).write_text(difference, encoding="utf-8")
        command = ["pomona", "run", str(copied), *(self._absolute(option) for option in options)]
        about = {
            "tree": tree, "cell": cell, "reason": reason, "asked": datetime.now(UTC).isoformat(timespec="seconds"),
            "call": call, "difference to": against, "command": shlex.join(command),
        }  # fmt: skip
        (request / REQUEST).write_text(json_text(about, indent=1) + "\n", encoding="utf-8")
        return request.name

    def _new_place(self, tree: str) -> Path:
        numbers = [int(path.name[:4]) for path in self._place.glob("[0-9][0-9][0-9][0-9]_*")]
        place = self._place / f"{max(numbers, default=0) + 1:04d}_{tree[:60]}"
        place.mkdir(parents=True)
        return place

    def _absolute(self, option: str) -> str:
        """Return an option that holds in every working folder."""
        name, _, value = option.partition("=")
        return f"{name}={self._folder.root / value}" if value.startswith("./") else option

    def _difference(self, document: Document) -> tuple[str, str]:
        """Return the last run of a tree of this name, or nothing, and the lines that have changed since then."""
        name = document.main.name
        for run in RunIndex(self._folder.records).read():
            if run.tree == name and run.state in ("ended", "cut off"):
                events = read_events(self._folder.records / run.run)
                started = next((event for event in events if isinstance(event, RunStarted)), None)
                if started is not None:
                    return run.run, _patch(started.tree_text, document.text, run.run, name)
        return "", _patch("", document.text, "never run", name)


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


def _patch(old: str, new: str, old_name: str, new_name: str) -> str:
    lines = difflib.unified_diff(old.splitlines(), new.splitlines(), old_name, new_name, lineterm="")
    return "".join(f"{line}\n" for line in lines)


def described(request: Path) -> Iterator[str]:
    """Yield the paragraphs of a request for the operator: who asks what, the difference, and the command to start it.

    Raises UsageError: it cannot be read.
    """
    try:
        about = json.loads(read_text(request / REQUEST))
        yield f"{request.name}: {about['tree']} on the cell {about['cell']}, asked {about['asked']}"
        yield f"reason: {about['reason']}"
        known = about["difference to"]
        yield f"difference to the run {known}:" if known else "no tree of this name has run; the whole tree:"
        yield read_text(request / DIFFERENCE).rstrip() or "none"
        yield f"to start it: {about['command']}"
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{request}: no request: {error}") from None


def dismiss(request: Path) -> None:
    """Remove a request. Raises UsageError: it cannot be removed."""
    try:
        shutil.rmtree(request)
    except OSError as error:
        raise UsageError(f"{request}: {error.strerror}") from error
