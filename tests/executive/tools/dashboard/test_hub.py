"""From the tick to the viewers: order, late joiners, resuming, and viewers that stop reading."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from pomona.executive.running.events import NodeChanged, Published, RunStarted, StateChanged
from pomona.executive.views import ImageView
from pomona.tools.dashboard import hub as hub_module, messages as messages_module
from pomona.tools.dashboard.hub import BACKLOG, Hub, Viewer
from pomona.tools.dashboard.messages import message
from tests.executive.loops import in_loop


def started() -> RunStarted:
    return RunStarted(
        0.0, 0, "run", "tree", "tree.yaml", "", "", "sim", "simulated", "sim.yaml", "", 0, {}, (), {}, 0.0, 0.02
    )  # fmt: skip


def waiting(viewer: Viewer) -> list[dict[str, Any]]:
    """Return the waiting messages of a viewer, without the greeting."""
    messages = [json.loads(line) for batch in viewer.waiting for line in batch.split("\n")]
    return [message for message in messages if message["event"] != "Hello"]


@pytest.fixture
def hub() -> Iterator[Hub]:
    hub = Hub()
    yield hub
    hub.close()


def test_a_late_viewer_gets_the_run_from_its_start_in_order(hub: Hub) -> None:
    hub.on_event(started())
    for tick in range(5):
        hub.on_event(StateChanged(tick * 0.02, tick, "running", ""))
    hub.close()
    messages = waiting(hub.join())
    assert [message["event"] for message in messages] == ["RunStarted"] + ["StateChanged"] * 5
    assert [message["seq"] for message in messages] == [1, 2, 3, 4, 5, 6]


def test_a_viewer_that_comes_back_gets_only_the_missed_messages(hub: Hub) -> None:
    hub.on_event(started())
    for tick in range(5):
        hub.on_event(StateChanged(0.0, tick, "running", ""))
    hub.close()
    assert [message["seq"] for message in waiting(hub.join(4, hub.stream))] == [5, 6]


def test_numbers_of_another_process_or_an_earlier_run_mean_nothing(hub: Hub) -> None:
    hub.on_event(started())
    hub.on_event(StateChanged(0.0, 0, "running", ""))
    hub.on_event(started())
    hub.on_event(StateChanged(0.0, 0, "running", ""))
    hub.close()
    for viewer in (hub.join(2, hub.stream), hub.join(4, "another")):
        assert [message["event"] for message in waiting(viewer)] == ["RunStarted", "StateChanged"]


def test_an_hour_of_messages_stays_small_and_leaves_each_last_word(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(hub_module, "HISTORY_BYTES", 20_000)
    hub = Hub()
    hub.on_event(started())
    hub.on_event(NodeChanged(0.0, 0, "early", "SUCCESS", "", 1))
    for tick in range(2_000):
        hub.on_event(NodeChanged(0.0, tick, "busy", "RUNNING", str(tick), 1))
    hub.close()
    messages = waiting(hub.join())
    assert len(messages) < 300
    assert messages[0]["event"] == "RunStarted"
    assert any(message.get("path") == "early" for message in messages)
    assert messages[-1]["feedback"] == "1999"
    assert (
        waiting(hub.join(5, hub.stream)) == messages
    )  # too far behind for a gapless rest: the whole state


def test_only_the_newest_picture_of_a_topic_is_kept(hub: Hub) -> None:
    hub.on_event(started())
    for tick in range(4):
        image = np.full((8, 8, 3), tick, np.uint8)
        hub.on_event(Published(0.0, tick, "n", "camera", ImageView(image)))
    hub.close()
    pictures = [message for message in waiting(hub.join()) if message["event"] == "Published"]
    assert [picture["tick"] for picture in pictures] == [3]
    assert pictures[0]["value"]["image"].startswith("data:image/jpeg;base64,")


def test_a_new_run_replaces_the_old_one(hub: Hub) -> None:
    hub.on_event(started())
    hub.on_event(NodeChanged(0.0, 0, "old", "RUNNING", "", 1))
    hub.on_event(started())
    hub.close()
    assert [message["event"] for message in waiting(hub.join())] == ["RunStarted"]


def test_a_viewer_that_stops_reading_gets_a_notice_and_costs_no_memory() -> None:
    async def watch() -> tuple[Viewer, list[dict[str, Any]]]:
        hub = Hub()
        hub.attach(asyncio.get_running_loop())
        viewer = hub.join()
        for tick in range(BACKLOG + 50):
            hub.tell("Beat", tick=tick)
        await asyncio.to_thread(hub.close)
        for _ in range(3):
            await asyncio.sleep(0)
        return viewer, waiting(viewer)

    viewer, messages = in_loop(watch())
    assert viewer.lagged
    assert messages == [{"v": 1, "event": "Lagged"}]


class Wire:
    """Takes frames while it is open."""

    def __init__(self) -> None:
        self.open, self.frames = True, list[bytes]()

    def take(self, frame: bytes) -> bool:
        self.frames += [frame] if self.open else []
        return self.open


def test_an_immediate_write_never_overtakes_waiting_ones() -> None:
    wire: Any = Wire()
    viewer = Viewer(wire)
    viewer.hand("a", b"a")
    wire.open = False
    viewer.hand("b", b"b")
    wire.open = True
    viewer.hand("c", b"c")  # b is on its way
    assert (wire.frames, list(viewer.waiting)) == ([b"a"], ["b", "c"])
    viewer.sent()
    viewer.sent()
    viewer.hand("d", b"d")
    assert (wire.frames, list(viewer.waiting)) == ([b"a", b"d"], [])


class Evil:
    """Raises at every access."""

    def __repr__(self) -> str:
        raise SystemExit("evil")

    __str__ = __repr__


HOSTILE: list[tuple[str, Any]] = [
    ("seen", ImageView(np.zeros((0, 0, 3), np.uint8))),
    ("seen", ImageView(np.zeros((8, 8, 2), np.uint8))),
    ("seen", ImageView(np.zeros(8, np.uint8))),
    ("evil", Evil()),
    ("big", "x" * 2_000_000),
    (["a topic"], ImageView(np.zeros((8, 8, 3), np.uint8))),
]


def test_an_unencodable_value_is_replaced_by_the_reason_and_ends_nothing(
    hub: Hub, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(messages_module, "MOST_TEXT", 1_000_000)
    hub.on_event(started())
    for topic, value in HOSTILE:
        hub.on_event(Published(0.5, 7, "a/Look", topic, value))
    hub.on_event(StateChanged(0.6, 8, "running", ""))
    hub.on_event(started())  # the next run
    hub.on_event(Published(0.0, 0, "a/Look", "number", float("nan")))
    hub.close()
    later = waiting(hub.join())
    assert [message["event"] for message in later] == ["RunStarted", "Published"]
    assert later[1]["value"] is None

    other = Hub()
    other.on_event(started())
    for topic, value in HOSTILE:
        other.on_event(Published(0.5, 7, "a/Look", topic, value))
    other.close()
    told = [message for message in waiting(other.join()) if message["event"] == "ErrorRaised"]
    assert [message["error"] for message in told] == ["UnencodableError"] * len(HOSTILE)
    assert {(message["node"], message["t"], message["tick"]) for message in told} == {
        ("a/Look", 0.5, 7)
    }
    words = [message["message"] for message in told]
    assert words[3] == "'evil' of a/Look cannot be encoded: SystemExit: evil"
    assert words[4] == "'big' of a/Look cannot be encoded: 2 MB of text; at most 1 MB are shown"
    assert (
        words[5] == "a published value of a/Look cannot be encoded: its topic is no text but list"
    )


def test_numbers_that_are_none_reach_no_browser() -> None:
    def refuse(name: str) -> Any:
        raise AssertionError(f"{name} is no JSON")

    for text in (message("Pong", ping=float("nan")), message("Beat", ages={"arm": float("inf")})):
        assert None in [
            *json.loads(text, parse_constant=refuse).values(),
            *json.loads(text).get("ages", {}).values(),
        ]
