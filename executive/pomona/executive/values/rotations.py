"""Rotations as files and messages write them, to and from matrices: one place, over scipy's Rotation.

numpy and scipy are imported where they are needed: a command that only reads a tree without poses waits for neither.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Float64 = NDArray[np.float64]


def from_rpy(rpy: ArrayLike) -> Float64:
    """Rotation matrix, shape (3, 3), of turns about the fixed axes x, y, z, in this order, shape (3,) [rad]."""
    from scipy.spatial.transform import Rotation

    R: Float64 = Rotation.from_euler("xyz", rpy).as_matrix()
    return R


def from_quaternion(q_xyzw: ArrayLike) -> Float64:
    """Rotation matrix, shape (3, 3), of a quaternion x, y, z, w, shape (4,), of any length but zero.

    Raises:
        ValueError: its length is zero.
    """
    from scipy.spatial.transform import Rotation

    R: Float64 = Rotation.from_quat(q_xyzw).as_matrix()
    return R


def to_quaternion(R: ArrayLike) -> Float64:
    """The unit quaternion x, y, z, w, shape (4,), with w ≥ 0, of a rotation matrix, shape (3, 3).

    Raises:
        ValueError: the matrix mirrors or flattens: it is no rotation.
    """
    from scipy.spatial.transform import Rotation

    q_xyzw: Float64 = Rotation.from_matrix(R).as_quat(canonical=True)
    return q_xyzw


def is_rigid(T: Float64) -> bool:
    """Whether a matrix, shape (4, 4), is a rotation and a translation: finite, and no mirror."""
    import numpy as np

    R = T[:3, :3]
    return bool(
        np.isfinite(T).all()
        and np.abs(R @ R.T - np.eye(3)).max() <= 1e-4
        and np.linalg.det(R) > 0.0
        and np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0))
    )
