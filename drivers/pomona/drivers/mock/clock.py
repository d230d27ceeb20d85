"""A clock that moves mock devices as it advances."""

from __future__ import annotations

from collections.abc import Callable

PERIOD = 0.002  # step of mock devices [s]


class MockClock:
    """Simulated time without a world; `each_step` hooks are called after every step of 2 ms."""

    simulated = True

    def __init__(self) -> None:
        self.each_step: list[Callable[[], None]] = []
        self._steps = 0
        self._owed = 0.0

    def now(self) -> float:
        return self._steps * PERIOD

    def advance(self, duration: float) -> None:
        """Step; a rest shorter than a step is kept for the next call."""
        self._owed += max(duration, 0.0)
        count = int(self._owed / PERIOD + 1e-6)
        self._owed -= count * PERIOD
        for _ in range(count):
            self._steps += 1
            for hook in tuple(self.each_step):
                hook()
