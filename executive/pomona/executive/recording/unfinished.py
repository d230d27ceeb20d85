"""The newest run on a cell, if it was cut off: the running skills, and the fruit that may be between the fingers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pomona.executive.recording.digest import digest
from pomona.executive.recording.ending import why_cut
from pomona.executive.recording.folder import EVENTS_FILE, in_order, is_being_written
from pomona.executive.recording.read import read_events
from pomona.executive.running.events import HandChanged, NodeChanged, RunStarted

RECOVERY = "recover"  # name of the tree that recovers a cell after a run that was cut off


@dataclass(frozen=True, slots=True)
class Unfinished:
    """A run that was cut off."""

    record: Path  # its folder
    kind: str  # kind of its cell; empty if unknown
    doing: tuple[str, ...]  # names of the running leaves
    time: float  # recorded time of the run [s]
    hand: str | None  # last content of the gripper as a sentence; empty for nothing, None if unknown
    why: str  # reason for the missing end

    @property
    def sentence(self) -> str:
        """Description for the operator."""
        doing = f" while {' and '.join(self.doing)} was running" if self.doing else ""
        hand = "the content of the gripper is unknown" if self.hand is None else self.hand
        hand = hand or "nothing was felt in the gripper"
        cut = f"was cut after {self.time:.1f} s{doing} ({self.why})"
        return f"the last run on this cell, {self.record.name}, {cut}; {hand}"


def unfinished(root: Path, cell: Path) -> Unfinished | None:
    """Return the newest run on a cell if it was cut off; None if it ended, or there is none.

    A damaged or unreadable record could be of any cell. It counts as a run that was cut off on this one, unless a newer
    run ended here. A record that another process is writing is ignored.

    Args:
        root: folder of records.
    """
    runs = [path for path in root.glob(f"*/{EVENTS_FILE}") if not is_being_written(path)]
    doubtful: Unfinished | None = None
    for record in reversed(in_order((path.parent for path in runs), _written)):
        started = _started(record)
        if started is None:
            doubtful = doubtful or Unfinished(record, "", (), 0.0, None, "its record cannot be read")
            continue
        if Path(started.cell_path) != cell.resolve():
            continue
        found = digest(record)
        if found.tree == RECOVERY and found.outcome != "success":
            continue  # a failed recovery leaves the cell as it was
        if found.state == "cut off":
            return _cut(record, started)
        if found.state == "ended":
            return doubtful
        return Unfinished(record, started.cell_kind, (), 0.0, None, found.message or found.state)
    return doubtful


def _written(record: Path) -> int:
    return (record / EVENTS_FILE).stat().st_mtime_ns


def _started(record: Path) -> RunStarted | None:
    """Return the beginning of a run; None if its record cannot be read."""
    try:
        return next((event for event in read_events(record) if isinstance(event, RunStarted)), None)
    except Exception:  # a damaged file may raise any exception; `pomona runs` reports it
        return None


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
