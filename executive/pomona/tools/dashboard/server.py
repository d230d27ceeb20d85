"""The dashboard's HTTP and WebSocket server."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.reasons import failure_codes
from pomona.executive.recording.folder import EVENTS_FILE, records_in
from pomona.executive.recording.index import RunIndex
from pomona.executive.recording.plain_file import is_plain
from pomona.executive.running.events import Event
from pomona.tools.dashboard.approvals import request_facts
from pomona.tools.dashboard.asides import Asides
from pomona.tools.dashboard.choices import Choices, JudgeForm, StartRun
from pomona.tools.dashboard.connections import wire_of
from pomona.tools.dashboard.control_lock import ControlLock, RefusedError, RunControl
from pomona.tools.dashboard.hub import Hub, Viewer
from pomona.tools.dashboard.presses import ButtonPresses, now, object_of, refuse_late, text
from pomona.tools.dashboard.reading import RecordReading
from pomona.tools.dashboard.record_messages import (
    between,
    cloud,
    image,
    moment,
    overview,
    record_messages,
    thumbnail,
)
from pomona.tools.dashboard.security import Access, RequestGuard
from pomona.tools.dashboard.serving import WATCH_ONLY, HttpService, acting

STATIC = Path(__file__).parent / "static"
MOST_VIEWERS = 200
MOST_RUNS = 2000
"""The newest ones are listed."""
MOST_BODY = 16_384
LAST_WORDS = 1.0
"""Time that viewers have to receive the rest when the server closes [s]."""

KNOWN_VIEWERS = 50
"""Viewers served in addition if they have the reading token: strangers cannot lock an operator out."""

MOST_PRESSES = 16
"""Button presses of one page that may be pending."""

UNSUPPORTED = 1003
"""Close code of a stream that sends bytes (RFC 6455, section 7.4.1)."""

PAGE_SILENT = 4.0
"""Time without a ping from the page that holds control after which every page is informed [s]."""

BEAT = 0.5
"""Period of a run's heartbeat [s]."""

SILENT = 1.0
"""Time without a message from the run's process after which every page is informed [s]; it sends four a second."""


RecordAnswer = Callable[[Path, Request], Response | None]


class Dashboard:
    """Serves the page, the live stream, the records, and the operators' actions."""

    def __init__(self, access: Access, records: Path, remote: RunControl | None = None) -> None:
        """
        Args:
            access: who may read and act.
            records: folder of the recorded runs.
            remote: the run's control where that is in another process; None: `control`, here.
        """
        self.access = access
        self.records = records
        self.hub = Hub()
        self.control = ControlLock(self.announce)
        self._control: RunControl = remote or self.control
        self.presses = ButtonPresses(self._control)
        self._index = RunIndex(records)
        self._asides = Asides(records)
        self._start_run: StartRun | None = None
        self._judge_form: JudgeForm = lambda _form: {}
        self._choices = Choices({}, {})
        self._reading = RecordReading()
        reading = self._reading.route
        acts = partial(acting, access=access, most=MOST_BODY)
        self.app = Starlette(
            routes=[
                Route("/", self._page),
                Route("/api/remedies", self._remedies),
                reading("/api/choices", self._offer),
                reading("/api/requests", self._asked),
                reading("/api/runs", self._runs),
                self._record_route("messages", self._messages, "record"),
                self._record_route("images/{at}", self._image, "image"),
                self._record_route("images/{at}/cloud", self._cloud, "record"),
                self._record_route("record", self._download, "record"),
                self._record_route("picture", self._picture, "picture"),
                self._record_route("thumbnail", self._thumbnail, "record"),
                acts("act", answer=self.presses.answer),
                acts("judge", answer=self._judge),
                acts("start", answer=self._start),
                acts("edit", answer=lambda body: asyncio.to_thread(self._edit, body)),
                acts("why", answer=lambda body: asyncio.to_thread(self._why, body)),
                reading("/api/why", lambda _request: JSONResponse(self._asides.found())),
                WebSocketRoute("/live", self._live),
                Mount("/static", StaticFiles(directory=STATIC)),
            ],
            middleware=[Middleware(RequestGuard, access=access)],
            lifespan=self._lifespan,
        )
        self._service = HttpService(self.app, access, MOST_BODY)
        self._told_silent = False
        self.announce()

    def allow_starts(
        self, start_run: StartRun, choices: Choices, judge_form: JudgeForm = lambda _form: {}
    ) -> None:
        """Let the page start runs of these trees on these cells."""
        self._start_run = start_run
        self._choices = choices
        self._judge_form = judge_form
        self.announce()

    def on_event(self, event: Event) -> None:
        """Take one event of a run; returns at once."""
        self.hub.on_event(event)

    @property
    def link(self) -> str:
        """The page's address, with the tokens that let it act and read."""
        return self.access.link

    def announce(self) -> None:
        """Send every page the holder of control and the run in preparation. From any thread."""
        standing = self._control.standing
        holder = standing.holder
        self._holder_here = self._is_here(holder.viewer)
        self.hub.announce(
            held_by=holder.who, grant=holder.grant, viewers=self.hub.viewers, starts=self._start_run is not None,
            start=standing.start, holder_here=self._holder_here, faults=standing.known_faults,
        )  # fmt: skip

    def _is_here(self, page: str) -> bool:
        """Return True if the page that holds control still sends messages."""
        return not page or now() - self.hub.last_seen(page) < PAGE_SILENT

    # ------------------------------------------------------------------------------------- its own thread

    def start(self) -> None:
        """Serve in a thread of its own. Raises UsageError: it cannot listen there."""
        self._service.start()

    def close(self) -> None:
        """Stop serving once the viewers have received everything. Harmless when it was not started."""
        self.hub.close()
        patience = time.monotonic() + LAST_WORDS
        while self._service.server and not self.hub.drained and time.monotonic() < patience:
            time.sleep(0.02)
        self._service.close()
        self._asides.close()

    @contextlib.asynccontextmanager
    async def _lifespan(self, _app: Starlette) -> AsyncIterator[None]:
        self.hub.attach(asyncio.get_running_loop())
        beating = asyncio.create_task(self._beat())
        yield
        beating.cancel()

    async def _beat(self) -> None:
        while True:
            await asyncio.sleep(BEAT)
            standing = self._control.standing
            silent = self._control.silent
            if self._is_here(standing.holder.viewer) != self._holder_here or standing.is_preparing:
                self.announce()
            if (
                standing.is_preparing or standing.signs is not None
            ):  # a run has the computer for itself
                await asyncio.to_thread(self._asides.stop_search)
            if silent > SILENT or self._told_silent:
                self._told_silent = silent > SILENT
                self.hub.tell("Silent", seconds=round(silent, 1) if self._told_silent else 0.0)
            if standing.signs is not None and self.hub.viewers and not self._told_silent:
                self.hub.tell("Beat", **standing.signs)
                for picture in await asyncio.to_thread(self.control.pictures):
                    self.hub.tell("Picture", **picture)

    # --------------------------------------------------------------------------------------------- reading

    async def _page(self, _request: Request) -> Response:
        return HTMLResponse((STATIC / "index.html").read_text(encoding="utf-8"))

    def _offer(self, _request: Request) -> Response:
        return JSONResponse(self._choices.describe())

    def _asked(self, _request: Request) -> Response:
        return JSONResponse(request_facts(self.records))

    async def _remedies(self, _request: Request) -> Response:
        return JSONResponse({code: about.remedy for code, about in failure_codes().items()})

    def _runs(self, _request: Request) -> Response:
        return JSONResponse([run.as_json() for run in self._index.read()[:MOST_RUNS]])

    def _record_route(self, path: str, answer: RecordAnswer, what: str) -> BaseRoute:
        """Return the route of a part of a record; where there is none, the answer says what is missing."""

        def respond(request: Request) -> Response:
            folder = self._folder(request)
            found = None if folder is None else answer(folder, request)
            return found or JSONResponse({"error": f"no such {what}"}, 404)

        return self._reading.route(f"/api/runs/{{name}}/{path}", respond)

    def _messages(self, folder: Path, request: Request) -> Response:
        interval = _interval(request.query_params)
        images = f"/api/runs/{quote(folder.name)}/images/"

        def pieces() -> Iterator[bytes]:
            try:
                if interval is not None:
                    part = moment if "standing" in request.query_params else between
                    yield from part(folder, images, *interval)
                elif "overview" in request.query_params:
                    yield from overview(folder, images)
                else:
                    yield from record_messages(folder)
            except (PomonaError, ValueError, KeyError) as error:
                yield (
                    json.dumps({"v": 1, "event": "Unreadable", "message": str(error)}).encode()
                    + b"\n"
                )

        return StreamingResponse(self._reading.pieces(pieces()), media_type="application/x-ndjson")

    def _image(self, folder: Path, request: Request) -> Response | None:
        return _jpeg(image(folder, request.path_params["at"]), 86400)

    def _cloud(self, folder: Path, request: Request) -> Response:
        found = cloud(folder, request.path_params["at"])
        return JSONResponse(found, headers={"cache-control": "private, max-age=86400"})

    def _download(self, folder: Path, _request: Request) -> Response:
        return FileResponse(folder / EVENTS_FILE, filename=f"{folder.name}.mcap")

    def _picture(self, folder: Path, _request: Request) -> Response | None:
        path = folder / "picture.png"
        return FileResponse(path) if is_plain(path) else None

    def _thumbnail(self, folder: Path, _request: Request) -> Response:
        return _jpeg(thumbnail(folder), 600) or Response(status_code=204)

    def _folder(self, request: Request) -> Path | None:
        """Return the record's folder, or None: only the exact name of a record counts, and no symbolic link."""
        name = request.path_params["name"]
        known = {path.parent.name: path for path in records_in(self.records)}
        path = known.get(name)
        return (
            path.parent
            if path is not None and is_plain(path) and not path.parent.is_symlink()
            else None
        )

    async def _live(self, stream: WebSocket) -> None:
        known = self.access.knows_reader(stream.query_params.get("token", ""))
        if self.hub.viewers >= MOST_VIEWERS + (KNOWN_VIEWERS if known else 0):
            await stream.close(4429)
            return
        await stream.accept()
        try:
            since = max(int(stream.query_params.get("since", "0")), 0)
        except ValueError:
            since = 0
        viewer = self.hub.join(
            since, stream.query_params.get("stream", ""), wire_of(stream.scope.get("state", {}))
        )
        self.announce()
        gone = asyncio.ensure_future(self._listen(stream, viewer))
        try:
            await _feed(stream, viewer, gone)
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            gone.cancel()
            self.hub.leave(viewer)
            self.announce()

    async def _listen(self, stream: WebSocket, viewer: Viewer) -> None:
        """Handle a page's messages on the live stream until it leaves: pings, its token, button presses."""
        pressed: set[asyncio.Task[None]] = set()
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                received = await stream.receive()
                if received["type"] == "websocket.disconnect":
                    return
                if received.get("text") is None:
                    await stream.close(UNSUPPORTED, "send text")
                    return
                said = object_of(received["text"])
                if isinstance(said.get("ping"), (int, float)):
                    viewer.last_seen = now()
                    held = self._control.standing.holder if viewer.page else None
                    grant = held.grant if held is not None and held.viewer == viewer.page else None
                    # it follows everything sent before; with `grant` the page knows of control whose answer was lost
                    viewer.tell("Pong", ping=said["ping"], now=viewer.last_seen, grant=grant)
                elif "token" in said:
                    viewer.armed = self.access.acts_with(text(said, "token"))
                    viewer.page = text(said, "viewer") if viewer.armed else ""
                    viewer.last_seen = now()
                    viewer.tell("Armed", armed=viewer.armed)
                elif "press" in said and len(pressed) < MOST_PRESSES:
                    task = asyncio.create_task(self._pressed(viewer, said))
                    pressed.add(task)
                    task.add_done_callback(pressed.discard)

    async def _pressed(self, viewer: Viewer, said: dict[str, Any]) -> None:
        press = text(said, "press")
        if not viewer.armed:
            viewer.tell("Pressed", press=press, error=WATCH_ONLY)
            return
        try:
            viewer.tell("Pressed", press=press, **await self.presses.answer(said))
        except PomonaError as refused:
            viewer.tell("Pressed", press=press, error=str(refused))

    # ---------------------------------------------------------------------------------------------- acting

    async def _start(self, body: dict[str, Any]) -> dict[str, Any]:
        if self._start_run is None:
            raise RefusedError("this dashboard belongs to one run and starts no other")
        return await self.presses.once(body, self._begin)

    async def _judge(self, body: dict[str, Any]) -> dict[str, Any]:
        return {"problems": await asyncio.to_thread(self._judge_form, body)}

    def _edit(self, body: dict[str, Any]) -> dict[str, Any]:
        tree = self._choices.tree(body.get("tree"))
        path = text(body, "path") or str(tree)
        if not self.access.local or Path(path).resolve() != tree.resolve():
            raise UsageError(f"type on the computer where the file is: pomona edit {path}")
        return {"link": self._asides.edit(tree)}

    def _why(self, body: dict[str, Any]) -> dict[str, Any]:
        run = text(body, "run")
        standing = self._control.standing
        if body.get("stop") is True:
            self._asides.stop_search()
        elif standing.is_preparing or standing.signs is not None:
            raise RefusedError("a run is going on: search when it has ended")
        elif (found := next((r for r in self._index.read() if r.run == run), None)) is None:
            raise UsageError("there is no such record")
        elif found.cell_kind not in ("simulated", "mock"):
            raise UsageError(
                f"the run was on a cell that is {found.cell_kind}: type pomona why {run}"
            )
        else:
            self._asides.search(run)
        return {"run": run}

    async def _begin(self, body: dict[str, Any]) -> dict[str, Any]:
        refuse_late(body)
        start_run = self._start_run
        assert start_run is not None

        def begin() -> str:
            self._control.call("require", text(body, "viewer"))
            return start_run(body)

        return {"tree": await asyncio.to_thread(begin)}


async def _feed(stream: WebSocket, viewer: Viewer, gone: asyncio.Future[None]) -> None:
    """Send the waiting messages of a viewer, until it leaves or lags."""
    while not gone.done():
        upcoming = asyncio.ensure_future(viewer.next())
        both: set[asyncio.Future[Any]] = {upcoming, gone}
        await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
        if not upcoming.done():
            upcoming.cancel()
            return
        await stream.send_text(upcoming.result())
        viewer.sent()
        if viewer.lagged and not viewer.waiting:
            await stream.close(4408)  # the page connects again and gets the whole state
            return


def _jpeg(coded: bytes | None, age: int) -> Response | None:
    """Return an image that a browser keeps for so long [s]; None without one."""
    kept = {"cache-control": f"private, max-age={age}"}
    return None if coded is None else Response(coded, media_type="image/jpeg", headers=kept)


def _interval(query: Mapping[str, str]) -> tuple[float, float] | None:
    """Return the interval of a record that is requested [s], or None for all of it."""
    try:
        return float(query["begin"]), float(query["end"])
    except (KeyError, ValueError):
        return None
