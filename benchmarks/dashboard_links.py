"""Parts of `bench_dashboard`: how soon a press is acknowledged among hostile connections, and a broken link seen."""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import socket
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.dashboard_viewers import watch
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell
from pomona.executive.running.runner import Runner
from pomona.tools.dashboard.server import Dashboard

VIEWERS, HOSTILE = 200, 260
WAITING = "pomona: 1\ntree: waiting\nroot:\n  wait: 3600 s\n"
BREAKS = ("cut", "black hole", "slow", "suspended")
PAGES = 2
SLOW = 3.0
"""Seconds by which a slow link delays everything."""


def press_times(dashboard: Dashboard, presses: int) -> list[float]:
    """Seconds from a press, sent over the live stream, to the run's own acknowledgement there."""
    from websockets.sync.client import connect

    times = []
    address = f"ws://127.0.0.1:{dashboard.access.port}/live?token={dashboard.access.reading}"
    with connect(address, compression=None, max_size=None) as stream:
        stream.send(json.dumps({"token": dashboard.access.token, "viewer": "bench"}))
        lines = (line for _ in iter(int, 1) for line in str(stream.recv(10.0)).split("\n"))
        actions = [
            "take",
            *(("pause", "resume")[number % 2] for number in range(presses)),
            "safe_stop",
        ]
        for number, action in enumerate(actions):
            began = time.perf_counter()
            stream.send(
                json.dumps(
                    {"press": f"p{number}", "action": action, "viewer": "bench", "who": "bench"}
                )
            )
            _wait_for(lines, '"event":"OperatorActed"', f'"action":"{action}"')
            times.append(time.perf_counter() - began)
            state = {"pause": '"state":"paused"', "resume": '"state":"running"'}.get(action)
            if state is not None:
                _wait_for(lines, '"event":"StateChanged"', state)
            time.sleep(0.02)
    return times[1:]  # the first one waits for the browser's backlog, too


def _wait_for(lines: Iterator[str], *words: str) -> None:
    next(line for line in lines if all(word in line for word in words))


def bench_presses(report: Any, dashboard: Dashboard, _browser: Any, duration: float) -> None:
    """Measure presses while 200 clients watch and 260 connections are silent or slow."""
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    process = context.Process(target=watch, args=(dashboard.access.port, VIEWERS, False, stop))
    process.start()
    while dashboard.hub.viewers < VIEWERS:
        time.sleep(0.05)
    hostile = [
        socket.create_connection(("127.0.0.1", dashboard.access.port)) for _ in range(HOSTILE)
    ]
    for number, one in enumerate(hostile):
        one.send((b"", b"POST /api/act HT")[number % 2])
    with tempfile.TemporaryDirectory() as scratch:
        tree = Path(scratch) / "waiting.yaml"
        tree.write_text(WAITING, encoding="utf-8")
        ready = threading.Event()

        def serve(runner: Runner) -> None:
            dashboard.control.serve(runner)
            ready.set()

        order = RunOrder(tree, find_cell("sim"), dry=True, real_time=True)
        run = threading.Thread(
            target=execute, args=(order, [dashboard.hub.on_event]), kwargs={"on_ready": serve}
        )
        run.start()
        ready.wait()
        times = press_times(dashboard, 300 if duration > 10.0 else 60)
        run.join()
        dashboard.control.clear()
    for one in hostile:
        one.close()
    stop.set()
    process.join(10.0)
    process.kill()
    p99 = float(np.percentile(times, 99)) * 1e3
    among = f"{VIEWERS} viewers, {HOSTILE} hostile"
    report.tell(
        f"press to the run's acknowledgement, p99 of {len(times)}, {among}", p99, "ms", 100.0
    )
    report.note("median, worst", f"{np.median(times) * 1e3:.1f}, {max(times) * 1e3:.1f} ms")


class Wire:
    """Passes a browser's connections on to the dashboard, and breaks them in four ways."""

    def __init__(self, port: int) -> None:
        self._to = port
        self.broken = ""
        self.port = 0
        self._writers: set[asyncio.StreamWriter] = set()
        self._loop = asyncio.new_event_loop()
        ready = threading.Event()

        async def serve() -> None:
            server = await asyncio.start_server(self._pass_on, "127.0.0.1", 0)
            self.port = server.sockets[0].getsockname()[1]
            ready.set()

        def work() -> None:
            asyncio.set_event_loop(self._loop)
            self._loop.run_until_complete(serve())
            self._loop.run_forever()

        threading.Thread(target=work, daemon=True).start()
        ready.wait()

    def breaks(self, how: str) -> None:
        """From now on; "" repairs it for new connections and what waits."""
        self.broken = how
        if how == "cut":
            for writer in list(self._writers):
                self._loop.call_soon_threadsafe(writer.transport.abort)

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self.broken == "cut":
            writer.transport.abort()
            return
        there, back = await asyncio.open_connection("127.0.0.1", self._to)
        self._writers |= {writer, back}
        await asyncio.gather(
            self._pump(reader, back), self._pump(there, writer), return_exceptions=True
        )
        self._writers -= {writer, back}

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while True:
                while self.broken == "suspended":  # nothing is even read: the sender's buffers fill
                    await asyncio.sleep(0.01)
                data = await reader.read(65_536)
                if not data:
                    break
                if self.broken == "slow":
                    await asyncio.sleep(SLOW)
                if self.broken != "black hole":
                    writer.write(data)
                    await writer.drain()
        finally:
            writer.close()


WATCH = """() => { const bar = document.getElementById("not-live");
    new MutationObserver(() => { if (!bar.hidden) window.staleAt ??= performance.now(); })
      .observe(bar, { attributes: true }); }"""


def bench_stale(report: Any, dashboard: Dashboard, browser: Any, duration: float) -> None:
    """Measure how soon, and whether, a page reports a lost link: two pages for each kind, all at once."""
    from playwright.sync_api import expect

    ways = [(how, number) for how in BREAKS for number in range(PAGES)]
    wires = {way: Wire(dashboard.access.port) for way in ways}
    pages = {way: browser.new_page() for way in ways}
    for way, page in pages.items():
        page.goto(dashboard.link.replace(f":{dashboard.access.port}/", f":{wires[way].port}/"))
        expect(page.locator("#connection")).to_have_text("connected")
        page.evaluate(WATCH)
    next(iter(pages.values())).wait_for_timeout(1000)
    times: dict[str, list[float]] = {how: [] for how in BREAKS}
    for _ in range(13 if duration > 10.0 else 1):
        began = {}
        for way, page in pages.items():
            began[way] = page.evaluate(
                "() => { window.staleAt = undefined; return performance.now(); }"
            )
            wires[way].breaks(way[0])
        for way, page in pages.items():
            expect(page.locator("#not-live")).to_be_visible(timeout=20_000)
            times[way[0]].append((page.evaluate("window.staleAt") - began[way]) / 1e3)
        for wire in wires.values():
            wire.breaks("")
        for page in pages.values():
            expect(page.locator("#not-live")).to_be_hidden(timeout=60_000)
            page.wait_for_timeout(100)
    for page in pages.values():
        page.close()
    every = [one for some in times.values() for one in some]
    report.tell(f"a broken link is shown, worst of {len(every)}", max(every), "s", 2.0)
    report.note(
        "worst of each", ", ".join(f"{how} {max(some):.2f} s" for how, some in times.items())
    )
