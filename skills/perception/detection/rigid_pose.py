"""Pose and keypoints of a fruit from what the close look says about it: centre, size and stem axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skills.perception.detection.close_look import REFERENCE_LENGTH
from skills.perception.detection.compact_detector import FoundFruit
from skills.perception.detection.cuboid import cuboid_keypoints
from skills.perception.detection.symmetry import label_rotation

F64 = NDArray[np.float64]


def cuboid_in_picture(found: FoundFruit, dimensions: F64, K: F64) -> F64:
    """Keypoints of the CAD model's cuboid, (9, 2) [px].

    Size gives the distance of a CAD-sized fruit, the axis its rotation by the swing rule.

    Args:
        found: by the close look.
        dimensions: of the CAD model [m].
        K: camera matrix (3, 3) [px].
    """
    ray = _ray(found, K)
    z = K[0, 0] * REFERENCE_LENGTH / found.size
    points = cuboid_keypoints(dimensions) @ label_rotation(found.stem, ray).T + z * ray
    # A fruit nearer than its own cuboid is deep has no picture; keep the corners before the camera.
    depth = np.maximum(points[:, 2:], 0.1 * z)
    keypoints: F64 = points[:, :2] / depth * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2])
    return keypoints


def pose_covariance(found: FoundFruit, T_camera_object: F64, K: F64, residual: float) -> F64:
    """Covariance of (rotation vector, translation) in the camera frame, (6, 6).

    The nine keypoints of a rigid cuboid err together, so what PnP's residuals leave is only a part: the spreads that
    the network expects of centre, size and axis are carried over to the pose, and the residual is added to the centre.
    """
    ray, z = _ray(found, K), float(T_camera_object[2, 3])
    centre = np.hypot(found.spreads[0] / np.sqrt(2.0), residual)
    sideways = np.diag([(z * centre / K[0, 0]) ** 2, (z * centre / K[1, 1]) ** 2, 0.0])
    along = np.outer(z * ray, z * ray) * found.spreads[1] ** 2
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.eye(3) * max(found.spreads[2] ** 2 / 2.0, 1e-6)
    covariance[3:, 3:] = sideways + along
    return covariance


def _ray(found: FoundFruit, K: F64) -> F64:
    """The line of sight through the centre, with z = 1."""
    return np.array([(found.centre[0] - K[0, 2]) / K[0, 0], (found.centre[1] - K[1, 2]) / K[1, 1], 1.0])
