"""HTTP connections that cannot be used up: whoever says nothing, or too slowly, makes room for whoever comes."""

from __future__ import annotations

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 250
"""Connections that are no live stream. One more, and the one that has been idle longest is closed."""

REQUEST_DEADLINE = 5.0
"""Seconds in which a request must have come, head and body."""


class PatientHttp(H11Protocol):
    """uvicorn's protocol, with deadlines and with an end to what idle connections take."""

    _since = 0.0
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """As uvicorn's; makes room."""
        super().connection_made(transport)
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

    def connection_lost(self, exc: Exception | None) -> None:
        """As uvicorn's."""
        self._expect_nothing()
        super().connection_lost(exc)

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

    def _close_unless_complete(self) -> None:
        state: Any = self.conn.their_state
        if state in (h11.IDLE, h11.SEND_BODY):
            self.transport.abort()
