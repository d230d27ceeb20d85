"""Delivery of frames some time after their exposure, as by a real camera."""

from __future__ import annotations

from collections import deque

import numpy as np

from pomona.drivers.interfaces import Frame
from pomona.executive.clock import Clock


class Delivery:
    """Frames on their way from a camera; a frame is exposed when one is asked for.

    After a time without a request nothing is on its way, and the first frame is delivered at once.
    """

    def __init__(self, clock: Clock, latency: tuple[float, float], seed: int) -> None:
        """
        Args:
            latency: least and largest time from an exposure to its delivery [s].
        """
        self._clock, self._latency, self._seed = clock, latency, seed
        self._coming: deque[tuple[float, Frame]] = deque()
        self._delivered: Frame | None = None

    def newest(self, exposed: Frame | None) -> Frame | None:
        """Take the frame of this moment, and return the newest one that has arrived."""
        if exposed is None or self._latency[1] == 0.0:
            return exposed
        now, waits = self._clock.now(), 2.0 * self._latency[1]
        if self._delivered is None or now - self._delivered.stamp > waits + self._latency[1]:
            self._coming.clear()
            self._delivered = exposed
            return exposed
        if exposed.sequence != (self._coming[-1][1] if self._coming else self._delivered).sequence:
            drawn = np.random.default_rng([self._seed, 19, exposed.sequence]).uniform(*self._latency)
            before = self._coming[-1][0] if self._coming else 0.0
            self._coming.append((max(now + float(drawn), before), exposed))  # in order
        while self._coming and self._coming[0][0] <= now + 1e-9:
            self._delivered = self._coming.popleft()[1]
        return self._delivered
