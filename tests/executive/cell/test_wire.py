"""Bytes of a device: a TCP connection, addresses, and bytes that are no message."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import pytest

from pomona.executive.cell import owner
from pomona.executive.cell.owner import Address, Malformed, Nonsense, TcpLink, tcp_opener
from pomona.executive.values.yaml_nodes import Unfit


@pytest.fixture
def peer() -> Iterator[tuple[TcpLink, socket.socket]]:
    """A link, and the device's end."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = TcpLink("127.0.0.1", server.getsockname()[1], 1.0)
        device, _ = server.accept()
        with device:
            yield link, device
        link.close()


def test_bytes_go_both_ways_at_once(peer: tuple[TcpLink, socket.socket]) -> None:
    link, device = peer
    link.send(b"question")
    assert device.recv(99) == b"question"
    device.sendall(b"answer")
    assert link.receive(5.0) == b"answer"
    assert link._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) != 0


def test_without_bytes_it_waits_as_long_as_it_may(peer: tuple[TcpLink, socket.socket]) -> None:
    link, _device = peer
    began = time.monotonic()
    assert link.receive(0.05) == b""
    assert time.monotonic() - began >= 0.045
    began = time.monotonic()
    assert link.receive(-1.0) == b""
    assert time.monotonic() - began < 0.045


def test_a_peer_that_does_not_read_or_has_gone_is_an_error(
    peer: tuple[TcpLink, socket.socket],
) -> None:
    link, device = peer
    began = time.monotonic()
    with pytest.raises(OSError, match="timed out"):
        link.send(b"x" * 50_000_000)
    assert time.monotonic() - began < 2.0
    device.close()
    with pytest.raises(OSError, match=r"closed the connection|reset"):
        link.receive(1.0)
    link.close()
    link.close()  # again is harmless


def test_a_closed_link_ends_the_peers_connection(peer: tuple[TcpLink, socket.socket]) -> None:
    link, device = peer
    link.close()
    device.settimeout(5.0)
    assert device.recv(9) == b""


@pytest.mark.parametrize(
    ("received", "words"),
    [
        (b"", "bad: no byte"),
        (b"\x01\xab", "bad: 01 ab"),
        (bytes(32), "bad: " + " ".join(["00"] * 32)),
        (bytes(33), "bad: " + " ".join(["00"] * 32) + " …"),
        (b"HTTP/1.1 400 Bad", "bad: a web server (HTTP) answers there"),
        (b"\r\n<!DOCTYPE html>", "bad: a web server (HTTP) answers there"),
        (b"  <html>", "bad: a web server (HTTP) answers there"),
        (b"my HTTP/1", "bad: 6d 79 20 48 54 54 50 2f 31"),
    ],
)
def test_bytes_that_are_no_message_are_shown(received: bytes, words: str) -> None:
    malformed = Malformed(received, "bad")
    assert str(malformed) == words
    assert Nonsense("arm", malformed).message == f"answered nonsense: {words}"
    assert malformed.received == Nonsense("arm", malformed).received == received


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("10.0.0.255", ("10.0.0.255", 502)),
        (" robot-1.local:1 ", ("robot-1.local", 1)),
        ("robot:65535", ("robot", 65535)),
        ("[::1]", ("::1", 502)),
        ("[fe80:0::1]:80", ("fe80::1", 80)),
        ("1a:5", ("1a", 5)),
        ("a_b", ("a_b", 502)),
    ],
)
def test_an_address_is_a_host_and_a_port(text: str, address: tuple[str, int]) -> None:
    assert Address(502).parse(text) == address
    assert Address(502).plain_schema()["examples"] == ["192.168.1.2:502"]


@pytest.mark.parametrize(
    "text",
    ["", ":502", "robot:0", "robot:65536", "robot:123456", "10.0.0.256", "10.0.0", "1.2.3.4.5", "::1",
     "[::g]", "[robot]", "a b", "robot:", "robot:x"],
)  # fmt: skip
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(Unfit, match="write HOST, HOST:PORT"):
        Address(502).parse(text)


def test_a_wire_of_the_same_address_is_taken_instead_of_tcp(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    opened: list[tuple[str, int]] = []
    monkeypatch.setattr(owner, "TcpLink", lambda *address: opened.append(address))
    wire: list[str] = []
    wires = {"robot:502": lambda: wire.append("wire")}
    tcp_opener("robot", 502, wires)()  # type: ignore[arg-type]
    tcp_opener("robot", 503, wires)()  # type: ignore[arg-type]
    tcp_opener("other", 502, wires)()  # type: ignore[arg-type]
    assert wire == ["wire"]
    assert opened == [("robot", 503), ("other", 502)]
