"""One score from the answers of both networks: a fitted net over heat, box quality and the close look's kind.

Products of powers of these cost one domain several points of recall: heat separates better on photographs, kind on
rendered frames. A net of a few units serves both with one threshold (docs/evidence/detect-photographs.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.executive.values.arrays import Float64

FEATURES = 4  # logits: heat, box quality, kind of the first look, and kind of the second look
LARGEST = 12.0  # logits are cut at ± this before the net reads them


@dataclass(frozen=True, slots=True, eq=False)
class FusedScore:
    """A net with one hidden layer of tanh units."""

    hidden: Float64  # weights and, last, bias of each unit, (units, 5)
    output: Float64  # weights of the units and, last, bias, (units + 1,)

    hopeless: float = 0.05  # a place with less score after one look gets no second one

    def __post_init__(self) -> None:
        fits = self.hidden.ndim == 2 and self.hidden.shape[1] == FEATURES + 1
        if not fits or self.output.shape != (len(self.hidden) + 1,):
            raise ValueError(f"a net of {self.hidden.shape} and {self.output.shape}, expected (n, 5) and (n + 1,)")
        if not (np.isfinite(self.hidden).all() and np.isfinite(self.output).all()):
            raise ValueError("a net with values that are not finite")

    def of(self, features: Float64) -> Float64:
        """Estimated ratio of fruit among places with these features (n, 4): (n,), 0..1."""
        x = np.clip(np.nan_to_num(features), -LARGEST, LARGEST)
        units = np.tanh(x @ self.hidden[:, :FEATURES].T + self.hidden[:, FEATURES])
        return np.asarray(1.0 / (1.0 + np.exp(-(units @ self.output[:-1] + self.output[-1]))), np.float64)

    def content(self) -> dict[str, Any]:
        """As `read_fused_score` reads it."""
        return {"hidden": self.hidden.tolist(), "output": self.output.tolist()}


def read_fused_score(content: Mapping[str, Any]) -> FusedScore:
    """Return the score that `FusedScore.content` describes.

    Raises KeyError, TypeError, ValueError: it describes none.
    """
    return FusedScore(np.array(content["hidden"], np.float64), np.array(content["output"], np.float64))
