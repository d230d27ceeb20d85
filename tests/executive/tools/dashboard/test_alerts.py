"""A webhook hears of it once when fewer runs succeed than should, and no run ever waits for it."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.reasons import Reason
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import RunEnded, RunStarted
from pomona.tools.dashboard import alerts as module
from pomona.tools.dashboard.alerts import AlertRule, Alerts, outcomes_in

LONG = 60.0
"""Seconds that a busy machine may take."""


class Hook:
    """A local HTTP server that keeps the posted messages; `silent` makes it answer nothing."""

    def __init__(self) -> None:
        self.posted: list[dict[str, Any]] = []
        self.fetched: list[str] = []
        self.moved_to = ""
        self.asked = threading.Semaphore(0)
        self.silent = threading.Event()
        hook = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                hook.fetched.append(self.path)
                self.send_response(204)
                self.end_headers()

            def do_POST(self) -> None:
                hook.posted.append(json.loads(self.rfile.read(int(self.headers["content-length"]))))
                hook.asked.release()
                if hook.silent.is_set():
                    hook.go.wait(LONG)
                self.send_response(302 if hook.moved_to else 204)
                if hook.moved_to:
                    self.send_header("location", hook.moved_to)
                self.end_headers()

            def log_message(self, format: str, *args: Any) -> None:
                """Print nothing."""

        self.go = threading.Event()
        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self.server.server_port}/hook"
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()


@pytest.fixture
def hook() -> Iterator[Hook]:
    hook = Hook()
    yield hook
    hook.go.set()
    hook.server.shutdown()
    hook.server.server_close()


def ended(good: bool) -> RunEnded:
    reason = None if good else Reason("a", "GAVE_UP", "x", {}, (Reason("a/b", "SLIPPED", "y"),))
    return RunEnded(1.0, 50, "success" if good else "failure", reason, 50, 1.0, 1.0, None)


def started(run: str) -> RunStarted:
    return RunStarted(
        0.0,
        0,
        run,
        "tree",
        "t.yaml",
        "",
        "",
        "fake",
        "mock",
        "c.yaml",
        "",
        0,
        {},
        (),
        {},
        1.0 + len(run),
        0.02,
    )


def feed(alerts: Alerts, outcomes: str) -> int:
    tellers = [alerts.take(ended(outcome == "+")) for outcome in outcomes]
    for teller in tellers:
        if teller is not None:
            teller.join(LONG)
    return sum(teller is not None for teller in tellers)


def test_a_falling_rate_is_reported_once_until_it_has_risen_again(hook: Hook) -> None:
    alerts = Alerts(AlertRule(hook.address, below=0.75, over=4))
    assert feed(alerts, "---") == 0  # too few to say anything
    assert feed(alerts, "+") == 1
    assert feed(alerts, "--") == 0  # it is known
    assert feed(alerts, "++++-") == 0  # three of four is enough
    assert feed(alerts, "-") == 1
    first, second = hook.posted
    assert first["success_rate"] == 0.25
    assert first["failures"] == {"SLIPPED": 3}
    assert (
        first["text"]
        == "Pomona: 25% of the last 4 runs succeeded, less than 75%; failures: SLIPPED 3×"
    )
    assert second["success_rate"] == 0.5


def test_no_run_waits_for_a_webhook_that_does_not_answer(
    hook: Hook, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "PATIENCE", LONG)
    hook.silent.set()
    teller = Alerts(AlertRule(hook.address, below=1.0, over=1)).take(ended(False))
    assert teller is not None
    assert teller.is_alive()  # the run goes on, and nothing was answered yet
    hook.go.set()
    teller.join(LONG)
    assert len(hook.posted) == 1
    assert hook.address not in caplog.text  # another test's alert may be given up meanwhile


def test_a_webhook_that_does_not_answer_is_asked_again_when_the_next_run_ends(
    hook: Hook, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.05)
    hook.silent.set()
    alerts = Alerts(AlertRule(hook.address, below=1.0, over=1))
    assert feed(alerts, "-") == 1
    assert "the alert was not taken" in caplog.text
    monkeypatch.setattr(module, "PATIENCE", LONG)
    hook.silent.clear()
    hook.go.set()
    assert feed(alerts, "-+") == 1
    assert len(hook.posted) == 2
    assert feed(alerts, "-") == 1  # it had risen again


def test_an_alert_follows_no_redirect(hook: Hook, caplog: pytest.LogCaptureFixture) -> None:
    hook.moved_to = hook.address.replace("/hook", "/inside")  # of the network behind the address
    assert feed(Alerts(AlertRule(hook.address, below=1.0, over=1)), "-") == 1
    assert (len(hook.posted), hook.fetched) == (1, [])
    assert "the alert was not taken" in caplog.text
    assert "302" in caplog.text


@pytest.mark.parametrize(
    "said", ["HTTP/1.1 500 no\r\ncontent-length: 0\r\n\r\n", "hello?\r\n\r\n", ""]
)
def test_any_answer_of_a_webhook_is_reported_and_nothing_else_happens(
    said: str, caplog: pytest.LogCaptureFixture
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            with contextlib.suppress(OSError):  # the test is over
                while True:
                    with server.accept()[0] as asked:
                        asked.recv(65_536)
                        asked.sendall(said.encode())

        threading.Thread(target=answer, daemon=True).start()
        teller = Alerts(AlertRule(f"http://127.0.0.1:{server.getsockname()[1]}", 1.0, 1)).take(
            ended(False)
        )
        assert teller is not None
        teller.join(LONG)
    assert "the alert was not taken by http://127.0.0.1" in caplog.text


def test_an_unreachable_webhook_is_reported_without_a_traceback(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    teller = Alerts(AlertRule(f"http://127.0.0.1:{port}", 1.0, 1)).take(ended(False))
    assert teller is not None
    teller.join(LONG)
    assert "Connection refused" in caplog.text


def test_a_run_that_ends_otherwise_than_it_seemed_counts_once(hook: Hook) -> None:
    alerts = Alerts(AlertRule(hook.address, below=0.5, over=2), before=[(True, "")])
    alerts.take(started("one"))
    assert alerts.take(ended(True)) is None
    assert (
        alerts.take(ended(False)) is None
    )  # its record was lost: an error after all; one of two is not yet too few
    alerts.take(started("two"))
    teller = alerts.take(ended(False))
    assert teller is not None
    alerts.wait()
    (told,) = hook.posted
    assert (told["success_rate"], told["failures"], told["last_run"]) == (
        0.0,
        {"SLIPPED": 2},
        "two",
    )


def test_runs_of_other_processes_count_killed_ones_too_and_a_rate_that_is_low_already_is_told(
    tmp_path: Path, hook: Hook
) -> None:
    for n, good in enumerate((True, False, False)):
        folder = tmp_path / f"2026-11-2{n}"
        folder.mkdir()
        recorder = Recorder(folder)
        recorder.on_event(started(folder.name))
        if n < 2:
            recorder.on_event(ended(good))
        recorder.close()
    before = outcomes_in(tmp_path, 3)
    assert before == [(True, ""), (False, "GAVE_UP"), (False, "")]
    for over, tells in ((3, True), (4, True), (5, False)):
        teller = Alerts(AlertRule(hook.address, 0.5, over), before).count(False, "X", "run")
        assert (teller is not None) is tells


def test_a_run_from_the_command_line_sends_alerts_too(tmp_path: Path, hook: Hook) -> None:
    tree = tmp_path / "bad.yaml"
    tree.write_text(
        "pomona: 1\ntree: bad\nroot:\n  fail: {code: BLOCKED, message: x}\n", encoding="utf-8"
    )
    alert = ["--alert-to", hook.address, "--alert-over", "2"]
    order = ["run", str(tree), "--dry", "--quiet", "--record", str(tmp_path / "runs"), *alert]
    assert [main(order), len(hook.posted)] == [1, 0]
    assert [main(order), len(hook.posted)] == [1, 1]
    assert hook.posted[0]["failures"] == {"BLOCKED": 2}


@pytest.mark.parametrize(
    ("address", "below", "over"),
    [
        ("ftp://a/b", 0.5, 3),
        ("file:///etc/passwd", 0.5, 3),
        ("http://", 0.5, 3),
        ("http://a", 0.0, 3),
        ("http://a", 0.5, 0),
        ("http://a:port/", 0.5, 3),
        ("http://[::1/", 0.5, 3),
        ("http://a b/", 0.5, 3),
        ("http://a/\r\nx: y", 0.5, 3),
    ],
)
def test_a_rule_that_makes_no_sense_is_refused(address: str, below: float, over: int) -> None:
    with pytest.raises(UsageError):
        AlertRule(address, below, over)
