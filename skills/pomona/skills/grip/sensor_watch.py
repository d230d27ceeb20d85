"""Detects faulty force readings: stuck channels, fingers that contradict each other or the gripper's motor.

A channel that was noisy during bias calibration and now repeats exactly is stuck, zero, or at the end of its range. A
load always comes to both fingers, so a reading that jumps on one finger alone is wrong.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.estimate_kernel import GripEstimate
from pomona.skills.grip.grip import SIDES
from pomona.skills.grip.settings import GripSettings
from pomona.skills.grip.stream_guard import GripSample
from pomona.skills.grip.timing import LowPass, Timer


class SensorWatch:
    """Compares each sample with the noise at calibration, the other finger and the motor. A fault is latched.

    Attributes:
        reason: sensor fault as a sentence; empty while the readings are plausible.
        no_signal: True when the samples carry no information: the controller then commands zero speed.
        doubt: reason why the grip must not be opened although the readings may be right; empty without any.
        has_pressed_alone: True after one finger's normal force has jumped alone.
    """

    def __init__(self, settings: GripSettings) -> None:
        self._settings, self._filters, self._rate = settings.sensors, settings.filters, settings.rate
        self.reason = self.doubt = ""
        self.no_signal = self.has_pressed_alone = False
        self._limits = np.full((2, 6), np.inf)
        self._runs = np.zeros((2, 6))
        self._last = np.full((2, 6), np.nan)
        self._apart, self._against_motor, self._held = Timer(), Timer(), Timer()
        self._load = self._force_rate = self._swings_for = 0.0
        self._motor, self._fingers = LowPass(settings.sensors.motor_lag), LowPass(settings.sensors.motor_lag)

    def calibrate(self, samples: Float64) -> None:
        """Learn the usual repetitions from samples with nothing touching, shape (n, 2, 6)."""
        noisy = (samples != samples[0]).any(axis=0)
        fewest = max(round(self._settings.frozen_after * self._rate), self._settings.fewest)
        longest = _longest_runs(np.ascontiguousarray(samples))
        self._limits = np.where(noisy, np.maximum(fewest, self._settings.longer * longest), np.inf)
        for side in range(2):
            if not noisy[side].any() and noisy[1 - side].any():
                self._find(f"the {SIDES[side]} finger's samples do not change, the other one's do", no_signal=True)

    def check(self, sample: GripSample, estimate: GripEstimate, is_carried: bool, force_rate: float) -> None:
        """Check one sample.

        Args:
            estimate: after it.
            is_carried: the fruit hangs in the fingers.
            force_rate: change of the grip force by the fingers' own motion [N/s].
        """
        s, elapsed, saturated = self._settings, sample.elapsed, sample.saturated
        frozen = _longest_now(sample.wrenches, self._last, self._runs, self._limits)
        if frozen >= 0 and not saturated[frozen // 6]:
            side, channel = SIDES[frozen // 6], ("x", "y", "z")[frozen % 3]
            kind = "force" if frozen % 6 < 3 else "torque"
            self._find(f"the {side} finger's {kind} {channel} repeats one value although it is noisy", no_signal=True)
        self._force_rate = max(abs(force_rate), self._force_rate * math.exp(-elapsed / s.own_motion_memory))
        if is_carried:
            self.has_pressed_alone = self.has_pressed_alone or estimate.one_presses_more
            if estimate.shear_jump > self._filters.jump:
                self.doubt = self.doubt or "one finger's signal jumped alone"
        if not is_carried or any(saturated):
            self._apart.lasted = self._load = self._held.lasted = 0.0
            return
        self._check_jumps(estimate, elapsed)
        self._load = max(estimate.f_t, self._load * math.exp(-elapsed / s.load_memory))
        most = max(s.apart, s.apart_ratio * estimate.f_t) + estimate.f_n_band
        is_apart = abs(estimate.left - estimate.right) > most and estimate.f_t > s.hanging * self._load
        if self._apart.update(is_apart, elapsed) > s.apart_after:
            forces = f"{estimate.left:.1f} N and {estimate.right:.1f} N"
            self._find(f"a hanging fruit presses on both fingers alike, they read {forces}")

    def _check_jumps(self, estimate: GripEstimate, elapsed: float) -> None:
        jump, lag = self._filters.jump, self._filters.normal_lag
        # A fruit whose contact broke swings between the pads, and the slow filters still contain the break.
        broke = estimate.contact_jump > 0.5 * jump
        self._swings_for = lag if broke else self._swings_for - elapsed
        if max(estimate.shear_jump, estimate.press_jump_of_one) > jump and self._swings_for <= 0.0:
            self._find("one finger's signal jumped alone: the other one shows no change at all")
        # A fruit that slides out of too weak a grip makes both fingers jump, too.
        held_for = self._held.update(estimate.f_n >= estimate.f_least, elapsed)
        if estimate.press_jump_of_both > jump + 0.5 * lag * self._force_rate:
            jumped = "both fingers' normal forces jumped at once without the gripper's doing"
            self.doubt = self.doubt or jumped
            if held_for > 0.5 * self._settings.load_memory:
                self._find(jumped)

    def compare_with_motor(self, force_sum: float, motor_force: float | None, elapsed: float) -> None:
        """Compare the sum of both fingers' forces [N] with the motor's force [N], where the gripper reports one."""
        s = self._settings
        if motor_force is None or not math.isfinite(motor_force):
            return
        # Both have the same lag, or the loss of a fruit would look like fingers that read too little.
        motor, fingers = self._motor.update(motor_force, elapsed), self._fingers.update(force_sum, elapsed)
        most = s.motor_error + s.motor_ratio * max(abs(fingers), abs(motor))
        if self._against_motor.update(abs(motor - fingers) > most, elapsed) > s.motor_after:
            words = f"the fingers read {fingers:.1f} N together while the motor presses with {motor:.1f} N"
            self._find(words, no_signal=True)

    def _find(self, reason: str, no_signal: bool = False) -> None:
        self.reason = self.reason or reason
        self.no_signal = self.no_signal or no_signal


@njit(cache=True)
def _longest_runs(samples):  # type: ignore[no-untyped-def]
    """Longest run of repetitions of each channel, shape (2, 6)."""
    n = samples.shape[0]
    longest = np.zeros((2, 6))
    for side in range(2):
        for channel in range(6):
            run = 0
            for i in range(1, n):
                run = run + 1 if samples[i, side, channel] == samples[i - 1, side, channel] else 0
                longest[side, channel] = max(longest[side, channel], run)
    return longest


@njit(cache=True)
def _longest_now(wrenches, last, runs, limits):  # type: ignore[no-untyped-def]
    """Index (6 * side + channel) of a channel that repeats its value too often, or -1; updates `runs` and `last`."""
    found = -1
    for side in range(2):
        for channel in range(6):
            value = wrenches[side, channel]
            runs[side, channel] = runs[side, channel] + 1.0 if value == last[side, channel] else 0.0
            last[side, channel] = value
            if found < 0 and runs[side, channel] > limits[side, channel]:
                found = 6 * side + channel
    return found
