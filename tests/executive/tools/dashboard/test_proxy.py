"""The page works through proxies: another port, a path of its own, whole answers only, no WebSockets."""

from __future__ import annotations

import asyncio
import contextlib
import re
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from shown_runs import GATE, HOLD, Show, press_stop

pytestmark = pytest.mark.browser

LOOKED = "pomona: 1\ntree: old\nroot:\n  sequence:\n    - Look: {seen: '{seen}'}\n"


def expect(locator: Any) -> Any:
    from playwright.sync_api import expect as playwright_expect

    return playwright_expect(locator)


class Proxy:
    """Passes requests on without the path they came under, and answers once they are there as a whole."""

    def __init__(
        self, to: int, below: str = "/", streams: bool = True, own_host: bool = False
    ) -> None:
        self._to, self._below, self._streams, self._own_host = to, below.encode(), streams, own_host
        self._loop = asyncio.new_event_loop()
        ready = threading.Event()

        async def serve() -> None:
            server = await asyncio.start_server(self._pass_on, "127.0.0.1", 0)
            self.port = server.sockets[0].getsockname()[1]
            ready.set()
            await self._ended.wait()
            server.close()
            for end in self._ends:
                end.transport.abort()
            tasks = asyncio.all_tasks() - {asyncio.current_task()}
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            for end in self._ends:
                with contextlib.suppress(OSError):
                    await end.wait_closed()

        self._ended = asyncio.Event()
        self._ends: list[asyncio.StreamWriter] = []
        self._thread = threading.Thread(target=lambda: self._loop.run_until_complete(serve()))
        self._thread.start()
        ready.wait()

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()
        self._loop.close()

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._ends.append(writer)
        try:
            head = await reader.readuntil(b"\r\n\r\n")
            upgrade = b"upgrade: websocket" in head.lower()
            if self._own_host:
                head = re.sub(rb"(?i)\r\nhost:[^\r]*", b"\r\nHost: localhost:%d" % self._to, head)
            method, path, rest = head.split(b" ", 2)
            if not path.startswith(self._below) or (upgrade and not self._streams):
                writer.write(
                    b"HTTP/1.1 502 Bad Gateway\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"
                )
                return
            if not upgrade:
                rest = re.sub(rb"(?i)\r\nconnection:[^\r]*", b"", rest).replace(
                    b"\r\n", b"\r\nconnection: close\r\n", 1
                )
            there, back = await asyncio.open_connection("127.0.0.1", self._to)
            self._ends.append(back)
            back.write(b" ".join((method, b"/" + path[len(self._below) :], rest)))
            up = asyncio.ensure_future(_pump(reader, back))
            if upgrade:
                await _pump(there, writer)
            else:
                writer.write(await there.read())
            up.cancel()
            await writer.drain()
            back.close()
        except (OSError, asyncio.IncompleteReadError):
            pass
        finally:
            writer.close()


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(65_536):
        writer.write(data)
        await writer.drain()


@pytest.fixture
def behind(show: Show, chromium: Any) -> Iterator[Callable[..., Any]]:
    proxies, pages = [], []

    def open_one(below: str, streams: bool, own_host: bool = False) -> Any:
        proxies.append(Proxy(show.dashboard.access.port, below, streams, own_host))
        pages.append(chromium.new_page())
        fragment = show.dashboard.link.partition("#")[2]
        pages[-1].goto(f"http://127.0.0.1:{proxies[-1].port}{below}#{fragment}")
        return pages[-1]

    yield open_one
    for page in pages:
        page.close()
    for proxy in proxies:
        proxy.close()


@pytest.mark.parametrize("below", ["/", "/orchard/row 3/".replace(" ", "%20")])
def test_a_run_is_watched_stopped_and_looked_at_again_through_a_proxy(
    show: Show, behind: Callable[..., Any], below: str
) -> None:
    show.record(LOOKED, "old_1")
    page = behind(below, streams=True)
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    page.locator("#safe-stop").click()
    expect(page.locator("#latched-rest")).to_contain_text(re.compile(r"Confirmed after \d+ ms"))
    page.get_by_role("button", name="Runs").click()
    page.get_by_role("button", name="old_1").click()
    expect(page.locator("#run")).to_have_text("old · seed 0")
    expect(page.locator("#scene-legend")).to_contain_text("planned path")
    page.wait_for_function("() => document.querySelector('#camera img')?.naturalWidth > 0")
    with page.expect_download() as download:
        page.locator("#download").click()
    assert download.value.suggested_filename == "old_1.mcap"


def test_a_proxy_that_writes_a_host_of_its_own_gets_the_missing_setting(
    show: Show, behind: Callable[..., Any]
) -> None:
    page = behind("/orchard/", streams=True, own_host=True)
    expect(page.locator("#safe-stop-words")).to_have_text("no connection: a press is tried")
    press_stop(page)
    expect(page.locator("#press-what")).to_have_text("SAFE STOP NOT CARRIED OUT")
    expect(page.locator("#press-words")).to_contain_text("--served-as NAME")


def test_where_no_stream_passes_the_page_reports_it_and_a_stop_still_arrives(
    show: Show, behind: Callable[..., Any]
) -> None:
    page = behind("/", streams=False)
    show.run(HOLD)
    expect(page.locator("#connection")).to_have_text(
        "no live stream: does a proxy in between pass WebSockets?"
    )
    press_stop(page)
    expect(page.locator("#press-what")).to_have_text(
        re.compile(r"✓ SAFE STOP confirmed after \d+ ms")
    )
    assert show.cell.latched == "safe stop by operator"
    GATE.set()
