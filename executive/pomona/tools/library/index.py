"""The index of runs: one SQLite file beside the records, made from them and replaceable at any time.

The index holds no data of its own. If it cannot be used (locked, read-only, damaged, made by a newer Pomona), the same
list is made in memory, and `problem` has the reason.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from pomona.executive.recording.digest import STATES, Digest, digest
from pomona.executive.recording.folder import EVENTS_FILE, in_order, is_being_written
from pomona.executive.recording.plain_file import moment_of, parse

INDEX_FILE = "index.sqlite"
PATIENCE = 2.0  # longest wait for another process that writes the index [s]

MIGRATIONS: tuple[str, ...] = (
    """
    CREATE TABLE runs (
        run TEXT PRIMARY KEY, stamp INTEGER NOT NULL, state TEXT NOT NULL,
        tree TEXT, tree_hash TEXT, cell TEXT, cell_kind TEXT, cell_hash TEXT, seed INTEGER, wall_time REAL, git TEXT,
        parameters TEXT, settings TEXT, outcome TEXT, code TEXT, message TEXT, codes TEXT, attempts INTEGER,
        time REAL, wall REAL, ticks INTEGER, truth TEXT, bytes INTEGER, picture INTEGER
    );
    CREATE INDEX runs_by_outcome ON runs (outcome, code);
    CREATE INDEX runs_by_tree ON runs (tree, tree_hash);
    """,
    """
    ALTER TABLE runs ADD COLUMN checked INTEGER;
    ALTER TABLE runs ADD COLUMN lost TEXT;
    UPDATE runs SET stamp = 0
    """,
    "UPDATE runs SET stamp = 0",  # the message is that of the last cause
    "ALTER TABLE runs ADD COLUMN peaks TEXT; UPDATE runs SET stamp = 0",
    "UPDATE runs SET stamp = 0",  # moments and trees are judged
)
"""Steps from one version of the schema to the next. A step that adds a column ends with `UPDATE runs SET stamp = 0`, so
every record is read again."""

_COLUMNS = tuple(field.name for field in fields(Digest))


def _kind_of(hint: Any) -> type:
    """Return the type of a column's values, without None."""
    kinds = (
        [kind for kind in get_args(hint) if kind is not NoneType]
        if isinstance(hint, UnionType)
        else [hint]
    )
    return dict if get_origin(kinds[0]) is Mapping else kinds[0]


_HINTS = get_type_hints(Digest)
_KINDS = {name: _kind_of(_HINTS[name]) for name in _COLUMNS}
_OPTIONAL = [name for name in _COLUMNS if isinstance(_HINTS[name], UnionType)]


class NewerIndexError(sqlite3.DatabaseError):
    """The index was made by a newer Pomona."""


class RunIndex:
    """Lists the records of a folder."""

    def __init__(self, root: Path, migrations: Sequence[str] = MIGRATIONS) -> None:
        self.root = root
        self.problem = ""  # reason why the file of the index could not be used the last time; empty without one
        self._migrations = migrations

    def read(self) -> list[Digest]:
        """Return every run, newest first, after an update for new, changed and removed records."""
        self.problem = ""
        if not self.root.is_dir():
            return []
        try:
            with self._open(str(self.root / INDEX_FILE)) as index:
                return self._refreshed(index)
        except sqlite3.Error as error:
            self.problem = f"{self.root / INDEX_FILE} cannot be used ({error}): the records themselves were read"
        with self._open(":memory:") as index:
            return self._refreshed(index)

    def rebuild(self) -> list[Digest]:
        """Delete the file of the index and make it again."""
        with contextlib.suppress(OSError):
            (self.root / INDEX_FILE).unlink(missing_ok=True)
        return self.read()

    @contextlib.contextmanager
    def _open(self, where: str) -> Iterator[sqlite3.Connection]:
        with contextlib.closing(
            sqlite3.connect(where, timeout=PATIENCE, isolation_level=None)
        ) as index:
            (version,) = index.execute("PRAGMA user_version").fetchone()
            if version > len(self._migrations):
                raise NewerIndexError(
                    f"its schema is version {version}, this Pomona knows {len(self._migrations)}"
                )
            if version < len(self._migrations):
                index.execute("BEGIN IMMEDIATE")
                (version,) = index.execute(
                    "PRAGMA user_version"
                ).fetchone()  # another process may have done it
                for script in self._migrations[version:]:
                    for statement in filter(str.strip, script.split(";")):
                        index.execute(statement)
                index.execute(f"PRAGMA user_version = {len(self._migrations)}")
                index.execute("COMMIT")
            yield index

    def _refreshed(self, index: sqlite3.Connection) -> list[Digest]:
        known: dict[str, int] = dict(index.execute("SELECT run, stamp FROM runs"))
        found: dict[str, int] = {}
        for path in records_in(self.root):
            with contextlib.suppress(OSError):  # removed meanwhile
                found[path.parent.name] = path.lstat().st_mtime_ns
        gone = [(run,) for run in known.keys() - found.keys()]
        changed = [run for run, stamp in found.items() if known.get(run) != stamp]
        if gone or changed:
            rows = [row for run in changed for row in self._rows(run, found[run])]
            index.execute("BEGIN IMMEDIATE")
            index.executemany("DELETE FROM runs WHERE run = ?", gone)
            marks = ", ".join("?" * (len(_COLUMNS) + 1))
            index.executemany(
                f"INSERT OR REPLACE INTO runs ({', '.join(_COLUMNS)}, stamp) VALUES ({marks})", rows
            )
            index.execute("COMMIT")
        rows = index.execute(f"SELECT {', '.join(_COLUMNS)} FROM runs").fetchall()
        runs = {
            self.root / entry.run: entry for row in rows if (entry := self._entry(row)) is not None
        }
        return [runs[record] for record in reversed(in_order(runs, lambda record: record.name))]

    def _rows(self, run: str, stamp: int) -> Iterator[tuple[Any, ...]]:
        with contextlib.suppress(OSError):
            entry = digest(self.root / run)
            values = (getattr(entry, name) for name in _COLUMNS)
            yield (
                *(_packed(name, value) for name, value in zip(_COLUMNS, values, strict=True)),
                stamp,
            )

    def _entry(self, row: Sequence[Any]) -> Digest | None:
        """Return a run from its row, or from its record if the row is invalid."""
        try:
            entry = Digest(
                **{name: _unpacked(name, value) for name, value in zip(_COLUMNS, row, strict=True)}
            )
        except (ValueError, TypeError):
            self.problem = f"{self.root / INDEX_FILE}: the row of {str(row[0])[:80]!r} is damaged: its record was read"
            try:
                entry = digest(self.root / str(row[0]))
            except (OSError, ValueError):
                return None
        if entry.state == "cut off" and is_being_written(self.root / entry.run / EVENTS_FILE):
            return replace(entry, state="running")
        return entry


def records_in(root: Path) -> list[Path]:
    """Return the MCAP files of a folder's records, except those in folders with unprintable names."""
    return [path for path in root.glob(f"*/{EVENTS_FILE}") if path.parent.name.isprintable()]


def _packed(name: str, value: Any) -> Any:
    return json.dumps(value) if _KINDS[name] is dict else value


def _unpacked(name: str, value: Any) -> Any:
    """Return a column's value. Raises ValueError, TypeError: it does not have the type of this column."""
    if _KINDS[name] is dict:
        value = _mapping(name, parse(value))
    elif _KINDS[name] is bool and value in (0, 1):
        value = bool(value)
    elif _KINDS[name] is float and isinstance(value, int):
        value = float(value)
    if name == "wall_time":
        value = moment_of(value)
    if value is None and name in _OPTIONAL:
        return None
    if not isinstance(value, _KINDS[name]) or (name == "state" and value not in STATES):
        raise TypeError(name)
    return value


def _mapping(name: str, value: Any) -> Any:
    kind = {"settings": str, "codes": int, "peaks": float}.get(name, object)
    if isinstance(value, dict) and not all(isinstance(item, kind) for item in value.values()):
        raise TypeError(name)
    return value
