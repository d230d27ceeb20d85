"""Named poses and their variations."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


def named_pose(poses: Mapping[str, Float64], name: str, variation: int = 1) -> Float64:
    """The joints of a pose: `name`, or one of its variations `name_2`, `name_3` … (starting over after the last).

    Args:
        poses: by name, shape (dof,) [rad] each.
        name: of the pose.
        variation: which one, from 1.

    Raises:
        KeyError: there is no such pose.
    """
    variations = [poses[name]]
    while (other := f"{name}_{len(variations) + 1}") in poses:
        variations.append(poses[other])
    return variations[(variation - 1) % len(variations)]
