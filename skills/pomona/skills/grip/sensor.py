"""The force sensor of a grip: its valid samples, its bias, and the detection of faulty readings.

Noise makes the resolution of a sensor visible: the smallest difference between two values of a channel is its step. A
coarse or slow sensor must be refused here: later its own noise is the measure by which stuck values are found.

A channel that was noisy during bias calibration and now repeats exactly is stuck, zero, or at the end of its range. A
load always comes to both fingers, so a reading that jumps on one finger alone is wrong.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.grip.estimate import GripEstimate
from pomona.skills.grip.grip import SIDES, UnfitSensor
from pomona.skills.grip.settings import BiasSettings, GripSettings

STALE_AFTER = 0.05
"""A stream without a valid sample for this long is stale [s]; the driver's watchdog stops the fingers at 0.1 s."""

EARLIEST = 0.02  # a sample whose timestamp lies further in the future is rejected [s]
# after a gap the filters run on with the new sample for at most this long [s]
LONGEST_CATCH_UP = 0.02
RESTART_AFTER = 0.05  # a sequence that falls back with a timestamp this much later comes from a restarted sensor [s]


class GripSample(NamedTuple):
    """A valid sample."""

    stamp: float  # time of the sample [s]
    periods: int  # sample periods since the last valid one; 1 in a flawless stream
    elapsed: float  # the same [s]
    wrenches: Float64  # of both fingers, shape (2, 6) [N, N·m], as in `WrenchSample`
    saturated: tuple[bool, bool] = (
        False,
        False,
    )  # True for a finger with a channel at the end of its range


class StreamGuard:
    """Lets valid samples through."""

    def __init__(self, period: float) -> None:
        self.period = period
        self._most_periods = max(round(LONGEST_CATCH_UP / period), 1)
        self.stamp = -math.inf
        self.sequence = -1

    def accept(
        self,
        stamp: float,
        sequence: int,
        wrenches: Float64,
        saturated: tuple[bool, bool] = (False, False),
    ) -> GripSample | None:
        """Return the sample, or None for one to be ignored."""
        if not (math.isfinite(stamp) and math.isfinite(wrenches.sum())):
            return None
        is_first = self.sequence < 0
        if not is_first and sequence <= self.sequence and stamp < self.stamp + RESTART_AFTER:
            return None
        if stamp <= self.stamp:
            return None
        gap = 0.0 if is_first else stamp - self.stamp - self.period
        self.stamp = stamp
        self.sequence = sequence
        periods = 1 + min(max(round(gap / self.period), 0), self._most_periods - 1)
        return GripSample(stamp, periods, periods * self.period, wrenches, saturated)


class Timer:
    """Duration for which a condition has held without a break.

    Attributes:
        lasted: that duration [s]; 0 when the condition does not hold.
    """

    def __init__(self) -> None:
        self.lasted = 0.0

    def update(self, is_true: bool, elapsed: float) -> float:
        """Return the duration after `elapsed` more seconds in which the condition held or not [s]."""
        self.lasted = self.lasted + elapsed if is_true else 0.0
        return self.lasted


class LowPass:
    """First-order average of irregular samples.

    Attributes:
        value: the average; nan until the first sample where no start is given.
    """

    def __init__(self, lag: float, start: float = math.nan) -> None:
        """Take the time constant [s] and the value at the start."""
        self._lag = lag
        self.value = start

    def update(self, sample: float, elapsed: float, lag: float | None = None) -> float:
        """Return the average after a sample that stands for `elapsed` seconds, here perhaps with another lag."""
        if math.isnan(self.value):
            self.value = sample
        self.value += (1.0 - math.exp(-elapsed / (lag or self._lag))) * (sample - self.value)
        return self.value


LEVER = 0.01  # lever at which a torque's resolution is compared with a force's [m]
SAME = 1e-9  # values that differ by less are equal but for rounding [N, N·m]


class BiasRecorder:
    """Collects samples until the error of their mean is small enough."""

    def __init__(self, settings: BiasSettings, rate: float) -> None:
        self._settings = settings
        self._rate = rate
        self._samples: list[Float64] = []
        self._received = 0

    def add(self, wrenches: Float64) -> Float64 | None:
        """Take a sample, shape (2, 6); return all of them, shape (n, 2, 6), once they are enough."""
        s = self._settings
        rate = self._rate
        self._received += 1
        if self._received <= round(s.dropped * rate):
            return None
        self._samples.append(np.array(wrenches))
        count = len(self._samples)
        enough = round(s.time * rate)
        most = round(s.longest * rate)
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


def _check_steps(
    side: str, samples: Float64, noisy: NDArray[np.bool_], settings: BiasSettings
) -> None:
    for channel in range(6):
        axis = "xyz"[channel % 3]
        is_force = channel < 3
        if noisy[channel]:
            gaps = np.diff(np.unique(samples[:, channel]))
            step = float(gaps[gaps > SAME].min())
            coarsest = settings.step * (1.0 if is_force else LEVER)
            if step > coarsest:
                name, unit, scale = ("force", "N", 1.0) if is_force else ("torque", "mN·m", 1e3)
                words = f"{name} {axis} changes in steps of {scale * step:.2g} {unit}"
                most = f"at most {scale * coarsest:.2g} {unit} is expected: set its resolution"
                raise UnfitSensor(f"the {side} finger's {words}, {most}", step, coarsest)
        elif is_force:
            words = f"force {axis} did not change in {len(samples)} samples, its other channels did"
            raise UnfitSensor(
                f"the {side} finger's {words}: it is dead, or coarser than its noise", 0.0, SAME
            )


def _check_copies(
    side: str, changes: NDArray[np.bool_], rate: float, settings: BiasSettings
) -> None:
    """Refuse copied samples: they repeat all channels at once, few bits repeat each channel by chance."""
    repeats = float((~changes.any(axis=1)).mean())
    by_chance = math.prod((~changes).mean(axis=0))
    if repeats - by_chance > settings.copies:
        words = f"repeats {100.0 * repeats:.0f} % of its samples, at most {100.0 * settings.copies:.0f} % are expected"
        fresh = round(rate * (1.0 - repeats), -1)
        words += f": it measures at about {fresh:.0f} Hz and delivers {rate:.0f} Hz; set its rate"
        raise UnfitSensor(f"the {side} finger {words}", repeats, settings.copies)


class SensorWatch:
    """Compares each sample with the noise at calibration, the other finger and the motor. A fault is latched.

    Attributes:
        reason: sensor fault as a sentence; empty while the readings are plausible.
        no_signal: True when the samples carry no information: the controller then commands zero speed.
        doubt: reason why the grip must not be opened although the readings may be right; empty without any.
    """

    def __init__(self, settings: GripSettings) -> None:
        self._settings = settings.sensors
        self._filters = settings.filters
        self._rate = settings.rate
        self.reason = self.doubt = ""
        self.no_signal = False
        self._limits = np.full((2, 6), np.inf)
        self._runs = np.zeros((2, 6))
        self._last = np.full((2, 6), np.nan)
        self._apart, self._against_motor, self._held = Timer(), Timer(), Timer()
        self._load = self._force_rate = self._swings_for = self._acceleration = 0.0
        self._motor, self._fingers = (
            LowPass(settings.sensors.motor_lag),
            LowPass(settings.sensors.motor_lag),
        )

    def calibrate(self, samples: Float64) -> None:
        """Learn the usual repetitions from samples with nothing touching, shape (n, 2, 6)."""
        noisy = (samples != samples[0]).any(axis=0)
        fewest = max(round(self._settings.frozen_after * self._rate), self._settings.fewest)
        longest = _longest_runs(np.ascontiguousarray(samples))
        self._limits = np.where(noisy, np.maximum(fewest, self._settings.longer * longest), np.inf)
        for side in range(2):
            if not noisy[side].any() and noisy[1 - side].any():
                self._find(
                    f"the {SIDES[side]} finger's samples do not change, the other one's do",
                    no_signal=True,
                )

    def check(
        self,
        sample: GripSample,
        estimate: GripEstimate,
        is_carried: bool,
        force_rate: float,
        acceleration: float = 0.0,
    ) -> None:
        """Check one sample.

        Args:
            estimate: after it.
            is_carried: the fruit hangs in the fingers.
            force_rate: change of the grip force by the fingers' own motion [N/s].
            acceleration: of the hand, in any direction, as a multiple of gravity: one pad brakes the fruit, the other
                is relieved.
        """
        s = self._settings
        elapsed = sample.elapsed
        saturated = sample.saturated
        frozen = _longest_now(sample.wrenches, self._last, self._runs, self._limits)
        if frozen >= 0 and not saturated[frozen // 6]:
            side = SIDES[frozen // 6]
            channel = ("x", "y", "z")[frozen % 3]
            kind = "force" if frozen % 6 < 3 else "torque"
            self._find(
                f"the {side} finger's {kind} {channel} repeats one value although it is noisy",
                no_signal=True,
            )
        fading = math.exp(-elapsed / s.own_motion_memory)
        self._force_rate = max(abs(force_rate), self._force_rate * fading)
        self._acceleration = max(acceleration, self._acceleration * fading)
        if is_carried and estimate.shear_jump > self._filters.jump:
            self.doubt = self.doubt or "one finger's signal jumped alone"
        if not is_carried or any(saturated):
            self._apart.lasted = self._load = self._held.lasted = 0.0
            return
        self._check_jumps(estimate, elapsed)
        self._load = max(estimate.f_t, self._load * math.exp(-elapsed / s.load_memory))
        inertia = self._load * self._acceleration
        most = max(s.apart, s.apart_ratio * estimate.f_t) + estimate.f_n_band + inertia
        is_apart = (
            abs(estimate.left - estimate.right) > most and estimate.f_t > s.hanging * self._load
        )
        if self._apart.update(is_apart, elapsed) > s.apart_after:
            forces = f"{estimate.left:.1f} N and {estimate.right:.1f} N"
            self._find(f"a hanging fruit presses on both fingers alike, they read {forces}")

    def _check_jumps(self, estimate: GripEstimate, elapsed: float) -> None:
        jump = self._filters.jump
        lag = self._filters.normal_lag
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

    def compare_with_motor(
        self, force_sum: float, motor_force: float | None, elapsed: float
    ) -> None:
        """Compare the sum of both fingers' forces [N] with the motor's force [N], where the gripper reports one."""
        s = self._settings
        if motor_force is None or not math.isfinite(motor_force):
            return
        # Both have the same lag, or the loss of a fruit would look like fingers that read too little.
        motor = self._motor.update(motor_force, elapsed)
        fingers = self._fingers.update(force_sum, elapsed)
        most = s.motor_error + s.motor_ratio * max(abs(fingers), abs(motor))
        if self._against_motor.update(abs(motor - fingers) > most, elapsed) > s.motor_after:
            words = f"the fingers read {fingers:.1f} N together while the motor presses with {motor:.1f} N"
            self._find(words, no_signal=True)

    def _find(self, reason: str, no_signal: bool = False) -> None:
        self.reason = self.reason or reason
        self.no_signal = self.no_signal or no_signal


@kernel()
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


@kernel()
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
