"""A bag as a camera. The bags are written by rosbags itself, image by image, not by our own export."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pomona.devices.frames.camera import FramesCamera
from pomona.devices.ros2.bag_camera import connect
from pomona.drivers.device import ConnectContext
from pomona.drivers.errors import CellFileError, DeviceFault
from pomona.drivers.registration import read_settings
from pomona.executive.clock import ManualClock

STORE = get_typestore(Stores.ROS2_JAZZY)
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
W, H = 40, 30


def header() -> Any:
    return STORE.types["std_msgs/msg/Header"](STORE.types["builtin_interfaces/msg/Time"](5, 0), "camera")


def image(pixels: Any, encoding: str, step: int | None = None, big: bool = False) -> Any:
    data = np.ascontiguousarray(pixels)
    step = data.strides[0] if step is None else step
    return STORE.types[IMAGE](
        header(), data.shape[0], data.shape[1], encoding, int(big), step, data.reshape(-1).view(np.uint8)
    )


def compressed(pixels: Any, ending: str, length: int | None = None) -> Any:
    coded = cv2.imencode(ending, pixels)[1].reshape(-1)[:length]
    return STORE.types[COMPRESSED](header(), ending[1:], coded)


def info(fx: float = 600.0, d: tuple[float, ...] = (0.0,) * 5) -> Any:
    k = np.array([fx, 0, 20, 0, 601, 15, 0, 0, 1.0])
    roi = STORE.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    eye, p = np.eye(3).reshape(-1), np.zeros(12)
    return STORE.types["sensor_msgs/msg/CameraInfo"](header(), H, W, "plumb_bob", np.array(d), k, eye, p, 0, 0, roi)


def colour(red: int = 200) -> Any:
    pixels = np.zeros((H, W, 3), np.uint8)
    pixels[..., 0] = red
    return pixels


def depth(mm: int = 750) -> Any:
    pixels = np.full((H, W), mm, np.uint16)
    pixels[0, 0] = 0
    return pixels


def write(path: Path, messages: list[tuple[str, int, Any]], plugin: StoragePlugin = StoragePlugin.MCAP) -> Path:
    writer = Writer(path, version=9, storage_plugin=plugin)
    if plugin is StoragePlugin.MCAP:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections: dict[tuple[str, str], Any] = {}
        for topic, stamp, message in messages:
            kind = message.__msgtype__
            if (topic, kind) not in connections:
                connections[topic, kind] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic, kind], stamp, STORE.serialize_cdr(message, kind))
    return path


def two(first: Any = None, its_depth: Any = None, about: Any = None) -> list[tuple[str, int, Any]]:
    ms = 1_000_000
    return [
        ("/info", 0, about or info()),
        ("/colour", 10 * ms, first if first is not None else image(colour(), "rgb8")),
        ("/depth", 12 * ms, its_depth if its_depth is not None else image(depth(), "16UC1")),
        ("/colour", 50 * ms, image(colour(10), "rgb8")),  # whose depth was lost
        ("/colour", 110 * ms, image(colour(20), "rgb8")),
        ("/depth", 109 * ms, image(depth(1000), "16UC1")),
    ]


def open_bag(cell: Path, bag: object, extra: str = "") -> FramesCamera:
    cell.write_text(f"driver: bag\nbag: '{bag}'\ncolour: /colour\ndepth: /depth\ninfo: /info\n{extra}\n")
    return connect.connect(read_settings(connect, cell), ConnectContext(cell, ManualClock(5.0), 0))


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    return tmp_path / "cell.yaml"


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_pairs_of_colour_and_depth_come_in_their_order(cell: Path, plugin: StoragePlugin) -> None:
    camera = open_bag(cell, write(cell.parent / "bag", two(), plugin))
    first = camera.latest()
    assert (camera.count, first.stamp, first.sequence) == (2, 5.0, 0)
    assert first.colour[3, 3].tolist() == [200, 0, 0]
    assert (first.depth[0, 0], first.depth[3, 3], first.depth.dtype) == (0.0, pytest.approx(0.75), np.float32)
    assert (first.intrinsics.fx, first.intrinsics.fy, first.intrinsics.cx, first.intrinsics.width) == (600, 601, 20, W)
    assert camera.advance()
    assert (camera.latest().colour[3, 3, 0], camera.latest().depth[3, 3]) == (20, pytest.approx(1.0))
    assert not camera.advance()


FOUR = np.dstack([colour(), colour()[..., :1]])
METRES = np.full((H, W), 0.5, np.float32)
METRES[0, :3] = np.nan, -1.0, np.inf
PADDED = np.zeros((H, 128), np.uint8)
PADDED[:, : 3 * W] = colour().reshape(H, -1)


@pytest.mark.parametrize(
    ("first", "its_depth", "metres"),
    [
        (image(colour()[..., ::-1], "bgr8"), image(METRES, "32FC1"), 0.5),
        (image(FOUR, "rgba8"), image(depth().astype(">u2"), "16UC1", big=True), 0.75),
        (compressed(colour()[..., ::-1], ".png"), compressed(depth(), ".png"), 0.75),
    ],
    ids=["bgr8 and metres", "rgba8 and the other end first", "compressed"],
)  # fmt: skip
def test_every_encoding_gives_the_same_pixels(cell: Path, first: Any, its_depth: Any, metres: float) -> None:
    frame = open_bag(cell, write(cell.parent / "bag", two(first, its_depth)[:3])).latest()
    assert frame.colour[3, 3].tolist() == [200, 0, 0]
    assert frame.depth[3, 3] == pytest.approx(metres)
    assert frame.depth[0, :3].tolist()[0] == 0.0
    assert np.isfinite(frame.depth).all()
    assert (frame.depth >= 0.0).all()


def test_rows_may_be_padded(cell: Path) -> None:
    padded = STORE.types[IMAGE](header(), H, W, "rgb8", 0, 128, PADDED.reshape(-1))
    assert np.array_equal(open_bag(cell, write(cell.parent / "bag", two(padded))).latest().colour, colour())


TEXT = STORE.types["std_msgs/msg/String"]("no image")


@pytest.mark.parametrize(
    ("messages", "words", "line"),
    [
        ([], r"has no topic /colour; it has nothing", 3),
        (two()[:2], r"has no topic /depth; it has /colour \(sensor_msgs/msg/Image\)", 4),
        ([("/colour", 1, TEXT), *two()[2:3]], r"/colour is std_msgs/msg/String, not sensor_msgs/msg/Image", 3),
        (two()[1:], r"has no topic /info: write 'intrinsics:'", 5),
        (two(about=info(fx=0.0)), r"/info: it has no focal length", 5),
        (two(about=info(d=(0.1, 0, 0, 0, 0))), r"its lens distorts", 5),
        (two(image(colour()[:20], "rgb8")), r"colour is 40 x 20, the intrinsics are for 40 x 30", 2),
        (two(compressed(colour(), ".jpg", -4))[:3], r"cannot be read as a picture: its end is missing", 2),
        (two(image(colour(), "bayer_rggb8")), r"its encoding is 'bayer_rggb8'", 2),
        (two(image(colour(), "rgb8", step=4000)), r"in rows of 4000 bytes, but it has 3600 bytes", 2),
        (two(its_depth=image(colour(), "rgb8")), r"depth has 16UC1", 2),
        ([(t, s if t != "/depth" else s + 10**10, m) for t, s, m in two()], r"no depth lies within 0.02 s", 2),
    ],
)
def test_a_bag_of_other_things_is_refused_at_its_place(cell: Path, messages: Any, words: str, line: int) -> None:
    bag = write(cell.parent / "bag", messages)
    with pytest.raises(CellFileError, match=words) as caught:
        open_bag(cell, bag)
    assert caught.value.line == line


def test_no_bag_or_half_a_bag_is_refused(cell: Path) -> None:
    with pytest.raises(CellFileError, match="there is no such bag"):
        open_bag(cell, "elsewhere")
    bag = write(cell.parent / "bag", two())
    (bag / "metadata.yaml").write_text("[")
    with pytest.raises(CellFileError, match="is no bag that can be read"):
        open_bag(cell, bag)
    whole = (bag / "bag.mcap").read_bytes()
    for part in (b"", whole[:20], whole[: len(whole) // 2]):
        (cell.parent / "part.mcap").write_bytes(part)
        with pytest.raises(CellFileError, match=r"part\.mcap"):
            open_bag(cell, cell.parent / "part.mcap")


def test_a_pipe_is_not_waited_for(cell: Path) -> None:
    os.mkfifo(cell.parent / "pipe.mcap")
    with pytest.raises(CellFileError, match="is neither a file nor a folder"):
        open_bag(cell, cell.parent / "pipe.mcap")


@pytest.mark.parametrize("first", [True, False])
def test_a_topic_with_two_types_is_refused_at_its_place(cell: Path, first: bool) -> None:
    text = [("/colour", 5_000_000, TEXT)]
    with pytest.raises(CellFileError, match="/colour is sensor_msgs/msg/Image and std_msgs/msg/String, not") as caught:
        open_bag(cell, write(cell.parent / "bag", [*text, *two()] if first else [*two(), *text]))
    assert caught.value.line == 3


@pytest.mark.parametrize(("kind", "line"), [(IMAGE, 2), ("sensor_msgs/msg/CameraInfo", 5)])
def test_a_bag_whose_types_only_bear_the_names_of_ros_is_refused(cell: Path, kind: str, line: int) -> None:
    own = get_typestore(Stores.EMPTY)
    own.register(get_types_from_msg("uint32 height\nuint8[] data\n", kind))
    with Writer(cell.parent / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, stamp, message in two():
            of = message.__msgtype__
            store = own if of == kind else STORE
            raw = own.serialize_cdr(own.types[kind](H, np.zeros(9, np.uint8)), kind) if of == kind else None
            known = [found for found in writer.connections if found.topic == topic]
            connection = known[0] if known else writer.add_connection(topic, of, typestore=store)
            writer.write(connection, stamp, STORE.serialize_cdr(message, of) if raw is None else raw)
    with pytest.raises(CellFileError, match="its type differs from the ROS type of that name") as caught:
        open_bag(cell, cell.parent / "bag")
    assert caught.value.line == line


def test_any_damaged_byte_is_refused_or_harmless_and_never_a_traceback(cell: Path) -> None:
    bag = write(cell.parent / "bag", two())
    whole = (bag / "bag.mcap").read_bytes()
    rng = np.random.default_rng(1)
    refused = 0
    for at in rng.integers(0, len(whole), 15):
        spoilt = bytearray(whole)
        spoilt[at] ^= 0xFF
        (cell.parent / "spoilt.mcap").write_bytes(bytes(spoilt))
        try:
            camera = open_bag(cell, cell.parent / "spoilt.mcap")
            for _ in range(camera.count):
                camera.latest()
                camera.advance()
        except (CellFileError, DeviceFault):
            refused += 1
    assert refused > 3


def test_a_later_image_that_cannot_be_used_is_a_fault_of_the_camera(cell: Path) -> None:
    messages = two()
    messages[4] = ("/colour", messages[4][1], image(colour()[:20], "rgb8"))
    camera = open_bag(cell, write(cell.parent / "bag", messages))
    camera.latest()
    camera.advance()
    with pytest.raises(DeviceFault, match="40 x 20"):
        camera.latest()
