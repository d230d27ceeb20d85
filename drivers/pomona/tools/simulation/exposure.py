"""When the simulated camera exposes and delivers: motion blur, depth beside colour, frames on their way."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.drivers.interfaces import Frame
from pomona.executive.clock import Clock
from pomona.tools.simulation.gl import load_mujoco

STEP = 2e-3
"""Longest time between two pictures of which a blurred one is the mean [s]: at 0.3 m/s 0.6 mm, less than a pixel."""


@dataclass(frozen=True, slots=True)
class Timing:
    """When a frame is exposed and delivered. Its stamp is the middle of the colour's exposure.

    Attributes:
        latency: least and largest time from the stamp to the delivery, drawn for each frame [s].
        exposure: of the colour picture [s]; 0 takes it in a moment, without blur.
        depth_after: moment of the depth picture after the stamp, negative before it [s].
    """

    latency: tuple[float, float] = (0.0, 0.0)
    exposure: float = 0.0
    depth_after: float = 0.0

    @property
    def colour(self) -> tuple[float, ...]:
        """Moments about the stamp of which the colour picture is the mean [s]."""
        count = max(math.ceil(self.exposure / STEP - 1e-9), 1)
        return tuple(self.exposure * ((k + 0.5) / count - 0.5) for k in range(count))


class Moments:
    """The world a few milliseconds from now: all its bodies move on at their present velocities."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self._scratch: Any = None

    def moved(self, state: Any, dt: float) -> Any:
        """Return the state, or for another moment a copy of it that the next call overwrites.

        Args:
            state: `mujoco.MjData` of the model.
            dt: from now [s], negative for the past.
        """
        if dt == 0.0:
            return state
        mujoco = load_mujoco()
        if self._scratch is None:
            self._scratch = mujoco.MjData(self._model)
        mujoco.mj_copyData(self._scratch, self._model, state)
        mujoco.mj_integratePos(self._model, self._scratch.qpos, state.qvel, dt)
        mujoco.mj_kinematics(self._model, self._scratch)
        mujoco.mj_camlight(self._model, self._scratch)
        return self._scratch


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
