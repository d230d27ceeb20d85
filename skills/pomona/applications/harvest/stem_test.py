"""A test whether a stem still holds a fruit: a small pull with the force measured before, out there and after.

Only the change of the force along the pull counts. A constant error of the sensors, the fruit's weight and a steady
drift leave it as it is; a wrong gain scales it.
"""

from __future__ import annotations

from enum import Enum

AVERAGED = 0.2
"""Time of each of the three measurements [s]: noise of 1 N per sample at 500 Hz becomes 0.14 N of both pads."""
SPEED, FURTHEST = 0.04, 0.05
"""Speed and longest way of the pull [m/s, m]: an apple on its branch needs 10 to 30 mm for `ENOUGH`."""
ENOUGH = 1.5
"""Rise of the force at which the pull ends [N]; a gain of two makes it 0.75 N, half of the stem's force in a roll."""
HOLDS = 0.8
"""Least change of the force that shows a stem [N]: a bias that jumps by 1 N in the test changes it by 0.5 N."""
SMOOTHED = 0.06
"""Time constant of the force that ends the pull [s]."""
PATIENCE = 30.0
"""Time after which the test ends without a result [s]."""


class _Stage(Enum):
    BEFORE = 0
    OUT = 1
    THERE = 2
    HOME = 3
    AFTER = 4
    ENDED = 5


class StemTest:
    """Pull of a held fruit, stepped with the force along it.

    Attributes:
        holds: whether the stem pulled back; None until the test has ended.
        rise: change of the force between inside and outside [N]; furthest: way of the pull [m].
    """

    def __init__(self) -> None:
        self.holds: bool | None = None
        self.rise = self.furthest = 0.0
        self._stage, self._since, self._time = _Stage.BEFORE, 0.0, 0.0
        self._sum, self._means = 0.0, [0.0, 0.0, 0.0]
        self._smooth = 0.0

    def step(self, dt: float, force: float, moved: float) -> float:
        """Return the speed of the set-point along the pull [m/s].

        Args:
            dt: period [s].
            force: of the pads on the fruit along the pull, mean of the period [N].
            moved: way of the set-point along the pull since the test began [m].
        """
        self._time += dt
        self._smooth += min(dt / SMOOTHED, 1.0) * (force - self._smooth)
        if self._stage is _Stage.OUT:
            self.furthest = max(self.furthest, moved)
            if self._smooth - self._means[0] > ENOUGH or moved > FURTHEST:
                self._next()
        elif self._stage is _Stage.HOME:
            if moved < 1e-3:
                self._next()
        elif self._stage is not _Stage.ENDED:
            self._average(dt, force)
        if self._time > PATIENCE and self._stage is not _Stage.ENDED:
            self.holds, self._stage = False, _Stage.ENDED
        return {_Stage.OUT: SPEED, _Stage.HOME: -SPEED}.get(self._stage, 0.0)

    def _average(self, dt: float, force: float) -> None:
        self._since, self._sum = self._since + dt, self._sum + dt * force
        if self._since < AVERAGED:
            return
        self._means[self._stage.value // 2] = self._smooth = self._sum / self._since
        if self._stage is _Stage.AFTER:
            before, there, after = self._means
            self.rise = there - 0.5 * (before + after)
            if self.rise <= HOLDS and self.furthest <= FURTHEST:
                self._stage, self._since, self._sum, self.furthest = _Stage.BEFORE, 0.0, 0.0, 0.0
                return  # a jolt had ended the pull: once more
            self.holds = self.rise > HOLDS
        self._next()

    def _next(self) -> None:
        self._since = self._sum = 0.0
        self._stage = _Stage(self._stage.value + 1)
