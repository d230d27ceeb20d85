"""Who may talk to the dashboard and who may act: hostile hosts, origins, tokens, paths, names and bodies."""

from __future__ import annotations

from pathlib import Path

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from executive.dashboard.security import Access
from executive.dashboard.server import Dashboard
from executive.events import StateChanged
from executive.recording.recorder import Recorder

HOST = "127.0.0.1:8420"


@pytest.fixture
def dashboard(tmp_path: Path) -> Dashboard:
    return Dashboard(Access("127.0.0.1", 8420), tmp_path)


@pytest.fixture
def client(dashboard: Dashboard) -> TestClient:
    return TestClient(dashboard.app, base_url=f"http://{HOST}")


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8420", "127.0.0.1", "127.0.0.1:9", "127.0.0.1.evil:8420"]
)
def test_a_rebound_host_is_refused_on_http(client: TestClient, host: str) -> None:
    assert client.get("/api/runs", headers={"host": host}).status_code == 403


@pytest.mark.parametrize("host", ["127.0.0.1:8420", "localhost:8420", "[::1]:8420"])
def test_our_own_names_are_served(client: TestClient, host: str) -> None:
    assert client.get("/api/runs", headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "headers", [{"host": "evil.example:8420"}, {"origin": "http://evil.example"}, {"origin": "null"}]
)
def test_a_foreign_page_cannot_open_the_live_stream(client: TestClient, headers: dict[str, str]) -> None:
    with pytest.raises(WebSocketDisconnect) as refused, client.websocket_connect("/live", headers=headers):
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
    form = client.post("/api/act", content="action=take", headers={**token, "content-type": "text/plain"})
    assert form.status_code == 415


@pytest.mark.parametrize(
    ("body", "status"), [(b"{", 400), (b"[]", 400), (b'"x"', 400), (b'{"a":"' + b"x" * 20_000 + b'"}', 413)]
)
def test_a_body_that_is_no_object_or_too_long_is_refused(
    client: TestClient, dashboard: Dashboard, body: bytes, status: int
) -> None:
    headers = {"x-pomona-token": dashboard.access.token, "content-type": "application/json"}
    assert client.post("/api/act", content=body, headers=headers).status_code == status


def test_an_address_that_is_not_this_machine_watches_only(tmp_path: Path) -> None:
    dashboard = Dashboard(Access("192.0.2.7", 8420, may_act=False), tmp_path)
    client = TestClient(dashboard.app, base_url="http://192.0.2.7:8420")
    assert client.get("/api/runs").status_code == 200
    answer = client.post("/api/act", json={"action": "take"}, headers={"x-pomona-token": dashboard.access.token})
    assert answer.status_code == 403


@pytest.mark.parametrize("name", ["..", "%2e%2e", "..%2f..%2fetc", "%2fetc%2fpasswd", "a%00b", ".", "nothing"])
def test_no_path_outside_the_records_can_be_read(client: TestClient, tmp_path: Path, name: str) -> None:
    (tmp_path.parent / "run.mcap").write_bytes(b"secret")
    for what in ("messages", "record", "picture"):
        assert client.get(f"/api/runs/{name}/{what}").status_code in (404, 405)
    (tmp_path.parent / "run.mcap").unlink()


@pytest.mark.parametrize("path", ["/static/../server.py", "/static/%2e%2e/server.py", "/static/..%2fserver.py"])
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
    recorder.hear(StateChanged(0.0, 0, "running", hostile))
    recorder.close()
    answer = client.get("/api/runs/run_1/messages")
    assert answer.headers["content-type"].startswith("application/x-ndjson")
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.json()["because"] == hostile


def test_the_page_builds_no_markup_from_text() -> None:
    static = Path(__file__).parents[3] / "executive" / "dashboard" / "static"
    for script in static.glob("*.js"):
        text = script.read_text(encoding="utf-8")
        for sink in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval("):
            assert sink not in text, f"{script.name} uses {sink}"
