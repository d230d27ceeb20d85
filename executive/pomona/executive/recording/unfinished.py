"""The newest run on a cell, when it was cut: what was going on, and what may be between the fingers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pomona.executive.recording.digest import digest
from pomona.executive.recording.ending import why_cut
from pomona.executive.recording.folder import EVENTS_FILE, is_being_written
from pomona.executive.recording.order import in_order
from pomona.executive.recording.read import read_events
from pomona.executive.running.events import HandChanged, NodeChanged, RunStarted

RECOVERY = "recover"
"""Name of the tree that brings a cell in order after a run that was cut."""


@dataclass(frozen=True, slots=True)
class Unfinished:
    """A run that was cut.

    Attributes:
        record: its folder.
        kind: of its cell; empty when its record does not say it.
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

    A record that is damaged, or cannot be read, says of no cell that all is well on it: it counts as a run that was cut
    on this one, unless a newer one came to its end here. One that another process still writes is passed over.

    Args:
        root: folder of records.
        cell: its file.
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
            continue  # it was tried: the cell is as it was before
        if found.state == "cut off":
            return _cut(record, started)
        if found.state == "ended":
            return doubtful
        return Unfinished(record, started.cell_kind, (), 0.0, None, found.message or found.state)
    return doubtful


def _written(record: Path) -> int:
    return (record / EVENTS_FILE).stat().st_mtime_ns


def _started(record: Path) -> RunStarted | None:
    """How a run began; None when its record does not say it."""
    try:
        return next((event for event in read_events(record) if isinstance(event, RunStarted)), None)
    except Exception:  # whatever a damaged file makes its readers raise; `pomona runs` says what is wrong with it
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
