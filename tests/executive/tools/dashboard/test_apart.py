"""The page in a process of its own: it answers while the run's process is busy, and calls reach the run from there."""

from __future__ import annotations

import ctypes
import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from fake_cell import FakeCell
from shown_runs import GATE, HOLD, REGISTRY

from pomona.executive.errors import UsageError
from pomona.executive.language import build, read
from pomona.executive.running.events import StateChanged
from pomona.executive.running.runner import Runner
from pomona.executive.running.tick import EventStream
from pomona.tools.dashboard import apart
from pomona.tools.dashboard.apart import PageLostError, PageProcess
from pomona.tools.dashboard.choices import Choices
from pomona.tools.dashboard.security import Access

VIEWER = """
import json, sys, time
from websockets.sync.client import connect
with connect(sys.argv[1], max_size=None) as stream:
    print("connected", flush=True)
    worst, silent, end, asked = 0.0, 0.0, time.monotonic() + float(sys.argv[2]), {}
    number = 0
    while time.monotonic() < end:
        number += 1
        began = time.monotonic()
        stream.send(json.dumps({"ping": number}))
        while True:
            messages = [json.loads(line) for line in stream.recv(timeout=10).split("\\n")]
            silent = max([silent, *(m["seconds"] for m in messages if m["event"] == "Silent")])
            if any(m["event"] == "Pong" and m["ping"] == number for m in messages):
                break
        worst = max(worst, time.monotonic() - began)
        time.sleep(0.05)
print(json.dumps([worst, silent]), flush=True)
"""

STOPPER = """
import json, sys, time
from urllib.request import Request, urlopen
print("ready", flush=True)
sys.stdin.readline()
began = time.monotonic()
headers = {"content-type": "application/json", "x-pomona-token": sys.argv[2]}
body = json.dumps({"action": "safe_stop", "viewer": "me", "who": "ada"}).encode()
with urlopen(Request(sys.argv[1], body, headers), timeout=20) as answer:
    confirmed = json.load(answer)
print(json.dumps([time.monotonic() - began, confirmed]), flush=True)
"""


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@pytest.fixture
def page(tmp_path: Path) -> Iterator[PageProcess]:
    page = PageProcess(Access("127.0.0.1", free_port()), tmp_path)
    page.start()
    yield page
    page.close()


def post(page: PageProcess, path: str, **body: Any) -> dict[str, Any]:
    headers = {"content-type": "application/json", "x-pomona-token": page.access.token}
    request = Request(f"{page.access.address}{path}", json.dumps(body).encode(), headers)
    try:
        with urlopen(request, timeout=20) as answer:
            return dict(json.load(answer))
    except HTTPError as error:
        with error:
            return dict(json.load(error))


@pytest.mark.slow
def test_a_viewer_is_answered_while_the_run_s_process_lets_no_thread_run(page: PageProcess) -> None:
    address = page.access.address.replace("http", "ws") + "live"
    command = [sys.executable, "-c", VIEWER, address, "5"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as viewer:
        assert viewer.stdout is not None
        assert viewer.stdout.readline() == "connected\n"
        ctypes.PyDLL(None).usleep(4_000_000)  # it holds the interpreter's lock
        worst, silent = json.loads(viewer.stdout.read())
    assert worst < 2.0  # 0.02 s on a quiet computer; the lock was held for 4 s
    assert silent > 1.0  # the pages are told that the run's process is silent


def test_control_stop_and_refusals_reach_the_run_and_come_back(page: PageProcess) -> None:
    GATE.clear()
    document = read(HOLD, "tree.yaml")
    cell, events = FakeCell(), EventStream()
    events.subscribe(page.on_event)
    runner = Runner(
        lambda context, board: build(document, REGISTRY, context=context, board=board),
        cell,
        events,
        real_time=True,
    )
    page.control.serve(runner)
    thread = threading.Thread(target=runner.run)
    thread.start()
    refused = post(page, "api/act", action="pause", viewer="me", who="ada")
    assert refused == {"error": "no operator holds control; take it first"}
    taken = post(page, "api/act", action="take", viewer="me", who="ada")
    assert (taken["held_by"], taken["yours"]) == ("ada", True)
    stopped = post(page, "api/act", action="safe_stop", viewer="me", who="ada")
    assert stopped["confirmed"] == "safe state: safe stop by ada"
    assert cell.latched == "safe stop by ada"
    assert (
        post(page, "api/start", viewer="me")["error"]
        == "this dashboard belongs to one run and starts no other"
    )
    thread.join(10.0)
    post(page, "api/act", action="acknowledge", viewer="me")
    runner.leave()


@pytest.mark.slow
def test_a_stop_during_a_preparation_is_confirmed_while_the_run_s_process_lets_no_thread_run(
    page: PageProcess,
) -> None:
    starting = page.control.prepare("pick")
    command = [sys.executable, "-c", STOPPER, f"{page.access.address}api/act", page.access.token]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as operator:
        assert operator.stdin is not None
        assert operator.stdout is not None
        assert operator.stdout.readline() == "ready\n"
        operator.stdin.write("press\n")
        operator.stdin.flush()
        ctypes.PyDLL(None).usleep(4_000_000)  # it holds the interpreter's lock
        took, answer = json.loads(operator.stdout.read())
    assert answer["confirmed"] == "the run that was being prepared does not begin"
    assert took < 2.0  # 0.01 s on a quiet computer; the lock was held for 4 s
    starting.begin()
    assert starting.cancelled.startswith("safe stop")


def test_an_action_that_starts_motion_is_refused_when_the_run_s_process_was_too_busy(
    page: PageProcess,
) -> None:
    refusals: list[dict[str, Any]] = []
    asking = threading.Thread(
        target=lambda: refusals.append(post(page, "api/act", action="take", viewer="me", who="ada"))
    )
    call = page._call
    page._call = lambda name, arguments, ago: call(name, arguments, ago + 3.0)  # type: ignore[method-assign]
    asking.start()
    asking.join(20.0)
    assert "too old" in refusals[0]["error"]
    assert page.control.holder.who == ""


def test_an_address_that_is_taken_is_refused(page: PageProcess, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="the port is taken"):
        PageProcess(page.access, tmp_path).start()


def test_a_run_is_started_from_the_page(tmp_path: Path) -> None:
    page = PageProcess(Access("127.0.0.1", free_port()), tmp_path)
    begun: list[str] = []

    def begin(form: dict[str, Any]) -> str:
        begun.append(form["tree"])
        return f"{form['tree']} begins"

    page.allow_starts(begin, Choices.installed())
    page.start()
    try:
        assert "holds control" in post(page, "api/start", tree="pick", viewer="me")["error"]
        post(page, "api/act", action="take", viewer="me", who="ada")
        for _ in range(2):  # a press that the browser sends again
            assert post(page, "api/start", tree="pick", viewer="me", press="1") == {
                "tree": "pick begins"
            }
        late = post(
            page, "api/start", tree="place", viewer="me", press="2", pressed=time.monotonic() - 5.0
        )
        assert "too old" in late["error"]
        assert begun == ["pick"]
    finally:
        page.close()


def test_a_run_whose_page_is_gone_ends_in_the_safe_state(page: PageProcess) -> None:
    GATE.clear()
    document = read(HOLD, "tree.yaml")
    cell, events = FakeCell(), EventStream()
    events.subscribe(page.on_event)
    runner = Runner(
        lambda context, board: build(document, REGISTRY, context=context, board=board),
        cell,
        events,
        real_time=True,
    )
    results: list[Any] = []
    thread = threading.Thread(target=lambda: results.append(runner.run()))
    thread.start()
    assert page._process is not None
    page._process.kill()
    for _ in range(200):
        try:
            page.on_event(StateChanged(0.0, 0, "running", ""))
        except PageLostError:
            break
        time.sleep(0.05)
    runner.pause()  # the next event of the run
    thread.join(10.0)
    assert results[0].outcome == "error"
    assert "page has ended" in results[0].reason.message
    assert cell.latched is not None


@pytest.mark.slow
def test_a_page_that_hangs_is_lost_and_keeps_the_run_s_process_from_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apart, "HUNG", 1.0)
    monkeypatch.setattr(apart, "GOODBYE", 1.0)
    page = PageProcess(Access("127.0.0.1", free_port()), tmp_path)
    page.start()
    assert page._process is not None
    page._process.send_signal(signal.SIGSTOP)
    words = "x" * 100_000
    deadline = time.monotonic() + 60.0
    while not page._lost and time.monotonic() < deadline:
        page.on_event(StateChanged(0.0, 0, "running", words))
        time.sleep(0.05)
    with pytest.raises(PageLostError):
        page.on_event(StateChanged(0.0, 0, "running", words))
    page.close()
    assert page._process.poll() == -signal.SIGKILL
