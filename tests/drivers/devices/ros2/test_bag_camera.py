"""A bag as a camera. The bags are written by rosbags itself, image by image, not by our own export."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")

from mcap.reader import make_reader
from mcap.writer import IndexType, Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pomona.devices.frames.camera import FramesCamera
from pomona.devices.ros2.bag_camera import connect
from pomona.drivers.errors import CellFileError, DeviceFault
from pomona.drivers.services import ConnectContext
from pomona.executive.clock import ManualClock
from tests.drivers.device_settings import read_settings

STORE = get_typestore(Stores.ROS2_JAZZY)
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
W, H = 40, 30


def header(taken: int = 0) -> Any:
    """A header of an image that was taken at a time [ns]; without a stamp the time of writing counts."""
    stamp = STORE.types["builtin_interfaces/msg/Time"](*divmod(taken, 10**9))
    return STORE.types["std_msgs/msg/Header"](stamp, "camera")


def image(
    pixels: Any, encoding: str, step: int | None = None, big: bool = False, taken: int = 0
) -> Any:
    data = np.ascontiguousarray(pixels)
    step = data.strides[0] if step is None else step
    return STORE.types[IMAGE](
        header(taken),
        data.shape[0],
        data.shape[1],
        encoding,
        int(big),
        step,
        data.reshape(-1).view(np.uint8),
    )


def compressed(pixels: Any, ending: str, length: int | None = None) -> Any:
    coded = cv2.imencode(ending, pixels)[1].reshape(-1)[:length]
    return STORE.types[COMPRESSED](header(), ending[1:], coded)


def packed(content: bytes, form: str) -> Any:
    return STORE.types[COMPRESSED](header(), form, np.frombuffer(content, np.uint8))


def info(
    fx: float = 600.0, d: tuple[float, ...] = (0.0,) * 5, p: tuple[float, ...] = (0.0,) * 12
) -> Any:
    k = np.array([fx, 0, 20, 0, 601, 15, 0, 0, 1.0])
    roi = STORE.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    eye = np.eye(3).reshape(-1)
    return STORE.types["sensor_msgs/msg/CameraInfo"](
        header(), H, W, "plumb_bob", np.array(d), k, eye, np.array(p), 0, 0, roi
    )


def colour(red: int = 200) -> Any:
    pixels = np.zeros((H, W, 3), np.uint8)
    pixels[..., 0] = red
    return pixels


def depth(mm: int = 750) -> Any:
    pixels = np.full((H, W), mm, np.uint16)
    pixels[0, 0] = 0
    return pixels


def write(
    path: Path, messages: list[tuple[str, int, Any]], plugin: StoragePlugin = StoragePlugin.MCAP
) -> Path:
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
    cell.write_text(
        f"driver: bag\nbag: '{bag}'\ncolour: /colour\ndepth: /depth\ninfo: /info\n{extra}\n"
    )
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
    assert (first.depth[0, 0], first.depth[3, 3], first.depth.dtype) == (
        0.0,
        pytest.approx(0.75),
        np.float32,
    )
    assert (
        first.intrinsics.fx,
        first.intrinsics.fy,
        first.intrinsics.cx,
        first.intrinsics.width,
    ) == (600, 601, 20, W)
    assert camera.advance()
    assert (camera.latest().colour[3, 3, 0], camera.latest().depth[3, 3]) == (
        20,
        pytest.approx(1.0),
    )
    assert not camera.advance()


MS = 1_000_000


def shown(camera: FramesCamera) -> list[tuple[int, float]]:
    """Red value and depth [m] of every frame."""
    found = []
    for _ in range(camera.count):
        frame = camera.latest()
        found.append((int(frame.colour[3, 3, 0]), round(float(frame.depth[3, 3]), 4)))  # type: ignore[index]
        camera.advance()
    return found


@pytest.mark.parametrize("late", [0, 25, 40, 90])
def test_images_belong_together_by_the_stamps_of_their_headers(cell: Path, late: int) -> None:
    messages: list[tuple[str, int, Any]] = [("/info", 0, info())]
    for i in range(6):
        taken = (1000 + 33 * i) * MS
        messages.append(("/colour", taken, image(colour(10 + i), "rgb8", taken=taken)))
        messages.append(
            ("/depth", taken + late * MS, image(depth(500 + 10 * i), "16UC1", taken=taken))
        )
    messages.sort(key=lambda message: message[1])
    expected = [(10 + i, round(0.5 + 0.01 * i, 4)) for i in range(6)]
    assert shown(open_bag(cell, write(cell.parent / "bag", messages))) == expected


def test_depth_that_was_taken_a_second_before_belongs_to_no_colour(cell: Path) -> None:
    messages: list[tuple[str, int, Any]] = [("/info", 0, info())]
    for i in range(3):
        at = (5000 + 33 * i) * MS
        messages += [
            ("/colour", at, image(colour(), "rgb8", taken=at)),
            ("/depth", at, image(depth(), "16UC1", taken=4000 * MS)),
        ]
    with pytest.raises(
        CellFileError, match=r"no depth lies within 0\.02 s of a colour image, by their headers"
    ):
        open_bag(cell, write(cell.parent / "bag", messages))


def test_a_depth_belongs_to_one_colour_image_the_nearest(cell: Path) -> None:
    """Twice as many colour images as depths, and colour images of one stamp: those of no depth are left out."""
    messages: list[tuple[str, int, Any]] = [("/info", 0, info())]
    for i, (of_colour, of_depth) in enumerate(
        [(1000, 1000), (1016, None), (1033, 1035), (1033, None), (1050, None)]
    ):
        messages.append(
            ("/colour", (1000 + i) * MS, image(colour(10 + i), "rgb8", taken=of_colour * MS))
        )
        if of_depth is not None:
            messages.append(
                (
                    "/depth",
                    (1000 + i) * MS,
                    image(depth(500 + 10 * i), "16UC1", taken=of_depth * MS),
                )
            )
    assert shown(open_bag(cell, write(cell.parent / "bag", messages))) == [(10, 0.5), (12, 0.52)]


def test_depth_in_floating_point_that_is_not_in_metres_is_refused(cell: Path) -> None:
    for numbers, unusable in ((np.full((H, W), 0.75), False), (np.full((H, W), 750.0), True)):
        bag = write(
            cell.parent / f"bag_{unusable}",
            two(its_depth=image(numbers.astype(np.float32), "32FC1")),
        )
        if unusable:
            with pytest.raises(
                CellFileError, match="its depth is 750 m in the middle: 32FC1 has metres, 16UC1"
            ):
                open_bag(cell, bag)
        else:
            assert float(open_bag(cell, bag).latest().depth[3, 3]) == pytest.approx(0.75)  # type: ignore[index]


def test_messages_that_were_written_at_the_same_time_are_told_apart(cell: Path) -> None:
    messages = [("/info", 0, info())]
    for i in range(3):
        messages += [("/colour", 7 * MS, image(colour(i), "rgb8", taken=(1 + i) * 100 * MS)),
                     ("/depth", 7 * MS, image(depth(500 + i), "16UC1", taken=(1 + i) * 100 * MS))]  # fmt: skip
    assert shown(open_bag(cell, write(cell.parent / "bag", messages))) == [
        (0, 0.5),
        (1, 0.501),
        (2, 0.502),
    ]


def test_intrinsics_that_change_are_refused_unless_the_cell_gives_them(cell: Path) -> None:
    bag = write(cell.parent / "bag", [*two(), ("/info", 100 * MS, info(fx=900.0))])
    with pytest.raises(
        CellFileError, match="/info changes: fx is 600 px at first, 900 px in the message at"
    ) as caught:
        open_bag(cell, bag)
    assert caught.value.line == 5
    own = "intrinsics: {fx: 610 px, fy: 610 px, cx: 20 px, cy: 15 px, width: 40, height: 30}"
    assert open_bag(cell, bag, own).latest().intrinsics.fx == 610.0


RECTIFIED = (580.0, 0, 21, 0, 0, 581, 16, 0, 0, 0, 1, 0)


@pytest.mark.parametrize(
    ("topic", "fx"),
    [
        ("/camera/image_rect_color", 580.0),
        ("/camera/image_rect/compressed", 580.0),
        ("/camera/image_raw", 0.0),
    ],
)
def test_a_rectified_image_has_the_intrinsics_of_p(cell: Path, topic: str, fx: float) -> None:
    renamed = [
        (topic if t == "/colour" else t, s, m)
        for t, s, m in two(about=info(d=(0.1, -0.2, 0, 0, 0), p=RECTIFIED))
    ]
    bag = write(cell.parent / "bag", renamed)
    cell.write_text(f"driver: bag\nbag: '{bag}'\ncolour: {topic}\ndepth: /depth\ninfo: /info\n")
    if not fx:
        with pytest.raises(
            CellFileError,
            match=r"its lens distorts .* use the topic image_rect… of image_proc, or write",
        ):
            connect.connect(read_settings(connect, cell), ConnectContext(cell, ManualClock(5.0), 0))
        return
    camera = connect.connect(
        read_settings(connect, cell), ConnectContext(cell, ManualClock(5.0), 0)
    )
    assert (
        camera.intrinsics.fx,
        camera.intrinsics.fy,
        camera.intrinsics.cx,
        camera.intrinsics.cy,
    ) == (fx, 581, 21, 16)


def png(pixels: Any) -> bytes:
    return bytes(cv2.imencode(".png", pixels)[1].tobytes())


INVERSE = np.full((H, W), 7, np.uint16)  # 3 / (7 - 1) m


@pytest.mark.parametrize(
    ("its_depth", "metres"),
    [
        (
            packed(struct.pack("<iff", 0, 0.0, 0.0) + png(depth()), "16UC1; compressedDepth png"),
            0.75,
        ),
        (packed(struct.pack("<iff", 0, 0.0, 0.0) + png(depth()), "16UC1; compressedDepth"), 0.75),
        (
            packed(struct.pack("<iff", 0, 3.0, 1.0) + png(INVERSE), "32FC1; compressedDepth png"),
            0.5,
        ),
    ],
)
def test_compressed_depth_is_read_after_its_header(
    cell: Path, its_depth: Any, metres: float
) -> None:
    frame = open_bag(cell, write(cell.parent / "bag", two(its_depth=its_depth)[:3])).latest()
    assert frame.depth[3, 3] == pytest.approx(metres)  # type: ignore[index]


@pytest.mark.parametrize("form", ["16UC1; compressedDepth rvl", "16UC1; compressedDepth png"])
def test_compressed_depth_of_another_form_is_refused_with_its_format(cell: Path, form: str) -> None:
    with pytest.raises(CellFileError, match=r"compressedDepth|cannot be read as a picture"):
        open_bag(cell, write(cell.parent / "bag", two(its_depth=packed(bytes(40), form))[:3]))


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
def test_every_encoding_gives_the_same_pixels(
    cell: Path, first: Any, its_depth: Any, metres: float
) -> None:
    frame = open_bag(cell, write(cell.parent / "bag", two(first, its_depth)[:3])).latest()
    assert frame.colour[3, 3].tolist() == [200, 0, 0]
    assert frame.depth[3, 3] == pytest.approx(metres)
    assert frame.depth[0, :3].tolist()[0] == 0.0
    assert np.isfinite(frame.depth).all()
    assert (frame.depth >= 0.0).all()


SLOPED = np.round(np.linspace(600, 900, H)[:, None] + np.random.default_rng(1).normal(0, 2, (H, W)))
SLOPED[8:20, 10:22] -= 90.0  # a fruit
SLOPED[0] = 0.0


@pytest.mark.slow
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize(
    ("counts", "encoding", "kind", "metre"),
    [(SLOPED, "16UC1", "u2", 1e3), (SLOPED / 1e3, "32FC1", "f4", 1.0)],
)
def test_depth_in_another_order_of_bytes_than_its_mark_is_refused(
    cell: Path, counts: Any, encoding: str, kind: str, metre: float, big: bool
) -> None:
    marked, other = (">", "<") if big else ("<", ">")
    right = image(counts.astype(marked + kind), encoding, big=big)
    frame = open_bag(cell, write(cell.parent / "right", two(its_depth=right)[:3])).latest()
    assert np.allclose(frame.depth, counts / metre, atol=1e-6)
    wrong = image(counts.astype(other + kind), encoding, big=big)
    with pytest.raises(
        CellFileError, match=rf"smooth only in the other byte order: is_bigendian {big:d} is wrong"
    ):
        open_bag(cell, write(cell.parent / "wrong", two(its_depth=wrong)[:3]))


def test_rows_may_be_padded(cell: Path) -> None:
    padded = STORE.types[IMAGE](header(), H, W, "rgb8", 0, 128, PADDED.reshape(-1))
    assert np.array_equal(
        open_bag(cell, write(cell.parent / "bag", two(padded))).latest().colour, colour()
    )


TEXT = STORE.types["std_msgs/msg/String"]("no image")


@pytest.mark.parametrize(
    ("messages", "words", "line"),
    [
        ([], r"has no topic /colour; it has nothing", 3),
        (two()[:2], r"has no topic /depth; it has /colour \(sensor_msgs/msg/Image\)", 4),
        (
            [("/colour", 1, TEXT), *two()[2:3]],
            r"/colour is std_msgs/msg/String, not sensor_msgs/msg/Image",
            3,
        ),
        (two()[1:], r"has no topic /info: write 'intrinsics:'", 5),
        (two(about=info(fx=0.0)), r"/info: it has no focal length", 5),
        (two(about=info(d=(0.1, 0, 0, 0, 0))), r"its lens distorts", 5),
        (
            two(image(colour()[:20], "rgb8")),
            r"colour is 40 x 20, the intrinsics are for 40 x 30",
            2,
        ),
        (
            two(compressed(colour(), ".jpg", -4))[:3],
            r"cannot be read as a picture: its end is missing",
            2,
        ),
        (two(image(colour(), "bayer_rggb8")), r"its encoding is 'bayer_rggb8'", 2),
        (
            two(image(colour(), "rgb8", step=4000)),
            r"it has 3600 bytes, its header 40 x 30 pixels in rows of 4000 bytes",
            2,
        ),
        (two(its_depth=image(colour(), "rgb8")), r"depth has 16UC1", 2),
        (
            [(t, s if t != "/depth" else s + 10**10, m) for t, s, m in two()],
            r"no depth lies within 0.02 s",
            2,
        ),
    ],
)
def test_a_bag_of_other_things_is_refused_at_its_place(
    cell: Path, messages: Any, words: str, line: int
) -> None:
    bag = write(cell.parent / "bag", messages)
    with pytest.raises(CellFileError, match=words) as caught:
        open_bag(cell, bag)
    assert caught.value.line == line


def test_no_bag_or_half_a_bag_is_refused(cell: Path) -> None:
    with pytest.raises(CellFileError, match="there is no such bag"):
        open_bag(cell, "elsewhere")
    bag = write(cell.parent / "bag", two())
    (bag / "metadata.yaml").write_text("[")
    with pytest.raises(
        CellFileError, match=r"is no bag that can be read: .*; `ros2 bag reindex` writes"
    ):
        open_bag(cell, bag)
    whole = (bag / "bag.mcap").read_bytes()
    for part, words in (
        (b"", "is empty"),
        (whole[:8], r"is cut off: `mcap recover`"),
        (whole[:20], r"is cut off: `mcap recover`"),
        (whole[: len(whole) // 2], r"is cut off: `mcap recover`"),
        (b"hello", r"is no bag: its beginning is not that of \.mcap"),
        (b"version https://git-lfs.github.com/spec/v1", r"is a pointer of Git LFS"),
    ):
        for place, named in (
            (cell.parent / "part.mcap", cell.parent / "part.mcap"),
            (bag / "bag.mcap", bag),
        ):
            place.write_bytes(part)
            with pytest.raises(CellFileError, match=rf"{place.name}: {words}"):
                open_bag(cell, named)


@pytest.mark.parametrize("name", ["part.db3", "part.bag"])
def test_a_file_that_only_bears_the_name_of_a_bag_is_refused(cell: Path, name: str) -> None:
    (cell.parent / name).write_bytes(b"hello")
    with pytest.raises(CellFileError, match="is no bag: its beginning is not that of"):
        open_bag(cell, cell.parent / name)


def test_of_a_bag_with_pictures_only_their_topics_are_listed(cell: Path) -> None:
    bag = write(cell.parent / "bag", [("/other", 1, image(colour(), "rgb8")), ("/words", 1, TEXT)])
    words = r"has no topic /colour; it has /other \(sensor_msgs/msg/Image\); name it with the option 'colour'\n"
    with pytest.raises(CellFileError, match=words):
        open_bag(cell, bag)


def test_without_a_name_the_camera_info_beside_the_colour_topic_holds(cell: Path) -> None:
    names = {"/colour": "/left/image_raw", "/info": "/left/camera_info"}
    other = ("/right/camera_info", 1, info(fx=900.0))
    bag = write(cell.parent / "bag", [other, *((names.get(t, t), s, m) for t, s, m in two())])
    cell.write_text(f"driver: bag\nbag: '{bag}'\ncolour: /left/image_raw\ndepth: /depth\n")
    camera = connect.connect(
        read_settings(connect, cell), ConnectContext(cell, ManualClock(5.0), 0)
    )
    assert camera.intrinsics.fx == 600.0


def test_a_bag_without_metadata_or_message_index_is_refused_with_the_remedy(cell: Path) -> None:
    bag = write(cell.parent / "bag", two())
    (bag / "metadata.yaml").unlink()
    with pytest.raises(
        CellFileError,
        match=r"is a bag without metadata\.yaml.* `ros2 bag reindex` .* such as bag\.mcap",
    ):
        open_bag(cell, bag)
    assert shown(open_bag(cell, bag / "bag.mcap")) == [(200, 0.75), (20, 1.0)]
    (bag / "bag.mcap").rename(bag / "bag.MCAP")
    with pytest.raises(CellFileError, match=r"ends with \.MCAP: rename it to end with \.mcap"):
        open_bag(cell, bag / "bag.MCAP")
    (bag / "bag.mcap").write_bytes(
        b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
    )
    with pytest.raises(CellFileError, match="is a pointer of Git LFS"):
        open_bag(cell, bag / "bag.mcap")


def test_an_mcap_without_message_index_is_not_called_empty(cell: Path) -> None:
    source, path = (
        next(write(cell.parent / "bag", two()).glob("*.mcap")),
        cell.parent / "other.mcap",
    )
    with source.open("rb") as read, path.open("wb") as written:
        writer = McapWriter(written, index_types=IndexType.CHUNK)
        writer.start("ros2", "a test")
        channels: dict[str, int] = {}
        for schema, channel, message in make_reader(read).iter_messages():
            if channel.topic not in channels:
                of = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, of
                )
            writer.add_message(
                channels[channel.topic], message.log_time, message.data, message.publish_time
            )
        writer.finish()
    with pytest.raises(
        CellFileError, match=r"other\.mcap has no message index; `mcap recover` writes one"
    ):
        open_bag(cell, path)


ROS1 = get_typestore(Stores.ROS1_NOETIC)
VIEWER = ("/device_0/sensor_1/Color_0/", "/device_0/sensor_0/Depth_0/")


def viewer_bag(
    path: Path, unit: float, counts: int, shift: float | None = None, fx: float = 600.0
) -> Path:
    """A bag of ROS 1 with the topics of RealSense's viewer."""
    types = ROS1.types

    def head(taken: int) -> Any:
        return types["std_msgs/msg/Header"](
            0, types["builtin_interfaces/msg/Time"](*divmod(taken, 10**9)), "0"
        )

    def picture(pixels: Any, encoding: str, taken: int) -> Any:
        data = np.ascontiguousarray(pixels)
        return types[IMAGE](
            head(taken), H, W, encoding, 0, data.strides[0], data.reshape(-1).view(np.uint8)
        )

    def about(fx: float) -> Any:
        k, roi = (
            np.array([fx, 0, 20, 0, 600, 15, 0, 0, 1.0]),
            types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
        )
        of = types["sensor_msgs/msg/CameraInfo"]
        return of(
            head(0), H, W, "Brown-Conrady", np.zeros(5), k, np.zeros(9), np.zeros(12), 0, 0, roi
        )

    messages = [
        ("/device_0/sensor_0/option/Depth_Units/value", 0, types["std_msgs/msg/Float32"](unit))
    ]
    messages += [
        (f"{stream}info/camera_info", 0, about(f))
        for stream, f in zip(VIEWER, (600.0, fx), strict=True)
    ]
    if shift is not None:
        for stream, x in zip(VIEWER, (shift, 0.0), strict=True):
            place, turn = (
                types["geometry_msgs/msg/Vector3"](x, 0.0, 0.0),
                types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            )
            messages.append((f"{stream}tf/0", 0, types["geometry_msgs/msg/Transform"](place, turn)))
    for i in range(2):
        taken = (100 + 33 * i) * MS
        messages.append((f"{VIEWER[0]}image/data", taken, picture(colour(), "rgb8", taken)))
        messages.append(
            (
                f"{VIEWER[1]}image/data",
                taken + MS,
                picture(np.full((H, W), counts, np.uint16), "mono16", taken),
            )
        )
    with Writer1(path) as writer:
        connections: dict[str, Any] = {}
        for topic, written, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS1)
            writer.write(connections[topic], written, ROS1.serialize_ros1(message, kind))
    return path


def open_viewer(cell: Path, bag: Path) -> FramesCamera:
    topics = f"colour: {VIEWER[0]}image/data\ndepth: {VIEWER[1]}image/data\ninfo: {VIEWER[0]}info/camera_info\n"
    cell.write_text(f"driver: bag\nbag: '{bag}'\n{topics}")
    return connect.connect(read_settings(connect, cell), ConnectContext(cell, ManualClock(5.0), 0))


@pytest.mark.parametrize(("unit", "counts"), [(0.001, 750), (0.0001, 7500), (0.00025, 3000)])
def test_depth_of_the_viewer_has_the_unit_that_the_bag_gives(
    cell: Path, unit: float, counts: int
) -> None:
    camera = open_viewer(cell, viewer_bag(cell.parent / "a.bag", unit, counts, shift=0.0))
    assert shown(camera) == [(200, 0.75)] * 2
    assert camera.intrinsics.fx == 600.0


def test_depth_of_the_viewer_that_is_not_registered_is_refused(cell: Path) -> None:
    with pytest.raises(
        CellFileError, match=r"tf/0 differ: its depth is not registered to colour: play it through"
    ):
        open_viewer(cell, viewer_bag(cell.parent / "a.bag", 0.001, 750, shift=0.015))
    with pytest.raises(
        CellFileError, match=r"info/camera_info differ: its depth is not registered to colour"
    ):
        open_viewer(cell, viewer_bag(cell.parent / "b.bag", 0.001, 750, fx=390.0))
    with pytest.raises(
        CellFileError, match=r"is of RealSense's viewer .*: its depth is not registered to colour"
    ):
        open_bag(cell, cell.parent / "a.bag")
    with pytest.raises(CellFileError, match="holds no single unit of depth"):
        open_viewer(cell, viewer_bag(cell.parent / "c.bag", 0.0, 750))


def test_a_pipe_is_not_waited_for(cell: Path) -> None:
    os.mkfifo(cell.parent / "pipe.mcap")
    with pytest.raises(CellFileError, match="is neither a file nor a folder"):
        open_bag(cell, cell.parent / "pipe.mcap")


@pytest.mark.parametrize("first", [True, False])
def test_a_topic_with_two_types_is_refused_at_its_place(cell: Path, first: bool) -> None:
    text = [("/colour", 5_000_000, TEXT)]
    with pytest.raises(
        CellFileError, match="/colour is sensor_msgs/msg/Image and std_msgs/msg/String, not"
    ) as caught:
        open_bag(cell, write(cell.parent / "bag", [*text, *two()] if first else [*two(), *text]))
    assert caught.value.line == 3


@pytest.mark.parametrize(("kind", "line"), [(IMAGE, 2), ("sensor_msgs/msg/CameraInfo", 5)])
def test_a_bag_whose_types_only_bear_the_names_of_ros_is_refused(
    cell: Path, kind: str, line: int
) -> None:
    own = get_typestore(Stores.EMPTY)
    own.register(get_types_from_msg("uint32 height\nuint8[] data\n", kind))
    with Writer(cell.parent / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, stamp, message in two():
            of = message.__msgtype__
            store = own if of == kind else STORE
            raw = (
                own.serialize_cdr(own.types[kind](H, np.zeros(9, np.uint8)), kind)
                if of == kind
                else None
            )
            known = [found for found in writer.connections if found.topic == topic]
            connection = known[0] if known else writer.add_connection(topic, of, typestore=store)
            writer.write(
                connection, stamp, STORE.serialize_cdr(message, of) if raw is None else raw
            )
    with pytest.raises(
        CellFileError, match="its type differs from the ROS type of that name"
    ) as caught:
        open_bag(cell, cell.parent / "bag")
    assert caught.value.line == line


@pytest.mark.slow
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
