"""Readers of records keep no press of a button out, and none of them keeps a place for ever."""

from __future__ import annotations

import http.client
import itertools
import json
import socket
import threading
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from recorded_events import FAILED, write
from shown_runs import Show

from pomona.tools.dashboard import connections, reading, server

LONG = 60.0
"""Time that a busy machine may take [s]."""

RECORD = "/api/runs/one"


@pytest.fixture
def shown(show: Show) -> Show:
    write(show.records / "one", FAILED)
    return show


@dataclass(frozen=True)
class Answer:
    status: int
    body: bytes
    again: str | None
    """The header Retry-After."""


def ask(show: Show, address: str) -> http.client.HTTPConnection:
    line = http.client.HTTPConnection("127.0.0.1", show.dashboard.access.port, timeout=LONG)
    line.request("GET", address)
    return line


def answer_of(line: http.client.HTTPConnection) -> Answer:
    with closing(line), line.getresponse() as answer:
        return Answer(answer.status, answer.read(), answer.headers["retry-after"])


def safe_stop(show: Show) -> int:
    line = http.client.HTTPConnection("127.0.0.1", show.dashboard.access.port, timeout=LONG)
    headers = {"content-type": "application/json", "x-pomona-token": show.dashboard.access.token}
    line.request(
        "POST",
        "/api/act",
        json.dumps({"action": "safe_stop", "who": "ada", "viewer": "v"}),
        headers,
    )
    return answer_of(line).status


def test_a_safe_stop_passes_readers_that_hold_every_place(
    shown: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "MOST_READS", reading.THREADS)
    began, go_on = threading.Semaphore(0), threading.Event()
    names: list[str] = []

    def slow(_folder: Path) -> bytes:
        names.append(threading.current_thread().name)
        began.release()
        assert go_on.wait(LONG)
        return b"jpeg"

    monkeypatch.setattr(server, "thumbnail", slow)
    waiting = [ask(shown, f"{RECORD}/thumbnail") for _ in range(reading.THREADS)]
    assert all(began.acquire(timeout=LONG) for _ in waiting)
    refused = answer_of(ask(shown, f"{RECORD}/messages"))
    assert (refused.status, refused.again) == (503, "1")
    assert "try again" in json.loads(refused.body)["error"]
    assert safe_stop(shown) == 200
    go_on.set()
    assert [answer_of(line).body for line in waiting] == [b"jpeg"] * reading.THREADS
    assert all(name.startswith("pomona-read") for name in names)
    assert answer_of(ask(shown, f"{RECORD}/messages")).status == 200  # the places are free again


def test_a_place_is_free_again_after_a_read_that_failed(
    shown: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "MOST_READS", 1)

    def broken(_folder: Path) -> Any:
        raise OSError("the disk is gone")

    monkeypatch.setattr(server, "thumbnail", broken)
    assert [answer_of(ask(shown, f"{RECORD}/thumbnail")).status for _ in range(2)] == [500, 500]
    assert answer_of(ask(shown, f"{RECORD}/messages")).status == 200


def test_a_reader_that_takes_nothing_loses_its_place(
    shown: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "MOST_READS", 1)
    monkeypatch.setattr(connections, "TAKING_DEADLINE", 0.1)
    monkeypatch.setattr(server, "record_messages", lambda _folder: itertools.repeat(bytes(1 << 18)))
    with socket.create_connection(("127.0.0.1", shown.dashboard.access.port), LONG) as silent:
        silent.send(f"GET {RECORD}/messages HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        assert silent.recv(12) == b"HTTP/1.1 200"
        patience = time.monotonic() + LONG
        while (found := answer_of(ask(shown, f"{RECORD}/picture")).status) == 503:
            assert time.monotonic() < patience, "the silent reader keeps its place"
        assert found == 404
