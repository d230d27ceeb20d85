"""Interface of cell files for the executive; `pomona.drivers.cell` implements it (entry point `pomona.cells`)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol, TypeVar

from pomona.executive.running.cell import Cell
from pomona.executive.values.documents import Outline
from pomona.executive.values.findings import Findings, Located
from pomona.executive.values.scoring import Score
from pomona.executive.values.yaml_nodes import YamlScalar

T = TypeVar("T")


class CellFile(Protocol):
    """A cell file in which nothing is wrong; nothing is connected yet."""

    @property
    def name(self) -> str: ...

    @property
    def kind(self) -> str: ...

    @property
    def record_required(self) -> bool:
        """Whether no run may begin without a record."""

    @property
    def score(self) -> Score | None:
        """The score of a world that scores runs."""

    @property
    def files(self) -> Mapping[str, str]:
        """Its text and those of the files that it includes, by their path from its folder."""

    def interfaces(self) -> tuple[type, ...]:
        """Return the device interfaces that the cell will have."""

    def wires(self) -> tuple[str, ...]:
        """Where its devices are reached outside this process: one run at a time on each."""

    def known(self, what: type[T]) -> T | None:
        """Return an object that the file describes, before any connection."""

    def place(self, interface: type) -> Located | None:
        """Return where the file describes the device with this interface, or None where it has none."""


class CellFiles(Protocol):
    """Reads cell files and connects the devices in them."""

    def outline(self, path: Path, findings: Findings) -> Outline | None:
        """Return the cell's kind and its options for `--set`, or None if the file cannot be read."""

    def judge(
        self,
        path: Path,
        findings: Findings,
        overrides: Mapping[str, str | YamlScalar],
        texts: Mapping[str, str],
    ) -> CellFile | None:
        """Read and judge a file: everything that is wrong is a finding, and there is no cell then."""

    def connect(self, file: CellFile, seed: int, cleared: bool = False) -> Cell:
        """Connect the devices of a cell file without errors; devices connected before one that fails are released.

        `cleared`: an operator has checked the cell, so fingers without a reference may find it by moving.
        """


@cache
def cell_files() -> CellFiles:
    """Return the installed reader of cell files."""
    reader: CellFiles = next(iter(entry_points(group="pomona.cells", name="file"))).load()
    return reader
