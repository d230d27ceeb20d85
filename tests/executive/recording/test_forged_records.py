"""A forged record ends no reader in a traceback and keeps none busy: one value anywhere in it is anything at all."""

from __future__ import annotations

import contextlib
import copy
import io
import json
import signal
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st
from recorded_events import everything, foreign, started

from pomona.executive.cli import main
from pomona.executive.encode import encoded
from pomona.executive.recording.message import message_of
from pomona.executive.running.events import Published
from pomona.executive.views import TableView

LIMIT = 10.0
"""Processor time that one command may take [s]: on a busy machine the wall clock says nothing."""

READERS: tuple[tuple[str, ...], ...] = (
    ("runs", "list"), ("runs", "list", "--json"), ("runs", "show", "odd"), ("runs", "show", "odd", "--json"),
    ("explain", "odd", "--all"), ("runs", "compare", "odd", "good"), ("rerun", "odd"),
    ("why", "odd"),
    ("runs", "export", "odd", "odd.html"), ("runs", "export", "odd", "odd.jsonl"),
    ("runs", "export", "odd", "frames", "--to", "frames"), ("runs", "export", "odd", "bag", "--to", "rosbag2"),
    ("evidence", "odd"), ("evidence", "runs"), ("runs", "repair", "odd"),
)  # fmt: skip
NODES = (
    {"path": "a", "parent": None, "name": "a", "type": "retry"},
    {"path": "a/Plan", "parent": "a", "name": "Plan"},
)
TABLE = Published(0.4, 8, "a/Plan", "table", TableView(("a", "b"), (("1", "2"),), "sizes"))
EVENTS = (started(nodes=NODES), TABLE, *everything()[1:])
MESSAGES: tuple[dict[str, Any], ...] = tuple(
    json.loads(encoded(message_of(event))) for event in EVENTS
)
Place = tuple[int, tuple[str | int, ...]]


class BusyError(BaseException):
    """A command took longer than `LIMIT`."""


def places(value: Any, at: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    yield at
    inner = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, item in inner:
        yield from places(item, (*at, key))


PLACES: st.SearchStrategy[Place] = st.sampled_from(range(len(MESSAGES))).flatmap(
    lambda k: st.tuples(st.just(k), st.sampled_from(list(places(MESSAGES[k]))))
)


def put(value: Any, at: Sequence[str | int], new: Any) -> Any:
    if not at:
        return new
    changed = copy.copy(value)
    changed[at[0]] = put(value[at[0]], at[1:], new)
    return changed


def nested(depth: int) -> Any:
    return [nested(depth - 1)] if depth else 1


FORGED: st.SearchStrategy[Any] = st.one_of(
    st.sampled_from(
        [
            float("nan"),
            float("inf"),
            -float("inf"),
            9e11,
            -9e11,
            1e300,
            -1,
            -0.5,
            10**30,
            2**63,
            2**31,
        ]
    ),
    st.sampled_from(
        ["x" * 1_000_000, "\ud800\x1b[2J", "", "x\n" * 10_000, nested(150), nested(250), None, True]
    ),
    st.sampled_from([[0.5] * 100_000, [["1"]] * 50_000, {str(k): k for k in range(20_000)}]),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
        ),
        max_leaves=5,
    ),
)


def cycle(*parents: str | None) -> list[dict[str, Any]]:
    return [
        {"path": str(k), "parent": parent, "name": "n", "type": "retry"}
        for k, parent in enumerate(parents)
    ]


def read_by_all(messages: Sequence[Any], readers: Sequence[Sequence[str]] = READERS) -> str:
    """Let commands read a record with these events beside a good one; return their words."""
    said = io.StringIO()
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        foreign(Path("runs/odd"), *(json.dumps(message).encode() for message in messages))
        foreign(Path("runs/good"), *(json.dumps(message).encode() for message in MESSAGES))
        for reader in readers:
            with (
                contextlib.redirect_stdout(said),
                contextlib.redirect_stderr(said),
                within_limit(reader),
            ):
                assert main(list(reader)) in (0, 1, 2), (
                    reader
                )  # 1: compared runs differ, a limit was passed
    assert "Traceback" not in said.getvalue()
    return said.getvalue()


@contextlib.contextmanager
def within_limit(reader: Sequence[str]) -> Iterator[None]:
    def busy(*_about: object) -> None:
        raise BusyError(f"{' '.join(reader)} took {LIMIT:g} s and went on")

    before = signal.signal(signal.SIGVTALRM, busy)
    signal.setitimer(signal.ITIMER_VIRTUAL, LIMIT)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def at(event: str, *keys: str | int) -> Place:
    number = next(k for k, message in enumerate(MESSAGES) if message["event"] == event)
    return number, keys


@pytest.mark.slow
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(place=PLACES, value=FORGED)
@example(at("RunStarted", "nodes"), cycle("1", "0"))
@example(at("RunStarted", "wall_time"), 9e11)
@example(at("RunStarted", "wall_time"), -9e11)
@example(at("RunStarted", "wall_time"), 3e9)
def test_every_reader_ends_soon_and_in_words(place: Place, value: Any) -> None:
    number, keys = place
    read_by_all(
        [
            put(message, keys, value) if k == number else message
            for k, message in enumerate(MESSAGES)
        ]
    )


@pytest.mark.parametrize("wall_time", [9e11, -9e11, 1e300])
def test_a_record_of_no_moment_is_listed_as_unreadable_and_the_others_stay(
    wall_time: float,
) -> None:
    said = read_by_all(
        [MESSAGES[0] | {"wall_time": wall_time}, *MESSAGES[1:]], [("runs", "list", "--json")]
    )
    states = {run["run"]: run["state"] for run in map(json.loads, said.splitlines())}
    assert states == {"odd": "unreadable", "good": "ended"}


@pytest.mark.parametrize(
    "reader", [("runs", "show", "odd"), ("explain", "odd"), ("runs", "export", "odd", "o.html")]
)
def test_a_cycle_of_nodes_is_refused_with_record_and_node(reader: Sequence[str]) -> None:
    forged = MESSAGES[0] | {"nodes": cycle(None, "2", "1")}
    said = " ".join(read_by_all([forged, *MESSAGES[1:]], [reader]).split())
    assert "runs/odd" in said
    assert "node '1' has no parent before it: the nodes form no tree" in said


@pytest.mark.slow
def test_a_long_table_is_printed_in_part_with_the_number_of_the_rest() -> None:
    number, _keys = at("Published")
    table = {
        "type": "TableView",
        "columns": ["a"] * 40,
        "rows": [["1", "2"]] * 50_000,
        "caption": "sizes",
    }
    messages = [*MESSAGES[:-1], MESSAGES[number] | {"value": table}, MESSAGES[-1]]
    said = read_by_all(messages, [("runs", "show", "odd")])
    assert "49800 more rows and 10 more columns" in " ".join(said.split())


def test_a_moment_that_ros_2_cannot_hold_is_named() -> None:
    messages = [MESSAGES[0] | {"wall_time": 3e9}, *MESSAGES[1:]]
    said = " ".join(
        read_by_all(messages, [("runs", "export", "odd", "bag", "--to", "rosbag2")]).split()
    )
    assert "3000000000 s since 1970 are no time of ROS 2" in said
