"""A cell: named, connected drivers with one clock and one safe stop."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from pomona.executive.cell.device import Device, FaultSwitch, World
from pomona.executive.cell.errors import DeviceFault
from pomona.executive.cell.services import Services, installed_services
from pomona.executive.clock import Clock, ManualClock
from pomona.executive.values.processes import warn
from pomona.executive.values.sentences import sentence_of

if TYPE_CHECKING:  # small commands do not load numpy
    from pomona.executive.values.arrays import UInt8

T = TypeVar("T")

logger = logging.getLogger(__name__)

# seconds for a safe stop of a device, and for the supervisor process to notice a stall
STOPPING = 1.0


class Cell:
    """Drivers that work together: looked after each tick by `check`, stopped together by `safe_stop`."""

    def __init__(
        self,
        name: str,
        kind: str,
        clock: Clock,
        devices: Mapping[str, Device],
        services: Services | None = None,
        world: World | None = None,
        record_required: bool = False,
        heartbeat_deadline: float = 1.0,
    ) -> None:
        """
        Args:
            devices: connected, in this order.
            services: of these devices; without them, those of the installation.
        """
        self.record_required = record_required
        self.heartbeat_deadline = heartbeat_deadline
        self.name = name
        self.kind = kind
        self.clock = clock
        self.devices = dict(devices)
        if services is None:  # none where there is nothing to watch: a dry run loads no robot
            services = (installed_services() if self.devices else Services)(self.devices)
        self.services = services
        self._world = world
        self._latched: str | None = None
        self._lock = threading.Lock()
        self._paused = False
        self._checked_at = clock.now()

    @property
    def workspace(self) -> Any:
        """The surroundings, as the installed services describe them, or None."""
        return self.services.workspace

    @property
    def latched(self) -> str | None:
        """The reason of an unacknowledged safe stop."""
        return self._latched

    def interfaces(self) -> tuple[type, ...]:
        """Return the device interfaces that this cell has."""
        offered = [interface for device in self.devices.values() for interface in device.interfaces]
        return tuple(dict.fromkeys(offered + ([type(self.workspace)] if self.workspace else [])))

    def device(self, interface: type[T]) -> T:
        """Return the device with this interface. Raises KeyError: the cell has none."""
        served = self.services.find(interface)
        devices = (device for device in self.devices.values() if interface in device.interfaces)
        found: Any = next(devices, None) if served is None else served
        if found is None:
            raise KeyError(f"the cell {self.name} has no {interface.__name__}")
        return found  # type: ignore[no-any-return]

    def links(self) -> Mapping[str, str]:
        """State of each device's link, by the device's name: 'ok', or the problem."""
        return {name: device.link() for name, device in self.devices.items()}

    def last_seen(self) -> Mapping[str, float]:
        """When each device was last seen, by its name: the stamp of the newest thing that it sent [s]."""
        stamps = {name: device.last_seen() for name, device in self.devices.items()}
        return {name: stamp for name, stamp in stamps.items() if stamp is not None}

    def pictures(self) -> Mapping[str, tuple[UInt8, float]]:
        """Return the newest image (h, w, 3) of each camera, and its timestamp [s]. From any thread."""
        pictures = {name: device.picture() for name, device in self.devices.items()}
        return {name: picture for name, picture in pictures.items() if picture is not None}

    def check(self) -> None:
        """Look after every device; called each tick.

        Raises:
            DeviceLost, DeviceFault: from the first device that has a problem, or of a clock that went back.
        """
        before = self._checked_at
        self._checked_at = self.clock.now()
        if self._checked_at < before:  # no deadline and no age of a sample can be trusted
            raise DeviceFault(
                "clock", f"the cell's time went back by {before - self._checked_at:.3g} s"
            )
        for device in self.devices.values():
            device.check()
            if device.distrusted:
                raise DeviceFault(device.name, device.distrusted)
        if self._paused and self.settled():
            self.services.at_rest()
        self.services.gather()

    def readings(self) -> Mapping[str, Mapping[str, Any]]:
        """Return the measurements of the devices since the last call, by device and quantity: arrays in SI units.
        Nothing is gathered before the first call.
        """
        return self.services.readings()

    def safe_stop(self, reason: str) -> Mapping[str, str]:
        """Arm decelerates and holds, gripper keeps its grip; latched until `acknowledge`.

        May be called from any thread and never raises. The first reason is kept. This is no replacement of the hardware
        emergency stop.

        Returns:
            the reasons of devices that could not be stopped, by their names.
        """
        if self._latched is None:
            self._latched = reason
        with self._lock:
            return self._stop_all(reason)

    def _stop_all(self, reason: str) -> dict[str, str]:
        if self._latched is None:  # an acknowledgement has come between
            self._latched = reason
        self._paused = False
        failed: dict[str, str] = {}
        # A simulated world is no place for threads, and nothing in it hangs.
        if self.clock.simulated:
            for name in self.devices:
                self._stop(name, self._latched, failed)
        else:
            failed = self._stop_side_by_side(self._latched)
        for name, what in failed.items():
            self.devices[name].distrusted = what
        return failed

    def _stop_side_by_side(self, reason: str) -> dict[str, str]:
        """One device that does not answer must not keep the others moving."""
        failed: dict[str, str] = {}
        stops = {
            name: threading.Thread(
                target=self._stop,
                args=(name, reason, failed),
                name=f"pomona-stop-{name}",
                daemon=True,
            )
            for name in self.devices
        }
        for name, stop in stops.items():
            try:
                stop.start()
            except (
                RuntimeError,
                MemoryError,
            ):  # no more threads can be had: one after the other, then
                self._stop(name, reason, failed)
        end = time.monotonic() + STOPPING
        for stop in stops.values():
            if stop.ident is not None:
                stop.join(max(end - time.monotonic(), 0.0))
        late = {
            name: f"has not taken the safe stop within {STOPPING:g} s"
            for name in stops
            if stops[name].is_alive()
        }
        return {**failed, **late}

    def _stop(self, name: str, reason: str, failed: dict[str, str]) -> None:
        """One that fails to stop must not either. A stop that is late keeps its reason, also after a reset."""
        try:
            self.devices[name].safe_stop(reason)
        except BaseException as error:
            failed[name] = f"did not take the safe stop: {sentence_of(error)}"

    def acknowledge(self) -> None:
        """Release the latch; nothing resumes by itself. When a device refuses, all of them stay in the safe state.

        Raises DeviceError: from the first device that is still lost, or still reports a fault.
        """
        with self._lock:
            try:
                for device in self.devices.values():
                    device.acknowledge()
            except BaseException as error:
                self._stop_all(sentence_of(error))
                raise
            for device in self.devices.values():
                device.distrusted = ""
            self._latched = None

    def pause(self) -> None:
        """Stop motions on their paths; force control goes on."""
        if not self._paused:
            self._paused = True
            self.services.forget()
            for device in self.devices.values():
                device.pause()

    def resume(self) -> None:
        """Go on with paused motions.

        Raises DeviceFault: the arm was moved or the fruit is gone since the pause; nothing moves.
        """
        if not self._paused:
            return
        if self._latched is not None:
            raise DeviceFault(
                self.name, f"stands in its safe state ({self._latched}); acknowledge it first"
            )
        self.services.compare()
        self._paused = False
        for device in self.devices.values():
            device.resume()

    @property
    def full_speed_only(self) -> tuple[str, ...]:
        """Names of arms whose drivers cannot reduce the speed."""
        return tuple(name for name, device in self.devices.items() if device.full_speed_only)

    def set_speed(self, speed: float, of: Collection[type] = ()) -> None:
        """Scale the commanded speed of devices from now on, also of motions in progress.

        Args:
            speed: above 0 to 1.
            of: applies to the devices with these interfaces, or to all if empty.

        Raises:
            DeviceFault: it is less than 1, and one of the arms cannot reduce its speed; nothing has changed.
            ValueError: it is outside this range.
        """
        if not 0.0 < speed <= 1.0:
            raise ValueError(f"a speed must be above 0 and at most 1, not {speed}")
        chosen = [
            device
            for device in self.devices.values()
            if not of or not set(of).isdisjoint(device.interfaces)
        ]
        for device in chosen:
            if speed < 1.0 and device.full_speed_only:
                raise DeviceFault(device.name, "its driver cannot reduce the commanded speed")
        for device in chosen:
            device.go_at(speed)

    @property
    def switches(self) -> Mapping[str, FaultSwitch]:
        """All that can be made to fail on purpose, by name; nothing on a real cell."""
        devices = {
            name: device for name, device in self.devices.items() if isinstance(device, FaultSwitch)
        }
        within: Mapping[str, FaultSwitch] = getattr(self._world, "switches", {})
        return {**within, **devices}

    def in_hand(self) -> str | None:
        """Describe an object that may be between the fingers: an empty text for none, None in a cell without a hand."""
        return self.services.in_hand()

    def outside_stops(self) -> Mapping[str, tuple[str, Sequence[Any]]]:
        """How another process stops the devices when this one hangs or dies, by the devices' names."""
        return {
            name: device.outside_stop
            for name, device in self.devices.items()
            if device.outside_stop is not None
        }

    def settled(self) -> bool:
        """True when no device moves."""
        return all(device.settled() for device in self.devices.values())

    def truth(self, reported: Mapping[str, Any] | None = None) -> Mapping[str, object] | None:
        """Return the simulated world's own score of the run; None on any other cell.

        Args:
            reported: the run's estimate of the fruit's position and size; its errors are part of the score.
        """
        if self._world is None:
            return None
        return self.services.score(self._world.truth(), reported or {})

    def close(self) -> None:
        """Bring everything to rest and release the devices, those connected last first."""
        self.services.close()
        close_all(self.devices)


def dry_cell() -> Cell:
    """Return a cell without devices on a manual clock, for runs in which mocks stand in for all skills."""
    return Cell("dry", "mock", ManualClock(), {})


def close_all(devices: Mapping[str, Device]) -> None:
    """Release devices, those connected last first; a device that fails to close must not keep the others open."""
    for name, device in reversed(list(devices.items())):
        try:
            device.close()
        except BaseException as error:
            warn(logger, "%s could not be closed: %s", name, sentence_of(error))
