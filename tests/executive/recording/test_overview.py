"""An overview keeps every change, and of repeated messages the last of each part of the time."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from pomona.executive.recording import overview
from pomona.executive.recording.overview import Extremes, Overview, standing


def series(t: list[float], **values: list[float | None]) -> dict[str, Any]:
    return {"event": "Published", "value": {"t": t, "values": values}}


def joined(*messages: dict[str, Any]) -> Extremes:
    found = Extremes()
    for message in messages:
        found.add(message, json.dumps(message).encode())
    return found


def represented(found: Extremes) -> Any:
    return json.loads(found.message())["value"]


def test_samples_are_represented_by_their_extremes_in_the_order_in_which_they_came() -> None:
    rng = np.random.default_rng(3)
    for _ in range(30):
        a, b = rng.normal(size=(2, 12)).round(3).tolist()
        cuts = [0, *sorted(rng.choice(range(1, 12), 2, replace=False).tolist()), 12]
        parts = [
            series([float(k) for k in range(low, high)], a=a[low:high], b=b[low:high])
            for low, high in pairwise(cuts)
        ]
        value = represented(joined(*parts))
        assert (value["t"], value["thinned"]) == ([0.0, 11.0], 12)
        for name, samples in (("a", a), ("b", b)):
            ends = sorted((min(samples), max(samples)), key=samples.index)
            assert value["values"][name] == ends
        early, late = joined(parts[0]), joined(*parts[1:])
        early.join(late)
        assert represented(early) == value


def test_holes_and_nan_are_no_extremes() -> None:
    found = Extremes()
    message = series([0.0, 1.0, 2.0, 3.0], a=[None, 2.0, math.nan, 1.0], b=[None] * 4)
    found.add(message, json.dumps(message).replace("NaN", "null").encode())
    assert represented(found)["values"] == {"a": [2.0, 1.0]}


def test_one_or_two_samples_are_kept_as_they_are() -> None:
    message = series([0.0, 1.0], a=[1.0, 5.0])
    assert json.loads(joined(message).message()) == message
    assert "thinned" in represented(joined(message, series([2.0], a=[3.0])))


@pytest.mark.parametrize(
    "message",
    [{}, {"value": {"t": 5, "values": {}}}, {"value": {"t": [], "values": {"a": [1.0]}}}, {"value": 3}],
)  # fmt: skip
def test_a_malformed_message_adds_no_sample(message: dict[str, Any]) -> None:
    found = joined(series([0.0, 1.0, 2.0], a=[1.0, 2.0, 3.0]))
    found.add(message, b"{}")
    assert found._count == 3
    assert found.message() == b"{}"


def test_arrays_count_as_lists() -> None:
    message = series([0.0, 1.0, 2.0], a=[4.0, 2.0, 3.0])
    arrays = {"value": {"t": np.array([0.0, 1.0, 2.0]), "values": {"a": np.array([4.0, 2.0, 3.0])}}}
    found = Extremes()
    found.add(arrays, json.dumps(message).encode())
    assert represented(found)["values"] == {"a": [4.0, 2.0]}


def view(topic: str, t: float, kind: str = "ImageView") -> dict[str, Any]:
    return {
        "event": "Published", "topic": topic, "node": "0", "tick": 3, "t": t,
        "value": {"type": kind, "t": [t], "values": {"a": [t]}},
    }  # fmt: skip


def fill(made: Overview, messages: list[dict[str, Any]]) -> Overview:
    for seq, message in enumerate(messages):
        made.add(seq, message["t"], message, json.dumps(message).encode())
    return made


def test_of_views_the_last_one_of_each_part_of_the_time_is_kept_for_each_topic() -> None:
    times = [0.0, 0.01, 0.049, 0.05, 0.051, 0.11]
    messages = [view(topic, t, "PosesView") for t in times for topic in ("a", "b")]
    made = fill(Overview(), messages)
    assert [entry.seq for entry in made.entries] == [4, 5, 8, 9, 10, 11]
    assert made.size == sum(len(entry.content) for entry in made.entries)
    assert made.count == len(messages)


def test_a_longer_run_has_longer_parts_and_never_more_than_there_may_be() -> None:
    made = fill(Overview(), [view("a", 0.05 * k, "PosesView") for k in range(4100)])
    assert made.interval == pytest.approx(0.2)
    assert len(made.entries) <= overview.PARTS
    # the last message of each part of 0.2 s
    assert [entry.seq for entry in made.entries][:3] == [3, 7, 11]
    assert made.entries[-1].seq == 4099
    assert made.size == sum(len(entry.content) for entry in made.entries)


def test_changes_of_a_node_are_all_kept_and_its_repetitions_are_not() -> None:
    def changed(t: float, status: str, starts: int = 1) -> dict[str, Any]:
        return {"event": "NodeChanged", "t": t, "path": "0/1", "status": status, "starts": starts}

    messages = [changed(0.001 * k, status) for k, status in enumerate("RRRSSR")]
    messages.append(changed(0.01, "R", 2))
    made = fill(Overview(), messages)
    kept = {entry.seq for entry in made.entries}
    assert {0, 3, 5, 6} <= kept
    assert len(kept) == 5  # and one repetition of this part of the time


def test_samples_of_a_part_of_the_time_are_joined_also_where_two_parts_become_one() -> None:
    def force(t: float, low: float, high: float) -> dict[str, Any]:
        message = view("grip", t, "SeriesView")
        message["value"] |= {"t": [t, t + 0.001], "values": {"a": [low, high]}}
        return message

    made = fill(Overview(), [force(0.0, 1.0, 9.0), force(0.01, 2.0, 8.0), force(0.06, 0.0, 3.0)])
    first, second = (json.loads(entry.text)["value"] for entry in made.entries)
    assert first["values"] == {"a": [1.0, 9.0]}
    assert (first["thinned"], first["t"]) == (4, [0.0, 0.011])
    assert second["values"] == {"a": [0.0, 3.0]}
    made._coarsen()
    (both,) = (json.loads(entry.text)["value"] for entry in made.entries)
    assert both["values"] == {"a": [9.0, 0.0]}
    assert (both["thinned"], both["t"]) == (6, [0.0, 0.061])


def test_a_short_record_is_its_own_overview_and_a_too_large_one_has_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(overview, "WHOLE", 5)
    events = [{"event": "Said", "t": 0.1 * k} for k in range(6)]
    assert list(fill(Overview(), events[:5]).lines()) == []
    head, *lines = fill(Overview(), events).lines()
    assert json.loads(head) == {"interval": 0.05}
    assert [json.loads(line) for line in lines] == [[k, event] for k, event in enumerate(events)]
    size = fill(Overview(), events).size
    monkeypatch.setattr(overview, "MOST_BYTES", size)
    assert len(list(fill(Overview(), [*events, *events]).lines())) == 0
    monkeypatch.setattr(overview, "MOST_BYTES", 10 * size)
    assert len(list(fill(Overview(), [*events, *events]).lines())) == 13


@pytest.mark.parametrize("kind", ["ImageView", "SceneView", "BodiesView", "TableView"])
def test_of_a_view_that_stands_the_overview_keeps_the_place_and_not_the_content(kind: str) -> None:
    (entry,) = fill(Overview(), [view("camera", 0.01, kind)]).entries
    head = json.loads(entry.text)
    assert (head["topic"], head["node"], head["t"], head["tick"]) == ("camera", "0", 0.01, 3)
    assert "values" not in json.dumps(head)
    found = standing(7, view("camera", 0.01, kind))
    assert found is not None
    assert (found.seq, found.t, found.key[0]) == (7, 0.01, kind)


@pytest.mark.parametrize("t", [None, "soon", math.nan, math.inf, -2e9, 1e9])
def test_a_view_without_a_time_or_of_another_kind_stands_nowhere(t: Any) -> None:
    assert standing(7, view("camera", t)) is None
    assert standing(7, view("camera", 1.0, "PosesView")) is None
    assert standing(7, {"event": "Said", "t": 1.0}) is None
    assert standing(7, view("camera", 999_999_999.0)) is not None
