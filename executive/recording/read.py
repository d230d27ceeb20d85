"""A record back to the events of its run."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.exceptions import InvalidMagic, McapError
from mcap.reader import NonSeekingReader

from executive.errors import UsageError
from executive.events import Event, Published
from executive.recording.decode import ForeignRecordError, event_from
from executive.recording.recorder import EVENTS_FILE
from executive.views import ImageView


def find_record(name: str, root: Path) -> Path:
    """The folder of a record: a path, a name below `root`, or `last`.

    Raises:
        UsageError: there is none.
    """
    if name == "last":
        records = sorted(root.glob(f"*/{EVENTS_FILE}"))
        if not records:
            raise UsageError(f"no records in {root}")
        return records[-1].parent
    for folder in (Path(name), root / name):
        if (folder / EVENTS_FILE).is_file():
            return folder
    raise UsageError(f"no record '{name}': neither a folder with {EVENTS_FILE} nor a name in {root}")


def read_events(folder: Path) -> Iterator[Event]:
    """The events in the order in which they happened, with their images.

    A record that was cut off gives the events up to there.

    Raises:
        UsageError: the file is not a record.
    """
    path = folder / EVENTS_FILE
    image: np.ndarray[Any, Any] | None = None
    with path.open("rb") as stream:
        try:
            messages = NonSeekingReader(stream).iter_messages(log_time_order=False)
            for _schema, channel, message in messages:
                content = json.loads(message.data)
                if channel.topic.startswith("/images/"):
                    image = _decode_image(content["data"])
                    continue
                event = event_from(content)
                if isinstance(event, Published) and isinstance(event.value, ImageView) and image is not None:
                    event = replace(event, value=replace(event.value, image=image))
                    image = None
                yield event
        except (ForeignRecordError, InvalidMagic, ValueError, KeyError) as error:
            raise UsageError(f"{path}: not a record of a run: {error}") from error
        except (McapError, EOFError):
            return


def _decode_image(text: str) -> np.ndarray[Any, Any]:
    coded = np.frombuffer(base64.b64decode(text), np.uint8)
    image = cv2.imdecode(coded, cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("an image cannot be decoded")
    rgb: np.ndarray[Any, Any] = image[..., ::-1]
    return rgb
