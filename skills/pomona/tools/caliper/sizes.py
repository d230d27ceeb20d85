"""The width of a picked fruit: the camera's measurement and the pads' first touches, fused.

The pads read z too wide, and the camera measures the fruit g κ a too narrow; both errors come from the picks of the
cell (`estimate`). A pad that feels its first force has been pressed in by some tenths of a millimetre, and the fruit
as well. That is the same in every pick, so that z has it: no width is corrected for it twice.
"""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.tools.caliper.estimate import SHOWN, SIZE, WIDTH, CameraErrors
from pomona.tools.caliper.pick import Pick


def fused_width(pick: Pick, found: CameraErrors) -> tuple[float, float]:
    """Return a fruit's width along the fingers and its standard deviation [m].

    A plain gripper presses while its width is read, and one finger alone shows no width: such a width is the camera's.

    Args:
        pick: of the fruit.
        found: errors of its cell, from this pick and others.
    """
    shown = SHOWN * pick.across
    measured = np.array([pick.across + shown * found.error[6], pick.across + pick.wider - found.error[7]])
    J = np.diag([shown, -1.0])
    covariance: Float64 = np.diag([SIZE**2, (WIDTH * found.scatter) ** 2]) + J @ found.covariance[6:, 6:] @ J.T
    if pick.plain or not np.isfinite(pick.wider):
        return float(measured[0]), float(np.sqrt(covariance[0, 0]))
    weights = np.linalg.solve(covariance, np.ones(2))
    return float(weights @ measured / weights.sum()), float(weights.sum() ** -0.5)
