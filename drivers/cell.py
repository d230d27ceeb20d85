"""A cell: named, connected drivers with one clock and one safe stop, as a cell file describes them.

    cell = load_cell("trees/cells/sim.yaml", seed=3, overrides={"fruit": "apple_5", "place": "3"})

`world:` names a simulated world, which gives the clock; without one the clock is the system's. `devices:` are connected
in the order of the file, so that one can build on those above it. `workspace:` is what skills know of the surroundings.
`record: required` ends a run in the safe state when its record cannot be written; without it the run goes on.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from drivers.cell_file import Settings, did_you_mean, read_cell_file
from drivers.device import Bench, Connect, Device, World
from drivers.errors import CellFileError, DeviceFault, DriverError
from drivers.estimate import estimate_errors
from drivers.hold_watch import HoldWatch
from drivers.interfaces import Arm, ForceSensor, Workspace
from drivers.readings import Readings
from drivers.workspace import read_workspace
from executive.clock import Clock, ManualClock, SystemClock

T = TypeVar("T")

KINDS = ("simulated", "emulated", "real", "frames", "mock")
GROUP = "pomona.drivers"


class Cell:
    """Drivers that work together: looked after each tick by `check`, stopped together by `safe_stop`."""

    def __init__(
        self,
        name: str,
        kind: str,
        clock: Clock,
        devices: Mapping[str, Device],
        workspace: Workspace | None = None,
        world: World | None = None,
        record_required: bool = False,
    ) -> None:
        self.record_required = record_required
        self.name, self.kind, self.clock, self.workspace = name, kind, clock, workspace
        self.devices = dict(devices)
        self._world = world
        self._latched: str | None = None
        self._lock = threading.Lock()
        self._paused = False
        self._watch = HoldWatch(self._find(Arm), self._find(ForceSensor))
        self._readings: Readings | None = None

    @property
    def latched(self) -> str | None:
        """The reason of a safe stop that nobody has acknowledged yet."""
        return self._latched

    def interfaces(self) -> tuple[type, ...]:
        """The device interfaces that this cell has."""
        offered = [interface for device in self.devices.values() for interface in device.interfaces]
        return tuple(dict.fromkeys(offered + ([Workspace] if self.workspace else [])))

    def device(self, interface: type[T]) -> T:
        """The device with this interface.

        Raises:
            KeyError: the cell has none.
        """
        found: T | None = self._find(interface)
        if found is None:
            raise KeyError(f"the cell {self.name} has no {interface.__name__}")
        return found

    def links(self) -> Mapping[str, str]:
        """State of each device's link, by the device's name: 'ok', or what is wrong."""
        return {name: device.link() for name, device in self.devices.items()}

    def heard(self) -> Mapping[str, float]:
        """When each device was last heard, by its name: the stamp of the newest thing that it sent [s]."""
        stamps = {name: device.heard() for name, device in self.devices.items()}
        return {name: stamp for name, stamp in stamps.items() if stamp is not None}

    def check(self) -> None:
        """Look after every device; called each tick.

        Raises:
            DeviceLost, DeviceFault: from the first device that has a problem.
        """
        for device in self.devices.values():
            device.check()
            if device.distrusted:
                raise DeviceFault(device.name, device.distrusted)
        if self._paused and self.settled():
            self._watch.note()
        if self._readings is not None:
            self._readings.note()

    def readings(self) -> Mapping[str, Mapping[str, Any]]:
        """What the devices measured since the last call, by device and quantity: `Readings.take`. Nothing is gathered
        before the first call."""
        if self._readings is None:
            self._readings = Readings(self.devices)
        return self._readings.take()

    def safe_stop(self, reason: str) -> None:
        """Arm decelerates and holds, gripper keeps its grip; latched until `acknowledge`.

        May be called from any thread and never raises. The first reason is kept. This is no replacement of the hardware
        emergency stop.
        """
        with self._lock:
            if self._latched is None:
                self._latched = reason
            self._paused = False
            for device in self.devices.values():
                # One device that fails to stop must not keep the others moving.
                with contextlib.suppress(Exception):
                    device.safe_stop(self._latched)

    def acknowledge(self) -> None:
        """Release the latch; nothing resumes by itself."""
        with self._lock:
            for device in self.devices.values():
                device.acknowledge()
                device.distrusted = ""
            self._latched = None

    def pause(self) -> None:
        """Stop motions on their paths; force control goes on."""
        if not self._paused:
            self._paused = True
            self._watch.forget()
            for device in self.devices.values():
                device.pause()

    def resume(self) -> None:
        """Go on with paused motions.

        Raises:
            DeviceFault: the arm was moved or the fruit is gone since the pause; nothing moves.
        """
        if not self._paused:
            return
        if self._latched is not None:
            raise DeviceFault(self.name, f"stands in its safe state ({self._latched}); acknowledge it first")
        self._watch.compare()
        self._paused = False
        for device in self.devices.values():
            device.resume()

    def settled(self) -> bool:
        """True when no device moves."""
        return all(device.settled() for device in self.devices.values())

    def truth(self, reported: Mapping[str, Any] | None = None) -> Mapping[str, object] | None:
        """The simulated world's own score of the run; None on any other cell.

        Args:
            reported: what the run says of the fruit's position and size; its errors are part of the score.
        """
        if self._world is None:
            return None
        truth = dict(self._world.truth())
        fruits = truth.pop("fruits", ())
        return {**truth, **estimate_errors(reported or {}, fruits if isinstance(fruits, Sequence) else ())}

    def close(self) -> None:
        """Bring everything to rest and let go of the devices, those connected last first."""
        if self._readings is not None:
            self._readings.close()
        for device in reversed(self.devices.values()):
            with contextlib.suppress(DriverError, OSError):
                device.close()

    def _find(self, interface: type) -> Any:
        if interface is Workspace:
            return self.workspace
        return next((device for device in self.devices.values() if interface in device.interfaces), None)


def load_cell(
    path: str | Path,
    *,
    seed: int = 0,
    overrides: Mapping[str, str] | None = None,
    missing: Callable[[str, DriverError], None] | None = None,
    text: str | None = None,
) -> Cell:
    """Read a cell file and connect its devices.

    Args:
        path: of the cell file.
        seed: of everything random in a simulated or mock cell.
        overrides: values of the file's `options`.
        missing: told of every device that cannot be connected, by name and why, instead of an error: for a look over
            the cell, never for a run.
        text: the file's content when it is not to be read from the disk; files that it names are still found beside
            `path`.

    Raises:
        CellFileError: the file cannot be used; says where, and what is known instead.
        DeviceError: a device could not be connected; those connected before are let go.
    """
    settings = read_cell_file(Path(path), overrides, text)
    name = settings.text("name", Path(path).stem)
    kind = settings.choice("kind", KINDS)
    workspace = read_workspace(settings.section("workspace")) if settings.has("workspace") else None
    bench = Bench(Path(path), _clock(settings), seed, workspace)
    try:
        world: World | None = None
        if settings.has("world"):
            simulator = _connect("world", settings.section("world"), bench)
            if not isinstance(simulator, World):
                raise settings.error("the driver of 'world' simulates no world", "world")
            world, bench.clock = simulator, simulator.clock
        devices = settings.section("devices")
        for device in devices.names():
            try:
                _connect(device, devices.section(device), bench)
            except DriverError as error:
                if missing is None:
                    raise
                missing(device, error)
        required = settings.choice("record", ("required", "optional"), "optional") == "required"
        settings.finish()
        cell = Cell(name, kind, bench.clock, bench.devices, workspace, world, required)
        _check_poses(settings, cell)
    except BaseException:
        for opened in reversed(bench.devices.values()):
            opened.close()
        raise
    return cell


def known_drivers() -> dict[str, str]:
    """Names that cell files can use, and the functions behind them."""
    return {name: entry.value for name, entry in _drivers().items()}


def _drivers() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def _clock(settings: Settings) -> Clock:
    return ManualClock() if settings.choice("clock", ("system", "manual"), "system") == "manual" else SystemClock()


def _connect(name: str, settings: Settings, bench: Bench) -> Device:
    drivers = _drivers()
    driver = settings.choice("driver", drivers)
    try:
        connect = cast(Connect, drivers[driver].load())
    except ImportError as error:
        raise settings.error(f"the driver '{driver}' cannot be loaded: {error}", "driver") from error
    device = connect(settings, bench)
    bench.devices[name] = device
    device.name = name
    settings.finish()
    return device


def _check_poses(settings: Settings, cell: Cell) -> None:
    """Named poses must be reachable by the cell's arm."""
    arm = cell._find(Arm)
    if arm is None or cell.workspace is None:
        return
    limits = arm.limits
    poses = settings.section("workspace").section("poses") if cell.workspace.poses else None
    for name, q in cell.workspace.poses.items():
        if poses is not None and (q.shape != limits.lower.shape or np.any((q < limits.lower) | (q > limits.upper))):
            raise poses.error(f"the pose '{name}' needs {limits.lower.size} joints within the arm's limits", name)


__all__ = ["Cell", "CellFileError", "did_you_mean", "known_drivers", "load_cell"]
