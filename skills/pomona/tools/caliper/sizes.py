"""The width of a picked fruit: the camera's measurement and the pads' first touches, fused.

The camera measures the fruit g κ a too narrow, and the fingers read z wider than the camera; both come from the picks
of the cell (`estimate`). Picks do not show which part of z is an error of the fingers' zero and which is the camera's
bias. Their priors share z: the pads are trusted more, so that a width that they felt is corrected by a seventh of it.
"""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.tools.caliper.estimate import BIAS, SHOWN, SIZE, WIDTH, ZERO, CameraErrors
from pomona.tools.caliper.pick import Pick

SHARE = ZERO**2 / (ZERO**2 + BIAS**2)  # part of z that is the fingers'


def fused_width(pick: Pick, found: CameraErrors) -> tuple[float, float]:
    """Return a fruit's width along the fingers and its standard deviation [m].

    A plain gripper presses, and one finger alone shows no width: such a width is the camera's.

    Args:
        pick: of the fruit.
        found: errors of its cell, from this pick and others.
    """
    shown = SHOWN * pick.across
    kappa, z = found.error[6:]
    measured = np.array(
        [pick.across + shown * kappa + (1.0 - SHARE) * z, pick.across + pick.wider - SHARE * z]
    )
    J = np.array([[shown, 1.0 - SHARE], [0.0, -SHARE]])
    own = (
        np.diag([SIZE**2, (WIDTH * found.scatter) ** 2]) + SHARE * BIAS**2
    )  # of both alike: how z is shared
    covariance: Float64 = own + J @ found.covariance[6:, 6:] @ J.T
    if not np.isfinite(pick.wider):
        return float(measured[0]), float(np.sqrt(covariance[0, 0]))
    weights = np.linalg.solve(covariance, np.ones(2))
    return float(weights @ measured / weights.sum()), float(weights.sum() ** -0.5)
