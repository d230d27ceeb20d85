"""A motion as its caller sees it, while another thread carries it out."""

from __future__ import annotations

from pomona.drivers.interfaces import Motion, MotionState
from pomona.drivers.owner import Owner


class PostedMotion:
    """A `Motion` whose stop is posted to the device's owner thread; every attribute read is a single value."""

    def __init__(self, motion: Motion, owner: Owner) -> None:
        self._motion, self._owner = motion, owner

    @property
    def state(self) -> MotionState:
        return self._motion.state

    @property
    def progress(self) -> float:
        return self._motion.progress

    @property
    def settled(self) -> bool:
        return self._motion.settled

    @property
    def problem(self) -> str:
        return self._motion.problem

    def stop(self) -> None:
        self._owner.post(self._motion.stop)
