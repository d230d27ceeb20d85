"""The newest run on a cell, when it was cut: what was going on, and what may be between the fingers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from executive.recording.digest import digest
from executive.recording.ending import why_cut
from executive.recording.folder import EVENTS_FILE, events_file, is_being_written
from executive.recording.read import read_events
from executive.running.events import HandChanged, NodeChanged, RunStarted

RECOVERY = "recover"
"""Name of the tree that brings a cell in order after a run that was cut."""

LOOKED_AT = 50
"""Newest records of a folder among which the cell's last run is looked for."""


@dataclass(frozen=True, slots=True)
class Unfinished:
    """A run that was cut.

    Attributes:
        record: its folder.
        kind: of its cell.
        doing: names of the leaves that were running.
        time: seconds of the run that are recorded.
        hand: what the fingers felt last; empty for nothing, None when nobody knows.
        why: why the record has no end.
    """

    record: Path
    kind: str
    doing: tuple[str, ...]
    time: float
    hand: str | None
    why: str

    @property
    def sentence(self) -> str:
        """For people."""
        doing = f" while {' and '.join(self.doing)} was running" if self.doing else ""
        hand = "nobody knows what is in the gripper" if self.hand is None else self.hand
        hand = hand or "nothing was felt in the gripper"
        cut = f"was cut after {self.time:.1f} s{doing} ({self.why})"
        return f"the last run on this cell, {self.record.name}, {cut}; {hand}"


def unfinished(root: Path, cell: Path) -> Unfinished | None:
    """The newest run on a cell, if it was cut; None when it came to an end, or there is none.

    Args:
        root: folder of records.
        cell: its file.
    """
    for record in sorted((path.parent for path in root.glob(f"*/{EVENTS_FILE}")), reverse=True)[:LOOKED_AT]:
        if is_being_written(events_file(record)):
            continue
        try:
            started = next(_started(record), None)
            if started is None or Path(started.cell_path) != cell.resolve():
                continue
            found = digest(record)
            if found.tree == RECOVERY and found.outcome != "success":
                continue  # it was tried: the cell is as it was before
            return _cut(record, started) if found.state == "cut off" else None
        except Exception:  # a record that cannot be read says nothing of the cell; `pomona runs` says why
            continue
    return None


def _started(record: Path) -> Iterator[RunStarted]:
    for event in read_events(record):
        if isinstance(event, RunStarted):
            yield event


def _cut(record: Path, started: RunStarted) -> Unfinished:
    names = {node["path"]: str(node["name"]) for node in started.nodes}
    leaves = set(names) - {node["parent"] for node in started.nodes}
    running: dict[str, None] = {}
    hand: str | None = None
    time = 0.0
    for event in read_events(record):
        time = max(time, event.t)
        if isinstance(event, HandChanged):
            hand = event.what
        elif isinstance(event, NodeChanged) and event.path in leaves:
            running.pop(event.path, None)
            if event.status == "RUNNING":
                running[event.path] = None
    return Unfinished(record, started.cell_kind, tuple(names[path] for path in running), time, hand, why_cut(record))
