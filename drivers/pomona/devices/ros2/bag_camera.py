"""The images of a bag as a camera: frames from another robot are processed like new ones."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.devices.frames.camera import FramesCamera
from pomona.devices.frames.folder import Images, UnusableFrames
from pomona.devices.ros2.bag import NOT_ROS, Bag, BagMessage, why
from pomona.devices.ros2.images import (
    COMPRESSED,
    IMAGE,
    INFO,
    MILLIMETRE,
    colour_of,
    depth_of,
    intrinsics_of,
    is_rectified,
)
from pomona.drivers import (
    ConnectContext,
    DepthModelSection,
    Intrinsics,
    IntrinsicsSection,
    Settings,
    depth_model_of,
    driver,
)
from pomona.executive import TIME, Measure, Section, Text, UnusablePicture, Whole, value

# intrinsics that differ by more than this ratio are of another zoom, focus or profile
APART_K = 1e-3

VIEWER = re.compile(r"(/device_\d+/sensor_\d+/)(\w+/)image/data")
"""An image topic of RealSense's viewer: the sensor's topics begin with the first part, the stream's with both."""

UNITS = (
    "option/Depth_Units/value",
    "option/Depth Units/value",
)  # of a sensor of the viewer: metres per count
REGISTER = "play it through realsense2_camera with align_depth, and record that"


@dataclass(frozen=True, slots=True)
class BagFrame:
    """Two messages that were taken together."""

    bag: Bag
    colour: BagMessage
    depth: BagMessage
    unit: float  # of depth in whole numbers [m]

    @property
    def label(self) -> str:
        return f"{self.bag.path.name} {self.colour.taken or self.colour.written}"

    def read(self, intrinsics: Intrinsics) -> Images:
        """Read both images. Raises UnusableFrames: an image cannot be used; the text names it and the reason."""
        taken = self.bag.read(self.colour, self.depth)
        place = self.colour
        try:
            colour = colour_of(taken[0], self.bag.topics[place.topic])
            place = self.depth
            depth = depth_of(taken[1], self.bag.topics[place.topic], self.unit)
        except (UnusablePicture, *NOT_ROS) as error:
            raise UnusableFrames(
                self.bag.path, f"{place.topic} at {place.written} ns: {why(error)}"
            ) from error
        size = (intrinsics.width, intrinsics.height)
        for name, image in (("colour", colour), ("depth", depth)):
            if image.shape[1::-1] != size:
                got = f"{image.shape[1]} x {image.shape[0]}"
                raise UnusableFrames(
                    self.bag.path, f"{name} is {got}, the intrinsics are for {size[0]} x {size[1]}"
                )
        return colour, depth


@dataclass(frozen=True, slots=True, kw_only=True)
class BagFile:
    """A bag with colour and depth images that belong together, and a CameraInfo unless intrinsics stand here."""

    bag: str = value(Text(), help="a bag's folder or file: --set bag=PATH")
    every: int = value(Whole(1, 1_000_000), 1, "number of frames of which one is shown")
    colour: str = value(
        Text(), "/camera/color/image_raw", "topic of sensor_msgs/Image or CompressedImage"
    )
    depth: str = value(Text(), "/camera/aligned_depth_to_color/image_raw", "topic of its depth")
    info: str = value(
        Text(), "", "topic of sensor_msgs/CameraInfo; without it camera_info beside colour"
    )
    apart: float = value(
        Measure(TIME, "0 s", "1 s"),
        "20 ms",
        "colour and depth further apart than this do not belong together",
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
        _check_viewer(bag, said)
        for key, kinds in (("colour", (IMAGE, COMPRESSED)), ("depth", (IMAGE, COMPRESSED))):
            _check_type(bag, getattr(said, key), kinds, key)
        key = "bag"
        frames = _pairs(bag, said)[:: said.every]
        key = "info"
        info = said.info or _info_beside(said.colour)
        intrinsics = (
            said.intrinsics.intrinsics() if said.intrinsics else _intrinsics(bag, info, said.colour)
        )
        key = "bag"
        frames[0].read(intrinsics)
    except UnusableFrames as error:
        raise settings.error(str(error), key) from error
    return FramesCamera(
        frames, intrinsics, context.clock, depth_model=depth_model_of(said.depth_model)
    )


def _info_beside(colour: str) -> str:
    """Return the topic of the CameraInfo beside an image, as image_transport names it."""
    return f"{colour.removesuffix('/compressed').rpartition('/')[0]}/camera_info"


def _check_type(bag: Bag, topic: str, kinds: Sequence[str], key: str = "info") -> None:
    found = bag.topics.get(topic)
    if found is None:
        seen = {
            name: kind for name, kind in bag.topics.items() if kind in (IMAGE, COMPRESSED, INFO)
        } or bag.topics
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(seen.items())) or "nothing"
        raise UnusableFrames(
            bag.path, f"has no topic {topic}; it has {there}; name it with the option '{key}'"
        )
    if found not in kinds:
        raise UnusableFrames(bag.path, f"{topic} is {found}, not {' or '.join(kinds)}")


def _pairs(bag: Bag, said: BagFile) -> tuple[BagFrame, ...]:
    """Pair each depth with the colour image that was taken nearest to it, and that has no nearer depth."""
    colours, depths = (bag.list_messages(topic) for topic in (said.colour, said.depth))
    stamped = all(place.taken for place in (*colours, *depths))

    def when(place: BagMessage) -> int:
        return place.taken if stamped else place.written

    colours = sorted(colours, key=when)
    depths = sorted(depths, key=when)
    times = [when(place) for place in depths]
    unit = _unit(bag, said.depth)
    nearest: dict[int, BagMessage] = {}  # by the number of a depth
    for colour in colours:
        at = bisect_left(times, when(colour))
        near = min(
            range(max(at - 1, 0), min(at + 1, len(times))),
            key=lambda k: abs(times[k] - when(colour)),
        )
        apart = abs(times[near] - when(colour))
        before = nearest.get(near)
        if apart <= said.apart * 1e9 and (
            before is None or apart < abs(times[near] - when(before))
        ):
            nearest[near] = colour
    frames = [BagFrame(bag, nearest[k], depths[k], unit) for k in sorted(nearest)]
    if not frames:
        by = "their headers" if stamped else "the time of writing"
        raise UnusableFrames(
            bag.path, f"no depth lies within {said.apart:g} s of a colour image, by {by}"
        )
    return tuple(frames)


def _check_viewer(bag: Bag, said: BagFile) -> None:
    """Refuse a bag of RealSense's viewer, unless its topics are named and both streams are of one imager."""
    viewer = sorted(topic for topic in bag.topics if VIEWER.fullmatch(topic))
    if viewer and said.colour not in bag.topics:
        words = (
            f"is of RealSense's viewer ({', '.join(viewer)}): its depth is not registered to colour"
        )
        raise UnusableFrames(bag.path, f"{words}: {REGISTER}")
    streams = [
        match[1] + match[2]
        for topic in (said.colour, said.depth)
        if (match := VIEWER.fullmatch(topic))
    ]
    for part, numbers in (("tf/0", _place), ("info/camera_info", _camera_matrix)):
        topics = [stream + part for stream in streams if stream + part in bag.topics]
        try:
            values = [numbers(bag.read_all(topic)[0]) for topic in topics]
        except NOT_ROS as error:
            raise UnusableFrames(bag.path, f"{' or '.join(topics)}: {why(error)}") from error
        if len(values) == 2 and not np.allclose(values[0], values[1], rtol=APART_K, atol=1e-4):
            words = f"{topics[0]} and {topics[1]} differ: its depth is not registered to colour"
            raise UnusableFrames(bag.path, f"{words}: {REGISTER}")


def _place(transform: Any) -> list[float]:
    t = transform.translation
    r = transform.rotation
    return [t.x, t.y, t.z, r.x, r.y, r.z, r.w]


def _camera_matrix(info: Any) -> list[float]:
    return list(np.asarray(info.K if hasattr(info, "K") else info.k, float))


def _unit(bag: Bag, depth: str) -> float:
    """Return the unit of depth in whole numbers [m]: that of the viewer's sensor, else a millimetre (REP 118)."""
    stream = VIEWER.fullmatch(depth)
    topic = next((t for end in UNITS if stream and (t := stream[1] + end) in bag.topics), "")
    if not topic:
        return MILLIMETRE
    units = {float(message.data) for message in bag.read_all(topic)}
    unit = units.pop() if len(units) == 1 else float("nan")
    if not 1e-6 <= unit <= 1e-2:
        raise UnusableFrames(
            bag.path, f"{topic} holds no single unit of depth between 1 µm and 10 mm"
        )
    return unit


def _intrinsics(bag: Bag, topic: str, colour: str) -> Intrinsics:
    if topic not in bag.topics:
        raise UnusableFrames(bag.path, f"has no topic {topic}: write 'intrinsics:' here")
    _check_type(bag, topic, (INFO,))
    places = bag.list_messages(topic)
    try:
        found = [intrinsics_of(info, is_rectified(colour)) for info in bag.read_all(topic)]
    except (UnusablePicture, *NOT_ROS) as error:
        raise UnusableFrames(bag.path, f"{topic}: {why(error)}") from error
    for place, other in zip(places, found, strict=True):
        if not np.allclose(_parts(other), _parts(found[0]), rtol=APART_K):
            words = f"fx is {found[0].fx:g} px at first, {other.fx:g} px in the message at {place.written} ns"
            raise UnusableFrames(
                bag.path,
                f"{topic} changes: {words}: cut the bag there, or write 'intrinsics:' here",
            )
    return found[0]


def _parts(intrinsics: Intrinsics) -> tuple[float, ...]:
    i = intrinsics
    return i.fx, i.fy, i.cx, i.cy, i.width, i.height
