"""Base of drivers, beyond their interface: the cell can watch, stop, pause and release a device.

A device derives from `Device` and lists its interfaces in `interfaces` (`pomona.drivers.interfaces.Camera`, …).
`pomona.executive.cell.registration` describes how a cell file connects it. The defaults below suit a device that cannot
move. An interface marks methods for the cell:

    class Thermometer(Protocol):
        @stamped
        def latest(self) -> Temperature | None: ...
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar, runtime_checkable

from pomona.executive.clock import Clock
from pomona.executive.lease import commands_of

if TYPE_CHECKING:  # small commands do not load numpy
    from pomona.executive.cell.errors import DeviceError
    from pomona.executive.cell.owner import Link
    from pomona.executive.values.arrays import UInt8

T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])


def stamped(method: F) -> F:
    """Mark a method of an interface: it returns the newest thing that the device sent, with a `stamp` [s], or None."""
    method.__is_stamped__ = True  # type: ignore[attr-defined]
    return method


def paced(method: F) -> F:
    """Mark a command of an interface: a run may reduce the speed of its motions, so the device needs `go_at`."""
    method.__is_paced__ = True  # type: ignore[attr-defined]
    return method


class Device:
    """A named device of a cell. Methods are called from the tick's thread; `safe_stop` from any thread."""

    interfaces: ClassVar[tuple[type, ...]] = ()
    outlives: ClassVar[bool] = False
    """Whether it moves something that keeps moving without this process. Its cell must then be declared real or
    emulated: the checks before a run depend on that."""
    declared: ClassVar[Mapping[str, str]] = {}
    """Claims of `pomona.drivers.conformance` that it cannot keep, by name: why, with the page of its protocol."""
    distrusted = ""
    _problem: DeviceError | None = None
    outside_stop: tuple[str, tuple[Any, ...]] | None = None
    """How another process stops the device when this one is gone: the function `module:name` and its arguments."""

    def __init__(self, name: str) -> None:
        self.name = name

    def _wrong(self) -> DeviceError | None:
        """Return what is wrong with it, until that is acknowledged; None: nothing."""
        return self._problem

    def link(self) -> str:
        """State of the link: 'ok', or the problem."""
        problem = self._wrong()
        return "ok" if problem is None else problem.message

    def picture(self) -> tuple[UInt8, float] | None:
        """Return the newest colour image (h, w, 3) and its timestamp [s], if it costs nothing. From any thread."""
        return None

    def last_seen(self) -> float | None:
        """Return the stamp [s] of the newest thing that the device sent, or None: nothing yet, or it sends nothing."""
        method = next(
            (
                name
                for interface in self.interfaces
                for name in commands_of(interface, "__is_stamped__")
            ),
            None,
        )
        newest: Any = None if method is None else getattr(self, method)()
        return None if newest is None else float(newest.stamp)

    def check(self) -> None:
        """Look after the device; called each tick and must not block.

        Raises:
            DeviceLost: no answer within the device's deadline, or its stream is stale.
            DeviceFault: the device reports a fault.
        """
        problem = self._wrong()
        if problem is not None:
            raise problem

    def distrust(self, reason: str) -> None:
        """Mark the device's values as implausible: until `acknowledge` the cell's check raises `DeviceFault` with this.

        Called from any thread, by code that compares its signals with others. The first reason stays.
        """
        self.distrusted = self.distrusted or reason

    def safe_stop(self, reason: str) -> None:
        """Bring the device to rest within its limits, hold, keep the grip; latch. Must not raise."""

    def acknowledge(self) -> None:
        """Release the latch; nothing resumes by itself."""

    def pause(self) -> None:
        """Stop motions on their paths so that they can be resumed; force control goes on."""

    def resume(self) -> None:
        """Resume the paused motion."""

    def go_at(self, speed: float) -> None:
        """Scale the commanded speed by this ratio (above 0 to 1) from now on, also of motions in progress.

        For an arm: its paths take longer by this ratio, within its limits during the change. An arm whose driver leaves
        this out has full speed only, and a request for less is refused. Other devices do nothing.
        """

    @property
    def full_speed_only(self) -> bool:
        """Whether it has paced commands, as an arm has, and its driver cannot reduce the speed."""
        return type(self).go_at is Device.go_at and any(
            commands_of(one, "__is_paced__") for one in self.interfaces
        )

    def settled(self) -> bool:
        """True when nothing of the device moves."""
        return True

    def close(self) -> None:
        """Bring the device to rest and disconnect."""


class FaultSwitch:
    """Simulated or emulated device, wire or sensor that can be made to fail in ways that it names, one at a time.

    A cell names all of them in `Cell.switches`. Real devices have none.

    Attributes:
        fault: the present one, or None.
    """

    known_faults: tuple[str, ...] = ()

    def __init__(self) -> None:
        self.fault: str | None = None

    def inject_fault(self, kind: str) -> None:
        """Fail from now on. Raises ValueError: there is no such fault here."""
        if kind not in self.known_faults:
            raise ValueError(f"there are the faults {', '.join(self.known_faults)}, not {kind}")
        self.fault = kind

    def clear_fault(self) -> None:
        """Clear the fault; its consequences remain."""
        self.fault = None


@runtime_checkable
class World(Protocol):
    """A simulated world: a device that gives the cell its clock and its truth."""

    @property
    def clock(self) -> Clock:
        """The world's own time."""

    def truth(self) -> Mapping[str, object]:
        """Return the true state of the world, for reports; empty where it is not known."""


@dataclass(slots=True)
class ConnectContext:
    """Context of a connection: the clock, the seed, and the devices connected before it.

    Attributes:
        cell: the cell file; relative paths in it start at its folder.
        seed: of everything random.
        workspace: the surroundings in the cell file, as the installed services describe them, or None.
        devices: connected so far, by name; a cell file lists devices before those that build on them.
        wires: for addresses and ports at which this process itself emulates a device, how to connect.
        cleared: an operator has checked that nothing is held: fingers without a reference may find it by moving.
        takes_over: this, or a recovery, was ordered: what another run seems to hold is taken over.
    """

    cell: Path
    clock: Clock
    seed: int
    workspace: Any = None
    devices: dict[str, Device] = field(default_factory=dict)
    wires: dict[str, Callable[[], Link]] = field(default_factory=dict)
    cleared: bool = False
    takes_over: bool = False

    def find(self, interface: type[T]) -> T | None:
        """Return the device connected before with this interface or of this class, or None."""
        for device in self.devices.values():
            if interface in device.interfaces or isinstance(device, _class_only(interface)):
                return device  # type: ignore[return-value]  # its class promises the interface
        return None


def _class_only(interface: type) -> type | tuple[()]:
    """Return the class itself for isinstance, but nothing for a Protocol, which matches by method names only."""
    return () if getattr(interface, "_is_protocol", False) else interface
