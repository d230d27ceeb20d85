"""A webhook hears of it once when fewer runs succeed than should, and no run ever waits for it."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from executive.dashboard import alerts as module
from executive.dashboard.alerts import AlertRule, Alerts
from executive.errors import UsageError
from executive.reasons import Reason
from executive.running.events import RunEnded


class Hook:
    """A local HTTP server that keeps what is posted; `silent` makes it answer nothing."""

    def __init__(self) -> None:
        self.posted: list[dict[str, Any]] = []
        self.silent = threading.Event()
        hook = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                hook.posted.append(json.loads(self.rfile.read(int(self.headers["content-length"]))))
                if hook.silent.is_set():
                    hook.go.wait(5.0)
                self.send_response(204)
                self.end_headers()

            def log_message(self, format: str, *args: Any) -> None:
                """Say nothing."""

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


def feed(alerts: Alerts, outcomes: str) -> int:
    tellers = [alerts.take(ended(outcome == "+")) for outcome in outcomes]
    for teller in tellers:
        if teller is not None:
            teller.join(5.0)
    return sum(teller is not None for teller in tellers)


def test_a_rate_that_falls_is_told_once_until_it_has_risen_again(hook: Hook) -> None:
    alerts = Alerts(AlertRule(hook.address, below=0.75, over=4))
    assert feed(alerts, "---") == 0  # too few to say anything
    assert feed(alerts, "+") == 1
    assert feed(alerts, "--") == 0  # it is known
    assert feed(alerts, "++++-") == 0  # three of four is enough
    assert feed(alerts, "-") == 1
    first, second = hook.posted
    assert first["success_rate"] == 0.25
    assert first["failures"] == {"SLIPPED": 3}
    assert first["text"] == "Pomona: 25% of the last 4 runs succeeded, less than 75%; failures: SLIPPED 3×"
    assert second["success_rate"] == 0.5


def test_no_run_waits_for_a_webhook_that_does_not_answer(
    hook: Hook, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.05)
    monkeypatch.setattr(module, "TRIES", 2)
    hook.silent.set()
    alerts = Alerts(AlertRule(hook.address, below=1.0, over=1))
    began = time.perf_counter()
    teller = alerts.take(ended(False))
    assert time.perf_counter() - began < 0.05
    assert teller is not None
    teller.join(5.0)
    assert len(hook.posted) == 2
    assert "the alert was not taken" in caplog.text


@pytest.mark.parametrize(
    ("address", "below", "over"),
    [
        ("ftp://a/b", 0.5, 3),
        ("file:///etc/passwd", 0.5, 3),
        ("http://", 0.5, 3),
        ("http://a", 0.0, 3),
        ("http://a", 0.5, 0),
    ],
)
def test_a_rule_that_makes_no_sense_is_refused(address: str, below: float, over: int) -> None:
    with pytest.raises(UsageError):
        AlertRule(address, below, over)
