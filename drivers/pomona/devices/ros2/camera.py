"""A camera that is a topic of ROS 2: colour, depth registered to it, and their CameraInfo (`driver: ros2-camera`).

Its frames are judged like any camera's (`pomona.devices.realsense.driver`): old, repeated or frozen ones are never the
newest, and a camera that gives nothing else is lost, subscribed to again, and stays latched.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from pomona.devices.realsense.camera_mount import CameraMount
from pomona.devices.realsense.driver import StreamingCamera
from pomona.devices.realsense.mounted_camera import MountedCameraFile, read_hand_eye
from pomona.devices.realsense.source import Pair
from pomona.devices.ros2.images import (
    COMPRESSED,
    IMAGE,
    INFO,
    colour_of,
    depth_of,
    intrinsics_of,
    is_rectified,
)
from pomona.drivers import Arm, ConnectContext, DeviceError, DeviceFault, Settings, driver
from pomona.executive import TIME, Measure, Text, UnusablePicture, value
from pomona.tools.ros2.peer import ADDRESS, DISTRIBUTIONS
from pomona.tools.ros2.rosbridge import WAY, open_peer
from pomona.tools.ros2.types import typestore

KEPT = 8  # images of each topic that wait for their partner; of a flood, only the newest


class Topics(Protocol):
    """The part of a peer that a source needs."""

    def subscribe(self, topic: str, kind: str, take: Callable[[bytes], None]) -> Any: ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class CameraTopics:
    """Topics and their types, and how far apart two images may be that belong together [s]."""

    colour: tuple[str, str]
    depth: tuple[str, str]
    info: tuple[str, str]
    apart: float


class Ros2Images:
    """Pairs of images from topics; a source of `StreamingCamera`."""

    def __init__(self, peer: Topics, topics: CameraTopics, name: str = "camera") -> None:
        self._peer = peer
        self._topics = topics
        self._name = name
        self._arrived = threading.Condition()
        self._raw: dict[str, deque[bytes]] = {
            kind: deque(maxlen=KEPT) for kind in ("colour", "depth", "info")
        }
        self._intrinsics: Any = None
        self._depths: deque[tuple[int, Any]] = deque(maxlen=KEPT)
        self._colours: deque[tuple[int, Any]] = deque(maxlen=KEPT)
        for kind in self._raw:
            topic, of = getattr(topics, kind)
            peer.subscribe(topic, of, partial(self._take, kind))

    def _take(self, kind: str, raw: bytes) -> None:
        """In the wire's thread: kept as it is."""
        with self._arrived:
            self._raw[kind].append(raw)
            self._arrived.notify_all()

    def wait(self, timeout: float) -> Pair | None:
        """Return the newest pair. Raises DeviceFault: the received message is no image of this camera."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._raw["colour"] or self._raw["depth"], timeout)
            taken = {kind: list(raw) for kind, raw in self._raw.items()}
            for raw in self._raw.values():
                raw.clear()
        try:
            return self._pair(taken)
        except UnusablePicture as error:
            raise DeviceFault(self._name, f"its messages cannot be used: {error}") from error

    def _pair(self, taken: Mapping[str, list[bytes]]) -> Pair | None:
        for raw in taken["info"][-1:]:
            self._intrinsics = intrinsics_of(
                _message(raw, INFO), is_rectified(self._topics.colour[0])
            )
        for kind, kept in (("colour", self._colours), ("depth", self._depths)):
            for raw in taken[kind]:
                message = _message(raw, getattr(self._topics, kind)[1])
                kept.append(
                    (message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, message)
                )
        if self._intrinsics is None:
            return None
        while self._colours:
            stamp, message = self._colours.pop()
            near = min(self._depths, key=lambda found: abs(found[0] - stamp), default=None)
            if near is not None and abs(near[0] - stamp) <= self._topics.apart * 1e9:
                self._colours.clear()  # older ones are of no use any more
                return self._decoded(stamp, message, near[1])
            if near is None or stamp > near[0]:
                self._colours.append((stamp, message))  # its depth may still come
                return None
        return None

    def _decoded(self, stamp: int, colour: Any, depth: Any) -> Pair:
        pixels = colour_of(colour, self._topics.colour[1])
        metres = depth_of(depth, self._topics.depth[1])
        size = (self._intrinsics.height, self._intrinsics.width)
        if pixels.shape[:2] != size or metres.shape != size:
            raise UnusablePicture(
                f"colour is {pixels.shape[:2]}, depth {metres.shape}, but the CameraInfo {size}"
            )
        return Pair(pixels, metres, self._intrinsics, stamp / 1e9, True, stamp)

    def close(self) -> None:
        """Subscribe to nothing any more."""
        self._peer.close()


def _message(raw: bytes, kind: str) -> Any:
    try:
        return typestore().deserialize_cdr(raw, kind)
    except Exception as error:  # any malformed message
        raise UnusablePicture(f"bytes that are no {kind}") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2CameraFile(MountedCameraFile):
    """A depth camera that is a topic of ROS 2, on the arm or in the cell."""

    address: str = value(WAY, ADDRESS, WAY.words)
    distribution: str = value(Text(*DISTRIBUTIONS), "jazzy", "version of ROS 2 behind the router")
    colour: str = value(
        Text(),
        "/camera/color/image_raw",
        "topic of sensor_msgs/Image; …/compressed: CompressedImage",
    )
    depth: str = value(Text(), "/camera/aligned_depth_to_color/image_raw", "topic of its depth")
    info: str = value(Text(), "/camera/color/camera_info", "topic of sensor_msgs/CameraInfo")
    apart: float = value(
        Measure(TIME, "0 s", "1 s"),
        "20 ms",
        "colour and depth further apart than this do not belong together",
    )


@driver(StreamingCamera, Ros2CameraFile)
def connect(settings: Settings[Ros2CameraFile], context: ConnectContext) -> StreamingCamera:
    """Subscribe to the topics and wait for the first pair."""
    said = settings.values
    topics = CameraTopics(
        (said.colour, _kind(said.colour)),
        (said.depth, _kind(said.depth)),
        (said.info, INFO),
        said.apart,
    )
    mount = CameraMount(context.find(Arm), read_hand_eye(said.hand_eye))
    camera = StreamingCamera(
        lambda: Ros2Images(open_peer(said.address, "pomona_camera", said.distribution), topics),
        mount,
        context.clock,
        silence=said.silence,
        depth_model=said.depth_errs,
        label="ros2",
    )
    try:
        camera.connect()
    except DeviceError as error:
        hint = "check with `ros2 topic info -v` that rmw_zenoh publishes it with this type"
        raise settings.error(error.message, "colour", hint) from error
    camera.start()
    return camera


def _kind(topic: str) -> str:
    return COMPRESSED if topic.endswith(("/compressed", "/compressedDepth")) else IMAGE
