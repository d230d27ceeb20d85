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
ENDS = 0.1
"""Time after which a gripper ends a speed that is not repeated [s]: `Gripper.set_speed`."""
RESISTS = 2.0
"""Force of the motor against a motion that shows a push [N]: a gripper that moves by itself is not followed."""


class YieldingFingers:
    """Lets resting fingers go along with a push while the arm moves.

    The deviation is measured as by `GripperSupervisor`: motion that no command explains. Fingers whose motor does not
    resist the motion do not give way.
    """

    def __init__(self, gripper: Gripper) -> None:
        self._gripper = gripper
        self._given = 0.0
        self._speed = 0.0
        state = gripper.state()
        self._stamp = state.stamp
        self._width = state.width
        # widths that the commands explain [m]
        self._lower = state.width
        self._upper = state.width

    def rest(self) -> None:
        """Give way to a push, once a tick."""
        before = self._speed
        self._speed = self._yielded()
        if before or self._speed:
            self._gripper.set_speed(self._speed)

    def _yielded(self) -> float:
        """Return the speed with which the fingers give way now [m/s]; 0: they stand."""
        state = self._gripper.state()
        dt = min(state.stamp - self._stamp, ENDS)
        self._stamp = state.stamp
        moved = state.width - self._width
        self._width = state.width
        self._lower = min(state.width, self._lower + max(self._speed, 0.0) * dt)
        self._upper = max(state.width, self._upper + min(self._speed, 0.0) * dt)
        opened = max(state.width - self._lower - GIVES, 0.0)
        closed = max(self._upper - state.width - GIVES, 0.0)
        push = opened - closed
        resistance = (state.motor_force or 0.0) * (1.0 if push > 0.0 else -1.0)
        if push == 0.0 or resistance <= RESISTS or self._given > MOST:
            return 0.0
        given = GAIN * push
        if given * moved > 0.0:
            given = math.copysign(max(abs(given), abs(moved) / dt), moved)
        # A faster command would be cut, and count as more than was commanded.
        most = self._gripper.limits.speed_max
        given = min(max(given, -most), most)
        self._given += abs(given) * dt
        return given
