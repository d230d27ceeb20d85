"""Scores that estimate the ratio of fruit among detections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64

HOPELESS = 0.2  # least product after one look for a second one: a quarter of the places have less, and hardly any fruit
EDGE = 1e-6  # scores are kept so far from 0 and 1 before their logits are taken


@dataclass(frozen=True, slots=True)
class ScoreMap:
    """Line through logits, from a product of the networks' outputs to a ratio of fruit (Platt's scaling).

    It rises, so that it changes no order. The default changes nothing.
    """

    slope: float = 1.0  # of the line, more than 0
    offset: float = 0.0  # of the line

    def __call__(self, score: float) -> float:
        """Return the ratio of fruit among detections with this score, 0..1."""
        return float(self.of(np.array([score]))[0])

    def of(self, scores: Float64) -> Float64:
        """Return the same of many, (n,)."""
        if self == ScoreMap():
            return scores
        return np.asarray(1.0 / (1.0 + np.exp(-(self.slope * _logit(scores) + self.offset))), np.float64)


@dataclass(frozen=True, slots=True)
class PowerScore:
    """Score of weights without a fitted one: product of powers of heat and of the kind that both looks give."""

    line: ScoreMap = ScoreMap()  # from this product to the ratio of fruit

    @property
    def hopeless(self) -> float:
        """A place with less score after one look gets no second one."""
        return self.line(HOPELESS)

    def of(self, features: Float64) -> Float64:
        """Return scores of places with these features, logits as of `FusedScore` (n, 4): (n,)."""
        heat, _, first, second = -np.logaddexp(0.0, -features.T)
        return self.line.of(np.exp(0.5 * heat + 0.25 * (first + second)))

    def content(self) -> dict[str, float]:
        """As a weights file holds it."""
        return {"slope": self.line.slope, "offset": self.line.offset}


def _logit(scores: Float64) -> Float64:
    inner = np.clip(scores, EDGE, 1.0 - EDGE)
    return np.asarray(np.log(inner) - np.log1p(-inner), np.float64)
