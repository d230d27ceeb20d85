"""Declaration of a driver, before any connection: its device, and its options in a cell file.

    @driver(WsgGripper, WsgFile)
    def connect(settings: Settings[WsgFile], context: ConnectContext) -> WsgGripper: ...

is found by its name in a cell file through the entry point group `pomona.drivers`. The options are a dataclass of
`pomona.executive.values.sections`: with its kinds, ranges and defaults a cell file is checked without any device. Its
`problems` checks across values, `fits` checks it in this cell, and `known` describes the cell before the connection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

from pomona.executive.cell.device import Device
from pomona.executive.cell.errors import CellFileError, DeviceError
from pomona.executive.values.documents import ValueFile, read_value_file
from pomona.executive.values.findings import Findings
from pomona.executive.values.installation import elsewhere, entry_points
from pomona.executive.values.kinds import Kind, Schema, Text
from pomona.executive.values.removed import import_problem, report_removed
from pomona.executive.values.sections import Placed, Problem, Section
from pomona.executive.values.yaml_nodes import Reader, Refused, YamlMapping, YamlNode

GROUP = "pomona.drivers"
Options = TypeVar("Options")
T = TypeVar("T")


class Served(Protocol):
    """A device that is connected, and then served by a thread of its own."""

    def connect(self) -> None:
        """Connect; nothing moves. Raises DeviceError, OSError: it cannot be."""

    def start(self) -> None:
        """Serve the device from now on."""


D = TypeVar("D", bound=Served)


@dataclass(frozen=True, slots=True, kw_only=True)
class NoOptions:
    """Nothing that could be set."""


@dataclass(frozen=True, slots=True)
class Driver(Generic[Options]):
    """A driver: the class of its device, its options, and how it is connected."""

    device: type[Device]
    options: type[Options]
    connect: Callable[
        [Settings[Options], Any], Device
    ]  # with a `ConnectContext`, or that of the installed services

    def __call__(self, settings: Settings[Options], context: Any) -> Device:
        """Connect the device.

        Raises CellFileError: a value of the cell file turns out to be wrong; DeviceError: the device refuses.
        """
        return self.connect(settings, context)


def driver(
    device: type[Device], options: type[Options]
) -> Callable[[Callable[[Settings[Options], Any], Device]], Driver[Options]]:
    """Make a driver of the function that connects it."""
    return lambda connect: Driver(device, options, connect)


@dataclass(frozen=True, slots=True)
class Settings(Generic[Options]):
    """A driver's section of a cell file, read and judged."""

    name: str
    driver: Driver[Options]
    placed: Placed[Options]

    @property
    def values(self) -> Options:
        """The options."""
        return self.placed.values

    def error(self, message: str, key: str = "", hint: str = "") -> CellFileError:
        """Return an error at the place of a value, or of the whole section."""
        findings = Findings()
        findings.error(self.placed.place(key), "device", f"{self.name}: {message}", hint)
        return CellFileError(findings.sorted())

    def opened(self, device: D, blamed: Mapping[type[Exception], tuple[str, str]]) -> D:
        """Connect a device and let it serve itself.

        `blamed` has the value to blame and the remedy of each kind of error, special ones first; an error with a `key`
        names its value itself. Raises CellFileError.
        """
        try:
            device.connect()
        except (DeviceError, OSError) as error:
            key, hint = next((blamed[kind] for kind in blamed if isinstance(error, kind)), ("", ""))
            words = (
                error.message if isinstance(error, DeviceError) else f"cannot be reached: {error}"
            )
            raise self.error(words, getattr(error, "key", key), hint) from error
        device.start()
        return device


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Surroundings of a device in its cell file: workspace, devices above it, and all devices' options, by name."""

    workspace: Any = None
    above: Mapping[str, type[Device]] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)

    def has(self, device: type[Device]) -> bool:
        """Return True if a device of this class stands above."""
        return any(issubclass(other, device) for other in self.above.values())


@runtime_checkable
class Fitting(Protocol):
    """Options with checks against the device's surroundings."""

    def fits(self, around: Surroundings) -> Iterable[Problem]:
        """Yield the conflicts with the rest of the cell; a key `workspace.…` is one of the whole file."""


@runtime_checkable
class Wired(Protocol):
    """Options of a device that is reached over wires of its own, on each of which there is one run at a time."""

    @property
    def wires(self) -> tuple[str, ...]:
        """Names of the wires, the same in every cell file that leads to them."""


@runtime_checkable
class Emulating(Protocol):
    """Options of a simulated world whose devices are at the other end of wires."""

    @property
    def inner_wires(self) -> tuple[str, ...]:
        """Names of the wires that end in this process, as `Wired.wires` has them."""


@runtime_checkable
class TellsOfCell(Protocol):
    """Options that describe the cell before its connection: limits of the arm, objects on the table."""

    def known(self) -> Iterable[object]: ...


class DriverSection(Kind[Settings[Any]]):
    """A device of a cell file: `driver` names how it is reached, the other keys are the driver's options."""

    words = "a mapping with a 'driver'"

    def read(self, node: YamlNode, reader: Reader) -> Settings[Any]:
        written = node.get("driver") if isinstance(node, YamlMapping) else None
        if written is None:
            raise reader.refuse(
                node, f"{reader.title} must be {self.words}", "driver: …", "missing-key"
            )
        points = installed_drivers()
        if not points:
            message = "this installation has no drivers, so a cell has no devices"
            raise reader.refuse(written, message, elsewhere("some"), "driver")
        name = Text().read(written, reader.inside("driver"))
        if name not in points and report_removed(reader.findings, written, "driver", name):
            raise Refused(name)
        name = Text(*sorted(points)).read(written, reader.inside("driver"))
        try:
            found = points[name].load()
        except ImportError as error:
            message = f"the driver '{name}' cannot be loaded: {import_problem(error)}"
            raise reader.refuse(written, message, code="driver") from error
        if not isinstance(found, Driver):
            message = f"the driver '{name}' ({points[name].value}) does not declare its options"
            raise reader.refuse(
                written, message, "see pomona.executive.cell.registration", "driver"
            )
        placed = Section(found.options, ignore=("driver",)).read_placed(node, reader)
        return Settings(reader.title.rpartition(".")[2], found, placed)

    def schema(self, options: bool = False) -> Schema:
        sections = []
        for name, point in sorted(installed_drivers().items()):
            try:
                found = point.load()
            except ImportError:
                continue
            section = Section(found.options).schema(options)
            section["properties"] = {"driver": {"const": name}, **section["properties"]}
            sections.append({**section, "required": ["driver", *section.get("required", ())]})
        return {"type": "object", "required": ["driver"], "oneOf": sections}


def read_section_file(path: Path, what: str, read: Callable[[ValueFile], T]) -> T:
    """Read a file that holds one section and nothing else: a camera's intrinsics, a depth model, one device's settings.

    Args:
        what: kind of the file, for messages.
        read: reads its content, and raises `Refused` if it cannot be used.

    Raises CellFileError: it cannot be used; the exception has all errors with their places.
    """
    findings = Findings()
    written = read_value_file(path, findings, what)
    try:
        if written is not None:
            return read(written)
    except Refused:
        pass
    raise CellFileError(findings.sorted())


def installed_drivers() -> Mapping[str, EntryPoint]:
    """Return every installed driver by its name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}
