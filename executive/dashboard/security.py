"""Who may talk to the dashboard, and who may act.

A page on another site can make a browser send requests here (DNS rebinding, cross-site requests). So: the Host header
must name us, the Origin of anything that is not a plain read must be ours, and whatever acts carries the token of this
start.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

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
        may_act: False when it is bound to another address without TLS and without the explicit insecure flag.
        certificate, key: files for TLS, or None.
        names: further names under which this machine is reached, for `--host 0.0.0.0`.
        token: must accompany everything that acts.
        reading: on another address than this machine's, it or the token must accompany everything that reads. It stands
            in addresses that a page opens by itself (downloads, the stream), and acts on nothing.
    """

    host: str
    port: int
    may_act: bool = True
    certificate: Path | None = None
    key: Path | None = None
    names: tuple[str, ...] = ()
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    reading: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    @property
    def local(self) -> bool:
        """Whether only this machine can reach it."""
        return self.host in ("127.0.0.1", "localhost", "::1")

    @property
    def address(self) -> str:
        """The page's address, without the token."""
        name = self.names[0] if self.names else f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.certificate is not None else 'http'}://{name}:{self.port}/"

    @property
    def hosts(self) -> frozenset[str]:
        """Host headers that name us."""
        names = LOOPBACK | {self.host, f"[{self.host}]", *self.names} if not self.local else LOOPBACK
        return frozenset(f"{name}:{self.port}" for name in names)

    def knows_host(self, headers: Headers) -> bool:
        """Whether the request names a host that this server is known by."""
        return headers.get("host", "") in self.hosts

    def knows_origin(self, headers: Headers) -> bool:
        """Whether a request comes from our own page; no Origin at all is a plain read or a program, not a page."""
        origin = headers.get("origin")
        return origin is None or urlsplit(origin).netloc in self.hosts

    def may_read(self, scope: Scope, headers: Headers) -> bool:
        """Whether a request may see runs. An address may carry what reads, and never what acts."""
        if self.local or not scope["path"].startswith(("/api", "/live")):
            return True
        query = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        return self._is_token(headers.get("x-pomona-token", "")) or _same(query, self.reading)

    def authorised(self, headers: Headers) -> bool:
        """Whether a request may act. A token in an address does not count: addresses are kept and shown."""
        return self.may_act and self._is_token(headers.get("x-pomona-token", ""))

    def _is_token(self, given: str) -> bool:
        return _same(given, self.token)


def _same(given: str, expected: str) -> bool:
    return secrets.compare_digest(given.encode(errors="replace"), expected.encode())


class Guard:
    """Middleware: refuses foreign hosts and origins, and adds the protective headers to every answer."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                present = list(message.get("headers", []))
                names = {name.lower() for name, _value in present}
                message["headers"] = present + [(n, v) for n, v in HEADERS.items() if n not in names]
            await send(message)

        headers = Headers(scope=scope)
        refusal = ""
        if not self._access.knows_host(headers) or not self._access.knows_origin(headers):
            refusal = "this host or origin is not served"
        elif not self._access.may_read(scope, headers):
            refusal = "open the link that was printed: it carries the token"
        if not refusal:
            await self._app(scope, receive, send_with_headers)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 4403})
        else:
            await JSONResponse({"error": refusal}, 403)(scope, receive, send_with_headers)
