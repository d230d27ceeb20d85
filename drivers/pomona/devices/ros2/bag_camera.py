"""The images of a bag as a camera: frames from another robot are processed like new ones."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from pomona.devices.frames.camera import FramesCamera
from pomona.devices.frames.folder import Images, UnusableFrames
from pomona.devices.ros2.images import COMPRESSED, IMAGE, INFO, UnusableImage, colour_of, depth_of, intrinsics_of
from pomona.drivers import (
    ConnectContext,
    DepthModelSection,
    Intrinsics,
    IntrinsicsSection,
    Settings,
    depth_model_of,
    driver,
)
from pomona.executive import TIME, Measure, Section, Text, Whole, install_extra, value

try:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore
except ImportError as error:
    raise ImportError(f"it needs the extra 'ros2': {install_extra('ros2')} ({error})") from error


NOT_ROS = (AttributeError, TypeError, ValueError, IndexError)
"""A bag brings its own types: one that bears a name of ROS may have other fields."""


class Bag:
    """A bag of ROS 2 (a folder, an .mcap or a .db3) or of ROS 1. Its file is open only while something is read.

    The reader raises many kinds of errors for a damaged file; they all become `UnusableFrames`.
    """

    def __init__(self, path: Path) -> None:
        """Raises UnusableFrames: there is none, or it cannot be read."""
        self.path = path
        if not path.exists():
            raise UnusableFrames(path, "there is no such bag")
        if not (path.is_file() or path.is_dir()):  # a pipe would be waited for
            raise UnusableFrames(path, "is neither a file nor a folder")
        kinds: dict[str, set[str]] = {}
        with self._opened("is no bag that can be read") as reader:
            for connection in reader.connections:
                kinds.setdefault(connection.topic, set()).add(connection.msgtype)
        self.topics = {topic: " and ".join(sorted(of)) for topic, of in kinds.items()}
        """Types by topic; normally one each."""

    def stamps(self, *topics: str) -> list[list[int]]:
        """When the messages of each topic were written [ns]. Raises UnusableFrames: the bag is damaged."""
        with self._opened() as reader:
            return [[stamp for _connection, stamp, _raw in reader.messages(_of(reader, topic))] for topic in topics]

    def messages(self, *wanted: tuple[str, int]) -> list[Any]:
        """Return the messages that were written to these topics at these times [ns].

        Raises UnusableFrames: the bag is damaged.
        """
        with self._opened() as reader:
            return [self._one(reader, topic, stamp) for topic, stamp in wanted]

    def _one(self, reader: Any, topic: str, stamp: int) -> Any:
        with closing(reader.messages(_of(reader, topic), stamp, stamp + 1)) as found:
            for connection, _stamp, raw in found:
                return reader.deserialize(raw, connection.msgtype)
        raise KeyError(f"the message of {topic} at {stamp} ns is missing; the bag has changed")

    @contextmanager
    def _opened(self, wrong: str = "is damaged") -> Iterator[Any]:
        try:
            with AnyReader([self.path], default_typestore=_types()) as reader:
                yield reader
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:
            raise UnusableFrames(self.path, f"{wrong}: {str(error) or type(error).__name__}") from error


@cache
def _types() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)


def _of(reader: Any, topic: str) -> list[Any]:
    return [connection for connection in reader.connections if connection.topic == topic]


@dataclass(frozen=True, slots=True)
class BagFrame:
    """Two messages that were taken together."""

    bag: Bag
    colour: tuple[str, int]
    depth: tuple[str, int]

    @property
    def label(self) -> str:
        return f"{self.bag.path.name} {self.colour[1]}"

    def read(self, intrinsics: Intrinsics) -> Images:
        """Read both images. Raises UnusableFrames: an image cannot be used; the text names it and the reason."""
        taken = self.bag.messages(self.colour, self.depth)
        topic, stamp = self.colour
        try:
            colour = colour_of(taken[0], self.bag.topics[topic])
            topic, stamp = self.depth
            depth = depth_of(taken[1], self.bag.topics[topic])
        except (UnusableImage, *NOT_ROS) as error:
            raise UnusableFrames(self.bag.path, f"{topic} at {stamp} ns: {_why(error)}") from error
        size = (intrinsics.width, intrinsics.height)
        for name, image in (("colour", colour), ("depth", depth)):
            if image.shape[1::-1] != size:
                got = f"{image.shape[1]} x {image.shape[0]}"
                raise UnusableFrames(self.bag.path, f"{name} is {got}, the intrinsics are for {size[0]} x {size[1]}")
        return colour, depth


@dataclass(frozen=True, slots=True, kw_only=True)
class BagFile:
    """A bag with colour and depth images that belong together, and a CameraInfo unless intrinsics stand here."""

    bag: str = value(Text(), help="a bag's folder or file: --set bag=PATH")
    every: int = value(Whole(1, 1_000_000), 1, "number of frames of which one is shown")
    colour: str = value(Text(), "/camera/color/image_raw", "topic of sensor_msgs/Image or CompressedImage")
    depth: str = value(Text(), "/camera/aligned_depth_to_color/image_raw", "topic of its depth")
    info: str = value(Text(), "/camera/color/camera_info", "topic of sensor_msgs/CameraInfo")
    apart: float = value(
        Measure(TIME, "0 s", "1 s"), "20 ms", "colour and depth further apart than this do not belong together"
    )
    intrinsics: IntrinsicsSection | None = value(
        Section(IntrinsicsSection), None, "of the camera, instead of the bag's"
    )
    depth_model: DepthModelSection | None = value(
        Section(DepthModelSection), None, "how the depth errs; without it as a RealSense D4xx"
    )


@driver(FramesCamera, BagFile)
def connect(settings: Settings[BagFile], context: ConnectContext) -> FramesCamera:
    """Open the bag: from the working folder, else from the cell file's."""
    said = settings.values
    path = Path(said.bag).expanduser()
    if not path.is_absolute() and not path.exists():
        path = context.cell.parent / path
    try:
        bag = Bag(path)
    except UnusableFrames as error:
        raise settings.error(str(error), "bag") from error
    key = "bag"
    try:
        for key, kinds in (("colour", (IMAGE, COMPRESSED)), ("depth", (IMAGE, COMPRESSED))):
            _check_type(bag, getattr(said, key), kinds)
        key = "bag"
        frames = _pairs(bag, said)[:: said.every]
        key = "info"
        intrinsics = said.intrinsics.intrinsics() if said.intrinsics else _intrinsics(bag, said.info)
        key = "bag"
        frames[0].read(intrinsics)
    except UnusableFrames as error:
        raise settings.error(str(error), key) from error
    return FramesCamera(frames, intrinsics, context.clock, depth_model=depth_model_of(said.depth_model))


def _check_type(bag: Bag, topic: str, kinds: Sequence[str]) -> None:
    found = bag.topics.get(topic)
    if found is None:
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(bag.topics.items())) or "nothing"
        raise UnusableFrames(bag.path, f"has no topic {topic}; it has {there}")
    if found not in kinds:
        raise UnusableFrames(bag.path, f"{topic} is {found}, not {' or '.join(kinds)}")


def _pairs(bag: Bag, said: BagFile) -> tuple[BagFrame, ...]:
    colours, depths = map(sorted, bag.stamps(said.colour, said.depth))
    if not colours or not depths:
        raise UnusableFrames(bag.path, f"holds no message of {said.depth if colours else said.colour}")
    frames = []
    for stamp in colours:
        at = bisect_left(depths, stamp)
        near = min(depths[max(at - 1, 0) : at + 1], key=lambda depth: abs(depth - stamp))
        if abs(near - stamp) <= said.apart * 1e9:
            frames.append(BagFrame(bag, (said.colour, stamp), (said.depth, near)))
    if not frames:
        raise UnusableFrames(bag.path, f"no depth lies within {said.apart:g} s of a colour image")
    return tuple(frames)


def _intrinsics(bag: Bag, topic: str) -> Intrinsics:
    if topic not in bag.topics:
        raise UnusableFrames(bag.path, f"has no topic {topic}: write 'intrinsics:' here")
    _check_type(bag, topic, (INFO,))
    (stamps,) = bag.stamps(topic)
    if not stamps:
        raise UnusableFrames(bag.path, f"holds no message of {topic}: write 'intrinsics:' here")
    try:
        return intrinsics_of(*bag.messages((topic, stamps[0])))
    except (UnusableImage, *NOT_ROS) as error:
        raise UnusableFrames(bag.path, f"{topic}: {_why(error)}") from error


def _why(error: Exception) -> str:
    return (
        str(error) if isinstance(error, UnusableImage) else f"its type differs from the ROS type of that name ({error})"
    )
