"""Moves of a parallel gripper, and the rules for widths and speeds that its drivers share."""

from __future__ import annotations

import math
from collections.abc import Callable

from pomona.drivers.errors import MotionRefused
from pomona.drivers.interfaces import GripperLimits, MotionState


class GripperMotion:
    """A move of the gripper that was started. Its driver reports the progress and the end."""

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
        if way < 1e-9 or self.state is MotionState.DONE:
            return 1.0
        return min(max(1.0 - abs(self.width - self.measured) / way, 0.0), 1.0)

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


class DirectMotion(GripperMotion):
    """A move whose end is its rest, as of fingers without a wire and an owner thread."""

    def __init__(self, width: float, speed: float, start: float, stopped: Callable[[], None] = lambda: None) -> None:
        """
        Args:
            stopped: called when the move is stopped, by its skill or its driver; tells the supervisor.
        """
        super().__init__(width, speed, start, self._stop_now)
        self._stopped = stopped

    def _stop_now(self, _move: GripperMotion) -> None:
        if not self.settled:
            self.end(MotionState.STOPPED)
            self._stopped()

    def end(self, state: MotionState, problem: str = "") -> None:
        super().end(state, problem)
        self.settled = True


def require_move(name: str, limits: GripperLimits, width: float, speed: float) -> None:
    """Check a width [m] and a speed [m/s] that a move asks of the gripper `name`.

    Raises MotionRefused: one lies outside the limits.
    """
    if not limits.width_min - 1e-6 <= width <= limits.width_max + 1e-6:
        span = f"{1e3 * limits.width_min:.1f} … {1e3 * limits.width_max:.1f} mm"
        raise MotionRefused(name, f"an opening of {1e3 * width:.1f} mm lies outside {span}")
    if not 0.0 < speed <= limits.speed_max * (1.0 + 1e-6):
        raise MotionRefused(name, f"a speed of {speed:g} m/s lies outside 0 … {limits.speed_max:g} m/s")


def allowed_speed(speed: float, limits: GripperLimits, is_latched: bool) -> float:
    """Return a streamed speed within the limits [m/s]; 0 if it is not finite. Latched fingers do not open."""
    wanted = min(max(speed, -limits.speed_max), limits.speed_max) if math.isfinite(speed) else 0.0
    return min(wanted, 0.0) if is_latched else wanted
