"""A cell without devices, for trees whose skills need none: the only kind of cell that `pomona-executive` reads.

Its file holds `name: …` and nothing else. `pomona.drivers.cell` reads cells with devices.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from pomona.executive.clock import SystemClock
from pomona.executive.running.cell_files import CellFile
from pomona.executive.running.dry_cell import DryCell
from pomona.executive.values.documents import Outline, read_value_file, with_includes
from pomona.executive.values.findings import Findings
from pomona.executive.values.installation import elsewhere
from pomona.executive.values.kinds import Schema, Text
from pomona.executive.values.reading import Refused
from pomona.executive.values.scoring import Score
from pomona.executive.values.sections import Section, value
from pomona.executive.values.yaml_nodes import YamlScalar

T = TypeVar("T")

KIND = "mock"


class EmptyCell(DryCell):
    """A cell without a device, on the system's clock."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name, self.clock = name, SystemClock()


@dataclass(frozen=True, slots=True)
class EmptyCellFile:
    """A cell file without devices; implements `CellFile`."""

    name: str
    files: Mapping[str, str] = field(default_factory=dict)
    kind: str = KIND
    record_required: bool = False
    score: Score | None = None

    def interfaces(self) -> tuple[type, ...]:
        return ()

    def wires(self) -> tuple[str, ...]:
        return ()

    def known(self, what: type[T]) -> T | None:
        return None

    def place(self, interface: type) -> None:
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class EmptyCellSection:
    """A cell without devices."""

    name: str = value(Text(), help="of the cell")


EMPTY_CELL = Section(EmptyCellSection)


class EmptyCellFiles:
    """Reads cell files without devices; implements `CellFiles`."""

    def outline(self, path: Path, findings: Findings) -> Outline | None:
        return None if read_value_file(path, findings, "a cell file") is None else Outline(KIND, ())

    def judge(
        self,
        path: Path,
        findings: Findings,
        overrides: Mapping[str, str | YamlScalar],
        texts: Mapping[str, str],
    ) -> CellFile | None:
        written = read_value_file(path, findings, "a cell file", texts=texts)
        if written is None:
            return None
        devices = written.root.get("devices") or written.root.get("world")
        if devices is not None:
            message = "this installation has no drivers, so a cell has no devices"
            findings.error(devices, "unfit", message, elsewhere("them"))
            return None
        try:
            return EmptyCellFile(EMPTY_CELL.read(written.root, written.reader).name, written.files)
        except Refused:
            return None

    def connect(self, file: CellFile, seed: int, cleared: bool = False) -> EmptyCell:
        return EmptyCell(file.name)

    def recognises(self, keys: Collection[str]) -> bool:
        """Return True if a file with these keys at its top is one."""
        return set(keys) == {"name"}

    def check(self, path: Path, findings: Findings) -> None:
        """Everything that is wrong with a file."""
        self.judge(path, findings, {}, {})

    def schema(self) -> Schema:
        """Return the JSON Schema of such files."""
        return {"title": "Pomona cell file without devices", **with_includes(EMPTY_CELL.schema())}


CELL_FILES = EmptyCellFiles()
