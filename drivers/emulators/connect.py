"""The drivers `emulated-world` and `emulated-camera` of a cell file: a world in real time behind emulated devices.

world:
  driver: emulated-world
  cell: sim.yaml                        # the simulated cell
  options: {fruit: apple_1}             # of that cell
  arm: 127.0.0.1:50240                  # where the real drivers find their devices
  controller: fs100
  gripper: 127.0.0.1:41000
  fingers: /run/user/1000/pomona        # folder with the links finger_left and finger_right
  camera: 127.0.0.1:41001
  pace: 1                               # below 1 the cell's time runs slower than the wall's
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drivers.cell_file import Settings
from drivers.device import Bench, Device
from drivers.emulators.sim_bridge import FRAME_HEADER, FRAME_MAGIC
from drivers.errors import DeviceLost
from drivers.interfaces import Arm, Float64, Intrinsics
from drivers.realsense.driver import StreamingCamera
from drivers.realsense.ride import Ride
from drivers.realsense.source import Pair
from drivers.wire import TcpLink, read_address
from executive.clock import Clock, SystemClock

START = 120.0
"""The world must be ready within this time [s]."""
ANSWER = 2.0
"""Deadline of the world's score [s]."""
WIRES = ("arm", "controller", "gripper", "fingers", "camera")


class PacedClock:
    """The system's time at a pace: below 1, every real second gives the cell less to do, for a busy computer."""

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

    def __init__(self, process: subprocess.Popen[bytes], pace: float = 1.0, name: str = "world") -> None:
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
            raise DeviceLost(self.name, f"the emulated world ended with status {self._process.returncode}")

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


def connect_world(settings: Settings, bench: Bench) -> EmulatedWorld:
    """`driver: emulated-world`: start the process and wait until its devices can be reached."""
    command = [sys.executable, "-m", "drivers.emulators.world_process", "--cell", str(settings.file("cell"))]
    command += ["--seed", str(bench.seed)]
    options = settings.section("options")
    for name in options.names():
        command += ["--set", f"{name}={options.text(name)}"]
    pace = settings.number("pace", "number", 1.0, 0.01, 1.0)
    command += ["--pace", str(pace)]
    for wire in WIRES:
        command += [f"--{wire}", settings.text(wire)]
    # A session of its own: Ctrl-C reaches the run, which stops safely, before the world ends.
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    )
    line = read_line(process, START)
    if line.strip() != b"ready":
        process.kill()
        _, complaint = process.communicate()
        words = complaint.decode(errors="replace").strip()
        raise settings.error(f"the emulated world did not start: {words or 'it said nothing'}", "cell")
    assert process.stderr is not None
    process.stderr.close()
    return EmulatedWorld(process, pace)


def read_line(process: subprocess.Popen[bytes], deadline: float) -> bytes:
    """A line of the process's standard output, or what came of it within `deadline` [s]."""
    assert process.stdout is not None
    descriptor, line, end = process.stdout.fileno(), b"", time.monotonic() + deadline
    while not line.endswith(b"\n"):
        ready, _, _ = select.select([descriptor], [], [], max(end - time.monotonic(), 0.0))
        chunk = os.read(descriptor, 65536) if ready else b""
        if not chunk:
            break
        line += chunk
    return line


class WireSource:
    """Frames from the emulated camera, one for every request, no more than `rate` a second of a clock at `pace`."""

    def __init__(self, host: str, port: int, rate: float, pace: float) -> None:
        self._link, self._period, self._pace = TcpLink(host, port), 1.0 / (rate * pace), pace
        self._buffer = bytearray()
        self._asked_at = 0.0
        self._waiting = False

    def wait(self, timeout: float) -> Pair | None:
        """As `Source.wait`."""
        now = time.monotonic()
        if not self._waiting:
            early = self._asked_at + self._period - now
            if early > timeout:
                time.sleep(timeout)
                return None
            time.sleep(max(early, 0.0))
            self._asked_at, self._waiting = time.monotonic(), True
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
        magic, width, height, fx, fy, cx, cy, age, number = FRAME_HEADER.unpack_from(self._buffer)
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
        return Pair(
            colour, depth, Intrinsics(fx, fy, cx, cy, width, height), time.time() - age * self._pace, True, number
        )


def connect_camera(settings: Settings, bench: Bench) -> StreamingCamera:
    """`driver: emulated-camera`: {address: HOST:PORT, robot: FILE with the site `camera`, rate: 5 Hz}"""
    host, port = read_address(settings, "address", 41001)
    robot = settings.file("robot")
    rate = settings.number("rate", "rate", 5.0, 0.5, 60.0)
    arm = bench.find(Arm)
    ride = Ride(arm, camera_site(robot))
    pace = bench.clock.pace if isinstance(bench.clock, PacedClock) else 1.0
    camera = StreamingCamera(
        lambda: WireSource(host, port, rate, pace), ride, bench.clock, silence=2.0, label="emulated"
    )
    camera.connect(deadline=20.0)
    camera.start()
    return camera


def camera_site(robot: Path) -> Float64:
    """T_tool0_camera from the robot's description: what a calibration would find."""
    import mujoco

    site = mujoco.MjModel.from_xml_path(str(robot)).site("camera")
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, site.quat)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.reshape(3, 3), site.pos
    return T
