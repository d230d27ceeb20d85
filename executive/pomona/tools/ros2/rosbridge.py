"""A client of rosbridge (JSON over a WebSocket): for ROS 1, and for laboratories whose ROS 2 speaks DDS.

It has the methods of `pomona.tools.ros2.peer.Ros2Peer` that devices use, and gives them the same bytes (CDR). So the
drivers need no second form. The library `websockets` is a dependency already; `roslibpy` would bring Twisted, whose
reactor runs once in a process, and reports no error after its server has died.
"""

from __future__ import annotations

import base64
import contextlib
import json
import logging
import re
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

from pomona.executive.cell.owner import Address
from pomona.executive.errors import UsageError
from pomona.executive.values.kinds import Text
from pomona.tools.ros2.peer import Ros2Peer
from pomona.tools.ros2.types import coder, typestore

logger = logging.getLogger(__name__)

SCHEMES = ("ws://", "wss://")
_HOST = rf"({Address.HOST}|\[[0-9a-fA-F:.]+\])"
_PORT = r":(6553[0-5]|655[0-2]\d|65[0-4]\d\d|6[0-4]\d{3}|[1-5]\d{4}|[1-9]\d{0,3})"


class _Way(Text):
    """A text in which a host in brackets is an IPv6 address."""

    def parse(self, text: str) -> str:
        if six := re.match(r"(?:wss?://)?(\[[^]]*\])", super().parse(text)):
            Address(1).parse(six[1])
        return text


WAY = _Way(
    pattern=rf"(wss?://{_HOST}({_PORT})?(/\S*)?|{_HOST}{_PORT})",
    words="HOST:PORT of rmw_zenoh's router, or ws://HOST:9090 of rosbridge",
)
"""Kind of a value in a cell file that names the way to the nodes of ROS."""
QUEUE = 16  # messages that wait to be sent; of more, the oldest are dropped
LARGEST = 32 * 2**20  # longest message that is read [bytes]: an image of 4 megapixels in base64
# of a connection, and the pause before the next try [s]
DEADLINE = 2.0
RETRY = 0.5
ROS_1 = {"sec": "secs", "nanosec": "nsecs"}


class RosbridgePeer:
    """A client; all methods may be called from any thread. Messages are taken in a thread of its own.

    A lost connection is opened again. Messages that wait then are dropped: an old set-point is never sent later.
    """

    def __init__(self, address: str) -> None:
        """Connect. `address`: ws://HOST:PORT. Raises UsageError: no rosbridge answers there, or an extra is missing."""
        typestore()
        self._address = address
        self._takes: dict[str, tuple[str, Callable[[bytes], None]]] = {}
        self._kinds: dict[str, str] = {}  # of published topics
        self._ros_1 = False  # the stamps of its messages have the names of ROS 1
        self._over, self._waiting = threading.Event(), threading.Condition()
        self._queue: deque[str] = deque(maxlen=QUEUE)
        try:
            self._socket: ClientConnection | None = self._connected()
        except (OSError, ValueError, WebSocketException) as error:  # a port beyond 65535 is a value
            raise UsageError(
                f"no rosbridge at {address}: {error or type(error).__name__}"
            ) from error
        self._threads = [
            threading.Thread(target=run, daemon=True) for run in (self._listen, self._speak)
        ]
        for thread in self._threads:
            thread.start()

    def subscribe(self, topic: str, kind: str, take: Callable[[bytes], None]) -> None:
        """Call `take` with the CDR of every message."""
        self._takes[topic] = kind, take
        self._send({"op": "subscribe", "topic": topic, "type": _old(kind), "queue_length": 1})

    def publish(self, topic: str, kind: str, coded: Any, stamp: int) -> None:
        """Send a message without waiting; it is dropped while there is no connection."""
        if topic not in self._kinds:
            self._kinds[topic] = kind
            self._send({"op": "advertise", "topic": topic, "type": _old(kind)})
        message = _shown(typestore().deserialize_cdr(bytes(coded), kind), self._ros_1)
        self._send({"op": "publish", "topic": topic, "msg": message})

    def send_goal(self, action: str, kind: str, goal: Mapping[str, Any], stamp: int) -> None:
        """Send a goal of an action, which ends an earlier one; it is dropped while there is no connection.

        Args:
            kind: of the action, "control_msgs/action/GripperCommand"; goal: its fields. stamp: nanoseconds since 1970.
        """
        if not self._ros_1:
            request = {
                "op": "send_action_goal",
                "action": action,
                "action_type": kind,
                "args": goal,
                "feedback": False,
            }
            self._send({**request, "id": f"{action}_{stamp}"})
            return
        topic = f"{action}/goal"
        of = kind.replace("/action/", "/") + "ActionGoal"
        if topic not in self._kinds:
            self._kinds[topic] = of
            self._send({"op": "advertise", "topic": topic, "type": of})
        times = dict(zip(("secs", "nsecs"), divmod(stamp, 10**9), strict=True))
        head = {"header": {"stamp": times}, "goal_id": {"stamp": times, "id": f"pomona_{stamp}"}}
        self._send({"op": "publish", "topic": topic, "msg": {**head, "goal": goal}})

    def close(self) -> None:
        """Leave. Harmless when it was left already."""
        self._over.set()
        socket = self._socket
        if socket is not None:
            socket.close()
        with self._waiting:
            self._waiting.notify_all()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(DEADLINE)

    def _connected(self) -> ClientConnection:
        limits: dict[str, Any] = {
            "open_timeout": DEADLINE,
            "close_timeout": 0.2,
            "max_size": LARGEST,
        }
        opening = connect(self._address, ping_interval=None, compression=None, proxy=None, **limits)
        connection: ClientConnection = (
            opening.__enter__()
        )  # versions from 17.1 on connect here; `close` ends it
        return connection

    def _send(self, message: Mapping[str, Any]) -> None:
        with self._waiting:
            if self._socket is not None:
                self._queue.append(json.dumps(message))
                self._waiting.notify_all()

    def _speak(self) -> None:
        while not self._over.is_set():
            with self._waiting:
                self._waiting.wait_for(lambda: bool(self._queue) or self._over.is_set())
                text = self._queue.popleft() if self._queue else None
                socket = self._socket
            if text is not None and socket is not None:
                with contextlib.suppress(
                    OSError, WebSocketException
                ):  # `_listen` sees the end, too
                    socket.send(text)

    def _listen(self) -> None:
        while not self._over.is_set():
            socket = self._socket
            try:
                if socket is None:
                    self._begin_again()
                else:
                    self._take(socket.recv())
            except (OSError, WebSocketException) as error:
                if not self._over.is_set() and socket is not None:
                    logger.warning("rosbridge at %s is lost: %s", self._address, error)
                with self._waiting:
                    self._socket = None
                    self._queue.clear()
                self._over.wait(RETRY)

    def _begin_again(self) -> None:
        socket = self._connected()
        with self._waiting:
            self._socket = socket
        if self._over.is_set():
            socket.close()
        for topic, kind in tuple(self._kinds.items()):
            self._send({"op": "advertise", "topic": topic, "type": _old(kind)})
        for topic, (kind, _take) in tuple(self._takes.items()):
            self._send({"op": "subscribe", "topic": topic, "type": _old(kind), "queue_length": 1})

    def _take(self, text: str | bytes) -> None:
        """Pass a message on; one that cannot be read is reported, and its topic stays silent."""
        try:
            message = json.loads(text)
            if message.get("op") == "status" and message.get("level") in ("error", "warning"):
                logger.warning("rosbridge at %s: %s", self._address, message.get("msg"))
            if message.get("op") != "publish" or message.get("topic") not in self._takes:
                return
            kind, take = self._takes[message["topic"]]
            stamp = message["msg"].get("header", {}).get("stamp", {})
            self._ros_1 = self._ros_1 or "secs" in stamp
            coded = bytes(coder(kind).coded(_plain(kind, message["msg"])))
        except Exception as error:  # any malformed message
            logger.warning(
                "rosbridge at %s sent a message that cannot be read: %r", self._address, error
            )
            return
        take(coded)


def open_peer(address: str, node: str, distribution: str = "jazzy") -> Ros2Peer | RosbridgePeer:
    """Return the way to the nodes of ROS: rosbridge at ws://HOST:PORT, else rmw_zenoh at HOST:PORT.

    Raises UsageError: the address cannot be used.
    """
    if address.startswith(SCHEMES):
        return RosbridgePeer(address)
    return Ros2Peer(address, node=node, distribution=distribution)


def _old(kind: str) -> str:
    """Return a type's name of two parts, which rosbridge of ROS 1 and of ROS 2 takes."""
    return kind.replace("/msg/", "/")


def _plain(kind: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a message in JSON under the names of ROS 2; those of ROS 1 are `secs`, and `K` for `k`."""
    found = {}
    for name, (node, of) in typestore().fielddefs[kind][1]:
        there = next(
            (other for other in (name, ROS_1.get(name, name), name.upper()) if other in given), None
        )
        if there is not None:
            found[name] = _value(node, of, given[there])
    return found


def _value(node: int, of: Any, value: Any) -> Any:
    if node == 2:  # a message
        return _plain(of, value)
    if node == 1:  # a number that is not finite is null in JSON
        return np.nan if value is None else value
    inner, kind = of[0]
    if isinstance(value, str):  # bytes, in base64
        return base64.b64decode(value, validate=True)
    return [_value(inner, kind, item) for item in value]


def _shown(message: Any, ros_1: bool) -> Any:
    """Return a message as plain values for JSON."""
    if isinstance(message, np.ndarray):
        return message.tolist()
    if isinstance(message, list):
        return [_shown(item, ros_1) for item in message]
    if not is_dataclass(message):
        return message
    times = ROS_1 if ros_1 and type(message).__name__.startswith("builtin_interfaces") else {}
    names = [field.name for field in fields(message) if not field.name.startswith("__")]
    return {times.get(name, name): _shown(getattr(message, name), ros_1) for name in names}
