"""`pomona run … --status-file PATH`: one line with the state of the run, for a panel that reads it."""

from __future__ import annotations

import argparse
from pathlib import Path

from pomona.executive import (
    Event,
    NodeChanged,
    RunEnded,
    RunStarted,
    RunView,
    SafeStopped,
    UsageError,
    ViewedRun,
)


class StatusFile(RunView):
    """A file with the newest state of the run."""

    _path: Path
    _tree = ""

    def add(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "--status-file", type=Path, metavar="PATH", help="keep the run's state in this file"
        )

    def open(self, options: argparse.Namespace, run: ViewedRun) -> bool:
        if options.status_file is None:
            return False
        self._path = options.status_file
        try:
            self._write("preparing")
        except OSError as error:
            raise UsageError(f"--status-file {self._path}: {error.strerror}") from error
        return True

    def on_event(self, event: Event) -> None:
        if isinstance(event, RunStarted):
            self._tree = event.tree
            self._write("running")
        elif isinstance(event, NodeChanged) and event.status == "running":
            self._write(f"running {event.path}")
        elif isinstance(event, SafeStopped):
            self._write("safe stop")
        elif isinstance(event, RunEnded):
            self._write(event.outcome)

    def ended(self, problem: str) -> None:
        if problem:
            self._write(f"not begun: {problem.splitlines()[0]}")

    def _write(self, state: str) -> None:
        self._path.write_text(f"{self._tree} {state}\n".lstrip(), encoding="utf-8")
