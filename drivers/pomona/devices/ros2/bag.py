"""A bag of ROS as its messages, and the reasons why one cannot be read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from pomona.devices.frames.folder import UnusableFrames
from pomona.executive import UnusablePicture, install_extra, is_lfs_pointer

try:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore
except ImportError as error:
    raise ImportError(f"it needs the extra 'ros2': {install_extra('ros2')} ({error})") from error


NOT_ROS = (AttributeError, TypeError, ValueError, IndexError)
"""A bag brings its own types: one that bears a name of ROS may have other fields."""

MCAP = b"\x89MCAP0\r\n"  # both ends of an .mcap
BEGINNINGS = {".mcap": MCAP, ".db3": b"SQLite format 3\0", ".bag": b"#ROSBAG V"}
FILES = (".mcap", ".db3")  # endings of the files in the folder of a bag of ROS 2


@dataclass(frozen=True, slots=True)
class BagMessage:
    """A place in a bag: the `nth` message of a topic among those that were written at the same time."""

    topic: str
    written: int  # when it was written [ns]
    nth: int
    taken: int  # stamp of its header [ns]; 0 without


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
        _check_kind(path)
        kinds: dict[str, set[str]] = {}
        with self._opened("is no bag that can be read") as reader:
            for connection in reader.connections:
                kinds.setdefault(connection.topic, set()).add(connection.msgtype)
        self.topics = {topic: " and ".join(sorted(of)) for topic, of in kinds.items()}
        """Types by topic; normally one each."""

    def list_messages(self, topic: str) -> list[BagMessage]:
        """Return the places of all messages of a topic, in the order of writing.

        Raises UnusableFrames: the bag is damaged, has no such message, or another type of that name.
        """
        found: list[BagMessage] = []
        with self._opened() as reader:
            for connection, written, raw in reader.messages(_of(reader, topic)):
                nth = found[-1].nth + 1 if found and found[-1].written == written else 0
                found.append(BagMessage(topic, written, nth, _taken(reader, connection, raw)))
        if not found:
            raise UnusableFrames(self.path, f"holds no message of {topic}{self._without_index()}")
        return found

    def read(self, *wanted: BagMessage) -> list[Any]:
        """Return these messages. Raises UnusableFrames: the bag is damaged."""
        with self._opened() as reader:
            return [self._one(reader, place) for place in wanted]

    def read_all(self, topic: str) -> list[Any]:
        """Return all messages of a topic. Raises UnusableFrames: the bag is damaged."""
        with self._opened() as reader:
            found = reader.messages(_of(reader, topic))
            return [
                reader.deserialize(raw, connection.msgtype) for connection, _written, raw in found
            ]

    def _one(self, reader: Any, place: BagMessage) -> Any:
        found = reader.messages(_of(reader, place.topic), place.written, place.written + 1)
        for number, (connection, _written, raw) in enumerate(found):
            if number == place.nth:
                return reader.deserialize(raw, connection.msgtype)
        raise KeyError(
            f"the message of {place.topic} at {place.written} ns is missing; the bag has changed"
        )

    def _without_index(self) -> str:
        for path in [self.path] if self.path.is_file() else sorted(self.path.glob("*.mcap")):
            if path.suffix.lower() == ".mcap" and _lacks_index(path):
                return f": {path.name} has no message index; `mcap recover` writes one"
        return ""

    @contextmanager
    def _opened(self, wrong: str = "is damaged") -> Iterator[Any]:
        try:
            with AnyReader([self.path], default_typestore=_types()) as reader:
                yield reader
        except (KeyboardInterrupt, SystemExit, UnusableFrames):
            raise
        except BaseException as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            index = "; `ros2 bag reindex` writes metadata.yaml anew" if self.path.is_dir() else ""
            raise UnusableFrames(self.path, f"{wrong}: {reason:.200}{index}") from error


def why(error: Exception) -> str:
    """Return the reason why a message cannot be used: that of an `UnusablePicture`, or one of `NOT_ROS`."""
    if isinstance(error, UnusablePicture):
        return str(error)
    return f"its type differs from the ROS type of that name ({error})"


def _check_kind(path: Path) -> None:
    if path.is_file():
        _check_file(path)
        if path.suffix != path.suffix.lower():
            raise UnusableFrames(
                path, f"ends with {path.suffix}: rename it to end with {path.suffix.lower()}"
            )
        return
    parts = sorted(part for part in path.iterdir() if part.suffix.lower() in FILES)
    if parts and not (path / "metadata.yaml").is_file():
        remedy = f"`ros2 bag reindex` writes it; or name one of its files, such as {parts[0].name}"
        raise UnusableFrames(
            path, f"is a bag without metadata.yaml, of a recorder that was cut off: {remedy}"
        )
    for part in parts:
        _check_file(part)


def _check_file(path: Path) -> None:
    """Refuse a file that is no bag, or not a whole one, before the reader gives its own words for that."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(64)
        stream.seek(max(size - len(MCAP), 0))
        tail = stream.read()
    if is_lfs_pointer(head):
        raise UnusableFrames(path, "is a pointer of Git LFS; `git lfs pull` fetches the bag")
    if not size:
        raise UnusableFrames(path, "is empty")
    begins = BEGINNINGS.get(path.suffix.lower(), b"")
    if not head.startswith(begins):
        raise UnusableFrames(path, f"is no bag: its beginning is not that of {path.suffix.lower()}")
    if begins == MCAP and (tail != MCAP or size < 2 * len(MCAP)):
        raise UnusableFrames(path, "is cut off: `mcap recover` saves the messages that it holds")


@cache
def _types() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)


def _of(reader: Any, topic: str) -> list[Any]:
    return [connection for connection in reader.connections if connection.topic == topic]


def _taken(reader: Any, connection: Any, raw: Any) -> int:
    try:
        stamp = reader.deserialize(raw, connection.msgtype).header.stamp
        return int(stamp.sec) * 10**9 + int(stamp.nanosec)
    except NOT_ROS:
        return 0  # the first frame names it


def _lacks_index(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            summary = make_reader(stream).get_summary()
    except Exception:  # of a damaged file the reader may raise any exception
        return False
    chunks: Sequence[Any] = summary.chunk_indexes if summary is not None else ()
    return any(not chunk.message_index_offsets for chunk in chunks)
