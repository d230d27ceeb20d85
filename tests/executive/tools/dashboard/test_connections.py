"""Silent or slow clients keep no other client out."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
from typing import Any

import pytest
from shown_runs import Show
from websockets.frames import Frame, Opcode
from websockets.sync.client import connect

from pomona.executive.errors import UsageError
from pomona.tools.dashboard import connections, server, serving

LONG = 60.0
"""Time that a busy machine may take [s]; a client that is kept out waits longer."""

HALF = b"POST /api/act HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 9\r\n\r\n{"
"""A request without the rest of its body, which the page that sends it never sends."""


def act(show: Show, action: str) -> int:
    """The status of an answer."""
    line = http.client.HTTPConnection("127.0.0.1", show.dashboard.access.port, timeout=LONG)
    headers = {"content-type": "application/json", "x-pomona-token": show.dashboard.access.token}
    line.request(
        "POST", "/api/act", json.dumps({"action": action, "who": "ada", "viewer": "v"}), headers
    )
    status = line.getresponse().status
    line.close()
    return status


def test_260_idle_and_slow_connections_do_not_keep_a_safe_stop_out(
    show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "REQUEST_DEADLINE", 100.0 * LONG)  # none goes by itself
    port = show.dashboard.access.port
    hostile = []
    for number in range(260):
        hostile.append(socket.create_connection(("127.0.0.1", port), LONG))
        if number % 3:
            hostile[-1].send(
                b"POST /api/act HTTP/1.1\r\nHost: 127.0.0.1:1\r\n"
                + b"Content-Length: 9\r\n\r\n" * (number % 2)
            )
    assert act(show, "safe_stop") == 200  # how soon is the benchmark's figure
    with connect(f"ws://127.0.0.1:{port}/live") as live:
        live.send('{"ping": 1}')
        while '"Pong"' not in str(live.recv(LONG)):
            pass
    for one in hostile:
        one.close()


def test_no_message_waits_for_the_next_one(show: Show) -> None:
    """With Nagle's algorithm every press was answered 40 ms later."""
    with connect(f"ws://127.0.0.1:{show.dashboard.access.port}/live") as live:
        live.recv(LONG)
        assert show.dashboard._service.server is not None
        lines: list[Any] = list(show.dashboard._service.server.server_state.connections)
        delays = [line.transport.get_extra_info("socket") for line in lines]
        assert delays
        assert all(line.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) for line in delays)


def test_strangers_that_fill_the_stream_do_not_keep_an_operator_out(
    show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "MOST_VIEWERS", 2)
    address = f"ws://127.0.0.1:{show.dashboard.access.port}/live"
    with (
        connect(address),
        connect(address),
        connect(f"{address}?token={show.dashboard.access.reading}") as operator,
    ):
        assert '"Hello"' in str(operator.recv(LONG))


@pytest.mark.parametrize("said", [b"", b"GET / HT", HALF])
def test_a_request_that_does_not_come_is_not_waited_for(
    show: Show, monkeypatch: pytest.MonkeyPatch, said: bytes
) -> None:
    monkeypatch.setattr(connections, "REQUEST_DEADLINE", 0.05)
    monkeypatch.setattr(serving, "BODY_DEADLINE", 30.0)
    token = b"X-Pomona-Token: %b\r\nHost" % show.dashboard.access.token.encode()
    address = ("127.0.0.1", show.dashboard.access.port)
    with socket.create_connection(address, LONG) as slow, contextlib.suppress(ConnectionError):
        slow.send(said.replace(b"Host", token))
        assert (
            slow.recv(1000) == b""
        )  # closed without an answer; else this waits until the socket's own limit


@pytest.mark.parametrize(
    ("host", "port", "words"),
    [
        ("127.0.0.1", 80_000, "a port is a number from 0 to 65535"),
        ("127.0.0.1", -1, "a port is a number from 0 to 65535"),
        ("192.0.2.7", 8420, "this machine has no such address"),
        ("no such host", 8420, "cannot listen on no such host:8420"),
    ],
)
def test_an_address_that_cannot_be_listened_on_is_refused_with_the_reason(
    host: str, port: int, words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        serving.listen_on(host, port)


def test_a_taken_port_is_reported() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(UsageError, match="the port is taken"):
            serving.listen_on("127.0.0.1", other.getsockname()[1])


def test_the_server_ends_while_a_peer_closes_its_stream(show: Show) -> None:
    """The close frame is read in the turn of the loop in which the server ends."""
    server_ = show.dashboard._service.server
    assert server_ is not None
    with connect(f"ws://127.0.0.1:{show.dashboard.access.port}/live") as live:
        live.recv(LONG)
        (wire,) = [
            line
            for line in server_.server_state.connections
            if isinstance(line, connections.LiveWire)
        ]
        wire.conn.receive_data(Frame(Opcode.CLOSE, (1000).to_bytes(2, "big")).serialize(mask=True))
        show.dashboard.close()  # an error in the server's thread is an error of this test
    assert server_.server_state.connections == set()


def test_the_server_ends_after_a_malformed_request(show: Show) -> None:
    server_ = show.dashboard._service.server
    assert server_ is not None
    with socket.create_connection(("127.0.0.1", show.dashboard.access.port), LONG) as line:
        line.send(b"no request\r\n\r\n")
        assert b"400" in line.recv(100)
        show.dashboard.close()
    assert server_.server_state.connections == set()
