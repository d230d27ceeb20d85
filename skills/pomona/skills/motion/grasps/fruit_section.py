"""Where a parallel gripper should take a measured fruit: the widest section across the fingers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.measured_fruit import MeasuredFruit


@dataclass(frozen=True, slots=True, eq=False)
class CrossSection:
    """The refined shape as the fingers meet it."""

    width: float  # extent along the fingers' sliding direction [m]
    # where the pads meet: on the fruit's axis at the height of its widest section, midway between the two sides across
    # the sliding direction; base frame, shape (3,) [m]
    p_base: Float64
    # angle between the sliding direction and the skin's normal where the pads meet it [rad], of the ellipsoid with the
    # fruit's dimensions: pads that meet it obliquely turn the fruit
    oblique: float
    behind: float  # how far the fruit reaches from `p_base` against the approach, towards the palm [m]
    # sigma_width, sigma_across, sigma_height: standard deviations of the width, of the position along the sliding
    # direction and of the position's height in the base frame [m]
    sigma_width: float
    sigma_across: float
    sigma_height: float


def fruit_section(measured: MeasuredFruit, vertices_base: Float64, R_base_tcp: Float64) -> CrossSection:
    """Measure a refined fruit along the TCP's axes R_base_tcp, shape (3, 3): z approach, y sliding.

    `vertices_base`, shape (n, 3) [m], is its refined shape, handed in because one shape serves many grasps.
    """
    widest = np.empty(3)
    # points within this distance of the outermost one belong to the widest section [m]
    low, high, top = extent(vertices_base, measured.T_base_fruit.copy()[:3, 3], R_base_tcp, 1e-3, widest)
    axis = R_base_tcp.T @ measured.T_base_fruit[:3, :3] @ measured.fruit.symmetry_axis
    centre = (widest @ axis) * axis  # on the axis of the nearly round fruit: the load then has no lever on the pads
    centre[1] = (low + high) / 2.0
    sliding = R_base_tcp[:, 1]
    in_object = measured.T_base_fruit[:3, :3].T @ sliding  # the width is a mix of the three dimensions
    half = measured.dimensions * in_object
    mix = half * in_object / max(float(np.linalg.norm(half)), 1e-9)
    touched = measured.dimensions * half  # points from the ellipsoid's centre to where a pad meets it
    oblique = np.arctan2(np.linalg.norm(np.cross(in_object, touched)), in_object @ touched)
    position, size = measured.covariance[:3, :3], measured.covariance[3:, 3:]
    return CrossSection(
        width=high - low,
        p_base=measured.T_base_fruit[:3, 3] + R_base_tcp @ centre,
        oblique=float(oblique),
        behind=float(centre[2] - top),
        sigma_width=_deviation(size, mix),
        sigma_across=_deviation(position, sliding),
        sigma_height=_deviation(position, np.array([0.0, 0.0, 1.0])),
    )


@njit(cache=True, nogil=True)
def extent(
    vertices: Float64, centre: Float64, R_base_tcp: Float64, band: float, widest: Float64
) -> tuple[float, float, float]:
    """Lowest and highest y and lowest z of vertices about a centre along a gripper's axes [m].

    Writes the mean of the vertices within `band` of either end in y, in the gripper's axes, into `widest`.
    """
    y = np.empty(vertices.shape[0])
    low, high, top = 1e9, -1e9, 1e9
    for i in range(vertices.shape[0]):
        a, b, c = vertices[i, 0] - centre[0], vertices[i, 1] - centre[1], vertices[i, 2] - centre[2]
        y[i] = a * R_base_tcp[0, 1] + b * R_base_tcp[1, 1] + c * R_base_tcp[2, 1]
        low, high = min(low, y[i]), max(high, y[i])
        top = min(top, a * R_base_tcp[0, 2] + b * R_base_tcp[1, 2] + c * R_base_tcp[2, 2])
    count = 0
    widest[:] = 0.0
    for i in range(vertices.shape[0]):
        if y[i] <= low + band or y[i] >= high - band:
            count += 1
            for k in range(3):
                for row in range(3):
                    widest[k] += (vertices[i, row] - centre[row]) * R_base_tcp[row, k]
    widest /= count
    return low, high, top


def _deviation(covariance: Float64, direction: Float64) -> float:
    variance = float(direction @ covariance @ direction)
    return float(np.sqrt(max(variance, 0.0)))
