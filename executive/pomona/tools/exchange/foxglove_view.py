"""A running run in Foxglove, through its SDK (extra `foxglove`).

The view accepts no commands. It listens on the local address only; use a tunnel for other machines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from pomona.executive.encode import encoded
from pomona.executive.errors import UsageError
from pomona.executive.recording.schemas import CAMERA_CALIBRATION, SCENE_UPDATE, Schema
from pomona.executive.recording.well_known import Images
from pomona.executive.values.installation import need
from pomona.executive.views import ImageView

EXTRA = "foxglove"
PORT = 8765
HOST = "127.0.0.1"

KEPT = (
    SCENE_UPDATE.name,
    CAMERA_CALIBRATION.name,
    "foxglove.CompressedImage",
    "foxglove.PointCloud",
)
"""Latched topics: a later subscriber receives the newest message."""


class FoxgloveView:
    """A server for viewers; a sink of `Live`."""

    def __init__(self, port: int = PORT) -> None:
        """Raises UsageError: the extra is not installed, or the port is taken."""
        self._sdk = need("foxglove", EXTRA, "a live view in Foxglove")
        self._context = self._sdk.Context()
        self._channels: dict[str, Any] = {}
        self._kept: dict[int, Callable[[], object]] = {}
        self._images = Images()
        try:
            self._server = self._sdk.start_server(
                name="Pomona",
                host=HOST,
                port=port,
                context=self._context,
                server_listener=_Listener(self._kept),
                message_backlog_size=256,  # messages that wait for a slow viewer; of more, the oldest are dropped
            )
        except Exception as error:
            raise UsageError(f"no live view at {HOST}:{port}: {error}") from error

    @property
    def link(self) -> str:
        """Where viewers find it."""
        return f"ws://{HOST}:{self._server.port}"

    def send(self, topic: str, schema: Schema, content: Mapping[str, Any], stamp: int) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            described = self._sdk.Schema(
                name=schema.name, encoding="jsonschema", data=schema.text.encode()
            )
            channel = self._sdk.Channel(
                topic, schema=described, message_encoding="json", context=self._context
            )
            self._channels[topic] = channel
        log = partial(channel.log, encoded(content), log_time=stamp)
        if schema.name in KEPT:
            self._kept[channel.id()] = log
        log()

    def show(self, topic: str, view: ImageView, stamp: int) -> None:
        for name, schema, content in self._images.messages(topic, view, stamp):
            self.send(name, schema, content, stamp)

    def rest(self) -> None:
        pass

    def close(self) -> None:
        self._server.stop()


class _Listener:
    """Called by the SDK, in its own threads."""

    def __init__(self, kept: Mapping[int, Callable[[], object]]) -> None:
        self._kept = kept

    def on_subscribe(self, client: Any, channel: Any) -> None:
        log = self._kept.get(channel.id)
        if log is not None:
            log()

    def __getattr__(self, name: str) -> Any:
        """Ignore the other callbacks of the SDK."""
        if name.startswith("on_"):
            return lambda *_arguments: None
        raise AttributeError(name)
