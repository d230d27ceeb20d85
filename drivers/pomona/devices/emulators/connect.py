"""The drivers `emulated-world` and `emulated-camera` of a cell file: a simulated world behind emulated devices.

world:
  driver: emulated-world
  cell: sim.yaml                        # the simulated cell
  options: {fruit: apple_1}             # of that cell
  time: virtual                         # the world's, in this process; or wall: in a process of its own, on real wires
  arm: 127.0.0.1:50240                  # where the real drivers find their devices
  controller: fs100
  gripper: 127.0.0.1:41000
  hand: wsg
  fingers: /run/user/1000/pomona        # folder with the links finger_left and finger_right
  camera: 127.0.0.1:41001
  pace: 1                               # of wall time; below 1 the cell's time runs slower, for a busy computer
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.devices.emulators.emulated import kind_of, kinds
from pomona.devices.emulators.sim_bridge import FRAME_HEADER, FRAME_MAGIC
from pomona.devices.emulators.virtual_world import VirtualWorld
from pomona.devices.realsense.camera_mount import CameraMount
from pomona.devices.realsense.driver import StreamingCamera
from pomona.devices.realsense.source import Pair
from pomona.drivers import (
    SIMULATED,
    Address,
    Arm,
    CellFileError,
    ConnectContext,
    DepthModelSection,
    Device,
    DeviceLost,
    DriverError,
    ForceSensor,
    Gripper,
    HandMemory,
    HandRecord,
    Intrinsics,
    Link,
    Settings,
    Surroundings,
    depth_model_of,
    driver,
    load_cell,
    read_cell_file,
    tcp_opener,
)
from pomona.executive import (
    RATE,
    TIME,
    Clock,
    Float64,
    MappingOf,
    Measure,
    Number,
    PathTo,
    Problem,
    Section,
    SystemClock,
    Text,
    choose,
    value,
)

START = 120.0  # the world must be ready within this time [s]
PLAYED = {"arm": Arm, "gripper": Gripper, "fingers": ForceSensor}
"""Interface of the simulated device behind each role's wires."""
ANSWER = 2.0  # deadline for the world's score [s]


class PacedClock:
    """System time at a pace: below 1 the cell's time runs slower than real time, so that a busy computer keeps up."""

    simulated = False

    def __init__(self, pace: float) -> None:
        self.pace = pace
        self._start = time.monotonic()

    def now(self) -> float:
        return self._start + (time.monotonic() - self._start) * self.pace

    def advance(self, duration: float) -> None:
        if duration > 0.0:
            time.sleep(duration / self.pace)


class EmulatedWorld(Device):
    """The process with the simulated world; gives the cell's clock and the world's score."""

    def __init__(
        self, process: subprocess.Popen[bytes], pace: float = 1.0, name: str = "world"
    ) -> None:
        super().__init__(name)
        self.clock: Clock = SystemClock() if pace == 1.0 else PacedClock(pace)
        self._process = process
        self._lock = threading.Lock()

    def truth(self) -> Mapping[str, object]:
        with self._lock:
            assert self._process.stdin is not None
            with contextlib.suppress(OSError):
                self._process.stdin.write(b"truth\n")
                self._process.stdin.flush()
            line = read_line(self._process, ANSWER)
        if not line:
            return {}
        score: dict[str, object] = json.loads(line)
        return score

    def check(self) -> None:
        if self._process.poll() is not None:
            raise DeviceLost(
                self.name, f"the emulated world ended with status {self._process.returncode}"
            )

    def close(self) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedWorldFile:
    """A simulated cell behind emulated devices: on its own time in this process, or on real wires in wall time."""

    cell: Path = value(PathTo("file"), help="the simulated cell")
    options: Mapping[str, str] = value(MappingOf(Text()), {}, "of that cell")
    time: str = value(
        Text("virtual", "wall"), "virtual", "virtual time in this process, or wall-clock time"
    )
    arm: str = value(Text(), help="address at which the arm's driver finds the controller")
    controller: str = value(Text(*kinds()), help="emulator of the arm's controller")
    gripper: str = value(Text(), help="address of the gripper: HOST:PORT or a serial port")
    hand: str = value(Text(*kinds()), "wsg", "emulator of the gripper")
    fingers: str = value(
        Text(), "", "folder with the links finger_left and finger_right; by default there are none"
    )
    camera: str = value(Text(), help="HOST:PORT of the camera")
    others: Mapping[str, str] = value(
        MappingOf(Text()), {}, "addresses of more emulators, by their names"
    )
    pace: float = value(
        Number(0.01, 1.0), "1", "share of wall-clock speed; below 1 the cell's time runs slower"
    )

    @property
    def inner_wires(self) -> tuple[str, ...]:
        """Wires that end in this process: all of them on virtual time, none of them on wall time."""
        return self.emulated if self.time == "virtual" else ()

    @property
    def emulated(self) -> tuple[str, ...]:
        """Wires at whose other end this world has a device."""
        wires = (kind_of(name).addresses(address) for name, address in self.choices.values())
        return (*(address for wire in wires for address in wire), self.camera)

    @property
    def choices(self) -> dict[str, tuple[str, str]]:
        """Emulator and address of each device, by its role."""
        fingers = {"fingers": ("suntouch", self.fingers)} if self.fingers else {}
        others = {name: (name, address) for name, address in self.others.items() if name in kinds()}
        return {
            "arm": (self.controller, self.arm),
            "gripper": (self.hand, self.gripper),
            **fingers,
            **others,
        }

    def problems(self) -> Iterator[Problem]:
        for name in self.others:
            if name not in kinds():
                yield Problem("others", f"there is no emulator '{name}'", choose(name, kinds()))
        try:
            simulated = read_cell_file(self.cell, self.options).interfaces()
            lacking = [
                role for role in self.choices if role in PLAYED and PLAYED[role] not in simulated
            ]
            for role in lacking:
                words = f"{self.cell.name} has no {PLAYED[role].__name__}, which these wires would lead to"
                yield Problem(
                    role, words, f"leave `{role}` out, or name a simulated cell that has one"
                )
        except CellFileError as error:
            for finding in (found for found in error.findings if found.severity == "error"):
                place = f"{finding.path}:{finding.line}:{finding.column}: " if finding.line else ""
                words = (
                    f"{self.cell.name} cannot be used with these options: {place}{finding.message}"
                )
                yield Problem("cell", words, finding.hint)

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        """A device at another address would not be this world's: perhaps the real one, which would move."""
        emulated = self.emulated
        for name, said in around.options.items():
            for wire in (
                (said.wire,) if isinstance(said, EmulatedCameraFile) else getattr(said, "wires", ())
            ):
                if wire not in emulated:
                    words = (
                        f"the device '{name}' is reached at {wire}, where this world emulates none"
                    )
                    advice = f'give both the same address: an option, such as "{{{name}}}", in its section and here'
                    yield Problem(
                        name if name in self.choices or name == "camera" else "", words, advice
                    )


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedCameraFile:
    """The emulated camera of an emulated world."""

    address: tuple[str, int] = value(Address(41001), help="HOST:PORT")
    robot: Path = value(PathTo("file"), help="MJCF with the site `camera`")
    rate: float = value(Measure(RATE, "0.5 Hz", "60 Hz"), "5 Hz", "frames per second")
    silence: float = value(
        Measure(TIME, "50 ms", "10 s"), "1 s", "without a frame for this long the camera is lost"
    )
    depth_model: DepthModelSection | None = value(
        Section(DepthModelSection),
        None,
        "error model of the depth; by default a simulated camera's",
    )

    @property
    def wire(self) -> str:
        """Its address, as the world has it."""
        host, port = self.address
        return f"{host}:{port}"


@driver(EmulatedWorld, EmulatedWorldFile)
def connect_world(
    settings: Settings[EmulatedWorldFile], context: ConnectContext
) -> EmulatedWorld | VirtualWorld:
    """`driver: emulated-world`"""
    return (
        _open_virtual(settings, context)
        if settings.values.time == "virtual"
        else _start_process(settings, context)
    )


def _open_virtual(settings: Settings[EmulatedWorldFile], context: ConnectContext) -> VirtualWorld:
    """Load the simulated cell, and put pipes in the places of the wires."""
    said = settings.values
    try:
        cell = load_cell(said.cell, seed=context.seed, overrides=said.options)
    except DriverError as error:
        raise settings.error(f"the emulated world did not start: {error}", "cell") from error
    world = VirtualWorld(cell, said.choices, said.camera)
    world.enter(context)
    return world


def _start_process(settings: Settings[EmulatedWorldFile], context: ConnectContext) -> EmulatedWorld:
    said = settings.values
    command = [
        sys.executable,
        "-m",
        "pomona.devices.emulators.world_process",
        "--cell",
        str(said.cell),
    ]
    command += ["--seed", str(context.seed)]
    for name, text in said.options.items():
        command += ["--set", f"{name}={text}"]
    command += ["--pace", str(said.pace)]
    for role, (kind, address) in said.choices.items():
        command += ["--device", role, kind, address]
    command += ["--camera", said.camera]
    # A session of its own: Ctrl-C reaches the run, which stops safely, before the world ends.
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    line = read_line(process, START)
    if line.strip() != b"ready":
        process.kill()
        _, complaint = process.communicate()
        words = complaint.decode(errors="replace").strip()
        raise settings.error(
            f"the emulated world did not start: {words or 'it gave no reason'}", "cell"
        )
    assert process.stderr is not None
    process.stderr.close()
    context.hand = HandMemory(None, HandRecord())  # of a new world, which ends with this process
    return EmulatedWorld(process, said.pace)


def read_line(process: subprocess.Popen[bytes], deadline: float) -> bytes:
    """Return a line of the process's standard output, or the part of it that arrived within `deadline` [s]."""
    assert process.stdout is not None
    descriptor = process.stdout.fileno()
    line = b""
    end = time.monotonic() + deadline
    while not line.endswith(b"\n"):
        ready, _, _ = select.select([descriptor], [], [], max(end - time.monotonic(), 0.0))
        chunk = os.read(descriptor, 65536) if ready else b""
        if not chunk:
            break
        line += chunk
    return line


class WireSource:
    """Frames from the emulated camera, one per request, at most `rate` per second of the cell's time."""

    def __init__(self, link: Link, rate: float, clock: Clock) -> None:
        self._link = link
        self._period = 1.0 / rate
        self._clock = clock
        self._buffer = bytearray()
        self._asked_at = -math.inf
        self._waiting = False

    def wait(self, timeout: float) -> Pair | None:
        """As `Source.wait`."""
        if not self._waiting:
            early = self._asked_at + self._period - self._clock.now()
            self._clock.advance(min(max(early, 0.0), timeout))
            if early > timeout:
                return None
            self._asked_at = self._clock.now()
            self._waiting = True
            self._link.send(b"?")
        self._buffer += self._link.receive(timeout)
        pair = self._take()
        self._waiting = self._waiting and pair is None
        return pair

    def close(self) -> None:
        self._link.close()

    def _take(self) -> Pair | None:
        if len(self._buffer) < FRAME_HEADER.size:
            return None
        magic, width, height, fx, fy, cx, cy, stamp, age, number = FRAME_HEADER.unpack_from(
            self._buffer
        )
        if magic != FRAME_MAGIC:
            raise DeviceLost("camera", "the emulated camera sent no frame")
        pixels = width * height
        end = FRAME_HEADER.size + 7 * pixels
        if len(self._buffer) < end:
            return None
        images = bytes(self._buffer[FRAME_HEADER.size : end])
        del self._buffer[:end]
        colour = np.frombuffer(images, np.uint8, 3 * pixels).reshape(height, width, 3)
        depth = np.frombuffer(images, np.float32, pixels, 3 * pixels).reshape(height, width)
        intrinsics = Intrinsics(fx, fy, cx, cy, width, height)
        if self._clock.simulated:  # there is no host clock: the camera uses its own
            return Pair(colour, depth, intrinsics, stamp, False, number)
        pace = self._clock.pace if isinstance(self._clock, PacedClock) else 1.0
        return Pair(colour, depth, intrinsics, time.time() - age * pace, True, number)


@driver(StreamingCamera, EmulatedCameraFile)
def connect_camera(
    settings: Settings[EmulatedCameraFile], context: ConnectContext
) -> StreamingCamera:
    """`driver: emulated-camera`"""
    said = settings.values
    host, port = said.address
    arm = context.find(Arm)
    mount = CameraMount(arm, camera_site(said.robot))
    open_link = tcp_opener(host, port, context.wires)
    camera = StreamingCamera(
        lambda: WireSource(open_link(), said.rate, context.clock),
        mount,
        context.clock,
        silence=said.silence,
        label="emulated",
        depth_model=depth_model_of(said.depth_model, SIMULATED),
    )
    camera.connect(deadline=20.0)
    camera.start()
    return camera


def camera_site(robot: Path) -> Float64:
    """Return T_tool0_camera (4, 4) [m] from the robot's description: the true result of a hand-eye calibration."""
    from pomona.tools.simulation import load_mujoco  # takes a moment

    mujoco = load_mujoco()
    site = mujoco.MjModel.from_xml_path(str(robot)).site("camera")
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, site.quat)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.reshape(3, 3), site.pos
    return T
