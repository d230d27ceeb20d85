"""Who may talk to the dashboard and who may act: hostile hosts, origins, tokens, paths, names and bodies."""

from __future__ import annotations

import argparse
import json
import socket
from pathlib import Path

import pytest
from recorded_events import FAILED, HOSTILE, foreign, write
from shown_runs import Show
from starlette.datastructures import Headers
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect
from websockets.exceptions import ConnectionClosedError
from websockets.sync.client import connect

from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import StateChanged
from pomona.tools.dashboard import server
from pomona.tools.dashboard.choices import Choices
from pomona.tools.dashboard.command_dashboard import Launcher, add_address, make_access
from pomona.tools.dashboard.security import Access
from pomona.tools.dashboard.server import Dashboard

HOST = "127.0.0.1:8420"


@pytest.fixture
def dashboard(tmp_path: Path) -> Dashboard:
    return Dashboard(Access("127.0.0.1", 8420), tmp_path)


@pytest.fixture
def client(dashboard: Dashboard) -> TestClient:
    return TestClient(dashboard.app, base_url=f"http://{HOST}")


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8420", "", ":8420", "127.0.0.1:9x", "127.0.0.1.evil:8420"],
)
def test_a_rebound_host_is_refused_on_http(client: TestClient, host: str) -> None:
    assert client.get("/api/runs", headers={"host": host}).status_code == 403


@pytest.mark.parametrize("host", ["127.0.0.1:8420", "localhost:8420", "[::1]:8420"])
def test_our_own_names_are_served(client: TestClient, host: str) -> None:
    assert client.get("/api/runs", headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "path", ["/api/runs", "/api/choices", "/api/remedies", "/api/runs/nothing/messages"]
)
def test_a_page_of_another_site_cannot_make_a_browser_read(client: TestClient, path: str) -> None:
    for site in ("cross-site", "same-site", "", "x"):
        assert client.get(path, headers={"sec-fetch-site": site}).status_code == 403, site
    for site in ("same-origin", "none"):
        assert client.get(path, headers={"sec-fetch-site": site}).status_code in (200, 404), site


def test_a_link_on_another_site_opens_the_page(client: TestClient) -> None:
    for path in ("/", "/static/app.js"):
        assert client.get(path, headers={"sec-fetch-site": "cross-site"}).status_code == 200


def test_a_tunnel_or_a_proxy_may_have_another_port_and_no_other_page_may_use_it(
    tmp_path: Path,
) -> None:
    dashboard = Dashboard(Access("127.0.0.1", 8420, names=("orchard.example",)), tmp_path)
    token, take = {"x-pomona-token": dashboard.access.token}, {"action": "take", "viewer": "v"}
    with TestClient(dashboard.app) as client:
        for host, origin, status in (
            ("localhost:9000", "http://localhost:9000", 200),  # ssh -L 9000:localhost:8420
            ("orchard.example", "https://orchard.example", 200),  # a proxy that keeps the name
            ("127.0.0.1:8420", "https://orchard.example", 200),  # one that does not
            ("localhost:8420", "http://localhost:3000", 403),  # another server on the same machine
            ("127.0.0.1:8420", "http://evil.example", 403),
        ):
            answer = client.post(
                "/api/act", json=take, headers={"host": host, "origin": origin, **token}
            )
            assert answer.status_code == status, (host, origin)


def test_bound_to_all_addresses_the_link_leads_here() -> None:
    access = Access("0.0.0.0", 8420, may_act=False)
    host = access.address.removeprefix("http://").rstrip("/")
    assert "0.0.0.0" not in host
    assert access.knows_host(Headers({"host": host}))
    assert access.knows_host(Headers({"host": f"{socket.gethostname()}:8420"}))
    assert not access.knows_host(Headers({"host": "evil.example:8420"}))


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "evil.example:8420"},
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://["},
    ],
)
def test_a_foreign_page_cannot_open_the_live_stream(
    client: TestClient, headers: dict[str, str]
) -> None:
    with (
        pytest.raises(WebSocketDisconnect) as refused,
        client.websocket_connect("/live", headers=headers),
    ):
        pass
    assert refused.value.code == 4403


@pytest.mark.parametrize("path", ["/api/act", "/api/start"])
def test_acting_needs_the_token(client: TestClient, path: str) -> None:
    for token in ("", "x", "wrong" * 10):
        answer = client.post(path, json={"action": "take"}, headers={"x-pomona-token": token})
        assert answer.status_code == 403
        assert "watch but not act" in answer.json()["error"]


def test_acting_needs_our_origin_and_json(client: TestClient, dashboard: Dashboard) -> None:
    token = {"x-pomona-token": dashboard.access.token}
    foreign = client.post("/api/act", json={}, headers={**token, "origin": "http://evil.example"})
    assert foreign.status_code == 403
    for origin in ("http://[", "http://[::1", "http://127.0.0.1:8420:8420", "//"):
        assert (
            client.post("/api/act", json={}, headers={**token, "origin": origin}).status_code == 403
        )
    form = client.post(
        "/api/act", content="action=take", headers={**token, "content-type": "text/plain"}
    )
    assert form.status_code == 415


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"{", 400), (b"[]", 400), (b'"x"', 400), (b'{"a":"' + b"x" * 20_000 + b'"}', 413),
        (b'{"a":' * 2000 + b"1" + b"}" * 2000, 400), (b'{"a":' * 300 + b"1" + b"}" * 300, 400), (b"\xff", 400),
        (b'{"action": "take", "viewer": "\\ud800"}', 400), (b'{"action": "take", "viewer": "v", "pressed": NaN}', 400),
        (b'{"action": "take", "viewer": "v", "number": 1e999}', 400),
    ],
)  # fmt: skip
def test_a_body_that_is_no_object_or_too_long_is_refused(
    client: TestClient, dashboard: Dashboard, body: bytes, status: int
) -> None:
    headers = {"x-pomona-token": dashboard.access.token, "content-type": "application/json"}
    assert client.post("/api/act", content=body, headers=headers).status_code == status
    assert dashboard.control.holder.who == ""  # nothing was carried out


def test_another_address_watches_with_the_token_and_does_not_act(tmp_path: Path) -> None:
    dashboard = Dashboard(Access("192.0.2.7", 8420, may_act=False), tmp_path)
    client = TestClient(dashboard.app, base_url="http://192.0.2.7:8420")
    token = dashboard.access.token
    assert client.get("/").status_code == 200
    assert client.get("/api/runs").status_code == 403
    assert client.get("/api/runs", headers={"x-pomona-token": "wrong"}).status_code == 403
    assert client.get("/api/runs", headers={"x-pomona-token": token}).status_code == 200
    with pytest.raises(WebSocketDisconnect) as refused, client.websocket_connect("/live"):
        pass
    assert refused.value.code == 4403
    reading = dashboard.access.reading
    with client.websocket_connect(
        f"/live?token={reading}", headers={"host": "192.0.2.7:8420"}
    ) as socket:
        assert socket.receive_json()["event"] == "Hello"
    assert client.get(f"/api/runs?token={reading}").status_code == 200
    assert (
        client.get(f"/api/runs?token={token}").status_code == 403
    )  # what acts is no part of an address
    answer = client.post("/api/act", json={"action": "take"}, headers={"x-pomona-token": token})
    assert answer.status_code == 403


@pytest.mark.parametrize(
    ("arguments", "acts"),
    [
        ([], True),
        (["--host", "192.0.2.7"], False),
        (["--host", "192.0.2.7", "--insecure-act"], True),
        (["--host", "192.0.2.7", "--tls-cert", "c.pem", "--tls-key", "k.pem"], True),
    ],
)
def test_another_address_acts_only_with_tls_or_the_explicit_flag(
    arguments: list[str], acts: bool
) -> None:
    parser = argparse.ArgumentParser()
    add_address(parser)
    access = make_access(parser.parse_args(arguments))
    assert access.may_act is acts
    assert access.address.startswith("https:") is ("--tls-cert" in arguments)


def test_a_certificate_needs_its_key_and_must_be_readable(tmp_path: Path) -> None:
    parser = argparse.ArgumentParser()
    add_address(parser)
    with pytest.raises(UsageError, match="belong together"):
        make_access(parser.parse_args(["--tls-cert", "c.pem"]))
    broken = tmp_path / "c.pem"
    broken.write_text("no certificate")
    dashboard = Dashboard(Access("127.0.0.1", 0, certificate=broken, key=broken), tmp_path)
    with pytest.raises(UsageError, match="cannot be used"):
        dashboard.start()


def test_reading_does_not_act(client: TestClient, dashboard: Dashboard) -> None:
    headers = {"x-pomona-token": dashboard.access.reading}
    assert client.post("/api/act", json={"action": "take"}, headers=headers).status_code == 403


def test_links_among_records_are_not_served(client: TestClient, dashboard: Dashboard) -> None:
    real = write(dashboard.records / "real", FAILED)
    (real / "picture.png").symlink_to("/etc/passwd")
    (dashboard.records / "trap").mkdir()
    (dashboard.records / "trap" / EVENTS_FILE).symlink_to("/etc/passwd")
    (dashboard.records / "elsewhere").symlink_to(real)
    for address in ("real/picture", "trap/record", "trap/messages", "elsewhere/record"):
        assert client.get(f"/api/runs/{address}").status_code == 404, address
    assert client.get("/api/runs/real/record").status_code == 200


def test_one_bad_record_does_not_take_the_list_down(
    client: TestClient, dashboard: Dashboard
) -> None:
    write(dashboard.records / "good", FAILED)
    for name, event in HOSTILE.items():
        foreign(dashboard.records / name, event)
    answer = client.get("/api/runs")
    assert answer.status_code == 200
    listed = {run["run"]: run for run in answer.json()}
    assert listed.keys() == {"good", *HOSTILE}
    assert listed["good"]["outcome"] == "failure"
    for name in HOSTILE:
        answer = client.get(f"/api/runs/{name}/messages?overview=1")
        assert answer.status_code == 200
        for line in answer.text.splitlines():
            json.loads(line, parse_constant=lambda word: pytest.fail(f"{word} stops a browser"))


def test_a_token_in_an_address_does_not_act(client: TestClient, dashboard: Dashboard) -> None:
    assert (
        client.post(f"/api/act?token={dashboard.access.token}", json={"action": "take"}).status_code
        == 403
    )


def test_viewers_beyond_the_limit_are_turned_away(
    client: TestClient, dashboard: Dashboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "MOST_VIEWERS", 1)
    headers = {"host": HOST}
    with client.websocket_connect("/live", headers=headers):
        with (
            pytest.raises(WebSocketDisconnect) as refused,
            client.websocket_connect("/live", headers=headers),
        ):
            pass
        assert refused.value.code == 4429


def test_only_offered_files_can_be_started(
    dashboard: Dashboard, client: TestClient, tmp_path: Path
) -> None:
    choices = Choices.installed()
    dashboard.allow_starts(Launcher(dashboard, tmp_path, choices).start, choices)
    headers = {"x-pomona-token": dashboard.access.token}
    form = {"viewer": "v", "who": "ada", "action": "take", "tree": "pick_apple"}
    assert (
        client.post("/api/start", json=form, headers=headers).status_code == 409
    )  # nobody holds control
    client.post("/api/act", json=form, headers=headers)
    for change in (
        {"tree": "/etc/passwd"}, {"tree": "../pick_apple"}, {"cell": "/dev/zero"}, {"seed": "1"}, {"settings": [1]},
        {"seed": -1}, {"seed": 2**63}, {"seed": True}, {"seed": None}, {"seed": 1.5},
        {"tree": None}, {"tree": ["pick_apple"]},
    ):  # fmt: skip
        answer = client.post("/api/start", json=form | change, headers=headers)
        assert answer.status_code == 409
        assert answer.json()["error"]
    offered = client.get("/api/choices").json()
    pick = next(tree for tree in offered["trees"] if tree["name"] == "pick_apple")
    assert {parameter["name"] for parameter in pick["parameters"]}
    sim = next(cell for cell in offered["cells"] if cell["name"] == "sim")
    assert {"name": "place", "default": "3", "help": "where it lies: 1 … 5"} in sim["options"]


@pytest.mark.parametrize(
    "name", ["..", "%2e%2e", "..%2f..%2fetc", "%2fetc%2fpasswd", "a%00b", ".", "nothing"]
)
def test_no_path_outside_the_records_can_be_read(
    client: TestClient, tmp_path: Path, name: str
) -> None:
    (tmp_path.parent / "run.mcap").write_bytes(b"secret")
    for what in (
        "messages",
        "messages?overview",
        "messages?begin=0&end=1",
        "record",
        "picture",
        "images/0",
    ):
        assert client.get(f"/api/runs/{name}/{what}").status_code in (404, 405)
    (tmp_path.parent / "run.mcap").unlink()


@pytest.mark.parametrize(
    "path", ["/static/../server.py", "/static/%2e%2e/server.py", "/static/..%2fserver.py"]
)
def test_static_files_stay_in_their_folder(client: TestClient, path: str) -> None:
    assert client.get(path).status_code == 404


def test_every_answer_carries_the_protective_headers(client: TestClient) -> None:
    for path in ("/", "/api/runs", "/static/app.js", "/nothing"):
        headers = client.get(path).headers
        assert "default-src 'self'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "DENY"


def test_hostile_text_from_a_run_travels_as_json_only(client: TestClient, tmp_path: Path) -> None:
    hostile = '</script><img src=x onerror="alert(1)">\u2028'
    (tmp_path / "run_1").mkdir()
    recorder = Recorder(tmp_path / "run_1")
    recorder.on_event(StateChanged(0.0, 0, "running", hostile))
    recorder.close()
    answer = client.get("/api/runs/run_1/messages")
    assert answer.headers["content-type"].startswith("application/x-ndjson")
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.json()["because"] == hostile


def test_the_page_builds_no_markup_from_text() -> None:
    static = Path(__file__).parents[4] / "executive" / "pomona" / "tools" / "dashboard" / "static"
    for script in (*static.glob("*.js"), *static.glob("panels/*.js")):
        text = script.read_text(encoding="utf-8")
        for sink in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval("):
            assert sink not in text, f"{script.name} uses {sink}"


def test_a_viewer_that_sends_bytes_gets_the_reason_of_its_closing(show: Show) -> None:
    address = show.dashboard.access.address.replace("http", "ws") + "live"
    with connect(address) as viewer:
        viewer.recv()
        viewer.send(b"\0\1")
        with pytest.raises(ConnectionClosedError):
            list(viewer)
    assert (viewer.close_code, viewer.close_reason) == (1003, "send text")


def test_a_viewer_that_sends_too_much_is_cut_off(show: Show) -> None:
    address = show.dashboard.access.address.replace("http", "ws") + "live"
    with connect(address) as viewer:
        assert json.loads(str(viewer.recv()).split("\n")[0])["event"] == "Hello"
        viewer.send("x" * (server.MOST_BODY + 1))
        with pytest.raises(ConnectionClosedError):
            list(viewer)
    assert viewer.close_code == 1009  # too big


@pytest.mark.parametrize("at", ["-1", "x", "1.5", "99999999999999999999999999", "8", "0"])
def test_an_image_is_an_image_of_the_record_or_nothing(
    client: TestClient, tmp_path: Path, at: str
) -> None:
    (tmp_path / "run_1").mkdir()
    recorder = Recorder(tmp_path / "run_1")
    recorder.on_event(StateChanged(0.0, 0, "running", "started"))
    recorder.close()
    assert client.get(f"/api/runs/run_1/images/{at}").status_code == 404


@pytest.mark.parametrize(
    "query",
    [
        "begin=x&end=y",
        "begin=nan&end=nan",
        "begin=-inf&end=inf",
        "begin=1",
        "overview=" * 99,
        "standing&begin=inf&end=inf",
        "standing&begin=1e308&end=0",
    ],
)
def test_odd_questions_about_a_record_do_no_harm(
    client: TestClient, tmp_path: Path, query: str
) -> None:
    (tmp_path / "run_1").mkdir()
    recorder = Recorder(tmp_path / "run_1")
    recorder.on_event(StateChanged(0.0, 0, "running", "started"))
    recorder.close()
    assert client.get(f"/api/runs/run_1/messages?{query}").status_code == 200
