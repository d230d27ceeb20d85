"""Rotations as files and messages write them, to and from matrices.

numpy is imported where it is needed: a command that only reads a tree without poses does not wait for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Float64 = NDArray[np.float64]


def from_rpy(rpy: ArrayLike) -> Float64:
    """Rotation matrix, shape (3, 3), of turns about the fixed axes x, y, z, in this order, shape (3,) [rad]."""
    import numpy as np

    angles = np.asarray(rpy, np.float64)
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def from_quaternion(q_xyzw: ArrayLike) -> Float64:
    """Rotation matrix, shape (3, 3), of a quaternion x, y, z, w, shape (4,), of any length but zero.

    Raises ValueError: its length is zero.
    """
    import numpy as np

    q = np.asarray(q_xyzw, np.float64)
    length = float(np.linalg.norm(q))
    if not length > 0.0:
        raise ValueError("a quaternion of norm zero is no rotation")
    x, y, z, w = q / length
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def to_quaternion(R: ArrayLike) -> Float64:
    """Return the unit quaternion x, y, z, w, shape (4,), with w ≥ 0, of a rotation matrix, shape (3, 3).

    Raises ValueError: the matrix mirrors or flattens: it is no rotation.
    """
    import numpy as np

    M = np.asarray(R, np.float64)
    if not np.linalg.det(M) > 0.0:
        raise ValueError("a matrix with a determinant that is not positive is no rotation")
    # Bar-Itzhack 2000: the eigenvector of the largest eigenvalue is the nearest rotation's, also where M is inexact.
    K = np.array(
        [
            [M[0, 0] - M[1, 1] - M[2, 2], 0.0, 0.0, 0.0],
            [M[0, 1] + M[1, 0], M[1, 1] - M[0, 0] - M[2, 2], 0.0, 0.0],
            [M[0, 2] + M[2, 0], M[1, 2] + M[2, 1], M[2, 2] - M[0, 0] - M[1, 1], 0.0],
            [M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1], np.trace(M)],
        ]
    )
    q: Float64 = np.linalg.eigh(K)[1][:, 3]
    return -q if q[3] < 0.0 else q


def is_rigid(T: Float64, tolerance: float = 1e-4) -> bool:
    """Return True if an array is a rotation and a translation of shape (4, 4): finite, and no mirror.

    Args:
        tolerance: of the products of its axes; a file may state four digits.
    """
    import numpy as np

    if T.shape != (4, 4) or not np.isfinite(T).all():
        return False
    R = T[:3, :3]
    return bool(
        np.abs(R @ R.T - np.eye(3)).max() <= tolerance
        and np.linalg.det(R) > 0.0
        and T[3].tolist() == [0.0, 0.0, 0.0, 1.0]
    )
