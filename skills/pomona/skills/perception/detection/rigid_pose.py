"""Pose, covariance and keypoints of a fruit from the close look's centre, size and stem axis."""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.cuboid import cuboid_keypoints
from pomona.skills.perception.detection.found_fruit import FoundFruit
from pomona.skills.perception.detection.symmetry import label_rotation

SCALES = np.array([0.97, 1.25, 1.99])
"""Deviations of centre [px], log size and axis [rad] (a direction each) where the network expects an error of 1, for a
fruit that is seen whole."""

POWERS = np.array([1.0, 1.0, 1.43])
"""The deviation grows with this power of the error that the network expects: an axis with a large expected error may be
reversed, so its true error is larger than expected, and that of a certain axis smaller."""

HIDDEN = np.array([2.8, 2.8, 0.0])
"""A fruit of which the part h is hidden has deviations exp(h · this) as large: the network underestimates the errors of
hidden fruit, and takes nearly hidden fruit for half visible. Scales and powers: quantile regressions to 90 % ellipsoids
over 958 apples and 634 lemons in rendered frames of seed 778001, these the least with which the ellipsoids also hold
90 % of those less than two fifths visible. docs/evidence/detect-pose-covariance.md has what all of them give on other
frames (`python -m benchmarks.bench_detect`)."""

LEAST_ROTATION = 1e-3  # least standard deviation of the axis [rad]


def pose_of(found: FoundFruit) -> Float64:
    """T_camera_object (4, 4) of a CAD-sized fruit: its place as it was seen, its rotation by the swing rule."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = label_rotation(found.stem, found.p_camera), found.p_camera
    return T


def cuboid_in_picture(T_camera_object: Float64, dimensions: Float64, K: Float64) -> Float64:
    """Return keypoints of a cuboid, (9, 2) [px].

    Args:
        T_camera_object: its pose (4, 4) [m].
        dimensions: its sides [m].
        K: camera matrix (3, 3) [px].
    """
    points = cuboid_keypoints(dimensions) @ T_camera_object[:3, :3].T + T_camera_object[:3, 3]
    # A fruit nearer than its own cuboid is deep has no picture; keep the corners before the camera.
    depth = np.maximum(points[:, 2:], 0.1 * T_camera_object[2, 3])
    keypoints: Float64 = points[:, :2] / depth * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2])
    return keypoints


def pose_covariance(found: FoundFruit, K: Float64) -> Float64:
    """Return covariance of (rotation vector, translation) in the camera frame, (6, 6) [rad, m].

    The errors that the network expects of centre, size and axis are carried over to the pose: the centre's across the
    line of sight, the size's along it, the axis's to a turn about any axis. The turn about the stem, which a fruit does
    not show, is the swing rule's.
    """
    p, z = found.p_camera, float(found.p_camera[2])
    centre, size, axis = SCALES * found.spreads**POWERS * np.exp(HIDDEN * (1.0 - found.visibility))
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.eye(3) * max(axis, LEAST_ROTATION) ** 2
    covariance[3:, 3:] = np.diag([(z * centre / K[0, 0]) ** 2, (z * centre / K[1, 1]) ** 2, 0.0])
    covariance[3:, 3:] += np.outer(p, p) * size**2
    return covariance
