"""Access to the dashboard: reading and acting.

A page on another site can make a browser send requests here (DNS rebinding, cross-site requests). So: the Host header
must name this server, an Origin and a Sec-Fetch-Site that a browser sends must be those of our own page, and a request
that acts carries the token of this start.
"""

from __future__ import annotations

import contextlib
import secrets
import socket
from dataclasses import dataclass, field
from functools import cache
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
    """The rules of one start of the server."""

    host: str  # host, port: what it is bound to
    port: int
    may_act: bool = True  # False when it is bound to another address without TLS and without the explicit insecure flag
    certificate: Path | None = None  # certificate, key: files for TLS, or None
    key: Path | None = None
    names: tuple[
        str, ...
    ] = ()  # further names under which this machine is reached, for `--host 0.0.0.0`
    token: str = field(
        default_factory=lambda: secrets.token_urlsafe(24)
    )  # required for requests that act
    # on another address than this machine's, it or the token must accompany everything that reads. It stands in
    # addresses that a page opens by itself (downloads, the stream), and acts on nothing.
    reading: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    @property
    def local(self) -> bool:
        """Whether only this machine can reach it."""
        return self.host in ("127.0.0.1", "localhost", "::1")

    @property
    def address(self) -> str:
        """The page's address, without the token."""
        host = own_names()[0] if self.wild else self.host
        name = self.names[0] if self.names else f"[{host}]" if ":" in host else host
        return f"{'https' if self.certificate is not None else 'http'}://{name}:{self.port}/"

    @property
    def link(self) -> str:
        """The page's address, with the tokens that let it act and read."""
        return f"{self.address}#token={self.token}&read={self.reading}"

    @property
    def hosts(self) -> frozenset[str]:
        """Names in Host headers that mean us. The port is left out: a tunnel or a proxy may have another one."""
        own = {self.host, f"[{self.host}]"} if not self.local else set()
        return frozenset(
            name.lower()
            for name in (*LOOPBACK, *self.names, *own, *(own_names() if self.wild else ()))
        )

    @property
    def wild(self) -> bool:
        """Whether it is bound to all addresses of this machine."""
        return self.host in ("0.0.0.0", "::", "")

    def knows_host(self, headers: Headers) -> bool:
        """Return True if the request names a host that this server is known by."""
        return _without_port(headers.get("host", "")) in self.hosts

    def knows_origin(self, headers: Headers) -> bool:
        """Return True if a request comes from our own page; no Origin at all is a plain read or a program, not a page.

        Our page stands where the request goes to, port and all: another server on this machine is not ours. Only a
        name that was given (`--served-as`) may differ, as it does behind a proxy that writes a Host of its own.
        """
        origin = headers.get("origin")
        if origin is None:
            return True
        try:
            origin_host = urlsplit(origin).netloc.lower()
        except ValueError:  # a bracket that is not closed
            return False
        return (
            origin_host == headers.get("host", "").lower()
            or _without_port(origin_host) in self._given
        )

    @staticmethod
    def knows_site(scope: Scope, headers: Headers) -> bool:
        """Return True unless a browser reports that a page of another site reads a run: an image there has no Origin.

        The page itself may be opened by a link from anywhere: it holds nothing of a run. A stream has its Origin.
        """
        site = headers.get("sec-fetch-site", "none")
        return (
            site in ("same-origin", "none")
            or scope["type"] != "http"
            or not scope["path"].startswith("/api")
        )

    @property
    def _given(self) -> frozenset[str]:
        return frozenset(name.lower() for name in self.names)

    def knows_reader(self, query: str) -> bool:
        """Return True if an address carries the reading token: such a viewer is known."""
        return _same(query, self.reading)

    def acts_with(self, token: str) -> bool:
        """Return True if this token permits actions."""
        return self.may_act and self._is_token(token)

    def may_read(self, scope: Scope, headers: Headers) -> bool:
        """Return True if a request may see runs. An address may carry the reading token, and never the acting one."""
        if self.local or not scope["path"].startswith(("/api", "/live")):
            return True
        query = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        return self._is_token(headers.get("x-pomona-token", "")) or _same(query, self.reading)

    def authorised(self, headers: Headers) -> bool:
        """Return True if a request may act. A token in an address does not count: addresses are kept and shown."""
        return self.acts_with(headers.get("x-pomona-token", ""))

    def _is_token(self, given: str) -> bool:
        return _same(given, self.token)


@cache
def own_names() -> tuple[str, ...]:
    """How others reach this machine: the address of its way out, if it has one, and its name."""
    names = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out, contextlib.suppress(OSError):
        out.connect(
            ("192.0.2.1", 9)
        )  # an address for documentation: nothing is sent, the system only chooses a way
        names.append(str(out.getsockname()[0]))
    return (*names, socket.gethostname().lower())


def _without_port(host: str) -> str:
    name, colon, port = host.lower().rpartition(":")
    return name if colon and port.isdigit() else host.lower()


def _same(given: str, expected: str) -> bool:
    return secrets.compare_digest(given.encode(errors="replace"), expected.encode())


class RequestGuard:
    """Middleware: refuses foreign hosts and origins, and adds the protective headers to every answer."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                present = list(message.get("headers", []))
                names = {name.lower() for name, _value in present}
                message["headers"] = present + [
                    (n, v) for n, v in HEADERS.items() if n not in names
                ]
            await send(message)

        headers = Headers(scope=scope)
        refusal = ""
        is_public = scope["path"].startswith(
            "/static/"
        )  # the page's own files hold nothing of a run
        if not self._access.knows_host(headers) or not (
            is_public or self._access.knows_origin(headers)
        ):
            refusal = "this host or origin is not served: --served-as NAME adds the name by which browsers reach it"
        elif not self._access.knows_site(scope, headers):
            refusal = (
                "a page of another site asked: only this server's own page and programs are served"
            )
        elif not self._access.may_read(scope, headers):
            refusal = "open the link that was printed: it carries the token"
        if not refusal:
            await self._app(scope, receive, send_with_headers)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 4403})
        else:
            await JSONResponse({"error": refusal}, 403)(scope, receive, send_with_headers)
