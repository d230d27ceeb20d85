"""A node of ROS 2 over Zenoh, as `rmw_zenoh` speaks it: topics, services, and the tokens by which others see them.

Without a router we are one: nodes with `RMW_IMPLEMENTATION=rmw_zenoh_cpp` find us at its usual address. The extra
`ros2` brings eclipse-zenoh. Names, attachments and tokens follow rmw_zenoh's design (docs/design.md of ros2/rmw_zenoh).
"""

from __future__ import annotations

import contextlib
import json
import logging
import secrets
import struct
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.values.installation import need
from pomona.tools.ros2.types import EXTRA, coder, typestore

logger = logging.getLogger(__name__)

ADDRESS = "127.0.0.1:7447"  # where rmw_zenoh looks for a router
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
DISTRIBUTIONS = ("humble", "jazzy", "kilted", "lyrical")
"""Versions of ROS 2. The types that Pomona uses have the same hashes from Jazzy on; Humble has no hashes."""
# in the keys of Humble's rmw_zenoh, in the place of a type's hash
UNHASHED = "TypeHashNotSupported"
QOS = "::,10:,:,:,,"  # as rmw_zenoh writes it: reliable, volatile, the last ten
# batches that wait for a link, and microseconds before a message is dropped
QUEUE = 16
PATIENCE = 50_000
_HEAD = struct.Struct("<qqB")

Reply = Callable[[Mapping[str, Any]], None]
Handler = Callable[
    [Any, Reply], None
]  # receives a request and the function that answers it with fields, now or later
WAITING = 16  # requests to a service that wait to be handled; more are refused at once


class Ros2Peer:
    """A node; all methods may be called from any thread. Handlers are called in Zenoh's threads."""

    def __init__(
        self,
        address: str = ADDRESS,
        node: str = "pomona",
        domain: int = 0,
        insist: bool = False,
        distribution: str = "jazzy",
    ) -> None:
        """
        Args:
            address: HOST:PORT; listened at as a router, or connected to if a router listens there.
            node: its name; domain: ROS_DOMAIN_ID.
            insist: a listening router must answer now; otherwise the connection is retried, as devices with deadlines
                of their own need it.
            distribution: one of `DISTRIBUTIONS`: of the other nodes. With humble, messages of any version arrive.

        Raises:
            UsageError: the extra is not installed, or the address cannot be used.
        """
        self._zenoh = need("zenoh", EXTRA, "ROS 2")
        typestore()
        host, colon, port = address.rpartition(":")
        if not colon or not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise UsageError(f"'{address}' is no address: HOST:PORT, for instance {ADDRESS}")
        self.local = host in LOOPBACK  # whether only this machine can reach it
        self._domain = domain
        self._node = node
        self._insist = insist
        self._hashed = distribution != "humble"
        self._session = self._open(
            f"tcp/{address}", "tcp/127.0.0.1:0" if self.local else "tcp/0.0.0.0:0"
        )
        self._gid = secrets.token_bytes(16)
        self._lock = threading.Lock()
        self._workers: list[ThreadPoolExecutor] = []
        self._publishers: dict[str, Any] = {}
        self._counts: dict[str, int] = {}
        self._held: list[Any] = []
        self._entities = 0
        self._token("NN", "")

    def _open(self, endpoint: str, own: str) -> Any:
        try:
            return self._zenoh.open(self._config("router", [endpoint], []))
        except Exception as taken:
            try:
                return self._zenoh.open(self._config("peer", [own], [endpoint]))
            except Exception as error:
                raise UsageError(
                    f"no ROS 2 at {endpoint[4:]}: {_words(error)} ({_words(taken)})"
                ) from error

    def _config(self, mode: str, listen: list[str], connect: list[str]) -> Any:
        config = self._zenoh.Config()
        for key, value in (
            ("mode", mode),
            ("listen/endpoints", listen),
            ("connect/endpoints", connect),
            ("connect/timeout_ms", 2000),
            ("connect/exit_on_failure", self._insist),
            ("scouting/multicast/enabled", False),  # nothing leaves by itself
            ("transport/link/tx/queue/size/data", QUEUE),
            ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", PATIENCE),
        ):
            config.insert_json5(key, json.dumps(value))
        return config

    def publish(self, topic: str, kind: str, coded: Any, stamp: int) -> None:
        """Send a message without waiting; messages for a slow subscriber are dropped.

        Args:
            topic, kind: `/joint_states`, `sensor_msgs/msg/JointState`.
            coded: its CDR.
            stamp: nanoseconds since 1970.
        """
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._session.declare_publisher(
                self._key(topic, kind),
                congestion_control=self._zenoh.CongestionControl.DROP,
                express=True,
            )
            self._publishers[topic] = publisher
            self._token("MP", topic, kind)
        number = self._counts[topic] = self._counts.get(topic, 0) + 1
        publisher.put(bytes(coded), attachment=self._attachment(number, stamp))

    def subscribe(self, topic: str, kind: str, take: Callable[[bytes], None]) -> Any:
        """Call `take` with the CDR of every message; `undeclare()` on the result ends it."""
        self._token("MS", topic, kind)
        subscriber = self._session.declare_subscriber(
            self._key(topic, kind, any_version=True), lambda sample: take(sample.payload.to_bytes())
        )
        self._held.append(subscriber)
        return subscriber

    def serve(self, name: str, kind: str, handle: Handler) -> None:
        """Offer a service; a request that cannot be read, or comes in a flood, gets no answer but an error.

        Args:
            name, kind: `/pomona/pause`, `pomona_msgs/srv/Act`.
            handle: of requests, one after the other in a thread of this service: a flood of others delays none of it.
        """
        request = f"{kind}_Request"
        response = coder(f"{kind}_Response")
        worker = ThreadPoolExecutor(1, thread_name_prefix=f"pomona-ros2-{name.rpartition('/')[2]}")
        room = threading.BoundedSemaphore(WAITING)
        self._workers.append(worker)

        def refuse(query: Any, why: str) -> None:
            with contextlib.suppress(Exception):  # who asked is gone
                query.reply_err(why.encode())
                query.drop()

        def answer(query: Any) -> None:
            try:
                asked = typestore().deserialize_cdr(query.payload.to_bytes(), request)
                number, _stamp, _size = _HEAD.unpack_from(query.attachment.to_bytes())
                gid = query.attachment.to_bytes()[_HEAD.size :]
            except Exception as error:  # any malformed request
                refuse(query, f"the request cannot be read: {_words(error)}")
                return
            if not room.acquire(blocking=False):
                refuse(query, f"{WAITING} requests wait already")
                return

            def reply(fields: Mapping[str, Any]) -> None:
                with contextlib.suppress(Exception):  # who asked is gone
                    attachment = self._attachment(number, time.time_ns(), gid)
                    query.reply(
                        query.key_expr, bytes(response.coded(fields)), attachment=attachment
                    )
                    query.drop()

            def work() -> None:
                try:
                    handle(asked, reply)
                except Exception as error:
                    logger.warning("%s could not be answered: %s", name, error)
                    refuse(query, _words(error))
                finally:
                    room.release()

            with contextlib.suppress(RuntimeError):  # it was closed meanwhile
                worker.submit(work)

        self._held.append(
            self._session.declare_queryable(self._key(name, kind), answer, complete=True)
        )
        self._token("SS", name, kind)

    def call(self, name: str, kind: str, fields: Mapping[str, Any], timeout: float = 5.0) -> Any:
        """Call a service. Raises TimeoutError: no answer came."""
        asked = bytes(coder(f"{kind}_Request").coded(fields))
        replies = self._session.get(
            self._key(name, kind),
            payload=asked,
            attachment=self._attachment(1, time.time_ns()),
            timeout=timeout,
        )
        for reply in replies:
            if reply.ok is not None:
                return typestore().deserialize_cdr(reply.ok.payload.to_bytes(), f"{kind}_Response")
        raise TimeoutError(f"{name} has not answered")

    def close(self) -> None:
        """Leave. Harmless when it was left already."""
        for worker in self._workers:
            worker.shutdown(wait=False, cancel_futures=True)
        with contextlib.suppress(Exception):
            self._session.close()

    def _key(self, name: str, kind: str, any_version: bool = False) -> str:
        version = "*" if any_version and not self._hashed else self._version(kind)
        return f"{self._domain}/{name.strip('/')}/{_dds(kind)}/{version}"

    def _version(self, kind: str) -> str:
        return type_hash(kind) if self._hashed else UNHASHED

    def _token(self, entity: str, name: str, kind: str = "") -> None:
        """Return the liveliness token of a node, a publisher, a subscription or a service."""
        with self._lock:
            number = self._entities
            self._entities += 1
        token = (
            f"@ros2_lv/{self._domain}/{self._session.zid()}/0/{number}/{entity}/%/%/{self._node}"
        )
        if kind:
            token += f"/{name.replace('/', '%')}/{_dds(kind)}/{self._version(kind)}/{QOS}"
        self._held.append(self._session.liveliness().declare_token(token))

    def _attachment(self, number: int, stamp: int, gid: bytes | None = None) -> bytes:
        gid = self._gid if gid is None else gid
        return _HEAD.pack(number, stamp, len(gid)) + gid


def type_hash(kind: str) -> str:
    """Return the hash by which both sides know that they mean the same type (REP 2011)."""
    found: str = typestore().hash_rihs01(kind)
    return found


def _dds(kind: str) -> str:
    package, group, name = kind.split("/")
    return f"{package}::{group}::dds_::{name}_"


def _words(error: BaseException) -> str:
    return str(error).split(" at /")[0] or type(error).__name__
