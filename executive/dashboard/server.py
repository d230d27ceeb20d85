"""The dashboard's HTTP and WebSocket server."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from executive.dashboard.choices import Choices
from executive.dashboard.control_lock import ControlLock, RefusedError
from executive.dashboard.hub import Hub, Viewer
from executive.dashboard.record_messages import between, image, overview, record_messages
from executive.dashboard.security import Access, Guard
from executive.errors import PomonaError, UsageError
from executive.recording.index import RunIndex, records_in
from executive.recording.plain_file import is_plain
from executive.recording.recorder import EVENTS_FILE

STATIC = Path(__file__).parent / "static"
MOST_VIEWERS = 200
MOST_RUNS = 2000
"""The newest ones are listed."""
MOST_BODY = 16_384
LAST_WORDS = 1.0
"""Seconds in which viewers may still read when the server ends."""

BEAT = 0.5
"""Seconds between two signs of life of a run."""

StartRun = Callable[[dict[str, Any]], str]
"""Starts a run from the page's form and returns its tree's name."""


SWITCH = 0.0005
"""Seconds after which Python's threads take turns while the dashboard serves."""


class Dashboard:
    """Serves the page, the live stream, the records, and what operators do."""

    def __init__(self, access: Access, records: Path) -> None:
        self.access, self.records = access, records
        self.hub = Hub()
        self.control = ControlLock(self._announce)
        self._index = RunIndex(records)
        self._start_run: StartRun | None = None
        self._choices = Choices({}, {})
        self._server: uvicorn.Server | None = None
        self._thread: threading.Thread | None = None
        self.app = Starlette(
            routes=[
                Route("/", self._page),
                Route("/api/choices", self._offer),
                Route("/api/runs", self._runs),
                Route("/api/runs/{name}/messages", self._messages),
                Route("/api/runs/{name}/images/{at:int}", self._image),
                Route("/api/runs/{name}/record", self._download),
                Route("/api/runs/{name}/picture", self._picture),
                Route("/api/act", self._act, methods=["POST"]),
                Route("/api/start", self._start, methods=["POST"]),
                WebSocketRoute("/live", self._live),
                Mount("/static", StaticFiles(directory=STATIC)),
            ],
            middleware=[Middleware(Guard, access=access)],
            lifespan=self._lifespan,
        )

        self._announce()

    def allow_starts(self, start_run: StartRun, choices: Choices) -> None:
        """Let the page start runs of these trees on these cells."""
        self._start_run, self._choices = start_run, choices
        self._announce()

    @property
    def link(self) -> str:
        """The page's address, with what lets it act and what lets it read."""
        return f"{self.access.address}#token={self.access.token}&read={self.access.reading}"

    def _announce(self) -> None:
        holder = self.control.holder
        self.hub.announce(
            held_by=holder.who, grant=holder.grant, viewers=self.hub.viewers, starts=self._start_run is not None
        )

    # ------------------------------------------------------------------------------------- its own thread

    def start(self) -> None:
        """Serve in a thread of its own.

        Raises:
            UsageError: the port is taken.
        """
        config = uvicorn.Config(
            self.app, host=self.access.host, port=self.access.port, log_level="critical", ws="websockets-sansio",
            ws_max_size=MOST_BODY, ws_per_message_deflate=False, lifespan="on", limit_concurrency=MOST_VIEWERS + 50,
            ssl_certfile=self.access.certificate, ssl_keyfile=self.access.key,
        )  # fmt: skip
        try:
            config.load()
        except OSError as error:  # ssl.SSLError, too
            raise UsageError(f"the certificate or its key cannot be used: {error}") from error
        # A tick that is due while a batch goes out to many viewers waits so long for the interpreter, not 5 ms.
        sys.setswitchinterval(min(sys.getswitchinterval(), SWITCH))
        self._server = uvicorn.Server(config)
        self._server.install_signal_handlers = lambda: None  # type: ignore[attr-defined]
        started = threading.Event()

        def serve() -> None:
            assert self._server is not None
            with contextlib.suppress(SystemExit):
                self._server.run()
            started.set()

        self._thread = threading.Thread(target=serve, name="pomona-dashboard", daemon=True)
        self._thread.start()
        while not self._server.started:
            if started.wait(0.02):
                raise UsageError(
                    f"the dashboard cannot listen on {self.access.host}:{self.access.port}: the port is taken. "
                    "Choose another with --port."
                )

    def close(self) -> None:
        """Stop serving, once the viewers have what was said. Harmless when it was not started."""
        self.hub.close()
        if self._server is not None and self._thread is not None:
            patience = time.monotonic() + LAST_WORDS
            while not self.hub.drained and time.monotonic() < patience:
                time.sleep(0.02)
            self._server.should_exit = True
            self._server.force_exit = True
            self._thread.join(5.0)

    @contextlib.asynccontextmanager
    async def _lifespan(self, _app: Starlette) -> AsyncIterator[None]:
        self.hub.attach(asyncio.get_running_loop())
        beating = asyncio.create_task(self._beat())
        yield
        beating.cancel()

    async def _beat(self) -> None:
        while True:
            await asyncio.sleep(BEAT)
            runner = self.control.runner
            if runner is not None and self.hub.viewers:
                t, tick = runner.progress
                ages = {device: round(age, 3) for device, age in runner.ages.items()}
                self.hub.beat(t=t, tick=tick, state=runner.state.value, ages=ages)

    # --------------------------------------------------------------------------------------------- reading

    async def _page(self, _request: Request) -> Response:
        return HTMLResponse((STATIC / "index.html").read_text(encoding="utf-8"))

    async def _offer(self, _request: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(self._choices.describe))

    async def _runs(self, _request: Request) -> Response:
        runs = await asyncio.to_thread(self._index.read)
        return JSONResponse([run.as_json() for run in runs[:MOST_RUNS]])

    async def _messages(self, request: Request) -> Response:
        folder = self._folder(request)
        if folder is None:
            return JSONResponse({"error": "no such record"}, 404)

        stretch = _stretch(request.query_params)
        images = f"/api/runs/{quote(folder.name)}/images/"

        def pieces() -> Iterator[bytes]:
            try:
                if stretch is not None:
                    yield from between(folder, images, *stretch)
                elif "overview" in request.query_params:
                    yield from overview(folder, images)
                else:
                    yield from record_messages(folder)
            except (PomonaError, ValueError, KeyError) as error:
                yield json.dumps({"v": 1, "event": "Unreadable", "message": str(error)}).encode() + b"\n"

        return StreamingResponse(pieces(), media_type="application/x-ndjson")

    async def _image(self, request: Request) -> Response:
        folder = self._folder(request)
        found = None if folder is None else await asyncio.to_thread(image, folder, request.path_params["at"])
        if found is None:
            return JSONResponse({"error": "no such image"}, 404)
        return Response(found, media_type="image/jpeg", headers={"cache-control": "private, max-age=86400"})

    async def _download(self, request: Request) -> Response:
        folder = self._folder(request)
        if folder is None:
            return JSONResponse({"error": "no such record"}, 404)
        return FileResponse(folder / EVENTS_FILE, filename=f"{folder.name}.mcap")

    async def _picture(self, request: Request) -> Response:
        folder = self._folder(request)
        if folder is None or not is_plain(folder / "picture.png"):
            return JSONResponse({"error": "no such picture"}, 404)
        return FileResponse(folder / "picture.png")

    def _folder(self, request: Request) -> Path | None:
        """The record's folder; a name that is not exactly that of a folder of records is none, nor is a link."""
        name = request.path_params["name"]
        known = {path.parent.name: path for path in records_in(self.records)}
        path = known.get(name)
        return path.parent if path is not None and is_plain(path) and not path.parent.is_symlink() else None

    async def _live(self, socket: WebSocket) -> None:
        if self.hub.viewers >= MOST_VIEWERS:
            await socket.close(4429)
            return
        await socket.accept()
        try:
            since = max(int(socket.query_params.get("since", "0")), 0)
        except ValueError:
            since = 0
        viewer = self.hub.join(since, socket.query_params.get("stream", ""))
        self._announce()
        gone = asyncio.ensure_future(_until_gone(socket))
        try:
            await _feed(socket, viewer, gone)
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            gone.cancel()
            self.hub.leave(viewer)
            self._announce()

    # ---------------------------------------------------------------------------------------------- acting

    async def _act(self, request: Request) -> Response:
        body = await self._authorised_body(request)
        if isinstance(body, Response):
            return body
        action, viewer = _text(body, "action"), _text(body, "viewer")
        who, detail = _text(body, "who")[:60] or "operator", _text(body, "detail")
        try:
            if action == "safe_stop":
                self.control.safe_stop(who)
            elif action == "take":
                self.control.take(viewer, who)
            elif action == "release":
                self.control.release(viewer)
            elif action == "acknowledge":
                self.control.acknowledge(viewer)
            else:
                self.control.act(viewer, action, detail)
        except RefusedError as refused:
            return JSONResponse({"error": str(refused)}, 409)
        held = self.control.holder
        return JSONResponse({"held_by": held.who, "grant": held.grant, "yours": bool(viewer) and held.viewer == viewer})

    async def _start(self, request: Request) -> Response:
        body = await self._authorised_body(request)
        if isinstance(body, Response):
            return body
        if self._start_run is None:
            return JSONResponse({"error": "this dashboard belongs to one run and starts no other"}, 409)
        try:
            self.control.require(_text(body, "viewer"))
            tree = await asyncio.to_thread(self._start_run, body)
        except PomonaError as error:
            return JSONResponse({"error": str(error)}, 409)
        return JSONResponse({"tree": tree})

    async def _authorised_body(self, request: Request) -> dict[str, Any] | Response:
        if not self.access.authorised(request.headers):
            return JSONResponse({"error": "this page may watch but not act: open the link that was printed"}, 403)
        if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
            return JSONResponse({"error": "send application/json"}, 415)
        body = b""
        async for chunk in request.stream():
            body += chunk
            if len(body) > MOST_BODY:
                return JSONResponse({"error": "too long"}, 413)
        try:
            content = json.loads(body)
        except ValueError:
            return JSONResponse({"error": "not JSON"}, 400)
        return content if isinstance(content, dict) else JSONResponse({"error": "not an object"}, 400)


async def _feed(socket: WebSocket, viewer: Viewer, gone: asyncio.Future[None]) -> None:
    """Send what waits for a viewer, until it leaves or lags."""
    while not gone.done():
        upcoming = asyncio.ensure_future(viewer.next())
        both: set[asyncio.Future[Any]] = {upcoming, gone}
        await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
        if not upcoming.done():
            upcoming.cancel()
            return
        await socket.send_text(upcoming.result())
        if viewer.lagged and not viewer.waiting:
            await socket.close(4408)  # the page connects again and gets the whole state
            return


async def _until_gone(socket: WebSocket) -> None:
    """Viewers have nothing to say; what they send is read and dropped until they leave."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            await socket.receive_text()


def _stretch(query: Mapping[str, str]) -> tuple[float, float] | None:
    """The part of a record that is asked for, or None: all of it."""
    try:
        return float(query["begin"]), float(query["end"])
    except (KeyError, ValueError):
        return None


def _text(body: dict[str, Any], key: str) -> str:
    value = body.get(key, "")
    return value if isinstance(value, str) else ""
