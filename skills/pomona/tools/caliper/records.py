"""Picks of recorded runs; runs that do not belong together are refused."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.errors import UsageError
from pomona.executive.recording.digest import trusted
from pomona.executive.recording.folder import EVENTS, EVENTS_FILE, events_file, find_record, in_order
from pomona.executive.recording.plain_file import parse_object
from pomona.executive.recording.scan import scan
from pomona.tools.caliper.pick import Pick, UnusableTouches, pick_from

SAME_POSE = 1e-6  # difference of two poses of a camera in its mount from which they are two calibrations


class OtherCalibration(UsageError):
    """Runs of another cell, or of another calibration of its camera."""


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
        self.cell = self._cell_hash = ""

    def add(self, record: Path) -> None:
        """Read the picks of one more run.

        Raises:
            OtherCalibration: the run is of another cell, or of another calibration; nothing was added.
            UsageError: the record cannot be trusted.
        """
        self.merge(_read(record))

    def merge(self, other: Picks) -> None:
        """Take the picks of others.

        Raises OtherCalibration: they are of another cell, or of another calibration; nothing was added.
        """
        run = next(iter(other.runs), "")
        if self.runs and (other.cell, other._cell_hash) != (self.cell, self._cell_hash):
            words = f"cell '{other.cell}' differs from cell '{self.cell}' of {self.runs[0]}, in its name or its files"
            raise OtherCalibration(f"{run}: {words}; name runs of one cell as it is now")
        first = next(iter((*self.picks, *other.picks)), None)
        for pick in other.picks:
            if first is not None and not _same_camera(pick, first):
                words = f"the camera's pose in its mount is another one than in {first.name}"
                raise OtherCalibration(f"{pick.name}: {words}; name runs of one calibration")
        self.cell, self._cell_hash = other.cell, other._cell_hash
        self.runs += other.runs
        self.picks += other.picks
        self.refused += other.refused


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
            inside = sorted(path.parent for path in folder.glob(f"*/{EVENTS_FILE}"))
            if not inside:
                raise UsageError(f"no records in {folder}: `pomona run --record {folder}` leaves one there")
            found += in_order(inside, lambda record: record.name)
        else:
            found.append(find_record(name, root))
    return list(dict.fromkeys(found))


def _read(record: Path) -> Picks:
    run, found = trusted(record), Picks()
    found.cell, found._cell_hash, found.runs = run.cell, run.cell_hash, [run.run]
    for name, touches in _touches(record):
        try:
            found.picks.append(pick_from(touches, name))
        except UnusableTouches as unusable:
            found.refused.append(f"{name}: {unusable}")
    return found


def _touches(record: Path) -> Iterable[tuple[str, Any]]:
    for topic, content, *_ in scan(events_file(record), topics=lambda topic: topic == EVENTS):
        if topic == EVENTS and b"PickTouches" in content:
            match parse_object(content):
                case {"event": "Published", "topic": "touches", "t": t, "value": {"type": "PickTouches"} as value}:
                    yield f"{record.name} at {float(t or 0.0):.2f} s", value


def _same_camera(one: Pick, other: Pick) -> bool:
    return one.on_arm == other.on_arm and bool(np.abs(one.T_mount_camera - other.T_mount_camera).max() < SAME_POSE)
