"""Pose, covariance and keypoints of a fruit from what the close look says about it: centre, size and stem axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skills.perception.detection.cuboid import cuboid_keypoints
from skills.perception.detection.found_fruit import FoundFruit
from skills.perception.detection.symmetry import label_rotation

F64 = NDArray[np.float64]

SCALES = np.array([0.87, 1.23, 0.61])
"""Deviations of centre, log size and axis (a direction each) over the errors that the network expects of them, for a
fruit that is seen whole."""

HIDDEN = np.array([1.9, 1.7, 1.2])
"""A fruit of which the part h is hidden has deviations exp(h · this) as large: the network doubts hidden fruit too
little. Both are quantile regressions to 90 % ellipsoids over 1 524 finds in 250 rendered frames of seed 778001; what
they give on other seeds is in docs/decisions/detect-pose-covariance.md (`python -m benchmarks.bench_detect`)."""

LEAST_ROTATION = 1e-3
"""No axis is told better than this [rad]."""


def pose_of(found: FoundFruit) -> F64:
    """T_camera_object (4, 4) of a CAD-sized fruit: its place as it was seen, its rotation by the swing rule."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = label_rotation(found.stem, found.p_camera), found.p_camera
    return T


def cuboid_in_picture(T_camera_object: F64, dimensions: F64, K: F64) -> F64:
    """Keypoints of a cuboid, (9, 2) [px].

    Args:
        T_camera_object: its pose (4, 4) [m].
        dimensions: its sides [m].
        K: camera matrix (3, 3) [px].
    """
    points = cuboid_keypoints(dimensions) @ T_camera_object[:3, :3].T + T_camera_object[:3, 3]
    # A fruit nearer than its own cuboid is deep has no picture; keep the corners before the camera.
    depth = np.maximum(points[:, 2:], 0.1 * T_camera_object[2, 3])
    keypoints: F64 = points[:, :2] / depth * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2])
    return keypoints


def pose_covariance(found: FoundFruit, K: F64) -> F64:
    """Covariance of (rotation vector, translation) in the camera frame, (6, 6) [rad, m].

    The errors that the network expects of centre, size and axis are carried over to the pose: the centre's across the
    line of sight, the size's along it, the axis's to a turn about any axis. The turn about the stem, which a fruit does
    not show, is the swing rule's.
    """
    p, z = found.p_camera, float(found.p_camera[2])
    centre, size, axis = found.spreads * SCALES * np.exp(HIDDEN * (1.0 - found.visibility))
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.eye(3) * max(axis, LEAST_ROTATION) ** 2
    covariance[3:, 3:] = np.diag([(z * centre / K[0, 0]) ** 2, (z * centre / K[1, 1]) ** 2, 0.0])
    covariance[3:, 3:] += np.outer(p, p) * size**2
    return covariance
