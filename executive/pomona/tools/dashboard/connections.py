"""Limits of connections: silent or slow clients are closed in favour of new ones."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Iterable, Mapping
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame, Opcode
from websockets.protocol import State

MOST_CONNECTIONS = 250  # connections without a live stream; of more, the longest idle one is closed
REQUEST_DEADLINE = 5.0  # seconds in which a request must have come, head and body
# seconds in which a client must take a piece of an answer: on 9 kB/s it does
TAKING_DEADLINE = 30.0


class PatientHttp(H11Protocol):
    """uvicorn's protocol, with deadlines and with closing of idle connections."""

    _since = 0.0
    _deadline: asyncio.TimerHandle | None = None
    _taking: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """As uvicorn's; makes room."""
        super().connection_made(transport)
        self.line = transport.get_extra_info("socket")
        self._expect_request()
        others = [c for c in self.connections if isinstance(c, PatientHttp) and c is not self]
        if len(others) >= MOST_CONNECTIONS:
            min(others, key=lambda other: (other._answers, other._since)).transport.abort()

    def on_response_complete(self) -> None:
        """As uvicorn's; the next request has its own deadline."""
        super().on_response_complete()
        self._expect_request()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """As uvicorn's; a live stream may be silent."""
        self._expect_nothing()
        super().handle_websocket_upgrade(event)

    def pause_writing(self) -> None:
        """As uvicorn's; a client that takes nothing of its answer is closed."""
        super().pause_writing()
        self._taking = self.loop.call_later(TAKING_DEADLINE, self.transport.abort)

    def resume_writing(self) -> None:
        """As uvicorn's; the next piece has its own deadline."""
        self._taken()
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """As uvicorn's."""
        self._expect_nothing()
        self._taken()
        super().connection_lost(exc)

    def shutdown(self) -> None:
        """As uvicorn's, in each state: uvicorn raises where the request in progress was malformed."""
        if self._answers:
            self.cycle.keep_alive = False
        else:
            self.transport.close()

    @property
    def _answers(self) -> bool:
        """Whether a request is being answered: such a connection is the last that has to go."""
        return self.cycle is not None and not self.cycle.response_complete

    def _expect_request(self) -> None:
        self._expect_nothing()
        self._since = self.loop.time()
        self._deadline = self.loop.call_later(REQUEST_DEADLINE, self._close_unless_complete)

    def _expect_nothing(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _taken(self) -> None:
        if self._taking is not None:
            self._taking.cancel()
            self._taking = None

    def _close_unless_complete(self) -> None:
        state: Any = self.conn.their_state
        if state in (h11.IDLE, h11.SEND_BODY):
            self.transport.abort()


class LiveWire(WebSocketsSansIOProtocol):
    """uvicorn's protocol, which also takes frames that are made already.

    A message to two hundred viewers is encoded as a frame once. With the application's own method, a task and a frame
    for each, a batch took the loop 60 ms and delayed a press by as much.
    """

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """As uvicorn's; the application finds this in its scope's state."""
        super().connection_made(transport)
        self.line = transport.get_extra_info("socket")
        self.app_state = {**self.app_state, WIRE: self}

    def shutdown(self) -> None:
        """As uvicorn's, in each state: uvicorn raises where the peer has just closed the stream."""
        if self.handshake_complete and self.conn.state is not State.OPEN:
            self.stop_keepalive()
            self.transport.close()
        else:
            super().shutdown()

    def take(self, frame: bytes) -> bool:
        """Send a frame at once; False when it would have to wait, or the stream is not open."""
        if (
            not self.handshake_complete
            or self.close_sent
            or self.disconnected
            or not self.writable.is_set()
        ):
            return False
        if self.conn.state is not State.OPEN or self.transport.is_closing():
            return False
        self.transport.write(frame)
        return True


def hang_up(connections: Iterable[Any]) -> None:
    """End connections at once, without waiting for their peers.

    The socket, too: a TLS transport that was closed twice has forgotten its protocol, and aborting it does nothing.
    """
    for connection in list(connections):
        connection.transport.abort()
        with contextlib.suppress(OSError):  # it is closed already
            connection.line.shutdown(socket.SHUT_RDWR)


WIRE = "wire"


def wire_of(state: Mapping[str, Any]) -> LiveWire | None:
    """Return the wire that takes frames for a stream, or None under another server."""
    found = state.get(WIRE)
    return found if isinstance(found, LiveWire) else None


def frame_of(text: str) -> bytes:
    """Return a message as the bytes of one frame of a server, which every viewer gets alike."""
    return Frame(Opcode.TEXT, text.encode(errors="replace")).serialize(mask=False)
