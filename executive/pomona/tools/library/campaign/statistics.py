"""Intervals at 95 %: Wilson's for rates, Student's for means, the bootstrap's for medians; a paired comparison."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

# runs from which a mean or median has an interval: of fewer it is wider than the question
FEWEST = 5


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure with its 95 % interval, from `count` values."""

    value: float
    low: float
    high: float
    count: int


def wilson(successes: int, of: int) -> tuple[float, float]:
    """95 % interval of a success rate (Wilson's score interval: honest near 0 and 1)."""
    if of == 0:
        return 0.0, 1.0
    p = successes / of
    z = 1.96
    centre = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of)) / (1 + z * z / of)
    return max(0.0, centre - half), min(1.0, centre + half)


def mean(values: Sequence[float]) -> Estimate:
    """Return the mean with Student's interval; of a single value the interval is the value."""
    data = np.asarray(values, dtype=np.float64)
    if data.size < 2:
        only = float(data.mean()) if data.size else math.nan
        return Estimate(only, only, only, data.size)
    half = float(stats.t.ppf(0.975, data.size - 1) * data.std(ddof=1) / math.sqrt(data.size))
    centre = float(data.mean())
    return Estimate(centre, centre - half, centre + half, data.size)


def median(values: Sequence[float]) -> Estimate:
    """Median with the interval of the percentile bootstrap."""
    data = np.asarray(values, dtype=np.float64)
    if data.size == 0:
        return Estimate(math.nan, math.nan, math.nan, 0)
    # resamples of a median's interval, always drawn with the same seed
    drawn = np.random.default_rng(0).integers(0, data.size, (2000, data.size))
    medians = np.median(data[drawn], axis=1)
    low, high = np.quantile(medians, (0.025, 0.975))
    return Estimate(float(np.median(data)), float(low), float(high), data.size)


def paired_p(only_first: int, only_second: int) -> float:
    """Chance of so unequal a split of the runs in which just one of two arms succeeded (exact McNemar test)."""
    of = only_first + only_second
    return float(stats.binomtest(only_first, of).pvalue) if of else 1.0
