"""Who may talk to the dashboard, and who may act.

A page on another site can make a browser send requests here (DNS rebinding, cross-site requests). So: the Host header
must name us, the Origin of anything that is not a plain read must be ours, and whatever acts carries the token of this
start.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

LOOPBACK = frozenset({"127.0.0.1", "localhost", "[::1]"})

HEADERS = {
    b"content-security-policy": b"default-src 'self'; img-src 'self' data:; style-src 'self'; script-src 'self'; "
    b"connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    b"x-content-type-options": b"nosniff",
    b"x-frame-options": b"DENY",
    b"referrer-policy": b"no-referrer",
    b"cache-control": b"no-store",
}


@dataclass(frozen=True, slots=True)
class Access:
    """The rules of one start of the server.

    Attributes:
        host, port: what it is bound to.
        token: must accompany everything that acts.
        may_act: False when it is bound to another address without TLS and without the explicit insecure flag.
    """

    host: str
    port: int
    may_act: bool = True
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    @property
    def hosts(self) -> frozenset[str]:
        """Host headers that name us."""
        names = LOOPBACK if self.host in ("127.0.0.1", "localhost", "::1") else LOOPBACK | {self.host}
        return frozenset(f"{name}:{self.port}" for name in names)

    def knows_host(self, headers: Headers) -> bool:
        return headers.get("host", "") in self.hosts

    def knows_origin(self, headers: Headers) -> bool:
        """Whether a request comes from our own page; no Origin at all is a plain read or a program, not a page."""
        origin = headers.get("origin")
        return origin is None or urlsplit(origin).netloc in self.hosts

    def authorised(self, headers: Headers) -> bool:
        """Whether a request may act."""
        given = headers.get("x-pomona-token", "")
        return self.may_act and secrets.compare_digest(given.encode(), self.token.encode())


class Guard:
    """Middleware: refuses foreign hosts and origins, and adds the protective headers to every answer."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if not self._access.knows_host(headers) or not self._access.knows_origin(headers):
            if scope["type"] == "websocket":
                await receive()
                await send({"type": "websocket.close", "code": 4403})
                return
            await PlainTextResponse("this host or origin is not served", 403)(scope, receive, send)
            return

        async def send_with_headers(message: dict[str, object]) -> None:
            if message["type"] == "http.response.start":
                present = list(message.get("headers", []))  # type: ignore[call-overload]
                names = {name.lower() for name, _value in present}
                message["headers"] = present + [(n, v) for n, v in HEADERS.items() if n not in names]
            await send(message)

        await self._app(scope, receive, send_with_headers)  # type: ignore[arg-type]
