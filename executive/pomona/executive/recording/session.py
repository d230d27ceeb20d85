"""The record of one run, with all its errors; and the newest run on a cell, if its record was cut off.

A run whose record cannot be opened does not begin. When the record is lost later, the run goes on unrecorded, or ends
in the safe state where the cell's file says `record: required`; both are reported. A required record that is lost after
the tree has succeeded makes the end an error. There the finished record is read once before the run's status is given.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.executive.cell.cell import Cell
from pomona.executive.errors import PomonaError
from pomona.executive.recording.digest import digest
from pomona.executive.recording.folder import (
    EVENTS_FILE,
    RecordError,
    events_file,
    in_order,
    is_being_written,
    new_record_folder,
    records_in,
    why_cut,
)
from pomona.executive.recording.picture import Picture
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import STALLED, Recorder
from pomona.executive.recording.scan import examine
from pomona.executive.running.events import (
    HandChanged,
    NodeChanged,
    RunEnded,
    RunStarted,
    TreeChanged,
)
from pomona.executive.running.runner import Runner
from pomona.executive.running.tick import EventStream
from pomona.executive.values.processes import within
from pomona.executive.values.sentences import sentence_of

Reader = Callable[[float, int, Mapping[str, Mapping[str, Any]]], None]
"""Takes the run's time, the tick, and the new measurements of the cell's devices, by device and quantity."""


DRAWING = 20.0  # longest wait for the run's picture: its library and its disk may wait for ever [s]
READING = 30.0  # longest wait while a finished record is read [s]


class RecordingSession:
    """Keeps the record of one run, or none for `root=None`.

    Attributes:
        folder: of the record; None while nothing is written, and after a run of which nothing was written.
    """

    def __init__(self, root: Path | None, cell: Cell, readers: Sequence[Reader] = ()) -> None:
        """
        Args:
            root: folder of records.
            cell: the cell with the devices to read.
            readers: further receivers of the measurements, called in the tick's thread; they must return at once.
        """
        self._root, self._cell, self._readers = root, cell, tuple(readers)
        self._recorder: Recorder | None = None
        self._runner: Runner | None = None
        self._picture = Picture()
        self._trouble = ""
        self.folder: Path | None = None

    def begin(self, runner: Runner, events: EventStream) -> None:
        """Open the record, before the run's first event. Raises RecordError: it cannot be opened."""
        self._runner = runner
        if self._root is None:
            return
        runner.look_after("record", self._state, required=self._cell.record_required)
        folder = new_record_folder(self._root, runner.tree.name)
        try:
            self._recorder = Recorder(folder, durable=self._cell.record_required)
        except RecordError:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        self.folder = folder
        events.subscribe(self._recorder.on_event)
        events.subscribe(self._picture.on_event)

    def look(self) -> Iterable[tuple[str, object]]:
        """Pass the devices' measurements to the recorder. The run calls it as a watcher; it publishes nothing."""
        readers = (*self._readers, *(() if self._recorder is None else (self._recorder.read,)))
        if readers and self._runner is not None:
            (t, tick), readings = self._runner.progress, self._cell.readings()
            for read in readers:
                read(t, tick, readings)
        return ()

    def draw(self, title: str) -> None:
        """Draw the run's picture."""
        if self._recorder is None or self._picture.empty or self._recorder.look() > STALLED:
            return
        place = self._recorder.folder / "picture.png"
        try:
            within(DRAWING, lambda: self._picture.save(place, title))
        except TimeoutError as error:
            self._trouble = f"the picture is {error}"
        except OSError as error:
            self._trouble = f"the picture cannot be written: {error.strerror or error}"
        except (
            Exception
        ) as error:  # a view that cannot be drawn, a drawing library that cannot be loaded
            self._trouble = f"the picture cannot be drawn: {sentence_of(error)}"

    def close(self) -> str:
        """Write the rest.

        Returns:
            the problem of the record as a sentence; empty without one.
        """
        self.look()
        recorder = self._recorder
        if (
            recorder is not None
            and recorder.close()
            and not _is_written(events_file(recorder.folder))
        ):
            self.folder = None
        return self._problem()

    def breach(self, outcome: str) -> str:
        """Return why a required record does not prove the run's outcome; empty if it does.

        Call it after `close`: the whole record is decoded, as by `pomona explain`.
        """
        if not self._cell.record_required or self._recorder is None:
            return ""
        folder = self._recorder.folder
        try:
            return self._recorder.problem or within(READING, lambda: _unread(folder, outcome))
        except TimeoutError as error:
            return f"the finished record cannot be read: {error}"

    def _problem(self) -> str:
        return (self._recorder.problem if self._recorder is not None else "") or self._trouble

    def _state(self) -> str:
        if self._recorder is not None:
            self._recorder.look()
        problem = self._problem()
        if not problem:
            return "ok"
        ended = self._recorder is None or self._recorder.has_ended
        return (
            f"{problem}; the run goes on unrecorded"
            if ended and not self._cell.record_required
            else problem
        )


def _is_written(path: Path) -> bool:
    try:
        return path.stat().st_size > 0
    except OSError:
        return False


def _unread(folder: Path, outcome: str) -> str:
    """Return why a finished record cannot be read, or differs from the run's outcome; empty otherwise."""
    try:
        state = examine(events_file(folder)).state
        said = [event.outcome for event in read_events(folder) if isinstance(event, RunEnded)]
    except (PomonaError, OSError) as error:
        return f"the finished record cannot be read: {error}"
    if state != "whole" or said != [outcome]:
        return f"the finished record is {state} and contains {' and '.join(said) or 'no end'} instead of {outcome}"
    return ""


RECOVERY = "recover"  # name of the tree that recovers a cell after a run that was cut off


@dataclass(frozen=True, slots=True)
class Unfinished:
    """A run that was cut off."""

    record: Path  # its folder
    kind: str  # kind of its cell; empty if unknown
    doing: tuple[str, ...]  # names of the running leaves
    time: float  # recorded time of the run [s]
    hand: (
        str | None
    )  # last content of the gripper as a sentence; empty for nothing, None if unknown
    why: str  # reason for the missing end

    @property
    def sentence(self) -> str:
        """Description for the operator."""
        doing = f" while {' and '.join(self.doing)} was running" if self.doing else ""
        hand = "the content of the gripper is unknown" if self.hand is None else self.hand
        hand = hand or "at the end of its record nothing was felt in the gripper"
        cut = f"was cut after {self.time:.1f} s{doing} ({self.why})"
        return f"the last run on this cell, {self.record.name}, {cut}; {hand}"


def unfinished(root: Path, cell: Path) -> Unfinished | None:
    """Return the newest run on a cell if it was cut off; None if it ended, or there is none.

    A damaged or unreadable record could be of any cell. It counts as a run that was cut off on this one, unless a newer
    run ended here. A record that another process is writing is ignored.

    Args:
        root: folder of records.
    """
    runs = [path for path in records_in(root) if not is_being_written(path)]
    doubtful: Unfinished | None = None
    for record in reversed(in_order((path.parent for path in runs), _written)):
        started = _started(record)
        if started is None:
            doubtful = doubtful or Unfinished(
                record, "", (), 0.0, None, "its record cannot be read"
            )
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
    leaves = names.keys() - {node["parent"] for node in started.nodes}
    running: dict[str, None] = {}
    hand: str | None = None
    time = 0.0
    for event in read_events(record):
        time = max(time, event.t)
        if isinstance(event, HandChanged):
            hand = event.what
        elif isinstance(event, TreeChanged):
            names.update((node["path"], str(node["name"])) for node in event.nodes)
            leaves = names.keys() - {node["parent"] for node in event.nodes}
        elif isinstance(event, NodeChanged) and event.path in leaves:
            running.pop(event.path, None)
            if event.status == "RUNNING":
                running[event.path] = None
    return Unfinished(
        record,
        started.cell_kind,
        tuple(names[path] for path in running),
        time,
        hand,
        why_cut(record),
    )
