"""A gripper whose fingers reach the commanded width at once and exactly, until they meet an object."""

from __future__ import annotations

import math

from pomona.drivers.device import Device
from pomona.drivers.errors import DeviceError, DeviceFault, MotionRefused
from pomona.drivers.gripper_motion import DirectMotion, require_move
from pomona.drivers.gripper_supervisor import GripperSupervisor
from pomona.drivers.interfaces import Gripper, GripperLimits, GripperState, Motion, MotionState
from pomona.drivers.mock.clock import PERIOD, MockClock

LIMITS = GripperLimits(width_min=0.035, width_max=0.103, speed_max=0.2, force_max=20.0)
WATCHDOG = 0.1
ACCELERATION = 1e3  # acceleration that the supervisor assumes [m/s²]: moves begin and end at once


class MockGripper(Device):
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

    interfaces = (Gripper,)

    def __init__(
        self, clock: MockClock, width: float = 0.10, limits: GripperLimits = LIMITS, blocked_at: float = 0.0
    ) -> None:
        super().__init__("gripper")
        self._clock = clock
        self.limits, self.width, self.blocked_at = limits, width, blocked_at
        self.motor_force: float | None = None
        self.speeds: list[tuple[float, float]] = []
        self.moves: list[DirectMotion] = []
        self._rate = 0.0
        self._aim: float | None = None
        self._paused = False
        self._latched: str | None = None
        self._refusal: str | None = None
        self._error: DeviceError | None = None
        self._supervisor = GripperSupervisor(limits, ACCELERATION)
        self._supervisor.rest(clock.now())
        clock.each_step.append(self._step)

    # ---------------------------------------------------------------------------------------------- script

    def refuse_next(self, why: str) -> None:
        """Refuse the next move."""
        self._refusal = why

    def fail_check(self, error: DeviceError | None) -> None:
        """Raise this from every `check` from now on; None ends it."""
        self._error = error

    # ----------------------------------------------------------------------------------------------- device

    def state(self) -> GripperState:
        moving = not self.settled()
        return GripperState(self._clock.now(), self.width, self._rate, moving, self.motor_force, aim=self._aim)

    def move(self, width: float, speed: float) -> Motion:
        refusal, self._refusal = self._refusal, None
        if self._latched is not None:
            refusal = f"latched in the safe state ({self._latched})"
        if refusal:
            raise MotionRefused(self.name, refusal)
        require_move(self.name, self.limits, width, speed)
        self._end_move()
        self._supervisor.move(self._clock.now(), self.width, width, speed)
        self.moves.append(DirectMotion(width, speed, self.width, lambda: self._supervisor.rest(self._clock.now())))
        self._aim = width
        return self.moves[-1]

    def set_speed(self, speed: float) -> None:
        self._end_move()
        self._aim = None
        self.speeds.append((self._clock.now(), speed))
        self._supervisor.stream(self._clock.now(), speed if math.isfinite(speed) else 0.0, WATCHDOG)

    def check(self) -> None:
        if self._error is not None:
            raise self._error
        wrong = self._supervisor.look(self._clock.now(), self.state())
        if wrong:
            raise DeviceFault(self.name, wrong)

    def link(self) -> str:
        return "ok" if self._error is None else self._error.message

    def safe_stop(self, reason: str) -> None:
        self._latched, self._paused = reason, False  # a pause ends with it
        self._end_move()

    def acknowledge(self) -> None:
        self._latched = None
        self._supervisor.rest(self._clock.now())

    def pause(self) -> None:
        self._paused = True
        if self._move is not None:
            self._move.state = MotionState.PAUSED
            self._supervisor.rest(self._clock.now())

    def resume(self) -> None:
        self._paused = False
        if self._move is not None:
            self._move.state = MotionState.RUNNING
            self._supervisor.move(self._clock.now(), self.width, self._move.width, self._move.speed)

    def settled(self) -> bool:
        return self._move is None or self._paused

    @property
    def _move(self) -> DirectMotion | None:
        return self.moves[-1] if self.moves and not self.moves[-1].settled else None

    def _end_move(self) -> None:
        if self._move is not None:
            self._move.stop()

    def _step(self) -> None:
        move = self._move
        if move is not None:
            left = move.width - self.width
            self._rate = 0.0 if self._paused else math.copysign(min(move.speed, abs(left) / PERIOD), left)
        elif self.speeds and self._clock.now() - self.speeds[-1][0] <= WATCHDOG and math.isfinite(self.speeds[-1][1]):
            limit = self.limits.speed_max
            self._rate = min(max(self.speeds[-1][1], -limit), limit)
        else:
            self._rate = 0.0
        low = max(self.limits.width_min, self.blocked_at)
        self.width = min(max(self.width + self._rate * PERIOD, low), self.limits.width_max)
        if move is None:
            return
        move.measured = self.width
        if abs(move.width - self.width) < 1e-6:
            move.end(MotionState.DONE)
        elif self._rate < 0.0 and self.width <= low:
            move.end(MotionState.FAILED, f"the fingers are blocked at {1e3 * self.width:.1f} mm")
        if move.settled:
            self._supervisor.rest(self._clock.now())
