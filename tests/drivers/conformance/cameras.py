"""A bench of every camera that ships, and of the one that `pomona new driver` writes."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from typing import Any, cast

import numpy as np

from pomona.devices.emulators.connect import WireSource
from pomona.devices.emulators.pipes import Pipe
from pomona.devices.emulators.sim_bridge import pack_frame
from pomona.devices.frames.camera import FramesCamera
from pomona.devices.realsense.camera_mount import CameraMount
from pomona.devices.realsense.driver import StreamingCamera
from pomona.devices.realsense.source import Pair
from pomona.drivers import DeviceLost, FaultSwitch, Frame, Intrinsics
from pomona.drivers.conformance import BenchClock, CameraBench, Wall, Wire
from pomona.drivers.depth_model import SIMULATED
from pomona.tools.kit.pieces import TEMPLATES
from pomona.tools.mock import MockCamera, MockClock
from pomona.tools.simulation.camera import SimCamera
from pomona.tools.simulation.gl import load_mujoco
from pomona.tools.simulation.stereo_depth import CHANGES, Stereo
from tests.drivers.conformance.grippers import timed

WALL_CAMERA = TEMPLATES / "package" / "tests" / "test_wall_camera.py"
LENS = Intrinsics(60.0, 61.0, 16.0, 12.0, 32, 24)
PERIOD = 1.0 / 30.0  # of a camera's pictures [s]


def picture(distance: float, number: int) -> tuple[Any, Any]:
    """Colour and depth of a wall, with a live sensor's noise and a corner that it does not measure."""
    colour = np.full((LENS.height, LENS.width, 3), number % 251, np.uint8)
    depth = np.full((LENS.height, LENS.width), distance, np.float32)
    depth[0] = 0.0
    depth[5, 7] += 1e-4 * (number % 17)
    return colour, depth


class Source(FaultSwitch):
    """A camera's own end: what the RealSense library or a topic gives, at 30 Hz, with a counter of its own."""

    known_faults = ("silent", "gone", "frozen", "same_depth", "old", "early", "stays")

    def __init__(self, clock: BenchClock, wall: Wall) -> None:
        super().__init__()
        self._clock, self._wall = clock, wall
        self.is_open = False
        self._number = 0
        self._shown = picture(wall.distance(), 0)

    def open(self) -> Source:
        if self.fault == "gone":
            raise DeviceLost("camera", "no device connected")
        self.is_open = True
        return self

    def close(self) -> None:
        self.is_open = False

    def wait(self, timeout: float) -> Pair | None:
        if self.fault == "gone":
            raise DeviceLost("camera", "unplugged")
        self._clock.advance(timeout if self.fault == "silent" else PERIOD)
        if self.fault == "silent":
            return None
        self._number += self.fault != "stays"
        colour, depth = picture(self._wall.distance(), self._number)
        kept = {"frozen": self._shown, "same_depth": (colour, self._shown[1])}
        self._shown = kept.get(self.fault or "", (colour, depth))
        late = {"old": 30.0, "early": -10.0}.get(self.fault or "", 0.0)
        taken = 123.0 + self._clock.now() - late
        return Pair(*self._shown, LENS, taken, False, self._number)


def realsense() -> CameraBench:
    """The driver of RealSense cameras, at a source of pictures."""
    clock = BenchClock()
    wall = Wall(clock)
    source = Source(clock, wall)
    camera = StreamingCamera(source.open, CameraMount(None, np.eye(4)), clock)
    camera.connect()
    return CameraBench(camera, clock, wall.distance, LENS, source, holds=lambda: source.is_open)


class TopicFaults(FaultSwitch):
    """What can happen to the topics of a camera."""

    known_faults = ("silent", "frozen", "old", "early", "nonsense", "empty")


def ros2() -> CameraBench:
    """The topics of a ROS 2 camera, at 10 Hz."""
    from pomona.devices.ros2.camera import Ros2Images
    from tests.drivers.devices.ros2.test_ros2_camera import TOPICS, H, W, Wire as Peer

    clock = BenchClock()
    wall = Wall(clock)
    faults = TopicFaults()
    peer = Peer()
    next_at = clock.now()
    shown = (0, 0.8)

    class Images(Ros2Images):
        def wait(self, timeout: float) -> Pair | None:
            clock.advance(0.02)
            return super().wait(0.0)

    def publish(now: float) -> None:
        nonlocal next_at, shown
        if now < next_at or faults.fault == "silent" or not peer.takers:
            return
        next_at = now + 0.1
        if faults.fault != "frozen":
            shown = (shown[0] + 1) % 251, wall.distance()
        late = {"old": 5.0, "early": -5.0}.get(faults.fault or "", 0.0)
        damage = {"nonsense": {"colour": b"\0\1\0\0nonsense"}, "empty": {"info": b""}}
        peer.publish(1e9 + now - late, *shown, **damage.get(faults.fault or "", {}))

    clock.each_step.append(publish)
    camera = StreamingCamera(
        lambda: Images(peer, TOPICS), CameraMount(None, np.eye(4)), clock, label="ros2"
    )
    camera._stamps._host_time = lambda: 1e9 + clock.now()
    camera.connect()
    lens = Intrinsics(60.0, 61.0, 20.0, 15.0, W, H)
    return CameraBench(camera, clock, wall.distance, lens, faults, holds=lambda: not peer.closed)


class CameraPort:
    """The emulated camera's end of its wire."""

    def __init__(self, clock: BenchClock, wall: Wall) -> None:
        self._clock, self._wall = clock, wall
        self._number = 0
        self.peers: set[int] = set()

    def connected(self, peer: Any) -> None:
        self.peers.add(id(peer))

    def disconnected(self, peer: Any) -> None:
        self.peers.discard(id(peer))

    def received(self, peer: Any, chunk: bytes) -> None:
        for _ in range(chunk.count(b"?")):
            self._number += 1
            now = self._clock.now()
            shown = picture(self._wall.distance(), self._number)
            peer.send(pack_frame(Frame(now, self._number, *shown, LENS, None, np.eye(4)), 0.0))

    def advance(self, now: float) -> None:
        """It has no time of its own."""


def emulated() -> CameraBench:
    """The emulated camera behind its wire."""
    clock, time = timed()
    wall = Wall(clock)
    port = CameraPort(clock, wall)
    wire = Wire(Pipe(port, time).open)
    camera = StreamingCamera(
        lambda: WireSource(wire.open(), 30.0, time),
        CameraMount(None, np.eye(4)),
        time,
        depth_model=SIMULATED,
    )
    camera.connect()
    return CameraBench(
        camera,
        time,
        wall.distance,
        LENS,
        wire,
        holds=lambda: bool(port.peers),
        without=("half", "noise"),
    )


class WallWorld:
    """A simulated world that holds a wall, which comes nearer."""

    seed = 1
    arm_joints = np.zeros(0, int)

    def __init__(self, clock: BenchClock, wall: Wall) -> None:
        mujoco = load_mujoco()
        self.clock, self._wall = clock, wall
        self.model = mujoco.MjModel.from_xml_string(
            '<mujoco><visual><quality offsamples="0"/></visual><worldbody><body name="wall" mocap="true">'
            '<geom type="box" size="3 3 0.1"/></body></worldbody></mujoco>'
        )
        self.state = mujoco.MjData(self.model)

    def looked(self) -> None:
        """Move the wall to where it is."""
        self.state.mocap_pos[0] = 0.0, 0.0, self._wall.distance() + 0.1
        load_mujoco().mj_forward(self.model, self.state)


RENDERED: list[SimCamera] = []
"""Simulated cameras that a test has opened, and has to close."""


def sim() -> CameraBench:
    """The simulated camera, which is fixed before a wall."""
    clock = BenchClock()
    wall = Wall(clock)
    world: Any = WallWorld(clock, wall)
    camera = SimCamera(world, LENS, Stereo(LENS.fx, 0.05, 0.0, 0.18), 10.0, np.eye(4))
    RENDERED.append(camera)
    held = lambda: camera._renderer is not None  # noqa: E731
    return CameraBench(
        camera,
        clock,
        wall.distance,
        LENS,
        camera,
        tolerance=0.01,
        holds=held,
        without=tuple(CHANGES),
    )


def mock() -> CameraBench:
    """The mock camera, which shows a new frame at each look."""
    clock = MockClock()
    frames = [Frame(0.0, k, *picture(0.5, k), LENS, None, np.eye(4)) for k in range(3)]
    return CameraBench(MockCamera(*frames, clock=clock), clock, lambda: 0.5, LENS)


class Kept:
    """A recorded frame."""

    label = "a"

    def read(self, intrinsics: Intrinsics) -> Any:
        return picture(0.5, 1)


def frames() -> CameraBench:
    """Recorded frames, which are as new as the look at them."""
    clock = BenchClock()
    camera = FramesCamera([Kept(), Kept()], LENS, clock, depth_model=SIMULATED)
    return CameraBench(camera, clock, lambda: 0.5, LENS)


def wall_camera() -> CameraBench:
    """The driver that `pomona new driver wall_camera` writes, as its own test has it."""
    sys.path.insert(0, str(TEMPLATES / "package"))
    try:
        return cast("CameraBench", runpy.run_path(str(WALL_CAMERA))["bench"]())
    finally:
        sys.path.pop(0)


BENCHES: dict[str, Callable[[], CameraBench]] = {
    "realsense": realsense,
    "emulated": emulated,
    "ros2": ros2,
    "sim": sim,
    "mock": mock,
    "frames": frames,
    "wall_camera": wall_camera,
}
