"""Finds fingers that lie: samples that stand still, fingers that contradict each other or the gripper's motor.

Noise is a witness: a channel whose noise was felt while the bias was taken and whose values repeat to the last bit is
stuck, zero, or at the end of its range. So are the other finger, since a load always comes to both, and the motor.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.slip_sense import SlipSense
from pomona.skills.grip.tuning import SensorWatchSettings

SIDES = ("left", "right")


class SensorWatch:
    """Looks at every sample; says in a sentence what cannot be true, once and for all.

    Attributes:
        reason: why the samples are not believed any more; empty as long as they are.
        still: whether they say nothing at all, so that fingers that follow them had better stand.
        doubt: why a grip must not be opened because of them, although they may be right; empty when there is none.
    """

    def __init__(self, settings: SensorWatchSettings, rate: float) -> None:
        self._settings, self._rate = settings, rate
        self.reason = self.doubt = ""
        self.still = False
        self._limits = np.full((2, 6), np.inf)
        self._runs = np.zeros((2, 6))
        self._last = np.full((2, 6), np.nan)
        self._apart_for = self._against_motor_for = 0.0
        self._load = self._force_rate = self._held_for = self._swings_for = 0.0
        self._motor = math.nan

    def calibrate(self, samples: Float64) -> None:
        """Learn how long values repeat in sound samples with nothing touching, shape (n, 2, 6)."""
        noisy = (samples != samples[0]).any(axis=0)
        fewest = max(round(self._settings.frozen_after * self._rate), self._settings.fewest)
        longest = _longest_runs(np.ascontiguousarray(samples))
        self._limits = np.where(noisy, np.maximum(fewest, self._settings.longer * longest), np.inf)
        for side in range(2):
            if not noisy[side].any() and noisy[1 - side].any():
                self._find(f"the {SIDES[side]} finger's samples do not change, the other one's do", still=True)

    def look(
        self,
        wrenches: Float64,
        elapsed: float,
        saturated: tuple[bool, bool],
        sense: SlipSense,
        carried: bool,
        force_rate: float,
    ) -> None:
        """Look at one sample.

        Args:
            wrenches: as they came, shape (2, 6).
            elapsed: since the last one [s].
            saturated: fingers that say so themselves are at the end of their range.
            sense: after the sample.
            carried: the fruit hangs in the fingers.
            force_rate: how fast the fingers' own motion changes the grasp force [N/s].
        """
        frozen = _longest_now(wrenches, self._last, self._runs, self._limits)
        if frozen >= 0 and not saturated[frozen // 6]:
            side, channel = SIDES[frozen // 6], ("x", "y", "z")[frozen % 3]
            kind = "force" if frozen % 6 < 3 else "torque"
            self._find(f"the {side} finger's {kind} {channel} repeats one value although it is noisy", still=True)
        fading = math.exp(-elapsed / self._settings.own_motion_memory)
        self._force_rate = max(abs(force_rate), self._force_rate * fading)
        if not carried or saturated[0] or saturated[1]:
            self._apart_for = self._load = self._held_for = 0.0
            return
        # A fruit whose contact broke swings between the pads, and the slow filters remember the break.
        broke = sense.loads.contact_jump > 0.5 * self._settings.jump
        self._swings_for = self._settings.swinging if broke else self._swings_for - elapsed
        if sense.jump_of_one_finger > self._settings.jump and self._swings_for <= 0.0:
            self._find("one finger's signal jumped alone: the other one felt nothing at all")
        # A fruit that slides out of too weak a grip lets both fingers jump, too.
        self._held_for = self._held_for + elapsed if sense.f_n >= sense.least else 0.0
        allowed = self._settings.jump + 0.5 * self._settings.own_motion * self._force_rate
        if sense.loads.press_jump > allowed:
            jumped = "both fingers' normal forces jumped at once without the gripper's doing"
            self.doubt = self.doubt or jumped
            if self._held_for > 0.5 * self._settings.load_memory:
                self._find(jumped)
        self._load = max(sense.f_t, self._load * math.exp(-elapsed / self._settings.load_memory))
        left, right = sense.finger_forces
        most = max(self._settings.apart, self._settings.apart_share * sense.f_t) + sense.normal_noise_band
        apart = abs(left - right) > most and sense.f_t > self._settings.hanging * self._load
        self._apart_for = self._apart_for + elapsed if apart else 0.0
        if self._apart_for > self._settings.apart_after:
            self._find(f"a fruit that hangs presses on both fingers alike, they feel {left:.1f} N and {right:.1f} N")

    def compare_with_motor(self, force_sum: float, motor_force: float | None, elapsed: float) -> None:
        """Compare what both fingers feel together [N] with what the gripper's motor presses with [N], if it tells."""
        if motor_force is None or not math.isfinite(motor_force):
            return
        if math.isnan(self._motor):
            self._motor = motor_force
        self._motor += (1.0 - math.exp(-elapsed / self._settings.motor_lag)) * (motor_force - self._motor)
        most = self._settings.motor_error + self._settings.motor_share * max(abs(force_sum), abs(self._motor))
        against = abs(self._motor - force_sum) > most
        self._against_motor_for = self._against_motor_for + elapsed if against else 0.0
        if self._against_motor_for > self._settings.motor_after:
            words = f"the fingers feel {force_sum:.1f} N together while the motor presses with {self._motor:.1f} N"
            self._find(words, still=True)

    def _find(self, reason: str, still: bool = False) -> None:
        self.reason = self.reason or reason
        self.still = self.still or still


@njit(cache=True)
def _longest_runs(samples):  # type: ignore[no-untyped-def]
    """How many times in a row each channel repeated its value at most, shape (2, 6)."""
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
    """Place (6 * side + channel) of a channel that repeats its value too often, or -1; counts on in `runs`."""
    found = -1
    for side in range(2):
        for channel in range(6):
            value = wrenches[side, channel]
            runs[side, channel] = runs[side, channel] + 1.0 if value == last[side, channel] else 0.0
            last[side, channel] = value
            if found < 0 and runs[side, channel] > limits[side, channel]:
                found = 6 * side + channel
    return found
