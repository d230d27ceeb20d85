"""A gripper whose fingers reach the commanded width at once and exactly, until they meet an object."""

from __future__ import annotations

import math

from pomona.drivers.base.direct_gripper import DirectGripper
from pomona.drivers.errors import DeviceError, MotionRefused
from pomona.drivers.gripper_motion import GripperMotion
from pomona.drivers.interfaces import GripperLimits, GripperState, MotionState
from pomona.drivers.mock.clock import PERIOD, MockClock

LIMITS = GripperLimits(width_min=0.035, width_max=0.103, speed_max=0.2, force_max=20.0)
WATCHDOG = 0.1
ACCELERATION = 1e3  # acceleration that the supervisor assumes [m/s²]: moves begin and end at once


class MockGripper(DirectGripper):
    """A kinematic gripper.

    Args:
        clock: that moves it.
        width: opening at the start [m].
        blocked_at: the fingers do not close below this [m]; 0 means never. For moves: they fail there.

    Attributes:
        width: present opening; write it to move the fingers by hand, which `check` notices.
        motor_force: reported with the state [N], or None.
        speeds: every value given to `set_speed`, with its time.
        moves: every move that was started.
    """

    def __init__(
        self, clock: MockClock, width: float = 0.10, limits: GripperLimits = LIMITS, blocked_at: float = 0.0
    ) -> None:
        super().__init__("gripper", clock, limits, acceleration=ACCELERATION, watchdog=WATCHDOG)
        self.width, self.blocked_at = width, blocked_at
        self.motor_force: float | None = None
        self.speeds: list[tuple[float, float]] = []
        self.moves: list[GripperMotion] = []
        self._rate = 0.0
        self._refused: str | None = None
        self._error: DeviceError | None = None
        clock.each_step.append(self.step)

    # ---------------------------------------------------------------------------------------------- script

    def refuse_next(self, why: str) -> None:
        """Refuse the next move."""
        self._refused = why

    def fail_check(self, error: DeviceError | None) -> None:
        """Raise this from every `check` from now on; None ends it."""
        self._error = error

    # ----------------------------------------------------------------------------------------------- device

    def state(self) -> GripperState:
        moving = not self.settled()
        return GripperState(self._clock.now(), self.width, self._rate, moving, self.motor_force, aim=self._aim)

    def move(self, width: float, speed: float) -> GripperMotion:
        refusal, self._refused = self._refused, None
        if refusal:
            raise MotionRefused(self.name, refusal)
        self.moves.append(super().move(width, speed))
        return self.moves[-1]

    def set_speed(self, speed: float) -> None:
        self.speeds.append((self._clock.now(), speed))
        super().set_speed(speed)

    def check(self) -> None:
        if self._error is not None:
            raise self._error
        super().check()

    def link(self) -> str:
        return super().link() if self._error is None else self._error.message

    def step(self) -> None:
        """Move the fingers for one period of the clock."""
        self._end_stale_stream(self._clock.now())
        move = None if self._move is None or self._move.ended else self._move
        if move is None:
            self._rate = self._speed
        else:
            left = move.width - self.width
            paused = move.state is MotionState.PAUSED
            self._rate = 0.0 if paused else math.copysign(min(move.speed, abs(left) / PERIOD), left)
        low = max(self.limits.width_min, self.blocked_at)
        self.width = min(max(self.width + self._rate * PERIOD, low), self.limits.width_max)
        if move is None:
            return
        move.measured = self.width
        if abs(move.width - self.width) < 1e-6:
            self._end_move(MotionState.DONE)
        elif self._rate < 0.0 and self.width <= low:
            self._end_move(MotionState.FAILED, f"the fingers are blocked at {1e3 * self.width:.1f} mm")
