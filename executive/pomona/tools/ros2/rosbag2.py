"""A record as a bag of ROS 2: a folder with an MCAP file (profile ros2) and metadata.yaml."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import events_file
from pomona.executive.recording.plain_file import made_whole, parse_object
from pomona.executive.recording.scan import require_valid, scan
from pomona.executive.values.installation import need
from pomona.tools.ros2.to_ros2 import NoRosTimeError, RosMessage, ToRos2
from pomona.tools.ros2.types import EXTRA, coder, typestore

VERSION = 9  # of the bag's metadata: ROS 2 Jazzy and later


def export_rosbag2(record: Path, folder: Path) -> Mapping[str, str]:
    """Write a record as a bag.

    Args:
        record: a record's folder or file.
        folder: of the bag; there must be none yet.

    Returns:
        for each topic, its type and how many messages it has.

    Raises UsageError: the extra is not installed, the folder is there already or cannot be written, or the record
    cannot be read.
    """
    rosbag2 = need("rosbags.rosbag2", EXTRA, "a bag of ROS 2")
    path = events_file(record)
    try:
        with made_whole(folder) as place:  # the file in it bears the folder's name
            verdict = require_valid(path)
            writer = rosbag2.Writer(
                place, version=VERSION, storage_plugin=rosbag2.StoragePlugin.MCAP
            )
            writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
            bag = _Bag(writer)
            run = ToRos2()
            last = 0
            with writer:  # closed in any case
                for found in scan(path, verdict):
                    last = found.stamp
                    for message in run.messages(
                        found.topic, parse_object(found.content), found.stamp
                    ):
                        bag.write(message)
                for message in run.rest(last):
                    bag.write(message)
                if not bag.topics:
                    raise UsageError(f"{path}: not a record of a run")
    except NoRosTimeError as error:
        raise UsageError(f"{path}: {error}") from error
    except (
        KeyError,
        TypeError,
        ValueError,
        IndexError,
        AttributeError,
        OverflowError,
        struct.error,
    ) as error:
        raise UsageError(f"{path}: not a record of a run: {error!r}") from error
    return {topic: f"{kind}  {count}" for topic, (kind, count) in sorted(bag.topics.items())}


class _Bag:
    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._connections: dict[str, Any] = {}
        self.topics: dict[str, tuple[str, int]] = {}

    def write(self, message: RosMessage) -> None:
        if message.topic not in self._connections:
            self._connections[message.topic] = self._writer.add_connection(
                message.topic, message.type, typestore=typestore()
            )
        coded = coder(message.type).coded(message.fields)
        self._writer.write(self._connections[message.topic], message.stamp, coded)
        self.topics[message.topic] = (message.type, self.topics.get(message.topic, ("", 0))[1] + 1)
