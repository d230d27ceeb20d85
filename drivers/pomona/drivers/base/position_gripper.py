"""Base of grippers that know positions alone: a move or a speed becomes set-points that advance before the fingers.

A set-point precedes the measured opening by a bounded way: this bounds the force on what the fingers meet, and fingers
without further set-points come to rest.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any

from pomona.drivers.base.parallel_gripper import (
    C,
    ParallelGripper,
    S,
    SpeedOrder,
    Stop,
    Wanted,
    WidthOrder,
)
from pomona.drivers.gripper_supervisor import GripperMotion
from pomona.drivers.interfaces import GripperState

LONGEST = 0.02  # time for which a set-point advances at once [s]: it does not jump after a stall
SPEED_WINDOW = 0.04  # window of a speed by differences [s]: positions are quantised


class PositionGripper(ParallelGripper[S, C]):
    """A gripper whose commands are positions."""

    repeat = 0.0

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """See the base."""
        super().__init__(*args, **kwargs)
        self._set_point: float | None = None  # None: the fingers' own place
        self._stepped_at = self._clock.now()
        self._widths: list[tuple[float, float]] = []

    @abstractmethod
    def _ahead(self, speed: float) -> float:
        """Return by how much a set-point that advances at a speed [m/s] may precede the fingers [m]."""

    def _command(self) -> None:
        """Advance the set-point before it is commanded."""
        now = self._clock.now()
        elapsed = min(max(now - self._stepped_at, 0.0), LONGEST)
        self._stepped_at = now
        if self._state is not None and isinstance(self._wanted, WidthOrder | SpeedOrder):
            self._set_point = self._advanced(self._wanted, self._state.width, elapsed)
        super()._command()

    def _begin(self, move: GripperMotion) -> None:
        """As the base; from the fingers' own place, where the set-point lies on their other side."""
        state = self._state
        last = self._set_point
        if state and last and (last - state.width) * (move.width - state.width) < 0.0:
            self._set_point = None
        super()._begin(move)

    def _advanced(self, wanted: WidthOrder | SpeedOrder, width: float, elapsed: float) -> float:
        """Return the next set-point [m], `elapsed` [s] after the last one, for fingers at `width` [m]."""
        last = width if self._set_point is None else self._set_point
        speed = abs(wanted.speed)
        goal = (
            wanted.width
            if isinstance(wanted, WidthOrder)
            else math.copysign(math.inf, wanted.speed)
        )
        aim = last + math.copysign(min(abs(goal - last), speed * elapsed), goal - last)
        aim = min(max(aim, self.limits.width_min), self.limits.width_max)
        ahead = self._ahead(speed)
        return min(max(aim, min(width - ahead, last)), max(width + ahead, last))

    def shows(self, wanted: Wanted, status: S) -> bool:
        return isinstance(wanted, Stop) and self._supervisor.at_rest

    def _watch(self, state: GripperState) -> None:
        if self._set_point is not None:
            self._judge_move(state, self._set_point)

    def _rate(self, stamp: float, width: float) -> float:
        """Return the rate of the opening by differences of widths [m/s]."""
        recent = [(t, w) for t, w in self._widths if t >= stamp - SPEED_WINDOW]
        self._widths = [*(recent or self._widths[-1:]), (stamp, width)]
        then, before = self._widths[0]
        elapsed = stamp - then
        return (width - before) / elapsed if elapsed > 0.5 * SPEED_WINDOW else 0.0
