"""The odds that a camera is not where its cell file has it, which may be looked at after every pick.

Two assumptions predict the touches: the camera sits and looks within a tolerance of its stated pose, or its error is
one of a cell that somebody set up by hand. Both leave the depth's scale and the fingers' zero open. The ratio of the
touches' likelihoods is a bet that wins nothing on average while the first one holds. By Ville's inequality it reaches
1 / α with a probability of at most α in any number of picks, so that no correction for repeated looks is needed.
No single pick is enough: with any one left out, the others have to bear it out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.tools.caliper.estimate import PRIOR, shown_by_table, whitened
from pomona.tools.caliper.pick import Pick

FALSE_ALARM = 1e-2  # probability that a good cell is ever reported: with ten picks and more, 1 alarm in 1 000 picks
BORNE_OUT = 0.1  # the same of the picks without any one of them
TOLERATED = np.array([*[0.1e-3] * 3, *np.radians([0.02] * 3), *PRIOR[6:]])
"""Standard deviations of the errors of a good cell: t [m], ω [rad], κ, z [m]; no hand-eye calibration does better."""
SUSPECTED = np.array([*PRIOR[:6] / 4.0, *PRIOR[6:]])
"""The same of a cell whose camera is off: 5 mm and 0.5°."""


def log_odds(picks: Sequence[Pick], scatter: float = 1.0) -> tuple[float, float]:
    """Return the natural logarithm of the odds that the camera is off, of all picks and the least of all but one.

    Both are minus infinity below two picks.

    Args:
        picks: without outliers.
        scatter: of the picks over the assumed one; a smaller one than 1 counts as 1.
    """
    if len(picks) < 2:
        return -np.inf, -np.inf
    systems = [whitened(pick) for pick in picks]
    informations = np.array([H.T @ H for H, _ in systems]) / max(scatter, 1.0) ** 2
    pulls = np.array([H.T @ y for H, y in systems]) / max(scatter, 1.0) ** 2
    table, table_pull = shown_by_table(picks)
    information = informations.sum(axis=0) + table
    pull = pulls.sum(axis=0) + table_pull
    every = (
        np.concatenate([information[None], information - informations]),
        np.vstack([pull, pull - pulls]),
    )
    odds = _log_evidence(*every, SUSPECTED) - _log_evidence(*every, TOLERATED)
    return float(odds[0]), float(odds[1:].min())


def is_off(picks: Sequence[Pick], scatter: float = 1.0) -> bool:
    """Return True when the camera is off with odds that a good cell reaches with a probability of `FALSE_ALARM`."""
    odds, without_one = log_odds(picks, scatter)
    return bool(odds > -np.log(FALSE_ALARM) and without_one > -np.log(BORNE_OUT))


def _log_evidence(information: Float64, pull: Float64, std: Float64) -> Float64:
    """Return the logarithm of the touches' likelihood under a prior, but for a constant, shape (n,)."""
    scaled = np.eye(8) + std[:, None] * information * std
    b = pull * std
    explained = np.einsum("ni,ni->n", b, np.linalg.solve(scaled, b[:, :, None])[:, :, 0])
    return np.asarray(0.5 * (explained - np.linalg.slogdet(scaled)[1]), np.float64)
