"""How far a run's estimate of a fruit is from the simulated truth: for the score, never for a skill."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


def estimate_errors(reported: Mapping[str, Any], fruits: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return errors of a reported position and size against the fruit that lies nearest to it.

    Args:
        reported: facts of the estimate: `position_m`, shape (3,), in the base frame, and `dimensions_m`, shape (3,).
        fruits: the world's: `T_base_fruit_at_look`, shape (4, 4), and `dimensions_m`.

    Returns:
        position error, its vertical part (the paper's centroid error, positive when the estimate is too low), the norm
        of the dimensions' error (the paper's dimensional error), the error of the mean width, all [mm]; empty when
        nothing was reported.
    """
    if "position_m" not in reported or "dimensions_m" not in reported or not fruits:
        return {}
    position = np.asarray(reported["position_m"], dtype=np.float64)
    size = np.asarray(reported["dimensions_m"], dtype=np.float64)
    centres = np.array([np.asarray(fruit["T_base_fruit_at_look"])[:3, 3] for fruit in fruits])
    nearest = int(np.argmin(np.linalg.norm(centres - position, axis=1)))
    true_size = np.asarray(fruits[nearest]["dimensions_m"], dtype=np.float64)
    offset = position - centres[nearest]
    return {
        "position_error_mm": 1e3 * float(np.linalg.norm(offset)),
        "centroid_error_mm": -1e3 * float(offset[2]),
        "size_error_mm": 1e3 * float(np.linalg.norm(size - true_size)),
        "width_error_mm": 1e3 * float(size[[0, 2]].mean() - true_size[[0, 2]].mean()),
    }
