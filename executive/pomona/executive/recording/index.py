"""The index of runs: one file beside the records, made from them and replaceable at any time.

The file holds no data of its own. An entry that is missing, damaged or of another version is made again.
"""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from pomona.executive.recording.digest import Digest, digest
from pomona.executive.recording.folder import in_order, is_being_written, records_in
from pomona.executive.recording.plain_file import open_plain, parse_object, replace_file
from pomona.executive.recording.typed import hints_of, typed

INDEX_FILE = "index.json"
VERSION = 1  # of the digests in it; another number makes all of them again


class RunIndex:
    """Lists the records of a folder."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.problem = ""  # reason why the index could not be kept the last time; empty without one

    def read(self) -> list[Digest]:
        """Return every run, newest first."""
        kept = self._kept()
        runs: dict[Path, Digest] = {}
        lasting: dict[str, list[Any]] = {}
        for path in records_in(self.root):
            record = path.parent
            with contextlib.suppress(OSError):  # removed meanwhile
                stamp = path.lstat().st_mtime_ns
                found = _entry(kept.get(record.name), stamp) or digest(record)
                if found.state == "cut off" and is_being_written(path):
                    runs[record] = replace(found, state="running")
                else:
                    runs[record] = found
                    lasting[record.name] = [stamp, found.as_json()]
        self.problem = "" if lasting == kept else self._keep(lasting)
        return [runs[record] for record in reversed(in_order(runs, lambda record: record.name))]

    def _kept(self) -> dict[str, Any]:
        """Return the entries of the file by run; none if it cannot be used."""
        with contextlib.suppress(OSError, ValueError), open_plain(self.root / INDEX_FILE) as file:
            content = parse_object(file.read())
            entries = content.get("runs")
            if content.get("version") == VERSION and isinstance(entries, dict):
                return entries
        return {}

    def _keep(self, entries: dict[str, list[Any]]) -> str:
        """Write the file; return why that is not possible."""
        text = json.dumps({"version": VERSION, "runs": entries})
        try:
            replace_file(self.root / INDEX_FILE, text.encode())
        except OSError as error:
            return f"{self.root / INDEX_FILE} cannot be written: {error.strerror}"
        return ""


def _entry(kept: Any, stamp: int) -> Digest | None:
    """Return the digest of an entry; None if it is malformed, or of another state of the file."""
    with contextlib.suppress(TypeError, ValueError, KeyError):
        known, about = kept
        if known == stamp:
            hints = hints_of(Digest).items()
            return Digest(**{name: typed(hint)(about[name]) for name, hint in hints})
    return None
