"""When the simulated camera exposes: motion blur, and depth of another moment than the colour."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

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
        """Return a copy of the state that the next call overwrites.

        Args:
            state: `mujoco.MjData` of the model.
            dt: from now [s], negative for the past.
        """
        mujoco = load_mujoco()
        if self._scratch is None:
            self._scratch = mujoco.MjData(self._model)
        mujoco.mj_copyData(self._scratch, self._model, state)
        mujoco.mj_integratePos(self._model, self._scratch.qpos, state.qvel, dt)
        mujoco.mj_kinematics(self._model, self._scratch)
        mujoco.mj_camlight(self._model, self._scratch)
        return self._scratch
