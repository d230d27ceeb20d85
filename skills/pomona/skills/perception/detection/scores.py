"""Scores that mean how often a find is fruit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64

EDGE = 1e-6
"""Scores are kept so far from 0 and 1 before their logits are taken."""


@dataclass(frozen=True, slots=True)
class ScoreMap:
    """From what the networks say to the share of such finds that are fruit: a line through logits (Platt's scaling).

    It rises, so that it changes no order. As it stands it changes nothing.

    Attributes:
        slope: of the line, more than 0.
        offset: of the line.
    """

    slope: float = 1.0
    offset: float = 0.0

    def __call__(self, score: float) -> float:
        """The share of fruit among finds with this score, 0..1."""
        return float(self.of(np.array([score]))[0])

    def of(self, scores: Float64) -> Float64:
        """The same of many, (n,)."""
        if self == ScoreMap():
            return scores
        return np.asarray(1.0 / (1.0 + np.exp(-(self.slope * _logit(scores) + self.offset))), np.float64)


LEAST_SLOPE = 0.05
"""Scores that say nothing, or the contrary, still keep their order."""


def fit_scores(scores: Float64, right: NDArray[np.bool_], weights: Float64 | None = None) -> ScoreMap:
    """The map under which these finds are likeliest.

    Args:
        scores: of finds, 0..1, (n,).
        right: whether each is fruit, (n,).
        weights: how much each counts, (n,); None: all alike.

    Returns:
        The map; the one that changes nothing where all finds are right, or none, or there are fewer than ten.
    """
    if len(scores) < 10 or right.all() or not right.any():
        return ScoreMap()
    x, y = np.stack([_logit(scores), np.ones(len(scores))], axis=1), right.astype(np.float64)
    w = np.ones(len(scores)) if weights is None else weights
    line = np.array([1.0, 0.0])
    for _ in range(50):
        p = 1.0 / (1.0 + np.exp(-x @ line))
        # A weak pull towards no change keeps the curvature from vanishing where finds can be told apart exactly.
        slope = x.T @ (w * (y - p)) - 1e-3 * (line - (1.0, 0.0))
        bend = (x * (w * p * (1.0 - p))[:, None]).T @ x + 1e-3 * np.eye(2)
        step = np.linalg.solve(bend, slope)
        line = line + np.clip(step, -2.0, 2.0)
        if np.abs(step).max() < 1e-9:
            break
    return ScoreMap(max(LEAST_SLOPE, float(line[0])), float(line[1]))


def _logit(scores: Float64) -> Float64:
    inner = np.clip(scores, EDGE, 1.0 - EDGE)
    return np.asarray(np.log(inner) - np.log1p(-inner), np.float64)
