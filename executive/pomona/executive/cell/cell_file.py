"""A cell file, read and checked without any connection.

name: bench
options:                       # may be changed with `--set`; "{place}" below stands for the value
  place: 3
workspace: {include: shared/workspace.yaml}
devices:
  arm: {driver: motoman, address: 192.168.1.31}
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from pomona.executive.cell.errors import CellFileError, DriverError
from pomona.executive.cell.registration import (
    DriverSection,
    Emulating,
    Fitting,
    Settings,
    Surroundings,
    TellsOfCell,
    Wired,
)
from pomona.executive.cell.services import Score, WorkspaceKind, installed_services
from pomona.executive.values.documents import Option, Outline, ValueFile, read_value_file
from pomona.executive.values.findings import Findings, Located, few_hints
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.kinds import MappingOf, Measure, Text
from pomona.executive.values.sections import Placed, Problem, Section, value
from pomona.executive.values.units import TIME
from pomona.executive.values.yaml_nodes import Refused, YamlMapping, YamlScalar

SHIPPED = (
    installed_trees() / "cells"
)  # cells that come with Pomona, for `include: sim.yaml` in a file elsewhere

KINDS = ("simulated", "emulated", "real", "frames", "mock")
SIMULATED = ("simulated", "mock")  # kinds of cells without anything outside this process
OUTLIVED = (
    "real",
    "emulated",
)  # kinds of cells whose devices may outlive the process: runs on them are supervised
T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class CellSection:
    """A cell: its devices, its surroundings, and its options for `--set`."""

    name: str = value(Text(), "", "the file's name without it")
    kind: str = value(
        Text(*KINDS), help="kind of the cell, shown with every run: " + ", ".join(KINDS)
    )
    record: str = value(
        Text("required", "optional"), "optional", "'required' ends a run that cannot be recorded"
    )
    heartbeat: float = value(
        Measure(TIME, "200 ms", "60 s"),
        "1 s",
        "the supervisor stops the devices when a run hangs for this long",
    )
    clock: str = value(
        Text("system", "manual"), "system", "where time comes from when no world gives it"
    )
    options: Mapping[str, str] = value(
        MappingOf(Text()), {}, 'options for --set; "{name}" stands for the value'
    )
    score: Score | None = value(Section(Score), None, "score of a world that scores runs")
    workspace: Any = value(WorkspaceKind(), None, "known surroundings")
    world: Settings[Any] | None = value(
        DriverSection(), None, "a simulated world; it gives the clock and the truth"
    )
    devices: Mapping[str, Settings[Any]] = value(
        MappingOf(DriverSection()), help="connected in this order: each may build on those above it"
    )


CELL = Section(CellSection)


@dataclass(frozen=True, slots=True)
class CellFile:
    """A cell file without errors."""

    path: Path  # of the file
    section: CellSection  # its values
    workspace: Any  # for the skills, as the installed services describe it, or None
    options: tuple[Option, ...]  # values that may be changed, with defaults
    # its text and those of the files that it includes, by their path from its folder
    files: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.section.name or self.path.stem

    @property
    def kind(self) -> str:
        """Kind of the cell, such as `sim`."""
        return self.section.kind

    @property
    def record_required(self) -> bool:
        """Whether a run without a record is refused."""
        return self.section.record == "required"

    @property
    def score(self) -> Score | None:
        return self.section.score

    def interfaces(self) -> tuple[type, ...]:
        """Return the device interfaces that the cell will have."""
        devices = [
            i for device in self.section.devices.values() for i in device.driver.device.interfaces
        ]
        world = self.section.world.driver.device.interfaces if self.section.world else ()
        return tuple(
            dict.fromkeys([*world, *devices, *([type(self.workspace)] if self.workspace else [])])
        )

    def wires(self) -> tuple[str, ...]:
        """Addresses at which the cell reaches devices outside this process."""
        options = [device.values for device in self.section.devices.values()]
        world = None if self.section.world is None else self.section.world.values
        inside = world.inner_wires if isinstance(world, Emulating) else ()
        wires = dict.fromkeys(
            wire for said in options if isinstance(said, Wired) for wire in said.wires
        )
        return tuple(wire for wire in wires if wire not in inside)

    def known(self, what: type[T]) -> T | None:
        """Return an object that the file describes, before any connection: its workspace, limits of its arm …"""
        if what is type(self.workspace):
            return self.workspace
        return next((fact for fact in _facts(self.section) if isinstance(fact, what)), None)

    def place(self, interface: type) -> Located | None:
        """Return where the file describes the device with this interface, or None where it has none."""
        devices = self.section.devices.values()
        return next(
            (said.placed.node for said in devices if interface in said.driver.device.interfaces),
            None,
        )


def read_cell_file(
    path: Path,
    overrides: Mapping[str, str | YamlScalar] | None = None,
    texts: Mapping[str, str] | None = None,
    missing: Callable[[str, DriverError], None] | None = None,
) -> CellFile:
    """Read and check a cell file; nothing is connected.

    Args:
        overrides: values of its options; a scalar has its place in a file.
        texts: contents of files, by path, that are not to be read from the disk.
        missing: called with the name of every device whose section is wrong, and the reason; the cell is then read
            without it.

    Raises CellFileError: the file has errors; the exception has all of them.
    """
    findings = Findings()
    found = judge_cell_file(path, findings, overrides, texts, missing)
    if found is None or findings.errors:
        raise CellFileError(findings.sorted())
    return found


@few_hints()
def judge_cell_file(
    path: Path,
    findings: Findings,
    overrides: Mapping[str, str | YamlScalar] | None = None,
    texts: Mapping[str, str] | None = None,
    missing: Callable[[str, DriverError], None] | None = None,
) -> CellFile | None:
    """As `read_cell_file`; everything that is wrong goes to `findings`."""
    written = read_value_file(
        path, findings, "a cell file", overrides=overrides or {}, texts=texts, shipped=SHIPPED
    )
    if written is None:
        return None
    if missing is not None:
        _leave_out(written, missing)
    try:
        placed = CELL.read_placed(written.root, written.reader)
    except Refused:
        return None
    section = placed.values
    workspace = section.workspace.workspace() if section.workspace else None
    for where, problem in _misfits(section, workspace):
        (placed if problem.key.startswith("workspace.") else where).refuse(problem)
    if not findings.errors:
        installed_services().judge(placed, _facts(section), findings)
        for name, device in section.devices.items():
            for claim, why in device.driver.device.declared.items():
                words = f"{name} does not keep '{claim.replace('_', ' ')}': {why}"
                findings.warning(device.placed.place("driver"), "declared", words)
    return (
        None
        if findings.errors
        else CellFile(path, section, workspace, written.options, written.files)
    )


def _leave_out(written: ValueFile, missing: Callable[[str, DriverError], None]) -> None:
    """Remove the devices whose sections cannot be read."""
    devices = written.root.get("devices")
    if not isinstance(devices, YamlMapping):
        return
    for name, (_, node) in list(devices.entries.items()):
        findings = Findings()
        try:
            DriverSection().read(
                node, replace(written.reader, findings=findings, title=f"devices.{name}")
            )
        except Refused:
            del devices.entries[name]
            missing(name, CellFileError(findings.sorted()))


def outline_cell(path: Path, findings: Findings) -> Outline | None:
    """Return a cell's kind, and its options with their defaults: the keys that `overrides` may hold."""
    written = read_value_file(path, findings, "a cell file", overrides={}, shipped=SHIPPED)
    if written is None:
        return None
    kind = written.root.get("kind")
    return Outline(kind.text if isinstance(kind, YamlScalar) else "", written.options)


def _misfits(section: CellSection, workspace: Any) -> Iterator[tuple[Placed[Any], Problem]]:
    """Yield the conflicts of a device with this cell; its own section is valid."""
    above = dict[str, Any]()
    lines = dict[str, str]()
    said = {name: device.values for name, device in section.devices.items()}
    world = section.world
    if world is not None and not hasattr(world.driver.device, "truth"):
        yield world.placed, Problem("driver", "it simulates no world")
    for name, device in (*((("world", world),) if world else ()), *section.devices.items()):
        options = device.values
        if device.driver.device.outlives and section.kind not in OUTLIVED:
            words = f"it moves a device outside this process: the cell's kind is real or emulated, not {section.kind}"
            yield device.placed, Problem("driver", words)
        for wire in options.wires if isinstance(options, Wired) else ():
            other = lines.setdefault(os.path.realpath(wire), name) if wire.startswith("/") else name
            if other != name:
                yield (
                    device.placed,
                    Problem(
                        "port", f"'{other}' is on {wire} already; a serial line has one device"
                    ),
                )
        if isinstance(options, Fitting):
            for problem in options.fits(Surroundings(workspace, above, said)):
                yield device.placed, problem
        above[name] = device.driver.device


def _facts(section: CellSection) -> Iterator[object]:
    for device in (*((section.world,) if section.world else ()), *section.devices.values()):
        if isinstance(device.values, TellsOfCell):
            yield from device.values.known()
