"""A cell: named, connected drivers with one clock and one safe stop, as a cell file describes them.

    cell = load_cell("trees/cells/sim.yaml", seed=3, overrides={"fruit": "apple_5", "place": "3"})

`world:` names a simulated world, which gives the clock; without one the clock is the system's. `devices:` are connected
in the order of the file, so that one can build on those above it. `workspace:` describes the surroundings for skills.
`heartbeat: 1 s` is the longest stall of a run before its supervisor process stops the devices. `record: required` ends
a run in the safe state when its record cannot be written; without it the run goes on.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pomona.drivers.cell_file import CELL, CellFile, judge_cell_file, outline_cell, read_cell_file
from pomona.drivers.device import ConnectContext, Device, World
from pomona.drivers.errors import CellFileError, DeviceFault, DriverError
from pomona.drivers.estimate import estimate_errors
from pomona.drivers.faults import FaultSwitch
from pomona.drivers.hand_memory import HandMemory, HandRecord
from pomona.drivers.hold_watch import HoldWatch
from pomona.drivers.interfaces import Arm, Camera, Cameras, DepthCamera, ForceSensor, Gripper, Hand, Workspace
from pomona.drivers.readings import Readings
from pomona.drivers.registration import Settings, Wired
from pomona.executive.clock import Clock, ManualClock, SystemClock
from pomona.executive.lease import viewed
from pomona.executive.values.arrays import UInt8
from pomona.executive.values.bounded import warn
from pomona.executive.values.documents import Outline, with_includes
from pomona.executive.values.findings import Findings
from pomona.executive.values.kinds import Schema
from pomona.executive.values.sentences import sentence_of
from pomona.executive.values.yaml_nodes import YamlScalar

T = TypeVar("T")

logger = logging.getLogger(__name__)

STOPPING = 1.0  # seconds for a safe stop of a device, and for the supervisor process to notice a stall

COUNTS_MOST = (
    "lifted",
    "put_away",
    "drops",
    "lost",
    "collisions",
    "slip_mm",
    "finger_peak_n",
    "position_error_mm",
    "size_error_mm",
)
"""Quantities that come first in a world's score: a summary shows the first five figures that are not 0."""


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
        heartbeat_deadline: float = 1.0,
    ) -> None:
        self.record_required, self.heartbeat_deadline = record_required, heartbeat_deadline
        self.name, self.kind, self.clock, self.workspace = name, kind, clock, workspace
        self.devices = dict(devices)
        self._world = world
        self._latched: str | None = None
        self._lock = threading.Lock()
        self._paused = False
        self._checked_at = clock.now()
        fingers, gripper = self._find(ForceSensor), self._find(Gripper)
        hand = gripper if fingers is None else fingers
        memory = None if hand is None else hand.hand_memory
        if memory is None and gripper is not None and not gripper.outlives:
            memory = HandMemory(None, HandRecord())  # of a new world, which ends with this process
        self._watch = HoldWatch(self._find(Arm), fingers, gripper, memory)
        self._readings: Readings | None = None

    @property
    def latched(self) -> str | None:
        """The reason of an unacknowledged safe stop."""
        return self._latched

    def interfaces(self) -> tuple[type, ...]:
        """Return the device interfaces that this cell has."""
        offered = [interface for device in self.devices.values() for interface in device.interfaces]
        return tuple(dict.fromkeys(offered + ([Workspace] if self.workspace else [])))

    def device(self, interface: type[T]) -> T:
        """Return the device with this interface. Raises KeyError: the cell has none."""
        found: T | None = self._find(interface)
        if found is None:
            raise KeyError(f"the cell {self.name} has no {interface.__name__}")
        return found

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
        before, self._checked_at = self._checked_at, self.clock.now()
        if self._checked_at < before:  # no deadline and no age of a sample can be trusted
            raise DeviceFault("clock", f"the cell's time went back by {before - self._checked_at:.3g} s")
        for device in self.devices.values():
            device.check()
            if device.distrusted:
                raise DeviceFault(device.name, device.distrusted)
        if self._paused and self.settled():
            self._watch.note()
        if self._readings is not None:
            self._readings.note()

    def readings(self) -> Mapping[str, Mapping[str, Any]]:
        """Return the measurements of the devices since the last call, by device and quantity: `Readings.take`. Nothing
        is gathered before the first call.
        """
        if self._readings is None:
            self._readings = Readings(self.devices)
        return self._readings.take()

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
                target=self._stop, args=(name, reason, failed), name=f"pomona-stop-{name}", daemon=True
            )
            for name in self.devices
        }
        for name, stop in stops.items():
            try:
                stop.start()
            except (RuntimeError, MemoryError):  # no more threads can be had: one after the other, then
                self._stop(name, reason, failed)
        end = time.monotonic() + STOPPING
        for stop in stops.values():
            if stop.ident is not None:
                stop.join(max(end - time.monotonic(), 0.0))
        late = {name: f"has not taken the safe stop within {STOPPING:g} s" for name in stops if stops[name].is_alive()}
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
            self._watch.forget()
            for device in self.devices.values():
                device.pause()

    def resume(self) -> None:
        """Go on with paused motions.

        Raises DeviceFault: the arm was moved or the fruit is gone since the pause; nothing moves.
        """
        if not self._paused:
            return
        if self._latched is not None:
            raise DeviceFault(self.name, f"stands in its safe state ({self._latched}); acknowledge it first")
        self._watch.compare()
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
        chosen = [device for device in self.devices.values() if not of or not set(of).isdisjoint(device.interfaces)]
        for device in chosen:
            if speed < 1.0 and device.full_speed_only:
                raise DeviceFault(device.name, "its driver cannot reduce the commanded speed")
        for device in chosen:
            device.go_at(speed)

    @property
    def switches(self) -> Mapping[str, FaultSwitch]:
        """All that can be made to fail on purpose, by name; nothing on a real cell."""
        devices = {name: device for name, device in self.devices.items() if isinstance(device, FaultSwitch)}
        within: Mapping[str, FaultSwitch] = getattr(self._world, "switches", {})
        return {**within, **devices}

    def in_hand(self) -> str | None:
        """Describe an object that may be between the fingers: an empty text for none, None in a cell without a hand."""
        return self._watch.in_hand()

    def outside_stops(self) -> Mapping[str, tuple[str, Sequence[Any]]]:
        """How another process stops the devices when this one hangs or dies, by the devices' names."""
        return {name: device.outside_stop for name, device in self.devices.items() if device.outside_stop is not None}

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
        truth = dict(self._world.truth())
        fruits = truth.pop("fruits", ())
        truth |= estimate_errors(reported or {}, fruits if isinstance(fruits, Sequence) else ())
        return {name: truth[name] for name in dict.fromkeys((*COUNTS_MOST, *truth)) if name in truth}

    def close(self) -> None:
        """Bring everything to rest and release the devices, those connected last first."""
        if self._readings is not None:
            self._readings.close()
        _close(self.devices)

    def _find(self, interface: type) -> Any:
        if interface is Workspace:
            return self.workspace
        if interface is Hand:
            return self._watch
        if interface is Cameras:
            seeing: Any = [device for device in self.devices.values() if Camera in device.interfaces]
            return Cameras(tuple(viewed(c, DepthCamera if isinstance(c, DepthCamera) else Camera) for c in seeing))
        return next((device for device in self.devices.values() if interface in device.interfaces), None)


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
    return connect_cell(read_cell_file(Path(path), overrides, texts, missing), seed=seed, missing=missing)


def connect_cell(
    file: CellFile,
    *,
    seed: int = 0,
    missing: Callable[[str, DriverError], None] | None = None,
    cleared: bool = False,
) -> Cell:
    """Connect the devices of a cell file without errors; for the arguments see `load_cell` and `ConnectContext`.

    Raises:
        CellFileError: a value is wrong on use: for example an address without a device.
        DeviceError: a device could not be connected; those connected before are released.
    """
    said = file.section
    clock: Clock = ManualClock() if said.clock == "manual" else SystemClock()
    context = ConnectContext(file.path, clock, seed, file.workspace, cleared=cleared)
    try:
        world: World | None = None
        if said.world is not None:
            simulator = _connect(said.world, context)
            if not isinstance(simulator, World):
                raise said.world.error("the driver simulates no world", "driver")
            world, context.clock = simulator, simulator.clock
        for name, settings in said.devices.items():
            try:
                _connect(settings, context)
            except DriverError as error:
                if missing is None:
                    raise
                missing(name, error)
        _remember_hand(file, context)
        return Cell(
            file.name,
            file.kind,
            context.clock,
            context.devices,
            file.workspace,
            world,
            file.record_required,
            said.heartbeat,
        )
    except BaseException:
        _close(context.devices)
        raise


def _close(devices: Mapping[str, Device]) -> None:
    """Release devices, those connected last first; a device that fails to close must not keep the others open."""
    for name, device in reversed(list(devices.items())):
        try:
            device.close()
        except BaseException as error:
            warn(logger, "%s could not be closed: %s", name, sentence_of(error))


def _remember_hand(file: CellFile, context: ConnectContext) -> None:
    """Give a gripper without force sensor the memory of its hand; an operator who cleared the cell knows it empty."""
    gripper: Any = context.find(Gripper)
    if gripper is None or context.find(ForceSensor) is not None or not gripper.outlives:
        return
    said = file.section.devices[gripper.name].values
    wires = said.wires if isinstance(said, Wired) else (str(file.path.resolve()), gripper.name)
    gripper.hand_memory = context.hand_memory(wires)
    if context.cleared:
        gripper.hand_memory.keep_hand("", gripper.state().width)


def _connect(settings: Settings[Any], context: ConnectContext) -> Device:
    device = settings.driver(settings, context)
    context.devices[settings.name] = device
    device.name = settings.name
    return device


class CellFiles:
    """Cell files for the executive: read, judged, connected, described."""

    def outline(self, path: Path, findings: Findings) -> Outline | None:
        """Return the cell's kind and its options for `--set`, or None if the file cannot be read."""
        return outline_cell(path, findings)

    def judge(
        self,
        path: Path,
        findings: Findings,
        overrides: Mapping[str, str | YamlScalar],
        texts: Mapping[str, str],
    ) -> CellFile | None:
        """Everything that is wrong with a file goes to `findings`; nothing is connected."""
        return judge_cell_file(path, findings, overrides, texts)

    def connect(self, file: CellFile, seed: int, cleared: bool = False) -> Cell:
        """Connect the devices: `connect_cell`."""
        return connect_cell(file, seed=seed, cleared=cleared)

    def load(self, path: Path) -> Cell:
        """Read a file and connect its devices: `load_cell`."""
        return load_cell(path)

    def recognises(self, keys: Collection[str]) -> bool:
        """Return True if a file with these keys at its top is one."""
        return not {"devices", "world", "workspace", "options"}.isdisjoint(keys)  # an `include` may bring the devices

    def check(self, path: Path, findings: Findings) -> None:
        """Everything that is wrong with a file, with its options as they are."""
        judge_cell_file(path, findings)

    def schema(self) -> Schema:
        """Return the JSON Schema of cell files."""
        return {"title": "Pomona cell file", **with_includes(CELL.schema(options=True))}


CELL_FILES = CellFiles()

__all__ = ["CELL_FILES", "Cell", "CellFileError", "connect_cell", "load_cell"]
