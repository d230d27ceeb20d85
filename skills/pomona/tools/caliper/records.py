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
    in_order,
    records_in,
)
from pomona.executive.recording.plain_file import made_whole, open_plain, parse_object
from pomona.executive.recording.scan import scan
from pomona.tools.caliper.pick import KINDS, Pick, UnusableTouches, pick_from

SAME_POSE = (
    1e-6  # difference of two poses of a camera in its mount from which they are two calibrations
)


class OtherCalibration(UsageError):
    """Runs of another cell, or of another calibration of its camera."""


class OtherCell(OtherCalibration):
    """Runs of a cell of another name."""


class Picks:
    """Picks of one cell with one calibration.

    Attributes:
        picks: those that can be used.
        refused: touches that cannot, with the reason.
        runs: ids of the runs that were read.
        cell: name of their cell.
    """

    def __init__(self) -> None:
        self.picks: list[Pick] = []
        self.refused: list[str] = []
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
        found, seen = cls(), list[Any]()
        found.cell, found.cell_hash, found.runs = cell, cell_hash, [run]
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

    def add(self, record: Path) -> None:
        """Read the picks of one more run.

        Raises:
            OtherCalibration: the run is of another cell, or of another calibration; nothing was added.
            UsageError: the record cannot be trusted.
        """
        self.merge(Picks.of_run(*_read(record)))

    def add_noted(self, record: Path, *, only: bool = False) -> None:
        """As `add`; a record is read once, and its touches are noted beside it.

        With `only`, a record without a note is left out.
        """
        noted = _noted(record)
        if noted is None and only:
            return
        if noted is None:
            noted = _read(record)
            note_touches(record, *noted[1:])
        self.merge(Picks.of_run(*noted))

    def merge(self, other: Picks) -> None:
        """Take the picks of others.

        Raises OtherCalibration: they are of another cell, or of another calibration; nothing was added.
        """
        run = next(iter(other.runs), "")
        if self.runs and (other.cell, other.cell_hash) != (self.cell, self.cell_hash):
            words = f"its cell '{other.cell}' is not that of {self.runs[0]}, '{self.cell}': other name or files"
            error = OtherCalibration if other.cell == self.cell else OtherCell
            raise error(f"{run}: {words}; name runs of one cell as it is now")
        first = next(iter((*self.picks, *other.picks)), None)
        for pick in other.picks:
            if first is not None and not _same_camera(pick, first):
                words = f"the camera's pose in its mount is another one than in {first.name}"
                raise OtherCalibration(f"{pick.name}: {words}; name runs of one calibration")
        self.cell, self.cell_hash = other.cell, other.cell_hash
        self.runs += other.runs
        self.refused += other.refused
        for pick in other.picks:
            name = self._names.setdefault(_measured(pick), pick.name)
            if name == pick.name:
                self.picks.append(pick)
            else:
                self.refused.append(
                    f"{pick.name}: measured to the last digit as {name}: a copy of its record"
                )


def read_groups(records: Iterable[Path]) -> list[Picks]:
    """Return the picks of many records, those of one cell and calibration together, in the order of their first.

    A record that cannot be trusted, or that has two calibrations, is left out.
    """
    groups: list[Picks] = []
    for record in records:
        with contextlib.suppress(UsageError):
            read = Picks()
            read.add(record)
            for group in groups:
                with contextlib.suppress(OtherCalibration):
                    group.merge(read)
                    break
            else:
                groups.append(read)
    return groups


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


NOTED = "touches.json"  # file in a record's folder with its touches, so that they are not looked for in every start
MOST_NOTED = 10_000_000  # longest note that is read [bytes]: 2 000 picks
Noted = tuple[
    str, str, str, list[tuple[str, Any]]
]  # run, cell, hash of its files, names and values of its touches


def _read(record: Path) -> Noted:
    run = trusted(record)
    return run.run, run.cell, run.cell_hash, list(_touches(record))


def note_touches(
    record: Path, cell: str, cell_hash: str, touches: Sequence[tuple[str, Any]]
) -> None:
    """Note a finished record's touches beside it; a folder that cannot be written has no note."""
    content = {"cell": cell, "cell_hash": cell_hash, "touches": [*map(list, touches)]}
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
        of, digest = content.pop("of"), content.pop("digest")
        if of == _state(record) and digest == _digest(content):
            touches = [(str(name), value) for name, value in content["touches"]]
            return record.name, str(content["cell"]), str(content["cell_hash"]), touches
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


def _same_camera(one: Pick, other: Pick) -> bool:
    return one.on_arm == other.on_arm and bool(
        np.abs(one.T_mount_camera - other.T_mount_camera).max() < SAME_POSE
    )
