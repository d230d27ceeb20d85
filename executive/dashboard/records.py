"""What the page lists of the folder of records."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

from executive.dashboard.record_messages import first_event
from executive.recording.recorder import EVENTS_FILE

MOST_RUNS = 2000
"""The newest ones are listed."""

STARTED = ("tree", "tree_hash", "cell", "cell_kind", "seed", "parameters", "settings", "wall_time")
ENDED = ("outcome", "time", "ticks", "truth")


class RecordList:
    """Lists records; how each run began and ended is read once."""

    def __init__(self, records: Path) -> None:
        self._records = records
        self._known: dict[tuple[str, int], dict[str, Any]] = {}

    def read(self) -> list[dict[str, Any]]:
        """One entry a record, newest first."""
        before, self._known = self._known, {}
        for path in sorted(self._records.glob(f"*/{EVENTS_FILE}"), reverse=True)[:MOST_RUNS]:
            with contextlib.suppress(OSError):  # removed while we look
                key = (path.parent.name, path.stat().st_mtime_ns)
                self._known[key] = before.get(key) or _entry(path)
        return list(self._known.values())


def _entry(path: Path) -> dict[str, Any]:
    started = first_event(path.parent)
    entry: dict[str, Any] = {"run": path.parent.name, "bytes": path.stat().st_size}
    entry |= {name: started.get(name) for name in STARTED}
    entry["picture"] = (path.parent / "picture.png").is_file()
    try:
        ended = json.loads((path.parent / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return entry  # it is going on, or was cut off
    entry |= {name: ended.get(name) for name in ENDED}
    reason = ended.get("reason") or {}
    entry |= {"code": reason.get("code"), "message": reason.get("message")}
    return entry
