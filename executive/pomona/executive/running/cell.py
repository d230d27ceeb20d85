"""Interface of a cell for the executive; `pomona.drivers.cell` implements it (entry point `pomona.cells`)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from pomona.executive.clock import Clock

if TYPE_CHECKING:  # small commands do not load numpy
    from pomona.executive.values.arrays import UInt8

T = TypeVar("T")


class FaultSwitch(Protocol):
    """Something of a simulated or emulated cell that can be made to fail in ways that it names, one at a time."""

    @property
    def known_faults(self) -> tuple[str, ...]:
        """The ways in which it can fail."""

    def inject_fault(self, kind: str) -> None:
        """Fail from now on."""

    def clear_fault(self) -> None:
        """Work again."""


class Cell(Protocol):
    """Named, connected drivers with one clock and one safe stop."""

    @property
    def name(self) -> str: ...

    @property
    def kind(self) -> str:
        """simulated, emulated, real, frames or mock: shown wherever the run is shown."""

    @property
    def clock(self) -> Clock:
        """The cell's time: the system's, or the simulated world's."""

    @property
    def latched(self) -> str | None:
        """The reason of an unacknowledged safe stop; nothing moves while there is one."""

    def interfaces(self) -> tuple[type, ...]:
        """Return the device interfaces that this cell has."""

    def device(self, interface: type[T]) -> T:
        """Return the device with this interface. Raises KeyError: the cell has none."""

    def links(self) -> Mapping[str, str]:
        """State of each device's link, by the device's name: 'ok', or the problem."""

    def last_seen(self) -> Mapping[str, float]:
        """When each device was last seen, by its name: a stamp of the clock [s]. Devices that send nothing are left
        out."""

    def pictures(self) -> Mapping[str, tuple[UInt8, float]]:
        """Return the newest image (h, w, 3) of each camera, and its timestamp [s]. From any thread."""

    @property
    def record_required(self) -> bool:
        """Whether a run must end in the safe state when its record cannot be written."""

    def readings(self) -> Mapping[str, Mapping[str, Any]]:
        """Device measurements since the last call, for the record: arrays in SI units by device and quantity."""

    def check(self) -> None:
        """Look after every device; called each tick.

        Raises Exception: a device is lost, stale or in fault; the run ends in the safe state.
        """

    def safe_stop(self, reason: str) -> Mapping[str, str]:
        """Arm decelerates and holds, gripper keeps its grip; latched. Never raises, may be called from any thread.

        Returns the reasons of devices that could not be stopped, by their names.
        """

    def acknowledge(self) -> None:
        """Release the latch; nothing resumes by itself."""

    def pause(self) -> None:
        """Stop motions on their paths; force control goes on."""

    def resume(self) -> None:
        """Go on with paused motions.

        Raises Exception: the world has changed since the pause: the arm was moved, or the fruit in the gripper is gone.
        """

    @property
    def full_speed_only(self) -> tuple[str, ...]:
        """Names of devices that should be slowed down by `set_speed`, and cannot be."""

    def set_speed(self, speed: float, of: Collection[type] = ()) -> None:
        """Scale the commanded speed by a ratio (above 0 to 1) from now on, for the given interfaces or all.

        Raises Exception: it is less than 1, and one of them cannot be slowed down.
        """

    def in_hand(self) -> str | None:
        """Describe an object that may be between the fingers: an empty text for none, None in a cell without a hand."""

    def outside_stops(self) -> Mapping[str, tuple[str, Sequence[Any]]]:
        """How another process can stop devices when this one hangs or dies: by name the function `module:name` and its
        arguments, which JSON can carry. Empty where nothing is left to move, as in a simulated cell."""

    @property
    def heartbeat_deadline(self) -> float:
        """Seconds without a tick after which that happens."""

    @property
    def switches(self) -> Mapping[str, FaultSwitch]:
        """All that can be made to fail on purpose, by name; nothing on a real cell."""

    def settled(self) -> bool:
        """True when no device moves."""

    def truth(self, reported: Mapping[str, object] | None = None) -> Mapping[str, object] | None:
        """Return the simulated world's own score of the run, for the report only; None on any other cell.

        `reported` are facts that the run found out and that the world can judge.
        """

    def close(self) -> None:
        """Bring everything to rest and release the devices."""
