"""Turning the pages of a recording."""

from dataclasses import dataclass

from py_trees.common import Status

from pomona.applications.inventory.recorded_frames import FirstFrame, NextFrame
from pomona.drivers.interfaces import FrameSequence
from pomona.executive.skill_testing import drive


@dataclass
class Pages:
    """A recording of some frames."""

    count: int
    position: int = 0

    def advance(self) -> bool:
        if self.position + 1 >= self.count:
            return False
        self.position += 1
        return True

    def rewind(self) -> None:
        self.position = 0


def test_the_first_frame_is_shown_and_all_are_counted():
    pages = Pages(3, position=2)
    outcome = drive(FirstFrame(), {}, {FrameSequence: pages})
    assert outcome.outputs == {"count": 3}
    assert pages.position == 0


def test_every_frame_is_shown_once_and_the_last_one_stays():
    pages, shown = Pages(3), [0]
    while (outcome := drive(NextFrame(), {}, {FrameSequence: pages})).status is Status.SUCCESS:
        shown.append(pages.position)
    assert shown == [0, 1, 2]
    assert outcome.reason.code == "LAST_FRAME"
    assert outcome.reason.message == "frame 3 of 3 is the last"
    assert pages.position == 2
