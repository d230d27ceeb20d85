"""Rigid transforms as 4 x 4 homogeneous matrices, float64: the one choice of pose in this project.

`T_a_b` maps coordinates of frame b into frame a: p_a = T_a_b p_b, and T_a_c = T_a_b @ T_b_c.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pomona.executive.values.arrays import Float64


def transform(rotation: ArrayLike | None = None, translation: ArrayLike | None = None) -> Float64:
    """Compose a pose from a 3 x 3 rotation and a translation, shape (3,) [m]; an omitted part is the identity."""
    T = np.eye(4)
    if rotation is not None:
        T[:3, :3] = rotation
    if translation is not None:
        T[:3, 3] = translation
    return T


def inverse(T_a_b: Float64) -> Float64:
    """T_b_a, exploiting that the rotation is orthonormal; shapes (..., 4, 4)."""
    T = np.zeros_like(T_a_b)
    R_t = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    T[..., :3, :3] = R_t
    T[..., :3, 3] = -np.einsum("...ij,...j->...i", R_t, T_a_b[..., :3, 3])
    T[..., 3, 3] = 1.0
    return T


def apply(T_a_b: Float64, p_b: ArrayLike) -> Float64:
    """Map points of shape (..., 3) from frame b into frame a."""
    points = np.asarray(p_b, dtype=np.float64)
    mapped: Float64 = points @ T_a_b[:3, :3].T + T_a_b[:3, 3]
    return mapped


def rotation_about(axis: ArrayLike, angle: float) -> Float64:
    """Rotation by `angle` [rad] about a unit axis, shape (3,) -> (3, 3) (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Float64 = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return rotation


def rot_x(angle: float) -> Float64:
    """Rotation about x [rad] -> (3, 3)."""
    return rotation_about((1.0, 0.0, 0.0), angle)


def rot_y(angle: float) -> Float64:
    """Rotation about y [rad] -> (3, 3)."""
    return rotation_about((0.0, 1.0, 0.0), angle)


def rot_z(angle: float) -> Float64:
    """Rotation about z [rad] -> (3, 3)."""
    return rotation_about((0.0, 0.0, 1.0), angle)


def angle_between(R_a: Float64, R_b: Float64) -> float:
    """Return the angle of the turn from one rotation to another, shapes (3, 3), from 0 to pi [rad]."""
    from scipy.spatial.transform import Rotation

    return float(Rotation.from_matrix(R_a.T @ R_b).magnitude())
