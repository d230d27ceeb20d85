"""Forward kinematics and Jacobian of a serial chain: loops that numpy cannot vectorise, compiled by numba.

Link 0 is the base; link i moves with joint i. The frame of link i has its origin on joint i's axis and its z along the
axis, so that a joint is one rotation about (or a shift along) its own z: T_base_link[i] = T_base_link[i-1] · step[i] ·
Rz(q[i]). Poses inside the kernels are the upper three rows of a homogeneous matrix, shape (3, 4).
"""

from __future__ import annotations

from math import cos, sin

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64


@njit(cache=True, nogil=True)
def forward(steps: Float64, sliding: NDArray[np.bool_], q: Float64, links: Float64) -> None:
    """Write the poses of all links into `links`, shape (dof + 1, 3, 4), for joints q, shape (dof,) [rad or m].

    `steps` (dof, 3, 4) are the poses of the joints in the link before, `sliding` (dof,) marks those that shift.
    """
    for row in range(3):
        for column in range(4):
            links[0, row, column] = 1.0 if row == column else 0.0
    for i in range(q.shape[0]):
        step = steps[i]
        for row in range(3):
            a, b, c, d = links[i, row, 0], links[i, row, 1], links[i, row, 2], links[i, row, 3]
            x = a * step[0, 0] + b * step[1, 0] + c * step[2, 0]
            y = a * step[0, 1] + b * step[1, 1] + c * step[2, 1]
            z = a * step[0, 2] + b * step[1, 2] + c * step[2, 2]
            p = a * step[0, 3] + b * step[1, 3] + c * step[2, 3] + d
            if sliding[i]:
                p += z * q[i]
            links[i + 1, row, 0], links[i + 1, row, 1], links[i + 1, row, 2], links[i + 1, row, 3] = x, y, z, p
        if not sliding[i]:
            cosine, sine = cos(q[i]), sin(q[i])
            for row in range(3):
                x, y = links[i + 1, row, 0], links[i + 1, row, 1]
                links[i + 1, row, 0] = cosine * x + sine * y
                links[i + 1, row, 1] = cosine * y - sine * x


@njit(cache=True, nogil=True)
def compose(T_a_b: Float64, T_b_c: Float64, T_a_c: Float64) -> None:
    """Write T_a_b · T_b_c into T_a_c; all of shape (3, 4)."""
    for row in range(3):
        for column in range(4):
            total = T_a_b[row, 3] if column == 3 else 0.0
            for k in range(3):
                total += T_a_b[row, k] * T_b_c[k, column]
            T_a_c[row, column] = total


@njit(cache=True, nogil=True)
def jacobian(links: Float64, sliding: NDArray[np.bool_], p_base: Float64, J: Float64) -> None:
    """Write the geometric Jacobian of a point that moves with the last link into J, shape (6, dof).

    Rows: velocity of the point [m/rad], then angular velocity, both in the base frame.
    """
    for i in range(sliding.shape[0]):
        z0, z1, z2 = links[i + 1, 0, 2], links[i + 1, 1, 2], links[i + 1, 2, 2]
        if sliding[i]:
            J[0, i], J[1, i], J[2, i] = z0, z1, z2
            J[3, i], J[4, i], J[5, i] = 0.0, 0.0, 0.0
        else:
            x = p_base[0] - links[i + 1, 0, 3]
            y = p_base[1] - links[i + 1, 1, 3]
            z = p_base[2] - links[i + 1, 2, 3]
            J[0, i], J[1, i], J[2, i] = z1 * z - z2 * y, z2 * x - z0 * z, z0 * y - z1 * x
            J[3, i], J[4, i], J[5, i] = z0, z1, z2
