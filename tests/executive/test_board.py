"""The board: stamped values, written by the tick thread only."""

from __future__ import annotations

import threading

import pytest

from pomona.executive.board import Board, Entry, WrongThread
from pomona.executive.clock import ManualClock


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


def test_a_snapshot_does_not_change(board):
    board.write("/a", 1, "t")
    taken = board.snapshot()
    board.write("/a", 2, "t")
    assert taken["/a"].value == 1
