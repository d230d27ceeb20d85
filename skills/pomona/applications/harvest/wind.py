"""Wind: a force on everything that moves, its share of the weight, in gusts that run along the wall."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.applications.harvest.model import WallModel
from pomona.applications.harvest.wood import GRAVITY
from pomona.executive import Float64

GUSTS = 5  # cosines between the slowest and the fastest frequency


@dataclass(slots=True)
class Wind:
    """F = A·m·g·Σ aₖ·cos(ωₖ·t + φₖ - ωₖ·x/c) on each body, Σ aₖ² = 2 (unit deviation), along and across the wall."""

    built: WallModel
    data: Any
    strength: float  # over the numbers' own; 0 is calm
    _bodies: NDArray[np.int64] = field(init=False)
    _rates: Float64 = field(init=False)
    _cosines: Float64 = field(init=False)
    _sines: Float64 = field(init=False)

    def __post_init__(self) -> None:
        model, numbers = self.built.model, self.built.wall.numbers
        rng = np.random.default_rng([self.built.wall.seed, 17])
        names = [model.body(b).name for b in range(model.nbody)]
        moving = [
            b
            for b, name in enumerate(names)
            if name.startswith(("lateral_", "spur_", "fruit_", "leaf_"))
        ]
        self._bodies = np.array(moving, np.int64)
        frequencies = rng.uniform(numbers.wind_slowest, numbers.wind_fastest, GUSTS)
        self._rates = 2.0 * np.pi * frequencies
        share = rng.uniform(0.5, 1.0, GUSTS)
        share *= np.sqrt(2.0 / (share @ share))
        x = self.data.xpos[self._bodies, 0]
        phase = (
            rng.uniform(-np.pi, np.pi, GUSTS)[None]
            - self._rates[None] * x[:, None] / numbers.wind_speed
        )
        weight = self.strength * numbers.wind_strength * GRAVITY * model.body_mass[self._bodies]
        self._cosines = weight[:, None] * share[None] * np.cos(phase)
        self._sines = weight[:, None] * share[None] * np.sin(phase)

    def blow(self, time: float) -> None:
        """Set the forces of this moment: across the wall, and half as hard along it, a quarter of a turn later."""
        if self.strength == 0.0:
            return
        c, s = np.cos(self._rates * time), np.sin(self._rates * time)
        self.data.xfrc_applied[self._bodies, 1] = self._cosines @ c - self._sines @ s
        self.data.xfrc_applied[self._bodies, 0] = 0.5 * (self._cosines @ s + self._sines @ c)
