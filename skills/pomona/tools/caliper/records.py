"""Picks of recorded runs; runs that do not belong together are refused."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.errors import UsageError
from pomona.executive.recording.digest import trusted
from pomona.executive.recording.folder import (
    EVENTS,
    EVENTS_FILE,
    events_file,
    find_record,
    hash_of,
    in_order,
    records_in,
)
from pomona.executive.recording.plain_file import made_whole, open_plain, parse_object
from pomona.executive.recording.read import read_events
from pomona.executive.recording.scan import scan
from pomona.executive.running.events import RunStarted
from pomona.executive.values.arrays import Float64
from pomona.executive.values.findings import Findings, Source
from pomona.executive.values.yaml_nodes import YamlMapping, YamlScalar, read_yaml, written
from pomona.tools.caliper.pick import KINDS, Pick, UnusableTouches, pick_from
from pomona.tools.caliper.run_view import NOTED

# difference of two poses of a camera in its mount from which they are two calibrations
SAME_POSE = 1e-6


class OtherCalibration(UsageError):
    """Runs of another cell, or of another calibration of its camera."""


class OtherCell(OtherCalibration):
    """Runs of a cell of another name."""


class Picks:
    """Picks of one cell with one calibration.

    Attributes:
        picks: those that can be used, in the order of time.
        refused: touches that cannot, with the reason.
        left_out: records that were not used, with the reason.
        runs: ids of the runs that were read.
        cell: name of their cell.
    """

    def __init__(self) -> None:
        self.picks: list[Pick] = []
        self.refused: list[str] = []
        self.left_out: list[str] = []
        self.runs: list[str] = []
        self.cell = self.cell_hash = ""
        self._names: dict[str, str] = {}  # names of the picks that were merged, by their values

    @classmethod
    def of_run(
        cls, run: str, cell: str, cell_hash: str, touches: Iterable[tuple[str, Any]]
    ) -> Picks:
        """Return the picks of one run; `touches` are names and recorded `PickTouches`, as plain JSON.

        A touch moves a fruit that lies free. Only the first one after its look shows where the camera saw it.
        UnusableTouches go to `refused`.
        """
        found = cls()
        seen = list[Any]()
        found.cell = cell
        found.cell_hash = cell_hash
        found.runs = [run]
        for name, value in touches:
            try:
                pick = pick_from(value, name)
                if not pick.is_look and value["T_base_fruit"] in seen:
                    raise UnusableTouches("an earlier touch has moved the fruit since its look")
                found.picks.append(pick)
            except UnusableTouches as unusable:
                found.refused.append(f"{name}: {unusable}")
            seen.append(value.get("T_base_fruit"))
        return found

    @classmethod
    def of_record(cls, record: Path) -> Picks:
        """Return the picks of a record, which is read once: its touches are noted beside it.

        Raises UsageError: the record cannot be trusted, or holds no beginning of a run.
        """
        noted = _noted(record)
        if noted is None:
            noted = _read(record)
            note_touches(record, *noted[1:])
        return cls.of_run(*noted)

    def merge(self, other: Picks) -> None:
        """Take the picks of earlier runs.

        Raises OtherCalibration: they are of another cell, or of another calibration; nothing was added.
        """
        run = next(iter(other.runs), "")
        if self.runs and (other.cell, other.cell_hash) != (self.cell, self.cell_hash):
            words = f"its cell '{other.cell}' is not that of {self.runs[0]}, '{self.cell}': other name or files"
            error = OtherCalibration if other.cell == self.cell else OtherCell
            raise error(f"{run}: {words}; name runs of one cell as it is now")
        first = next(iter((*self.picks, *other.picks)), None)
        for pick in other.picks:
            if first is not None and not (
                pick.on_arm == first.on_arm and same_pose(pick.T_mount_camera, first.T_mount_camera)
            ):
                words = f"the camera's pose in its mount is another one than in {first.name}"
                raise OtherCalibration(f"{pick.name}: {words}; name runs of one calibration")
        self.cell = other.cell
        self.cell_hash = other.cell_hash
        self.runs = [*other.runs, *self.runs]
        self.refused += other.refused
        kept: list[Pick] = []
        for pick in other.picks:
            name = self._names.setdefault(_measured(pick), pick.name)
            if name == pick.name:
                kept.append(pick)
            else:
                self.refused.append(
                    f"{pick.name}: measured to the last digit as {name}: a copy of its record"
                )
        self.picks = [*kept, *self.picks]


def read_back(
    records: Sequence[Path], read: Picks | None = None, *, cell: str = "", noted: bool = False
) -> Picks:
    """Return the picks of a cell's newest calibration: of runs from the newest back to the first of another one.

    Args:
        records: in the order of time, of any cells.
        read: picks that are newer than all records, or none yet of a known cell; without it the newest record counts.
        cell: name of the only cell to look at; empty: that of the newest record.
        noted: leave out records whose touches are not noted beside them: to look for them takes a second for each.
    """
    read = Picks() if read is None else read
    for record in reversed(records):
        if noted and _noted(record) is None:
            continue
        try:
            other = Picks.of_record(record)
            if not cell or other.cell == cell:
                read.merge(other)
                if not other.picks and not other.refused:
                    words = "it holds no touch and no look; was the record cut?"
                    read.left_out.append(f"{record.name}: {words}")
        except OtherCell as error:
            read.left_out.append(str(error))
        except OtherCalibration as error:
            read.left_out.append(f"{error}; nor are earlier ones")
            break
        except UsageError as error:  # its own `explain` gives the reason
            read.left_out.append(str(error))
    return read


def records_before(root: Path, run: str = "") -> list[Path]:
    """Return the newest records of a folder in the order of time, `MOST_RUNS` at most; those before a run alone."""
    ordered = in_order({path.parent for path in records_in(root)}, lambda record: record.name)
    names = [record.name for record in ordered]
    return ordered[: names.index(run) if run in names else None][-MOST_RUNS:]


def values_of(*texts: str) -> str:
    """Return the hash of the values in a cell's files; comments, layout and the caliper's limits count for nothing."""
    values: list[str] = []
    for text in texts:
        root = read_yaml(Source("", text), Findings(), "a cell file")
        devices = root.get("devices") if isinstance(root, YamlMapping) else None
        if isinstance(devices, YamlMapping):
            for name, (_, said) in list(devices.entries.items()):
                driver = said.get("driver") if isinstance(said, YamlMapping) else None
                if isinstance(driver, YamlScalar) and driver.text == "caliper":
                    del devices.entries[name]
        values.append(text if root is None else written(root))
    return hash_of(*values)


def find_runs(names: Sequence[str], root: Path) -> list[Path]:
    """Return the records of names, paths, and folders of records.

    Raises UsageError: a name is no record, or a folder has none.
    """
    found: list[Path] = []
    for name in names:
        folder = Path(name)
        if folder.is_dir() and not (folder / EVENTS_FILE).is_file():
            inside = sorted(path.parent for path in records_in(folder))
            if not inside:
                raise UsageError(
                    f"no records in {folder}: `pomona run --record {folder}` leaves one there"
                )
            found += in_order(inside, lambda record: record.name)
        else:
            found.append(find_record(name, root))
    return list(dict.fromkeys(found))


MOST_RUNS = 30  # newest runs that are looked at
MOST_NOTED = 10_000_000  # longest note that is read [bytes]: 2 000 picks
Noted = tuple[
    str, str, str, list[tuple[str, Any]]
]  # run, cell, hash of its files, names and values of its touches


def _read(record: Path) -> Noted:
    run = trusted(record)
    started = next((e for e in read_events(record) if isinstance(e, RunStarted)), None)
    if started is None:
        raise UsageError(f"{record}: the record holds no beginning of a run: leave it out")
    texts = started.cell_text, *started.cell_files.values()
    return run.run, run.cell, values_of(*texts), list(_touches(record))


def note_touches(
    record: Path, cell: str, cell_hash: str, touches: Sequence[tuple[str, Any]]
) -> None:
    """Note a finished record's touches beside it; a folder that cannot be written has no note."""
    content = {"cell": cell, "cell_values": cell_hash, "touches": [*map(list, touches)]}
    with contextlib.suppress(OSError, UsageError):
        (record / NOTED).unlink(missing_ok=True)
        with made_whole(record / NOTED) as place:
            noted = content | {"of": _state(record), "digest": _digest(content)}
            place.write_text(json.dumps(noted), encoding="utf-8")


def _noted(record: Path) -> Noted | None:
    """Return the note beside a record; None without one, or when the record or the note has changed since."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        with open_plain(record / NOTED) as file:
            content = parse_object(file.read(MOST_NOTED))
        of = content.pop("of")
        digest = content.pop("digest")
        if of == _state(record) and digest == _digest(content):
            touches = [(str(name), value) for name, value in content["touches"]]
            return record.name, str(content["cell"]), str(content["cell_values"]), touches
    return None


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _state(record: Path) -> list[int]:
    found = events_file(record).stat()
    return [found.st_size, found.st_mtime_ns]


def _touches(record: Path) -> Iterable[tuple[str, Any]]:
    for topic, content, *_ in scan(events_file(record), topics=lambda topic: topic == EVENTS):
        if topic == EVENTS and any(kind.encode() in content for kind in KINDS.values()):
            match parse_object(content):
                case {
                    "event": "Published",
                    "topic": str() as at,
                    "t": t,
                    "value": {"type": kind} as value,
                } if KINDS.get(at) == kind:
                    yield f"{record.name} at {float(t or 0.0):.2f} s", value


def _measured(pick: Pick) -> str:
    """Return all values of a pick as text: no two measurements are alike to the last digit, copies of one are."""
    values = {item.name: getattr(pick, item.name) for item in fields(pick) if item.name != "name"}
    return repr(
        {
            key: value.tolist() if isinstance(value, np.ndarray) else value
            for key, value in values.items()
        }
    )


def same_pose(one: Float64, other: Float64) -> bool:
    """Return True where two poses of a camera in its mount, shape (4, 4), are one calibration."""
    return bool(np.abs(one - other).max() < SAME_POSE)
