"""Services of a cell beside its devices: surroundings, state of a hand, measurements for the record, a run's score.

The executive has none. A package that knows its devices names a class of them in the entry point group `pomona.cells`
as `services` (`pomona.drivers.services.RobotServices`); one object is made for each cell with devices.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pomona.executive.cell.device import ConnectContext, Device
from pomona.executive.cell.registration import Settings
from pomona.executive.errors import UsageError
from pomona.executive.values.findings import Findings
from pomona.executive.values.installation import (
    WHOLE,
    distribution,
    elsewhere,
    entry_points,
    reinstall,
)
from pomona.executive.values.kinds import Kind, Schema, Words
from pomona.executive.values.sections import Placed, Section, value
from pomona.executive.values.yaml_nodes import Reader, YamlNode


class Services:
    """No services: the base of those that a package installs."""

    context: ClassVar[type[ConnectContext]] = ConnectContext
    """Class of the context in which devices are connected."""
    section: ClassVar[type | None] = None
    """Dataclass of the key `workspace` in a cell file; its method `workspace` returns the object for the skills."""

    def __init__(self, devices: Mapping[str, Device], workspace: object | None = None) -> None:
        self.devices = devices
        self.workspace = workspace

    @classmethod
    def judge(cls, placed: Placed[Any], facts: Iterable[object], findings: Findings) -> None:
        """Look for conflicts of a cell file's workspace with `facts`: all that its devices describe beforehand."""

    @classmethod
    def connected(cls, settings: Mapping[str, Settings[Any]], context: ConnectContext) -> Services:
        """Return the services of a cell whose devices have just been connected.

        Args:
            settings: sections of the devices, by name; a device that could not be connected has one as well.
        """
        return cls(context.devices, context.workspace)

    def find(self, interface: type) -> Any:
        """Return the service with this interface, or None."""
        return self.workspace if interface is type(self.workspace) else None

    def at_rest(self) -> None:
        """Note the state of the devices; called in each tick of a pause in which nothing moves."""

    def forget(self) -> None:
        """Forget the noted state; called when a pause begins."""

    def compare(self) -> None:
        """Compare with the noted state. Raises DeviceFault: nothing may move on, since something has changed."""

    def gather(self) -> None:
        """Gather measurements; called each tick."""

    def readings(self) -> Mapping[str, Mapping[str, Any]]:
        """Return the measurements of the devices since the last call, by device and quantity."""
        return {}

    def in_hand(self) -> str | None:
        """Describe an object that may be between the fingers: an empty text for none, None in a cell without a hand."""
        return None

    def score(
        self, truth: Mapping[str, object], reported: Mapping[str, Any]
    ) -> Mapping[str, object]:
        """Return the score of a run: a simulated world's truth, and how far the `reported` facts are from it."""
        return truth

    def close(self) -> None:
        """Called before the devices are released."""


def installed_services() -> type[Services]:
    """Return the class that an installed package names. Raises UsageError: the installation is damaged or outdated."""
    for point in entry_points(group="pomona.cells", name="services"):
        found: type[Services] = point.load()
        return found
    if distribution() == WHOLE:  # without them no cell would watch its hand
        raise UsageError(f"the installation lacks the services of its cells: {reinstall(WHOLE)}")
    return Services


class WorkspaceKind(Kind[Any]):
    """Surroundings of the devices, as the installed services describe them."""

    words = "a mapping"

    def read(self, node: YamlNode, reader: Reader) -> Any:
        section = installed_services().section
        if section is None:
            message = f"{reader.title}: nothing installed here describes surroundings"
            raise reader.refuse(node, message, elsewhere("robots"), "unfit")
        return Section(section).read(node, reader)

    def schema(self, options: bool = False) -> Schema:
        section = installed_services().section
        return {"not": {}} if section is None else Section(section).schema(options)


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Quantities of the world's truth for reports."""

    figures: tuple[str, ...] = value(Words(), (), "numbers of the world's truth, for reports")

    def over(self, cells: Score | None) -> Score:
        """Return this score, completed by the cell's; the cell's figures come first."""
        if cells is None:
            return self
        return Score(figures=tuple(dict.fromkeys((*self.figures, *cells.figures))))
