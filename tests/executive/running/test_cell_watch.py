"""Watchers look at the cell at their own pace, and none of them can end a run."""

from __future__ import annotations

from collections.abc import Iterator

from fake_cell import FakeCell

from pomona.executive.running.cell_watch import EVERY, Watch


class Counting:
    """Shows how often it has looked."""

    def __init__(self) -> None:
        self.looks = 0

    def look(self) -> Iterator[tuple[str, object]]:
        self.looks += 1
        yield "looks", self.looks


class Broken:
    """Fails after its first word."""

    def look(self) -> Iterator[tuple[str, object]]:
        yield "word", 1
        raise RuntimeError("a lens fell out")


def test_watchers_look_at_their_own_pace_and_devices_are_heard() -> None:
    cell, seen = FakeCell(), []
    watch = Watch(cell, lambda _node, topic, view: seen.append((topic, view)), [Counting()])
    for _ in range(20):
        watch.look()
        cell.clock.advance(EVERY / 5)
    assert seen == [("looks", n) for n in (1, 2, 3, 4)]
    assert watch.last_seen.keys() == {"wheel"}


def test_a_watcher_that_fails_is_not_asked_again() -> None:
    cell, seen = FakeCell(), []
    watch = Watch(cell, lambda _node, topic, _view: seen.append(topic), [Broken(), Counting()])
    for _ in range(3):
        watch.look()
        cell.clock.advance(EVERY)
    assert seen == ["word", "looks", "looks", "looks"]
