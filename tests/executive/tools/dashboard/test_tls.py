"""Another address than this machine's own: TLS with a test certificate, and the refusals without it.

127.0.0.2 is not this machine's usual name, so the rules for other addresses hold there; no packet leaves the machine.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import socket
import ssl
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import trustme
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from pomona.tools.dashboard.command_dashboard import add_address, make_access
from pomona.tools.dashboard.server import Dashboard
from tests.executive.loops import in_loop

ADDRESS = "127.0.0.2"
Serve = Callable[..., Dashboard]


@pytest.fixture(scope="module")
def authority() -> trustme.CA:
    return trustme.CA()


@pytest.fixture
def trusting(authority: trustme.CA) -> ssl.SSLContext:
    """A client that knows who signed our certificate."""
    context = ssl.create_default_context()
    authority.configure_trust(context)
    return context


@pytest.fixture
def certificate(authority: trustme.CA, tmp_path: Path) -> list[str]:
    """The options that name a certificate for the address."""
    issued = authority.issue_cert(ADDRESS)
    issued.cert_chain_pems[0].write_to_path(tmp_path / "cert.pem")
    issued.private_key_pem.write_to_path(tmp_path / "key.pem")
    return ["--tls-cert", str(tmp_path / "cert.pem"), "--tls-key", str(tmp_path / "key.pem")]


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    """A dashboard on the other address, with options of the command line."""
    served: list[Dashboard] = []

    def start(*options: str) -> Dashboard:
        with socket.socket() as free:
            free.bind((ADDRESS, 0))
            port = free.getsockname()[1]
        parser = argparse.ArgumentParser()
        add_address(parser)
        access = make_access(parser.parse_args(["--host", ADDRESS, "--port", str(port), *options]))
        served.append(Dashboard(access, tmp_path))
        served[-1].start()
        return served[-1]

    yield start
    for dashboard in served:
        dashboard.close()


def ask(
    dashboard: Dashboard,
    path: str,
    *,
    token: bool = True,
    body: Any = None,
    context: ssl.SSLContext | None = None,
) -> int:
    """The status of an answer."""
    headers = {"x-pomona-token": dashboard.access.token} if token else {}
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(
        dashboard.access.address.rstrip("/") + path,
        data,
        {**headers, "content-type": "application/json"},
    )
    try:
        with urllib.request.urlopen(request, timeout=60.0, context=context) as answer:
            status: int = answer.status
            return status
    except urllib.error.HTTPError as refused:
        refused.close()
        return refused.code


def first_word(address: str, context: ssl.SSLContext) -> str:
    """The first event of a live stream.

    With asyncio: the library's client with threads reads and writes one TLS connection in two of them, and may wait
    for ever under load.
    """

    async def listen() -> str:
        async with connect(address, ssl=context) as stream:
            event: str = json.loads(str(await stream.recv()).split("\n")[0])["event"]
            return event

    return in_loop(asyncio.wait_for(listen(), 30.0))


TAKE = {"viewer": "v", "who": "ada", "action": "take"}


def test_with_tls_another_address_watches_and_acts_with_the_token(
    serve: Serve, certificate: list[str], trusting: ssl.SSLContext
) -> None:
    dashboard = serve(*certificate)
    assert dashboard.link.startswith("https://127.0.0.2:")
    assert ask(dashboard, "/", token=False, context=trusting) == 200
    assert ask(dashboard, "/api/runs", token=False, context=trusting) == 403
    assert ask(dashboard, "/api/runs", context=trusting) == 200
    assert ask(dashboard, "/api/act", token=False, body=TAKE, context=trusting) == 403
    assert ask(dashboard, "/api/act", body=TAKE, context=trusting) == 200
    assert dashboard.control.holder.who == "ada"
    live = dashboard.access.address.replace("https", "wss") + "live"
    assert first_word(f"{live}?token={dashboard.access.reading}", trusting) == "Hello"
    with pytest.raises(InvalidStatus):
        first_word(live, trusting)


def test_a_client_without_the_certificate_is_warned_and_plain_http_gets_nothing(
    serve: Serve, certificate: list[str]
) -> None:
    dashboard = serve(*certificate)
    with pytest.raises(urllib.error.URLError, match="certificate verify failed"):
        ask(dashboard, "/")
    plain = urllib.request.Request(dashboard.access.address.replace("https", "http"))
    with pytest.raises(OSError, match=r"."):
        urllib.request.urlopen(plain, timeout=60.0)


def test_the_end_waits_for_no_farewell_and_leaves_no_connection_open(
    serve: Serve, certificate: list[str], trusting: ssl.SSLContext
) -> None:
    dashboard = serve(*certificate)
    address = (ADDRESS, dashboard.access.port)
    with (
        socket.create_connection(address, 60.0) as plain,
        trusting.wrap_socket(plain, server_hostname=ADDRESS) as line,
    ):
        line.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.2:%d\r\n\r\n" % address[1])
        assert line.recv(12) == b"HTTP/1.1 200"
        assert dashboard._service.server is not None
        assert len(dashboard._service.server.server_state.connections) == 1
        dashboard.close()
        assert dashboard._service.server.server_state.connections == set()


def test_the_end_tolerates_a_page_that_is_closing_without_a_close_message(
    serve: Serve, certificate: list[str], trusting: ssl.SSLContext
) -> None:
    dashboard = serve(*certificate)
    address = (ADDRESS, dashboard.access.port)
    with (
        socket.create_connection(address, 60.0) as plain,
        trusting.wrap_socket(plain, server_hostname=ADDRESS) as line,
    ):
        line.sendall(
            b"GET /live?token=%s HTTP/1.1\r\nHost: 127.0.0.2:%d\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
            b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
            % (dashboard.access.reading.encode(), address[1])
        )
        assert line.recv(12) == b"HTTP/1.1 101"
        line.sendall(
            bytes([0x88, 0x82, 0, 0, 0, 0]) + (1000).to_bytes(2, "big")
        )  # a close frame, and no TLS farewell
        assert dashboard._service.server is not None
        open_connections = dashboard._service.server.server_state.connections
        while not all(connection.transport.is_closing() for connection in list(open_connections)):
            assert dashboard._service.server.started
        assert len(open_connections) == 1
        dashboard.close()  # an error in the server's thread is an error of this test
        assert open_connections == set()


@pytest.mark.parametrize(("options", "status"), [((), 403), (("--insecure-act",), 200)])
def test_without_tls_another_address_acts_only_with_the_explicit_flag(
    serve: Serve, options: tuple[str, ...], status: int
) -> None:
    dashboard = serve(*options)
    assert ask(dashboard, "/api/runs") == 200
    assert ask(dashboard, "/api/act", body=TAKE) == status


@pytest.mark.browser
def test_a_browser_works_over_tls(serve: Serve, certificate: list[str], chromium: Any) -> None:
    from playwright.sync_api import expect

    dashboard = serve(*certificate)
    context = chromium.new_context(
        ignore_https_errors=True
    )  # nobody has told Chromium of our authority
    page = context.new_page()
    page.goto(dashboard.link)
    expect(page.locator("#connection")).to_have_text("connected")
    page.get_by_label("your name").fill("ada")
    page.get_by_role("button", name="Take control").click()
    expect(page.locator("#holder")).to_have_text("You hold control.")
    assert "token" not in page.url
    context.close()
