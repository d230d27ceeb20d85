"""Recording of the bias, and the check of the sensor by its samples at rest.

Noise makes the resolution of a sensor visible: the smallest difference between two values of a channel is its step. A
coarse or slow sensor must be refused here: later its own noise is the measure by which stuck values are found.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.errors import UnfitSensor
from pomona.skills.grip.grip import SIDES
from pomona.skills.grip.settings import BiasSettings

LEVER = 0.01  # lever at which a torque's resolution is compared with a force's [m]
SAME = 1e-9  # values that differ by less are equal but for rounding [N, N·m]


class BiasRecorder:
    """Collects samples until the error of their mean is small enough."""

    def __init__(self, settings: BiasSettings, rate: float) -> None:
        self._settings, self._rate = settings, rate
        self._samples: list[Float64] = []
        self._received = 0

    def add(self, wrenches: Float64) -> Float64 | None:
        """Take a sample, shape (2, 6); return all of them, shape (n, 2, 6), once they are enough."""
        s, rate = self._settings, self._rate
        self._received += 1
        if self._received <= round(s.dropped * rate):
            return None
        self._samples.append(np.array(wrenches))
        count, enough, most = len(self._samples), round(s.time * rate), round(s.longest * rate)
        if count < enough or (count % max(enough // 2, 1) and count < most):
            return None
        samples = np.array(self._samples)
        error = float(samples[:, :, :3].std(axis=0).max()) / math.sqrt(count)
        return None if error > s.error and count < most else samples


def check_bias(samples: Float64, rate: float, settings: BiasSettings) -> None:
    """Check the samples from which a bias is taken.

    Samples without any noise pass: the driver detects a constant sensor.

    Args:
        samples: with nothing touching, shape (n, 2, 6) [N, N·m].
        rate: of the samples [Hz].

    Raises UnfitSensor: a channel's step is too coarse, a force shows no noise at all, or samples are copies.
    """
    changes: NDArray[np.bool_] = np.abs(np.diff(samples, axis=0)) > SAME
    noisy: NDArray[np.bool_] = np.any(changes, axis=0)
    if not noisy.any():
        return
    for side in range(2):
        if noisy[side].any():
            _check_steps(SIDES[side], samples[:, side], noisy[side], settings)
            _check_copies(SIDES[side], changes[:, side], rate, settings)


def _check_steps(side: str, samples: Float64, noisy: NDArray[np.bool_], settings: BiasSettings) -> None:
    for channel in range(6):
        axis, is_force = "xyz"[channel % 3], channel < 3
        if noisy[channel]:
            gaps = np.diff(np.unique(samples[:, channel]))
            step, coarsest = float(gaps[gaps > SAME].min()), settings.step * (1.0 if is_force else LEVER)
            if step > coarsest:
                name, unit, scale = ("force", "N", 1.0) if is_force else ("torque", "mN·m", 1e3)
                words = f"{name} {axis} changes in steps of {scale * step:.2g} {unit}"
                most = f"at most {scale * coarsest:.2g} {unit} is expected: set its resolution"
                raise UnfitSensor(f"the {side} finger's {words}, {most}", step, coarsest)
        elif is_force:
            words = f"force {axis} did not change in {len(samples)} samples, its other channels did"
            raise UnfitSensor(f"the {side} finger's {words}: it is dead, or coarser than its noise", 0.0, SAME)


def _check_copies(side: str, changes: NDArray[np.bool_], rate: float, settings: BiasSettings) -> None:
    """Refuse copied samples: they repeat all channels at once, few bits repeat each channel by chance."""
    repeats = float((~changes.any(axis=1)).mean())
    by_chance = math.prod((~changes).mean(axis=0))
    if repeats - by_chance > settings.copies:
        words = f"repeats {100.0 * repeats:.0f} % of its samples, at most {100.0 * settings.copies:.0f} % are expected"
        fresh = round(rate * (1.0 - repeats), -1)
        words += f": it measures at about {fresh:.0f} Hz and delivers {rate:.0f} Hz; set its rate"
        raise UnfitSensor(f"the {side} finger {words}", repeats, settings.copies)
