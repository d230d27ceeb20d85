"""One label among the equivalent poses of a fruit that is nearly symmetric about its stem axis.

The label must move smoothly with the view, or the network is asked to jump. "The front faces the camera" is
singular for a fruit seen from straight above. The swing rule is singular only for an upside-down fruit seen from
below: take the mean upright view, and turn it by the smallest rotation that brings its stem axis onto the seen one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

MEAN_ELEVATION = np.deg2rad(57.0)  # mean elevation of the view [rad]; the label's singularity is opposite to it
STEM_AXIS = np.array([0.0, -1.0, 0.0])  # the stem axis in the object frame


def minimal_rotation(source: ArrayLike, target: ArrayLike) -> NDArray[np.float64]:
    """Return the rotation by the smallest angle that maps unit vector `source` onto unit vector `target`, (3, 3)."""
    a, b = np.asarray(source, np.float64), np.asarray(target, np.float64)
    cosine = float(a @ b)
    if cosine < -1.0 + 1e-9:
        # Any half turn across the source will do: the axis is not determined here.
        across = np.cross(a, [1.0, 0.0, 0.0] if abs(a[0]) < 0.9 else [0.0, 1.0, 0.0])
        across /= np.linalg.norm(across)
        half_turn: NDArray[np.float64] = 2.0 * np.outer(across, across) - np.eye(3)
        return half_turn
    # I + [v]x + [v]x² / (1 + c) with v = a x b, written out: this is called sixty times a picture.
    (p, q, r), (s, t, u) = a.tolist(), b.tolist()
    x, y, z = q * u - r * t, r * s - p * u, p * t - q * s
    k = 1.0 / (1.0 + cosine)
    return np.array(
        [
            [1.0 - k * (y * y + z * z), k * x * y - z, k * x * z + y],
            [k * x * y + z, 1.0 - k * (x * x + z * z), k * y * z - x],
            [k * x * z - y, k * y * z + x, 1.0 - k * (x * x + y * y)],
        ]
    )


def label_rotation(stem_camera: ArrayLike, centre_camera: ArrayLike) -> NDArray[np.float64]:
    """R_camera_object of the label by the swing rule, (3, 3).

    Args:
        stem_camera: direction of the stem axis in the camera frame, (3,).
        centre_camera: the fruit's centre in the camera frame, (3,) [m].
    """
    stem = np.asarray(stem_camera, np.float64) / np.linalg.norm(stem_camera)
    upright = upright_rotation(centre_camera)
    # Turned back into the ray's frame, so that the label is the same wherever in the picture the fruit lies.
    R_ray = _ray_rotation(centre_camera)
    swing = minimal_rotation(R_ray.T @ upright @ STEM_AXIS, R_ray.T @ stem)
    rotation: NDArray[np.float64] = R_ray @ swing @ R_ray.T @ upright
    return rotation


def upright_rotation(centre_camera: ArrayLike) -> NDArray[np.float64]:
    """R_camera_object (3, 3) of a fruit with its stem up, as a camera sees it at the mean elevation.

    Args:
        centre_camera: the fruit's centre in the camera frame, (3,) [m].
    """
    cosine, sine = np.cos(MEAN_ELEVATION), np.sin(MEAN_ELEVATION)
    R_mean = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    rotation: NDArray[np.float64] = _ray_rotation(centre_camera) @ R_mean
    return rotation


def _ray_rotation(centre_camera: ArrayLike) -> NDArray[np.float64]:
    ray = np.asarray(centre_camera, np.float64) / np.linalg.norm(centre_camera)
    return minimal_rotation((0.0, 0.0, 1.0), ray)
