"""Reads of records: two threads of their own make the answers piece by piece, so no press of a button waits for them.

Python runs one thread at a time. With forty readers in forty threads, the server's loop got its turn so late that a
safe stop took seconds.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

THREADS = 2
"""Threads that make answers: a long record does not keep a short one waiting, and the loop waits for two at most."""

MOST_READS = 32
"""Reads that are open at once, waiting ones too; a browser opens six."""

AGAIN = 1
"""Time after which a refused reader may try again [s]."""


class RecordReading:
    """Answers reads within a limit of threads and of open requests. Use it in the server's loop."""

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(THREADS, thread_name_prefix="pomona-read")
        self._open = 0

    def route(self, path: str, answer: Callable[[Request], Response]) -> Route:
        """Return the route of a read. `answer` is called in a thread of the reads."""
        return Route(path, _Read(self, answer), methods=["GET"])

    async def pieces(self, made: Iterator[bytes]) -> AsyncIterator[bytes]:
        """Yield pieces of an answer. Each is made in a thread of the reads, once the one before was sent."""
        loop = asyncio.get_running_loop()
        while (piece := await loop.run_in_executor(self._threads, next, made, None)) is not None:
            yield piece

    async def respond(
        self, answer: Callable[[Request], Response], scope: Scope, receive: Receive, send: Send
    ) -> None:
        """Answer a request to its last piece, or refuse it with 503 while `MOST_READS` are open."""
        if self._open >= MOST_READS:
            words = {"error": f"{MOST_READS} reads are open: try again in {AGAIN} s"}
            await JSONResponse(words, 503, {"retry-after": str(AGAIN)})(scope, receive, send)
            return
        self._open += 1
        try:
            loop = asyncio.get_running_loop()
            made = await loop.run_in_executor(self._threads, answer, Request(scope, receive))
            await made(scope, receive, send)
        finally:
            self._open -= 1


class _Read:
    """One kind of read, as an application."""

    def __init__(self, reading: RecordReading, answer: Callable[[Request], Response]) -> None:
        self._reading = reading
        self._answer = answer

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self._reading.respond(self._answer, scope, receive, send)
