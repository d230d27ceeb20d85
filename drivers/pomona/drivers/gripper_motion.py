"""A move of the gripper that was started."""

from __future__ import annotations

from collections.abc import Callable

from pomona.drivers.interfaces import MotionState


class GripperMotion:
    """Watched by the caller that started it; its driver reports the progress."""

    def __init__(self, width: float, speed: float, start: float, stop: Callable[[GripperMotion], None]) -> None:
        self.width, self.speed = width, speed
        self.state = MotionState.RUNNING
        self.settled = False
        self.problem = ""
        self.measured = start
        self._start, self._stop = start, stop

    @property
    def progress(self) -> float:
        way = abs(self.width - self._start)
        return 1.0 if way < 1e-9 else min(max(1.0 - abs(self.width - self.measured) / way, 0.0), 1.0)

    @property
    def ended(self) -> bool:
        """Whether the outcome is known; the fingers may still come to rest."""
        return self.state not in (MotionState.RUNNING, MotionState.PAUSED)

    def stop(self) -> None:
        self._stop(self)

    def end(self, state: MotionState, problem: str = "") -> None:
        """Report the end; the first outcome counts."""
        if not self.ended:
            self.state, self.problem = state, problem
