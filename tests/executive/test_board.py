"""The board: stamped values, written by the tick thread only."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

import numpy as np
import pytest

from pomona.executive.board import Board, Entry, WrongThread
from pomona.executive.clock import ManualClock
from pomona.executive.values.arrays import Float64
from pomona.executive.values.read_only import LARGE, own


@pytest.fixture
def board():
    return Board(ManualClock(5.0))


def test_entries_have_their_time_and_author(board):
    board.tick = 7
    board.write("/a", 1, "t/A")
    assert board.get("/a") == Entry(1, 5.0, 7, "t/A")
    assert board.get("/b") is None


def test_listeners_hear_every_write(board):
    received = []
    board.subscribe(lambda key, entry: received.append((key, entry.value)))
    board.write("/a", 1, "t")
    board.write("/a", 2, "t")
    assert received == [("/a", 1), ("/a", 2)]


def test_only_the_thread_that_adopted_it_writes(board):
    board.adopt()
    raised = []

    def write():
        try:
            board.write("/a", 1, "t")
        except WrongThread as error:
            raised.append(error)

    thread = threading.Thread(target=write)
    thread.start()
    thread.join()
    assert [error.key for error in raised] == ["/a"]
    board.write("/a", 2, "t")
    assert board.entries["/a"].value == 2


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A value of a skill that protects nothing by itself."""

    size: Float64
    parts: list[Float64] = field(default_factory=list)
    inner: Measured | None = None


def reader_of(board, key):
    """A skill's read, as `bind_skill` makes it."""
    return own(board.get(key).value)


@pytest.mark.parametrize("large", [False, True])
def test_a_written_value_can_be_changed_neither_by_its_writer_nor_by_a_reader(board, large):
    array = np.zeros(LARGE if large else 2)
    board.write("/a", Measured(array, [array.copy()], Measured(array.copy())), "t")
    read = reader_of(board, "/a")
    for kept in (read.size, read.parts[0], read.inner.size):
        with pytest.raises(ValueError, match="read-only"):
            kept += 1.0
    with pytest.raises(AttributeError):
        read.parts.append(array)
    if not large:
        array += 1.0
    assert board.get("/a").value.size[0] == 0.0


def test_a_list_keeps_its_type_and_each_reader_has_its_own(board):
    given = [1, {"b": [np.zeros(2)]}, {2}]
    board.write("/a", given, "t")
    given.append(3)
    read = reader_of(board, "/a")
    read[1]["b"].clear()
    read[2].add(5)
    del read[0]
    again = reader_of(board, "/a")
    assert [type(item) for item in again] == [int, dict, set]
    assert again[2] == {2}
    with pytest.raises(ValueError, match="read-only"):
        again[1]["b"][0][0] = 1.0
