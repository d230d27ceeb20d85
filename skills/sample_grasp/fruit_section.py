"""Where a parallel gripper should take a measured fruit: the widest section across the fingers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skills.refine.measured_fruit import MeasuredFruit

Float64 = NDArray[np.float64]

WIDEST_BAND = 1e-3
"""Points within this distance of the outermost one belong to the widest section [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class FruitSection:
    """The refined shape as the fingers meet it.

    Attributes:
        width: extent along the fingers' sliding direction [m].
        p_base: where the pads meet: on the fruit's axis at the height of its widest section, midway between the two
            sides across the sliding direction; base frame, shape (3,) [m].
        behind: how far the fruit reaches from `p_base` against the approach, towards the palm [m].
        sigma_width, sigma_across, sigma_height: standard deviations of the width, of the position along the sliding
            direction and of the position's height in the base frame [m].
    """

    width: float
    p_base: Float64
    behind: float
    sigma_width: float
    sigma_across: float
    sigma_height: float


def fruit_section(measured: MeasuredFruit, vertices_base: Float64, R_base_tcp: Float64) -> FruitSection:
    """Measure the refined shape along a gripper's axes.

    Args:
        measured: the refined fruit with its covariance.
        vertices_base: its refined shape, shape (n, 3) [m], handed in because one shape serves many grasps.
        R_base_tcp: axes of the TCP: z approach, y sliding; shape (3, 3).
    """
    points = (vertices_base - measured.T_base_fruit[:3, 3]) @ R_base_tcp
    across = points[:, 1]
    low, high = across.min(), across.max()
    widest = points[(across <= low + WIDEST_BAND) | (across >= high - WIDEST_BAND)].mean(axis=0)
    axis = R_base_tcp.T @ measured.T_base_fruit[:3, :3] @ measured.fruit.symmetry_axis
    centre = (widest @ axis) * axis  # on the axis of the nearly round fruit: the load then has no lever on the pads
    centre[1] = (low + high) / 2.0
    sliding = R_base_tcp[:, 1]
    in_object = measured.T_base_fruit[:3, :3].T @ sliding  # the width is a mix of the three dimensions
    half = measured.dimensions * in_object
    mix = half * in_object / max(float(np.linalg.norm(half)), 1e-9)
    position, size = measured.covariance[:3, :3], measured.covariance[3:, 3:]
    return FruitSection(
        width=float(high - low),
        p_base=measured.T_base_fruit[:3, 3] + R_base_tcp @ centre,
        behind=float(centre[2] - points[:, 2].min()),
        sigma_width=_deviation(size, mix),
        sigma_across=_deviation(position, sliding),
        sigma_height=_deviation(position, np.array([0.0, 0.0, 1.0])),
    )


def _deviation(covariance: Float64, direction: Float64) -> float:
    variance = float(direction @ covariance @ direction)
    return float(np.sqrt(max(variance, 0.0)))
