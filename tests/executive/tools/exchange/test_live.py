"""Live views: the same messages as the record's, dropped rather than waited for, and never the end of a run."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_events import contents, everything, record, started

from pomona.executive.cli import main
from pomona.executive.encode import encoded
from pomona.executive.recording.schemas import Schema
from pomona.executive.running.events import NodeChanged, Published
from pomona.executive.views import ImageView
from pomona.tools.exchange import live as live_module
from pomona.tools.exchange.live import MOST, Live
from pomona.tools.ros2.run_view import Ros2RunView

BEGAN = 10**18


class Shown:
    """A sink that keeps its input."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, str, Any, int]] = []
        self.pictures: list[tuple[str, ImageView, int]] = []
        self.closed = False

    def send(self, topic: str, schema: Schema, content: Mapping[str, Any], stamp: int) -> None:
        self.messages.append((topic, schema.name, json.loads(encoded(content)), stamp))

    def show(self, topic: str, view: ImageView, stamp: int) -> None:
        self.pictures.append((topic, view, stamp))

    def rest(self) -> None:
        pass

    def close(self) -> None:
        self.closed = True


def timeless(message: Any) -> Any:
    """Without the messages' own times: a record's are the run's clock, live ones the world's."""
    if isinstance(message, dict):
        return {key: timeless(value) for key, value in message.items() if key != "timestamp"}
    return [timeless(item) for item in message] if isinstance(message, (list, tuple)) else message


def test_a_view_gets_the_events_of_the_record_in_their_order(tmp_path: Path) -> None:
    shown = Shown()
    live = Live(shown)
    for event in everything():
        live.on_event(event)
    live.read(0.8, 12, {"arm": {"stamp_s": np.array([0.1, 0.2]), "q_1_rad": np.array([0.0, 0.5])}})
    live.close()
    kept = [(t, name, c) for t, name, _s, c in contents(record(tmp_path, everything()))]
    recorded = [m for m in kept if not m[0].startswith(("/images", "/depth"))]
    told = [(topic, name, content) for topic, name, content, _stamp in shown.messages]
    for topic in {m[0] for m in recorded}:
        live_ones = [timeless(m) for m in told if m[0] == topic]
        assert live_ones == [timeless(m) for m in recorded if m[0] == topic], topic
    assert shown.closed
    assert [topic for topic, _view, _stamp in shown.pictures] == ["detection"]
    assert shown.messages[0][3] == BEGAN
    assert live.dropped == 0


def test_a_viewer_that_hangs_costs_the_tick_nothing_and_its_gap_is_reported(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_module, "CLOSING", 0.1)
    hung = threading.Event()

    class Hangs(Shown):
        def send(self, *_arguments: Any) -> None:
            hung.wait()  # who waited for it would wait for ever

    live = Live(Hangs())
    live.on_event(started())
    for k in range(3 * MOST):
        live.on_event(NodeChanged(0.1, k, "a", "RUNNING", "", 1))
    assert live.dropped >= 2 * MOST - 10
    hung.set()
    with caplog.at_level(logging.WARNING):
        live.close()
    assert "a live view could not follow" in caplog.text


def test_a_view_that_fails_is_reported_once_and_asked_no_more(
    caplog: pytest.LogCaptureFixture,
) -> None:
    class Fails(Shown):
        tried = 0

        def send(self, *_arguments: Any) -> None:
            self.tried += 1
            raise OSError("the viewer is gone")

    sink = Fails()
    live = Live(sink)
    for event in everything():
        live.on_event(event)
    live.close()
    assert sink.tried == 2  # the event, and the error in its place
    assert caplog.text.count("Fails shows no more: the viewer is gone") == 1


class Evil:
    """Raises at every access."""

    def __repr__(self) -> str:
        raise SystemExit("evil")

    __str__ = __repr__


class Codes(Shown):
    """A sink that codes pictures."""

    def show(self, topic: str, view: ImageView, stamp: int) -> None:
        if view.image is None or not view.image.size:
            raise ValueError("no pixels")
        super().show(topic, view, stamp)


@pytest.mark.parametrize(
    ("sink", "told"),
    [
        (Codes(), ["RunStarted", "ErrorRaised", "ErrorRaised", "ErrorRaised", "NodeChanged"]),
        (Shown(), ["RunStarted", "ErrorRaised", "Published", "ErrorRaised", "NodeChanged"]),
    ],
)
def test_a_value_that_cannot_be_shown_is_replaced_by_its_reason_and_the_view_goes_on(
    sink: Shown, told: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    live = Live(sink)
    live.on_event(started())
    live.on_event(Published(0.5, 7, "a/Look", "evil", Evil()))
    live.on_event(Published(0.5, 7, "a/Look", "seen", ImageView(np.zeros((0, 0, 3), np.uint8))))
    live.read(0.6, 8, {"arm": Evil()})  # type: ignore[dict-item]
    live.on_event(NodeChanged(0.7, 9, "a/Look", "SUCCESS", "", 1))
    live.close()
    assert caplog.text == ""
    events = [m[2] for m in sink.messages if m[0] == "/events"]
    assert [m["event"] for m in events] == told
    reasons = [m["message"] for m in events if m["event"] == "ErrorRaised"]
    assert reasons[0] == "'evil' of a/Look cannot be encoded: SystemExit: evil"
    assert (
        reasons[-1] == "measurements of the run cannot be encoded: 'Evil' object is not a mapping"
    )
    assert len(reasons) == 2 or reasons[1] == "'seen' of a/Look cannot be encoded: no pixels"


# ------------------------------------------------------------------------------------------------- commands

OPTIONS = ("exchange", "ros2", "run_view")  # modules of packages whose options `pomona run` lists
EXTRAS = (
    "rosbags",
    "zenoh",
    "pyarrow",
    "pomona.tools.exchange",
    "pomona.tools.ros2",
)


@pytest.mark.slow
def test_a_run_that_does_not_ask_imports_no_more_than_the_options(tmp_path: Path) -> None:
    (tmp_path / "tree.yaml").write_text("pomona: 1\ntree: rest\nroot:\n  wait: 100 ms\n")
    program = (
        "import sys; from pomona.executive.cli import main; status = main(['run', 'tree.yaml', '--dry', '--quiet']);"
        "import pomona.executive.cell.cell, pomona.tools.library.command_runs;"
        f"found = [n for n in sys.modules if n.startswith({EXTRAS!r}) and not n.endswith({OPTIONS!r})];"
        "print(found); sys.exit(status)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip()) == (0, "[]"), done.stderr


def test_a_run_shows_itself_where_it_is_asked_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = Shown()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tree.yaml").write_text("pomona: 1\ntree: rest\nroot:\n  wait: 100 ms\n")
    monkeypatch.setattr(Ros2RunView, "sink", lambda *_asked: shown)
    assert main(["run", "tree.yaml", "--dry", "--quiet"]) == 0
    names = [
        content["event"] for topic, _schema, content, _stamp in shown.messages if topic == "/events"
    ]
    assert (names[0], names[-1], shown.closed) == ("RunStarted", "RunEnded", True)
