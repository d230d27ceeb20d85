"""Faults of a force sensor: its samples during a fault, for tests and `make faults`."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pomona.drivers.interfaces import WrenchSample
from pomona.executive.values.arrays import Float64

OFFSET = 1.0  # of a channel that jumps [N]
CLIPPED = 0.5  # where a channel that clips has its end, unknown to its `saturated` flag [N]
NOISE = 1.0  # standard deviation of a channel that is noisy, white, per sample [N]
STEP = 0.5  # of a force that is measured coarsely [N]
LATE, EARLY = 0.5, 10.0  # how old, and how far in the future, wrong stamps are [s]

Lie = Callable[[WrenchSample, WrenchSample], WrenchSample]
"""Maps a sample, and the last one before the fault, to the delivered sample."""


def _changed(change: Callable[[Float64, Float64], None]) -> Lie:
    def lie(sample: WrenchSample, before: WrenchSample) -> WrenchSample:
        wrenches = sample.wrenches.copy()
        change(wrenches, before.wrenches)
        return WrenchSample(sample.stamp, sample.sequence, wrenches, sample.saturated)

    return lie


def _left(wrenches: Float64, before: Float64) -> None:
    wrenches[0] = before[0]


def _right(wrenches: Float64, before: Float64) -> None:
    wrenches[1] = before[1]


def _both(wrenches: Float64, before: Float64) -> None:
    wrenches[:] = before


def _set(index: Any, value: float) -> Callable[[Float64, Float64], None]:
    def change(wrenches: Float64, _before: Float64) -> None:
        wrenches[index] = value

    return change


def _add(index: Any, value: float) -> Callable[[Float64, Float64], None]:
    def change(wrenches: Float64, _before: Float64) -> None:
        wrenches[index] += value

    return change


def _clip(wrenches: Float64, _before: Float64) -> None:
    np.clip(wrenches[0, :3], -CLIPPED, CLIPPED, out=wrenches[0, :3])


def _round(wrenches: Float64, _before: Float64) -> None:
    wrenches[:, :3] = STEP * np.round(wrenches[:, :3] / STEP)


def _scale(index: Any, factor: float) -> Callable[[Float64, Float64], None]:
    def change(wrenches: Float64, _before: Float64) -> None:
        wrenches[index] *= factor

    return change


def _noisy(sample: WrenchSample, _before: WrenchSample) -> WrenchSample:
    """Add noise that follows from the sample's number."""
    wrenches = sample.wrenches.copy()
    wrenches[:, :3] += np.random.default_rng([sample.sequence, 10]).normal(0.0, NOISE, (2, 3))
    return WrenchSample(sample.stamp, sample.sequence, wrenches, sample.saturated)


class _Slow:
    """Delivers one measurement many times, each with a stamp and a number of its own."""

    def __init__(self) -> None:
        self._measured: tuple[int, Float64] | None = None

    def __call__(self, sample: WrenchSample, _before: WrenchSample) -> WrenchSample:
        # number of successive samples with one measurement of slow fingers: 50 Hz of 500 Hz
        number = sample.sequence // 10
        if self._measured is None or self._measured[0] != number:
            self._measured = number, sample.wrenches
        return WrenchSample(sample.stamp, sample.sequence, self._measured[1], sample.saturated)


def _swap(wrenches: Float64, _before: Float64) -> None:
    wrenches[:] = wrenches[::-1].copy()


def _drift(index: Any, sign: float = 1.0) -> Lie:
    """Return an offset that grows from when the fault begins."""

    def lie(sample: WrenchSample, before: WrenchSample) -> WrenchSample:
        wrenches = sample.wrenches.copy()
        wrenches[index] += sign * 0.5 * (sample.stamp - before.stamp)  # how fast a channel drifts [N/s]
        return WrenchSample(sample.stamp, sample.sequence, wrenches, sample.saturated)

    return lie


def _stamped(offset: float) -> Lie:
    return lambda sample, _before: WrenchSample(
        sample.stamp + offset, sample.sequence, sample.wrenches, sample.saturated
    )


@dataclass(frozen=True, slots=True)
class DelayedSamples:
    """Samples that arrive late, through a line that begins empty: each second one waits until the line is full."""

    duration: float  # from the measurement to the arrival, once the line is full [s]
    hidden: bool = False  # the samples arrive with the stamps and numbers of their arrival

    def pass_on(self, line: deque[WrenchSample], sample: WrenchSample) -> WrenchSample | None:
        """Put a sample into the line; the one that leaves it, or None where none does."""
        line.append(sample)
        if sample.stamp - line[0].stamp < self.duration - 1e-9 and sample.sequence % 2:
            return None
        late = line.popleft()
        return replace(late, stamp=sample.stamp, sequence=sample.sequence) if self.hidden else late


DELAYS = {
    "late_40": DelayedSamples(0.04),
    "late_120": DelayedSamples(0.12),
    "hidden_late_40": DelayedSamples(0.04, hidden=True),
    "hidden_late_120": DelayedSamples(0.12, hidden=True),
}

LIES: dict[str, Lie] = {
    "stuck_left": _changed(_left),
    "stuck_right": _changed(_right),
    "stuck": _changed(_both),
    "dead_left": _changed(_set(0, 0.0)),
    "dead_right": _changed(_set(1, 0.0)),
    "zero": _changed(_set(slice(None), 0.0)),
    "bias_jump": _changed(_add((0, 2), -OFFSET)),
    "presses_less": _changed(_add((1, 2), OFFSET)),
    "both_press_more": _changed(_add((slice(None), 2), -OFFSET)),
    "pulls_more": _changed(_add((0, 0), OFFSET)),
    "clipped_left": _changed(_clip),
    "halved": _changed(_scale(slice(None), 0.5)),
    "doubled": _changed(_scale(slice(None), 2.0)),
    "halved_left": _changed(_scale(0, 0.5)),
    "doubled_left": _changed(_scale(0, 2.0)),
    "noisy": _noisy,
    "drifts_along": _drift((slice(None), 0)),
    "drifts_pressing": _drift((0, 2), -1.0),
    "coarse": _changed(_round),
    "slow": _Slow(),
    "swapped": _changed(_swap),
    "not_a_number": _changed(_set((0, 1), np.nan)),
    "infinite": _changed(_set((slice(None), 2), -np.inf)),
    "old": _stamped(-LATE),
    "early": _stamped(EARLY),
    "repeated": lambda _sample, before: before,
}
