"""Fingers that give way to a push from outside, before the gripper's supervisor takes it for a fault."""

from __future__ import annotations

import math

from pomona.drivers.interfaces import Gripper

GIVES = 1e-3
"""Deviation from the commands from which fingers give way [m]: a third of the supervisor's default `stray`."""
GAIN = 25.0
"""Speed of giving way per deviation beyond that [1/s]; at least that of the push."""
MOST = 0.03
"""Distance by which fingers give way in one motion [m]: beyond it the supervisor's limit holds."""
PRESSES, RELIEVES = 10.0, 0.03
"""Force of the motor outwards at which fingers press on something beside them [N], and speed at which they close then
[m/s]: fingers that were pressed by 4 mm spring open when the hand leaves, which the supervisor takes for a fault."""
ENDS = 0.1
"""Time after which a gripper ends a speed that is not repeated [s]: `Gripper.set_speed`."""
RESISTS = 2.0
"""Force of the motor against a motion that shows a push [N]: a gripper that moves by itself is not followed."""


class YieldingFingers:
    """Streams speeds to a gripper, and lets its fingers go along with a push.

    The deviation is measured as by `GripperSupervisor`: motion that no command explains. Fingers that lag their
    commands do not give way, nor those whose motor does not resist the motion.

    Attributes:
        holds: the fingers do not give way now.
    """

    def __init__(self, gripper: Gripper, relax: bool = False) -> None:
        """
        Args:
            relax: close while the motor presses outwards; without it fingers may press on the end of their stroke.
        """
        self.holds, self._relax = False, relax
        self._gripper, self._given, self._speed = gripper, 0.0, 0.0
        state = gripper.state()
        self._stamp, self._width = state.stamp, state.width
        self._lower, self._upper = state.width, state.width  # widths that the commands explain [m]

    def set_speed(self, speed: float, press: float = 0.0, bears: float = math.inf) -> None:
        """Command a speed [m/s], or that of the push.

        Args:
            press: larger force of the pads on the object between them [N].
            bears: force of the pads from which fingers that press outwards close no further [N]: the motor's current
                may be wrong.
        """
        self._speed = self._yielded(speed, self._relax and press < bears)
        self._gripper.set_speed(self._speed)

    def rest(self) -> None:
        """Let resting fingers give way while the arm moves, once a tick."""
        before, self._speed = self._speed, self._yielded(0.0, self._relax)
        if before or self._speed:
            self._gripper.set_speed(self._speed)

    def _yielded(self, speed: float, relax: bool) -> float:
        state = self._gripper.state()
        dt, self._stamp = min(state.stamp - self._stamp, ENDS), state.stamp
        moved, self._width = state.width - self._width, state.width
        self._lower = min(state.width, self._lower + max(self._speed, 0.0) * dt)
        self._upper = max(state.width, self._upper + min(self._speed, 0.0) * dt)
        push = max(state.width - self._lower - GIVES, 0.0) - max(
            self._upper - state.width - GIVES, 0.0
        )
        force = state.motor_force or 0.0
        resisted = force * (1.0 if push > 0.0 else -1.0) > RESISTS
        given = GAIN * push if resisted else 0.0
        if given * moved > 0.0:
            given = math.copysign(max(abs(given), abs(moved) / dt), moved)
        if relax and force < -PRESSES:
            given = min(given, -RELIEVES)
        if not given or self.holds or self._given > MOST:
            return speed
        most = (
            self._gripper.limits.speed_max
        )  # a faster command would be cut, and count as more than was commanded
        given = min(max(given, -most), most)
        self._given += abs(given) * dt
        return max(speed, given) if given > 0.0 else min(speed, given)
