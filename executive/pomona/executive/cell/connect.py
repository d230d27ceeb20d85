"""Connection of a cell as its file describes it.

    cell = load_cell("trees/cells/sim.yaml", seed=3, overrides={"fruit": "apple_5", "place": "3"})

`world:` names a simulated world, which gives the clock; without one the clock is the system's. `devices:` are connected
in the order of the file, so that one can build on those above it. `workspace:` describes the surroundings for skills.
`heartbeat: 1 s` is the longest stall of a run before its supervisor process stops the devices. `record: required` ends
a run in the safe state when its record cannot be written; without it the run goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

from pomona.executive.cell.cell import Cell, close_all
from pomona.executive.cell.cell_file import CELL, CellFile, judge_cell_file, read_cell_file
from pomona.executive.cell.device import ConnectContext, Device, World
from pomona.executive.cell.errors import DriverError
from pomona.executive.cell.registration import Settings
from pomona.executive.cell.services import installed_services
from pomona.executive.clock import ManualClock, SystemClock
from pomona.executive.values.documents import with_includes
from pomona.executive.values.findings import Findings
from pomona.executive.values.kinds import Schema
from pomona.executive.values.later import import_all


def load_cell(
    path: str | Path,
    *,
    seed: int = 0,
    overrides: Mapping[str, str] | None = None,
    missing: Callable[[str, DriverError], None] | None = None,
    texts: Mapping[str, str] | None = None,
) -> Cell:
    """Read a cell file and connect its devices; nothing is connected when anything in the file is wrong.

    Args:
        seed: of everything random in a simulated or mock cell.
        overrides: values of the file's `options`.
        missing: called with the name of every device that cannot be connected, and the reason, instead of an error: for
            an inspection of the cell, never for a run.
        texts: contents of files, by path, that are not to be read from the disk.

    Raises:
        CellFileError: the file cannot be used; the text has the place and the known alternatives.
        DeviceError: a device could not be connected; those connected before are released.
    """
    return connect_cell(
        read_cell_file(Path(path), overrides, texts, missing), seed=seed, missing=missing
    )


def connect_cell(
    file: CellFile,
    *,
    seed: int = 0,
    missing: Callable[[str, DriverError], None] | None = None,
    cleared: bool = False,
    takes_over: bool = False,
) -> Cell:
    """Connect the devices of a cell file without errors; for the arguments see `load_cell` and `ConnectContext`.

    Raises:
        CellFileError: a value is wrong on use: for example an address without a device.
        DeviceError: a device could not be connected; those connected before are released.
    """
    import_all()
    said = file.section
    services = installed_services()
    context = services.context(
        file.path,
        ManualClock() if said.clock == "manual" else SystemClock(),
        seed,
        file.workspace,
        cleared=cleared,
        takes_over=takes_over,
    )
    try:
        world: World | None = None
        if said.world is not None:
            simulator = _connect(said.world, context)
            if not isinstance(simulator, World):
                raise said.world.error("the driver simulates no world", "driver")
            world = simulator
            context.clock = simulator.clock
        for name, settings in said.devices.items():
            try:
                _connect(settings, context)
            except DriverError as error:
                if missing is None:
                    raise
                missing(name, error)
        return Cell(
            file.name,
            file.kind,
            context.clock,
            context.devices,
            services.connected(said.devices, context),
            world,
            file.record_required,
            said.heartbeat,
        )
    except BaseException:
        close_all(context.devices)
        raise


def _connect(settings: Settings[Any], context: ConnectContext) -> Device:
    device = settings.driver(settings, context)
    context.devices[settings.name] = device
    device.name = settings.name
    return device


class CellFiles:
    """Cell files for `pomona check` and `pomona schema`."""

    def recognises(self, keys: Collection[str]) -> bool:
        """Return True if a file with these keys at its top is one."""
        return not {"devices", "world", "workspace", "options"}.isdisjoint(
            keys
        )  # an `include` may bring the devices

    def check(self, path: Path, findings: Findings) -> None:
        """Everything that is wrong with a file, with its options as they are."""
        judge_cell_file(path, findings)

    def schema(self) -> Schema:
        """Return the JSON Schema of cell files."""
        return {"title": "Pomona cell file", **with_includes(CELL.schema(options=True))}


CELL_FILES = CellFiles()
