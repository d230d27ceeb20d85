"""An application of the page served in a thread of its own, with limits on connections and on bodies."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
import sys
import threading
from collections.abc import Awaitable, Callable
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from pomona.executive.errors import PomonaError, UsageError
from pomona.tools.dashboard.connections import LiveWire, PatientHttp, hang_up
from pomona.tools.dashboard.presses import object_of
from pomona.tools.dashboard.security import Access

Answer = Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]
WATCH_ONLY = "this page may watch but not act: open the link that was printed"
BODY_DEADLINE = 5.0
"""Seconds within which the body of an acting request must arrive."""

MAX_CLOSING_TURNS = 8
"""Turns of the event loop in which remaining connections can notice that they are closed."""

CLOSING = 0.05
"""Time in which connections can end by themselves when the server ends [s]."""

SWITCH = 0.0005
"""Python's thread switch interval while the dashboard serves [s]."""


class HttpService:
    """Serves an application, from `start` to `close`."""

    def __init__(self, app: Starlette, access: Access, most: int) -> None:
        """Listen where `access` has it, from `start` on; a message of a stream has `most` bytes."""
        self.server: _Server | None = None
        self._app = app
        self._access = access
        self._most = most
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Serve in a thread of its own. Raises UsageError: it cannot listen there."""
        config = uvicorn.Config(
            self._app, http=PatientHttp, log_level="critical", ws=LiveWire,
            ws_max_size=self._most, ws_per_message_deflate=False, lifespan="on",
            ssl_certfile=self._access.certificate, ssl_keyfile=self._access.key,
        )  # fmt: skip
        try:
            config.load()
        except OSError as error:  # ssl.SSLError, too
            raise UsageError(f"the certificate or its key cannot be used: {error}") from error
        listening = listen_on(self._access.host, self._access.port)
        # A tick that is due while a batch goes out to many viewers waits this long for the interpreter, not 5 ms.
        sys.setswitchinterval(min(sys.getswitchinterval(), SWITCH))
        self.server = server = _Server(config)
        server.install_signal_handlers = lambda: None  # type: ignore[attr-defined]
        started = threading.Event()

        def serve() -> None:
            with contextlib.suppress(SystemExit):
                server.run([listening])
            started.set()

        self._thread = threading.Thread(target=serve, name="pomona-dashboard", daemon=True)
        self._thread.start()
        while not server.started:
            if started.wait(0.02):
                raise UsageError(
                    f"the dashboard cannot be served on {self._access.host}:{self._access.port}"
                )

    def close(self) -> None:
        """Stop serving. Harmless when it was not started."""
        if self.server is not None and self._thread is not None:
            self.server.should_exit = True
            self.server.force_exit = True
            self._thread.join(5.0)


async def authorised_body(request: Request, access: Access, most: int) -> dict[str, Any] | Response:
    """Return the JSON object of a request that acts; or a refusal: no token, longer than `most` bytes, too slow."""
    if not access.authorised(request.headers):
        return JSONResponse({"error": WATCH_ONLY}, 403)
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        return JSONResponse({"error": "send application/json"}, 415)
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_DEADLINE):
            async for chunk in request.stream():
                body += chunk
                if len(body) > most:
                    return JSONResponse({"error": "too long"}, 413)
    except TimeoutError:
        return JSONResponse({"error": "sent too slowly"}, 408)
    return object_of(bytes(body)) or JSONResponse({"error": "send a JSON object"}, 400)


def acting(name: str, access: Access, most: int, answer: Answer) -> Route:
    """Return the route /api/NAME of requests that act: `answer` takes and returns a JSON object.

    A refusal may add `facts` to its answer.
    """

    async def respond(request: Request) -> Response:
        body = await authorised_body(request, access, most)
        if isinstance(body, Response):
            return body
        try:
            return JSONResponse(await answer(body))
        except PomonaError as error:
            return JSONResponse({"error": str(error), **getattr(error, "facts", {})}, 409)
        except (ValueError, KeyError, TypeError) as error:  # a request that no page makes
            return JSONResponse({"error": f"not understood: {error}"}, 400)

    return Route(f"/api/{name}", respond, methods=["POST"])


class _Server(uvicorn.Server):
    """uvicorn's server, leaving no connection open: over TLS each waits for its peer's close, longer than the loop."""

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Shut down as uvicorn does, then abort the connections that are still open."""
        connections = self.server_state.connections
        ending = asyncio.ensure_future(super().shutdown(sockets))
        while not ending.done():  # since Python 3.12 it waits until all connections have ended
            await asyncio.wait({ending}, timeout=CLOSING)
            hang_up(connections)
        await ending
        for _turn in range(MAX_CLOSING_TURNS):
            hang_up(connections)
            await asyncio.sleep(0)


def listen_on(host: str, port: int) -> socket.socket:
    """Return a socket that listens. Raises UsageError: there is no such port or address, or another program has it."""
    where = f"{host}:{port}"
    if not 0 <= port <= 65535:
        raise UsageError(f"--port {port}: a port is a number from 0 to 65535")
    try:
        family, *_rest, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        # The protocol must be named: asyncio switches Nagle's delay (40 ms) off only for sockets with the protocol TCP.
        listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    except OSError as error:
        raise UsageError(
            f"the dashboard cannot listen on {where}: {error.strerror or error}"
        ) from error
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen(2048)
        listening.set_inheritable(False)
    except OSError as error:
        listening.close()
        why = _WHY_NOT.get(error.errno or 0, error.strerror or str(error))
        raise UsageError(f"the dashboard cannot listen on {where}: {why}") from error
    return listening


_WHY_NOT = {
    errno.EADDRINUSE: "the port is taken. Choose another with --port.",
    errno.EADDRNOTAVAIL: "this machine has no such address. --host 0.0.0.0 listens on all that it has.",
    errno.EACCES: "ports below 1024 are the system's. Choose another with --port.",
}
