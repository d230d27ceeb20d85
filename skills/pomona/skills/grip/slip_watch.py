"""Detects slip without relying on the coefficient of friction: by the centre of pressure and the lever arm of the load.

When a round fruit slides, its contact moves on the pads: the torques over the normal force give the centre of pressure.
When it turns, the lever arm of its load, moment over force, changes; the acceleration of a lift does not change it. A
fast and a slow average are compared, and their difference counts beyond noise.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.estimate_kernel import GripEstimate
from pomona.skills.grip.pads import LEVER_LOAD, MIRROR
from pomona.skills.grip.settings import SlipWatchSettings

LEAST_FORCE = 0.15  # mean normal force of the fingers below which the centre of pressure is unknown [N]


class SlipWatch:
    """Watches the centre of pressure and the lever arm of a held fruit.

    Attributes:
        slipped: distance that the contact has moved since `start` [m].
    """

    def __init__(self, settings: SlipWatchSettings, rate: float) -> None:
        self._settings = settings
        self._lags = np.array(settings.place_lags)
        self._shares = 1.0 - np.exp(-1.0 / (rate * self._lags))
        self._period = 1.0 / rate
        self._torque_std = 0.0
        self._means, self._places = np.zeros((3, 5)), np.zeros((3, 2))
        self._lever_fast = self._lever_slow = 0.0
        self._samples = 0
        self._carried_for = 0.0
        self._origin = np.full(2, np.nan)
        self._slipped_before = 0.0
        self.slipped = 0.0

    def calibrate(self, samples: Float64) -> None:
        """Learn the noise of the torques from samples with nothing touching, shape (n, 2, 6)."""
        alike = 0.5 * (samples[:, 0] + MIRROR * samples[:, 1])
        self._torque_std = float(np.sqrt(alike[:, 3:5].var(axis=0).max()))

    def start(self) -> None:
        """Use the present place of the fruit as the reference."""
        self._samples = 0
        self._carried_for = 0.0
        self._origin[:] = np.nan
        self.slipped = self._slipped_before = 0.0

    def check(self, estimate: GripEstimate, periods: int, is_carried: bool) -> bool:
        """Take one sample; return True when the fruit slides or turns now.

        Args:
            estimate: after the sample.
            periods: sample periods that it stands for.
            is_carried: the fruit hangs in the fingers.
        """
        self._samples += periods
        weakest = _average(
            estimate.unfiltered, self._samples, min(periods, 10), self._shares, self._means, self._places
        )
        if weakest < LEAST_FORCE:
            return False
        pressing, places = self._means[:, 0], self._places
        if math.isnan(self._origin[0]) and self._samples * self._period > self._lags[1]:
            self._origin[:] = places[1]
        elif not math.isnan(self._origin[0]):
            way = math.hypot(places[1, 0] - self._origin[0], places[1, 1] - self._origin[1])
            self.slipped = self._slipped_before + way
        slides = self._slides(places, pressing, is_carried)
        turns = self._turns(estimate, is_carried, periods)
        if slides or turns:
            self._means[1:] = self._means[0]
            self._samples = min(self._samples, round(1.0 / self._shares[0]))
            self._lever_slow = self._lever_fast
            # Count from here: the rising force brings the fruit to rest, which is no further slip.
            if not math.isnan(self._origin[0]):
                self._slipped_before += math.hypot(places[0, 0] - self._origin[0], places[0, 1] - self._origin[1])
                self._origin[:] = places[0]
        return slides or turns

    def _slides(self, places: Float64, pressing: Float64, is_carried: bool) -> bool:
        s = self._settings
        if not math.hypot(places[0, 0] - self._origin[0], places[0, 1] - self._origin[1]) > s.moved_far:
            return False
        for fast, slow in ((0, 1), (1, 2)):
            if slow == 2 and not is_carried:
                continue
            moved = math.hypot(places[fast, 0] - places[slow, 0], places[fast, 1] - places[slow, 1])
            share = self._shares[fast]
            std = self._torque_std / float(pressing[fast]) * math.sqrt(share / (2.0 - share))
            f_x, f_y = self._means[fast, 3:] - self._means[slow, 3:]
            given = s.compliance * 2.0 * math.hypot(f_x, f_y)
            if moved > max(s.moved, s.stds * std) + given:
                return True
        return False

    def _turns(self, estimate: GripEstimate, is_carried: bool, periods: int) -> bool:
        s = self._settings
        if not is_carried or estimate.f_t < LEVER_LOAD:
            self._carried_for = 0.0
            return False
        lever = estimate.tau_n / estimate.f_t
        if self._carried_for == 0.0:
            self._lever_fast = self._lever_slow = lever
        self._carried_for += periods * self._period
        slow_lag = min(s.lever_lags[1], max(self._carried_for, s.lever_lags[0]))
        self._lever_fast += (1.0 - math.exp(-periods * self._period / s.lever_lags[0])) * (lever - self._lever_fast)
        self._lever_slow += (1.0 - math.exp(-periods * self._period / slow_lag)) * (lever - self._lever_slow)
        moved = abs(self._lever_fast - self._lever_slow)
        noise = s.lever_stds * estimate.tau_std / estimate.f_t
        least = max(s.lever_moved, s.lever_ratio * abs(self._lever_slow), noise)
        return self._carried_for > s.lever_lags[1] and moved > least


@njit(cache=True, error_model="numpy")
def _average(wrench, samples, periods, shares, means, places):  # type: ignore[no-untyped-def]
    """Update averages and places by the mean wrench of both fingers, and return the smallest normal force [N].

    Columns of `means`, shape (3, 5), one row a time constant: normal force, that times the centre of pressure (x, y),
    tangential force (x, y). Each average is a plain mean until its time constant has passed. `places` are the
    centres of pressure, shape (3, 2).
    """
    for k in range(3):
        share = max(min(periods * shares[k], 1.0), 1.0 / samples)
        means[k, 0] += share * (-wrench[2] - means[k, 0])
        means[k, 1] += share * (wrench[4] - means[k, 1])
        means[k, 2] += share * (-wrench[3] - means[k, 2])
        means[k, 3] += share * (wrench[0] - means[k, 3])
        means[k, 4] += share * (wrench[1] - means[k, 4])
        places[k, 0] = means[k, 1] / means[k, 0]
        places[k, 1] = means[k, 2] / means[k, 0]
    return min(means[0, 0], means[1, 0], means[2, 0])
