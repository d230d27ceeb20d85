"""Editors of trees, and the search for the cure of a failed run, which the page starts in processes beside its own."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

from pomona.tools.dashboard.options import free_port
from pomona.tools.dashboard.side_command import SideCommand

MOST_EDITORS = 4  # at once; one more ends the oldest, whose drafts are kept


class Asides:
    """Editors of trees, and one search for the cure of a failed run."""

    def __init__(self, records: Path) -> None:
        self._records, self._lock = str(records.resolve()), threading.Lock()
        self._editors: dict[Path, SideCommand] = {}
        self._search: tuple[str, SideCommand] | None = None

    def edit(self, tree: Path) -> str:
        """Return the link of an editor of this file. Raises UsageError: it does not begin."""
        path = tree.resolve()
        with self._lock:
            if path not in self._editors or self._editors[path].over:
                self._editors.pop(path, None)
                while len(self._editors) >= MOST_EDITORS:
                    self._editors.pop(next(iter(self._editors))).close()
                words = ("edit", str(path), "--port", str(free_port()), "--record", self._records)
                self._editors[path] = SideCommand(*words)
            return self._editors[path].link()

    def search(self, run: str) -> None:
        """Begin the search for a record's cure, in place of the last one."""
        with self._lock:
            self._end()
            self._search = (
                run,
                SideCommand(
                    "why", str(Path(self._records) / run), "--json", "--record", self._records
                ),
            )

    def found(self) -> dict[str, Any]:
        """Return run, last line, whether it is over, and the answer of the last search; without one nothing."""
        if self._search is None:
            return {}
        run, command = self._search
        over = command.over
        lines = list(command.lines)
        answer = json.loads(lines[-1]) if over and lines and lines[-1].startswith("{") else None
        return {
            "run": run,
            "over": over,
            "line": "" if answer else next(reversed(lines), ""),
            "answer": answer,
        }

    def stop_search(self) -> None:
        """End the search; harmless without one."""
        with self._lock:
            self._end()

    def close(self) -> None:
        """End all of them."""
        self.stop_search()
        for editor in self._editors.values():
            editor.close()

    def _end(self) -> None:
        if self._search is not None:
            self._search[1].close()
