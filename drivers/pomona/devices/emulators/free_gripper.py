"""A gripper of pure kinematics, for an emulator without a world: it stops at its ends and at an object."""

from __future__ import annotations

import math
from collections.abc import Callable

from pomona.drivers import GripperLimits, GripperMotion, GripperState, MotionRefused, MotionState


class FreeGripper:
    """Implements `Gripper`; widths are those of the jaws. The truth of an emulated hand.

    Attributes:
        obstacle: width that the jaws cannot close below [m]: a part between them, or a hand; 0: none.
        stiffness: of the obstacle, for one finger [N/m]; the jaws press it together by their force.
    """

    def __init__(
        self,
        now: Callable[[], float],
        width: float = 0.030,
        limits: GripperLimits = GripperLimits(0.0, 0.068, 0.4, 50.0),
        stiffness: float = math.inf,
    ) -> None:
        self.limits = limits
        self._now = now
        self._then = now()
        self._width = width
        self._speed = 0.0
        self._motion: GripperMotion | None = None
        self.obstacle = 0.0
        self.stiffness = stiffness
        self._strength = limits.force_max

    @property
    def width(self) -> float:
        """Opening of the jaws [m]; what is written pushes them there."""
        return self.state().width

    @width.setter
    def width(self, width: float) -> None:
        self._advance()
        self._width = width

    @property
    def force(self) -> float:
        """Force of one finger on an elastic obstacle [N]."""
        return self._press(self.width)

    def state(self) -> GripperState:
        """Where the fingers are now [m], as they move by themselves."""
        self._advance()
        pressing = None if math.isinf(self.stiffness) else 2.0 * self._press(self._width)
        return GripperState(self._then, self._width, self._speed, self._speed != 0.0, pressing)

    def move(self, width: float, speed: float, force: float | None = None) -> GripperMotion:
        self._advance()
        most = self.limits.force_max
        self._strength = most if force is None else min(force, most)
        if not self.limits.width_min <= width <= self.limits.width_max:
            raise MotionRefused("gripper", f"{1e3 * width:.1f} mm is outside the stroke")
        self._motion = GripperMotion(width, speed, self._width, self._stop)
        self._speed = math.copysign(speed, width - self._width)
        self._advance()
        return self._motion

    def set_speed(self, speed: float) -> None:
        self._advance()
        if self._motion is not None:
            self._stop(self._motion)
        self._speed = speed

    def _press(self, width: float) -> float:
        return self.stiffness * max(self.obstacle - width, 0.0) / 2.0

    def _stop(self, motion: GripperMotion) -> None:
        if not motion.ended:
            motion.end(MotionState.STOPPED)
            motion.settled = True
            self._speed = 0.0

    def _advance(self) -> None:
        now = self._now()
        deepest = self.obstacle - 2.0 * self._strength / self.stiffness
        low = max(deepest, self.limits.width_min)
        reached = self._width + self._speed * (now - self._then)
        self._then = now
        motion = self._motion if self._motion is not None and not self._motion.ended else None
        if (
            motion is not None
            and (reached - motion.width) * self._speed >= 0.0
            and motion.width >= low
        ):
            self._width = motion.width
            self._speed = 0.0
            motion.end(MotionState.DONE)
            motion.settled = True
        elif low <= reached <= self.limits.width_max:
            self._width = reached
        elif self._speed != 0.0:
            self._width = min(max(reached, min(low, self._width)), self.limits.width_max)
            self._speed = 0.0
            if motion is not None:
                motion.end(MotionState.FAILED, "blocked")
                motion.settled = True
