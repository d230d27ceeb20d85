"""The skills that turn the pages of a recording."""

from __future__ import annotations

from typing import Annotated

from pomona.drivers import FrameSequence
from pomona.executive import Outputs, Port, Skill


class Counted(Outputs):
    """Outputs of FirstFrame."""

    count: Annotated[int, Port(help="number of recorded frames")]


class FirstFrame(Skill):
    """Show the first recorded frame, and return their number."""

    devices = (FrameSequence,)

    def run(self) -> Counted:
        frames = self.device(FrameSequence)
        frames.rewind()
        return Counted(frames.count)


class NextFrame(Skill):
    """Show the next recorded frame."""

    devices = (FrameSequence,)
    failures = ("LAST_FRAME",)

    def run(self) -> None:
        frames = self.device(FrameSequence)
        if not frames.advance():
            raise self.failure(
                "LAST_FRAME", f"frame {frames.position + 1} of {frames.count} is the last"
            )
        return
