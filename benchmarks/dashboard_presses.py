"""A part of `bench_dashboard`: how soon a press is acknowledged among hostile connections."""

from __future__ import annotations

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
