"""The skills that turn the pages of a recording."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.interfaces import FrameSequence
from executive.ports import Ports
from executive.skill import Skill


class FirstFrame(Skill):
    """Show the first recorded frame, and say how many there are."""

    outputs = Ports(count=int)
    devices = (FrameSequence,)

    def run(self) -> Mapping[str, object]:  # type: ignore[override]
        frames = self.device(FrameSequence)
        frames.rewind()
        return {"count": frames.count}


class NextFrame(Skill):
    """Show the next recorded frame."""

    devices = (FrameSequence,)
    failures = ("LAST_FRAME",)

    def run(self) -> Mapping[str, object]:  # type: ignore[override]
        frames = self.device(FrameSequence)
        if not frames.advance():
            raise self.failure("LAST_FRAME", f"frame {frames.position + 1} of {frames.count} is the last")
        return {}
