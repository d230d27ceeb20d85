"""One size from several looks at the same fruit, and whether they agree."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtri  # scipy.stats takes 0.4 s of the processor to load

from pomona.executive import Float64

SHARED = 0.9
"""Share of a look's variance that all looks at one fruit are taken to have in common, since its proportions are not the
model's from any side. Measured: 0.61 of the width's and 0.98 of the height's
(`python -m benchmarks.bench_count`)."""


@dataclass(frozen=True, slots=True, eq=False)
class FusedSize:
    """A fruit's size by all its looks."""

    dimensions: Float64  # (d_x, d_y, d_z), shape (3,) [m]
    covariance: Float64  # of them, shape (3, 3) [m²]
    looks: int  # number of measurements
    agree: bool  # whether the measurements differ by no more than their uncertainties, taken as independent


@dataclass(slots=True, eq=False)
class SizeOfLooks:
    """The mean of the measurements of one fruit, weighted by their information; one more costs the same for any number.

    The common error (`SHARED`) is not averaged. If the measurements disagree, the covariance is widened by the factor
    by which they differ more than expected (Birge's ratio).
    """

    looks: int = 0
    _axes: Float64 = field(default_factory=lambda: np.eye(3))
    _information: Float64 = field(default_factory=lambda: np.zeros((3, 3)))
    _weighted: Float64 = field(default_factory=lambda: np.zeros(3))
    _common: Float64 = field(default_factory=lambda: np.zeros((3, 3)))
    _squares: float = 0.0

    def add(self, dimensions: Float64, covariance: Float64, R: Float64) -> None:
        """Add a look's dimensions, (3,) [m], their covariance, and the fruit's axes R in the common frame, (3, 3)."""
        if not self.looks:
            self._axes = R
        dimensions, covariance = _turned_as(self._axes, dimensions, covariance, R)
        information = np.linalg.inv(covariance)
        self.looks += 1
        self._information = self._information + information
        self._weighted = self._weighted + information @ dimensions
        self._common = self._common + information @ np.linalg.cholesky(covariance)
        self._squares += float(dimensions @ information @ dimensions)

    def fused(self) -> FusedSize:
        """Return the size by all looks, of which there must be one at least."""
        spread: Float64 = np.asarray(np.linalg.inv(self._information), np.float64)
        mean: Float64 = spread @ self._weighted
        if self.looks == 1:
            return FusedSize(mean, spread, 1, True)
        common = spread @ self._common
        covariance = (1.0 - SHARED) * spread + SHARED * common @ common.T
        distance = self._squares - float(mean @ self._weighted)
        freedom = mean.size * (self.looks - 1)
        # looks that differ by more than so rarely happens by chance disagree
        agree = distance <= float(chdtri(freedom, 0.01))
        widened: Float64 = covariance if agree else covariance * (distance / freedom)
        return FusedSize(mean, widened, self.looks, agree)


def _turned_as(
    first: Float64, dimensions: Float64, covariance: Float64, R: Float64
) -> tuple[Float64, Float64]:
    """Return a measurement's dimensions with x and z exchanged where its x axis lies along the first one's z: the turn
    of a fruit about its stem depends on the view, so the axes of another view may differ.
    """
    if abs(first[:, 0] @ R[:, 0]) >= abs(first[:, 2] @ R[:, 0]):
        return dimensions, covariance
    order = [2, 1, 0]
    return dimensions[order], covariance[np.ix_(order, order)]
