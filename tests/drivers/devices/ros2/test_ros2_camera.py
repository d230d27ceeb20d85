"""A camera on ROS 2 topics: its pixels, and its behaviour when it is lost, frozen, floods or sends nonsense."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("zenoh", reason="the extra ros2 is not installed")

from rosbags.typesys import Stores, get_typestore

from pomona.devices.realsense.camera_mount import CameraMount
from pomona.devices.realsense.driver import StreamingCamera
from pomona.devices.ros2 import camera as module
from pomona.devices.ros2.camera import KEPT, CameraTopics, Ros2Images, connect
from pomona.devices.ros2.images import COMPRESSED, IMAGE, INFO
from pomona.drivers.errors import CellFileError, DeviceError, DeviceFault, DeviceLost
from pomona.drivers.interfaces import Camera
from pomona.drivers.services import ConnectContext
from pomona.executive.clock import ManualClock, SystemClock
from pomona.tools.ros2.peer import Ros2Peer
from tests.drivers.device_settings import read_settings

STORE = get_typestore(Stores.ROS2_JAZZY)
W, H = 40, 30
TOPICS = CameraTopics(("/colour", IMAGE), ("/depth", IMAGE), ("/info", INFO), 0.02)


class Wire:
    """A peer that passes on the test's messages."""

    def __init__(self) -> None:
        self.takers: dict[str, Callable[[bytes], None]] = {}
        self.closed = False

    def subscribe(self, topic: str, _kind: str, take: Callable[[bytes], None]) -> None:
        self.takers[topic] = take

    def close(self) -> None:
        self.closed = True

    def publish(self, t: float, red: int = 200, metres: float = 0.5, **damage: Any) -> None:
        """A CameraInfo, a colour and a depth image, taken at `t` [s since 1970]."""
        for topic, coded in messages(t, red, metres).items():
            self.takers[topic](damage.get(topic.strip("/"), coded))


def messages(t: float, red: int = 200, metres: float = 0.5) -> dict[str, bytes]:
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](int(t), round(t % 1.0 * 1e9) % 10**9)
    head = types["std_msgs/msg/Header"](stamp, "camera")
    colour = np.zeros((H, W, 3), np.uint8)
    colour[..., 0] = red
    depth = np.full((H, W), metres, np.float32)
    depth[0, :2] = np.nan, -1.0
    depth[16, 16] += 1e-5 * red  # noise: no sensor repeats its depth exactly
    roi = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    k = np.array([60.0, 0, 20, 0, 61, 15, 0, 0, 1])
    info = types[INFO](
        head, H, W, "plumb_bob", np.zeros(5), k, np.eye(3).reshape(-1), np.zeros(12), 0, 0, roi
    )
    found = {
        "/info": (INFO, info),
        "/colour": (IMAGE, types[IMAGE](head, H, W, "rgb8", 0, 3 * W, colour.reshape(-1))),
        "/depth": (
            IMAGE,
            types[IMAGE](head, H, W, "32FC1", 0, 4 * W, depth.reshape(-1).view(np.uint8)),
        ),
    }
    return {
        topic: bytes(STORE.serialize_cdr(message, kind)) for topic, (kind, message) in found.items()
    }


class Setting:
    def __init__(self) -> None:
        self.clock, self.wire = ManualClock(100.0), Wire()
        self.camera = StreamingCamera(
            self._source, CameraMount(None, np.eye(4)), self.clock, silence=0.5
        )
        self.camera._stamps._host_time = lambda: 1e9 + self.clock.now()
        self.camera._open()
        self.publish()
        self.camera.connect()

    def _source(self) -> Ros2Images:
        self.images = Ros2Images(self.wire, TOPICS)
        return self.images

    def publish(self, **how: Any) -> None:
        self.wire.publish(1e9 + self.clock.now(), **how)

    def connect(self) -> None: ...

    def go_on(self, seconds: float, publish: Callable[[int], None]) -> None:
        for k in range(round(seconds / 0.1)):
            self.clock.advance(0.1)
            publish(k)
            self.camera.step()


@pytest.fixture
def setting(monkeypatch: pytest.MonkeyPatch) -> Setting:
    """A camera whose wire is a list, and which has seen its first frame."""
    waits = Ros2Images.wait
    monkeypatch.setattr(Ros2Images, "wait", lambda self, _timeout: waits(self, 0.0))
    monkeypatch.setattr(StreamingCamera, "_open", opened(StreamingCamera._open))
    return Setting()


def opened(open_it: Any) -> Any:
    """Opening a camera that is open already is harmless here: its first messages are there."""

    def once(self: StreamingCamera) -> None:
        if self._source is None:
            open_it(self)

    return once


def test_pixels_depth_and_intrinsics_are_those_that_were_published(setting: Setting) -> None:
    frame = setting.camera.latest()
    assert isinstance(setting.camera, Camera)
    assert frame.colour[3, 3].tolist() == [200, 0, 0]
    assert frame.depth[3, 3] == np.float32(0.5)
    assert frame.depth[0, :2].tolist() == [0.0, 0.0]  # neither a number nor a distance
    assert (frame.intrinsics.fx, frame.intrinsics.cy, frame.intrinsics.width) == (60.0, 15.0, W)
    assert frame.stamp == pytest.approx(100.0, abs=1e-3)
    setting.go_on(0.3, lambda k: setting.publish(red=k))
    assert setting.camera.latest().colour[3, 3, 0] == 2
    assert setting.camera.link() == "ok"


def test_a_camera_that_goes_is_lost_and_stays_latched_when_it_comes_back(setting: Setting) -> None:
    setting.go_on(0.7, lambda _k: None)
    with pytest.raises(DeviceLost, match="no image for 0"):
        setting.camera.check()
    assert setting.wire.closed
    setting.go_on(
        1.5, lambda k: setting.publish(red=k) if setting.camera._source is not None else None
    )
    with pytest.raises(DeviceLost):
        setting.camera.check()


@pytest.mark.parametrize(
    ("publish", "error"),
    [
        (lambda s, _k: s.publish(), DeviceFault),  # the same picture again and again
        (
            lambda s, k: s.wire.publish(1e9 + s.clock.now() - 5.0, red=k),
            DeviceFault,
        ),  # five seconds old
        (
            lambda s, k: s.wire.publish(1e9 + s.clock.now() + 5.0, red=k),
            DeviceFault,
        ),  # of the future
        (lambda s, k: s.publish(red=k, colour=b"\0\1\0\0nonsense"), DeviceFault),
        (
            lambda s, k: s.publish(red=k, depth=messages(1e9 + s.clock.now())["/colour"]),
            DeviceFault,
        ),
        (lambda s, k: s.publish(red=k, info=b""), DeviceFault),
    ],
    ids=["frozen", "old", "early", "nonsense", "colour as depth", "empty"],
)
def test_an_impossible_sample_ends_as_a_fault_and_is_never_the_newest(
    setting: Setting, publish: Any, error: type[DeviceError]
) -> None:
    setting.go_on(2.0, lambda k: publish(setting, k))
    with pytest.raises(error):
        setting.camera.check()


def test_a_flood_costs_no_memory_and_the_newest_counts(setting: Setting) -> None:
    setting.clock.advance(0.1)
    for k in range(300):
        setting.wire.publish(1e9 + setting.clock.now() - 0.05 + 1e-4 * k, red=k % 250)
    assert all(len(raw) <= KEPT for raw in setting.images._raw.values())
    setting.camera.step()
    assert setting.camera.latest().colour[3, 3, 0] == 299 % 250


def test_colour_waits_for_its_depth_and_no_longer_than_it_may(setting: Setting) -> None:
    setting.clock.advance(0.1)
    now = 1e9 + setting.clock.now()
    setting.wire.takers["/colour"](messages(now, red=7)["/colour"])
    setting.camera.step()
    assert setting.camera.latest().colour[3, 3, 0] == 200
    setting.wire.takers["/depth"](messages(now + 0.01, red=7)["/depth"])
    setting.camera.step()
    assert setting.camera.latest().colour[3, 3, 0] == 7


def free_port() -> int:
    import socket

    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def test_over_the_wire_from_another_peer_and_a_missing_topic_is_reported_at_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = free_port()
    (tmp_path / "pose.json").write_text(json.dumps({"T_mount_camera": np.eye(4).tolist()}))
    (tmp_path / "cell.yaml").write_text(
        f"driver: ros2-camera\naddress: 127.0.0.1:{port}\ncolour: /colour\ndepth: /depth\ninfo: /info\n"
        "hand_eye: pose.json\nsilence: 5 s\n"
    )
    other = Ros2Peer(f"127.0.0.1:{port}", node="camera")
    context = ConnectContext(tmp_path / "cell.yaml", SystemClock(), 0)
    import threading

    over = threading.Event()

    def film() -> None:
        while not over.wait(0.03):
            now = time.time()
            for topic, coded in messages(now, red=int(now * 100) % 250).items():
                other.publish(topic, INFO if topic == "/info" else IMAGE, coded, time.time_ns())

    thread = threading.Thread(target=film)
    thread.start()
    try:
        camera = connect.connect(read_settings(connect, tmp_path / "cell.yaml"), context)
        try:
            assert camera.latest().depth[3, 3] == np.float32(0.5)
            assert camera.link() == "ok"
        finally:
            camera.close()
    finally:
        over.set()
        thread.join()
        other.close()
    silent = module.StreamingCamera.connect
    monkeypatch.setattr(module.StreamingCamera, "connect", lambda self: silent(self, 0.1))
    with pytest.raises(CellFileError, match=r"no image within 0\.1 s") as caught:
        connect.connect(read_settings(connect, tmp_path / "cell.yaml"), context)
    assert caught.value.line == 3
    assert module._kind("/x/compressed") == COMPRESSED
