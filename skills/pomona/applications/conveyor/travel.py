"""How far a belt has run at any moment, from its encoder's measurements; and whether they can be true."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque

from pomona.applications.conveyor.conveyor import SILENCE, ConveyorState

KEPT = 2.0  # time over which measurements are kept [s]: longer than a frame takes to be looked at
# change of a belt's speed that is a change and no noise, of whatever encoder [m/s]
SAME_SPEED = 0.02
LEAST_CHANGE = 4e-3
RIPPLE = 1.5
"""A smaller change is one as well, from this one on [m/s], if it is so many times what the speed varied by lately."""
STEADY = 0.3  # time over which the speed is measured before a pick [s]: counts of 0.1 mm then err by 0.3 mm/s
FASTEST_CHANGE = 5.0
"""Acceleration that no loaded belt passes [m/s²]; its speed is measured over the last `MEASURED` seconds."""
MEASURED = 0.1
NOISE = 2e-3  # error of one position [m]
BACKWARDS = 2e-3  # travel against the belt's direction that no noise explains [m]


class Travel:
    """Measurements of an encoder over the last seconds.

    A position that no belt can have reached is not taken: the hand follows the belt by it, beside the surface.
    """

    def __init__(self) -> None:
        self._states: deque[ConveyorState] = deque()
        self._jumped = ""

    def note(self, state: ConveyorState | None) -> None:
        """Take the newest measurement; one that was taken before is ignored."""
        if state is None or (self._states and state.stamp <= self._states[-1].stamp):
            return
        if self._states and (jump := _jump(self._states[-1], state)):
            self._jumped = jump
            return
        self._jumped = ""
        self._states.append(state)
        while state.stamp - self._states[0].stamp > KEPT:
            self._states.popleft()

    @property
    def speed(self) -> float:
        """Present speed [m/s]; 0 without an encoder."""
        return self._states[-1].speed if self._states else 0.0

    def steady(self) -> tuple[float, float]:
        """Return the speed of the last `STEADY` seconds, and the least difference from it that is a change [m/s]."""
        if len(self._states) < 2:
            return self.speed, SAME_SPEED
        speeds = [state.speed for state in self._states]
        bound = min(max(LEAST_CHANGE, RIPPLE * (max(speeds) - min(speeds))), SAME_SPEED)
        newest = self._states[-1]
        since = max(newest.stamp - STEADY, self._states[0].stamp)
        return (newest.position - self.at(since)) / (newest.stamp - since), bound

    def at(self, t: float) -> float:
        """Return the travel at a time [m]; beyond the newest measurement with its speed, 0 without an encoder."""
        if not self._states:
            return 0.0
        stamps = [state.stamp for state in self._states]
        after = bisect_right(stamps, t)
        if after == len(stamps):
            newest = self._states[-1]
            return newest.position + newest.speed * (t - newest.stamp)
        if after == 0:
            oldest = self._states[0]
            return oldest.position + oldest.speed * (t - oldest.stamp)
        before = self._states[after - 1]
        behind = self._states[after]
        share = (t - before.stamp) / (behind.stamp - before.stamp)
        return before.position + share * (behind.position - before.position)

    def problem(self, now: float, fastest: float) -> str:
        """Describe why the measurements cannot be used, in half a sentence; empty if they can.

        Args:
            fastest: speed that the arm can follow [m/s].
        """
        if not self._states or self._jumped:
            return self._jumped or "the encoder has sent nothing yet"
        newest = self._states[-1]
        if now - newest.stamp > SILENCE:
            return f"the encoder sent nothing for {1e3 * (now - newest.stamp):.0f} ms"
        if newest.position - self._states[0].position < -BACKWARDS or newest.speed < -SAME_SPEED:
            words = "the encoder counts backwards"
            return f"{words}, at {newest.speed:.2f} m/s: turn its sign, or the belt's direction in the cell file"
        if newest.speed > fastest + SAME_SPEED:
            return f"the belt runs at {newest.speed:.2f} m/s, the arm can follow up to {fastest:.2f} m/s"
        return ""


def _jump(before: ConveyorState, after: ConveyorState) -> str:
    """Describe a step that no belt makes; empty for one that it makes."""
    dt = after.stamp - before.stamp
    unexpected = after.position - before.position - before.speed * dt
    if abs(unexpected) <= FASTEST_CHANGE * dt * (dt / 2.0 + MEASURED) + NOISE:
        return ""
    return f"the encoder's position jumped by {1e3 * unexpected:.0f} mm within {1e3 * dt:.0f} ms, which no belt does"
