"""A pose from the cuboid's keypoints: EPnP, then least squares on the reprojection error."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.errors import DetectError
from pomona.skills.perception.detection.instances import CuboidConvention, cuboid_keypoints

LEAST_KEYPOINTS = 4
LEAST_SPREAD = 0.3  # no keypoint is trusted better than this [px]


class PoseUnsolved(DetectError):
    """No pose follows from the keypoints."""

    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(f"no pose follows from the keypoints: {problem}")


@dataclass(frozen=True, slots=True, eq=False)
class SolvedPose:
    """The pose of a cuboid."""

    T_camera_object: Float64  # object's frame to camera frame [m]
    covariance: Float64  # of (rotation vector, translation) in the camera frame, (6, 6) [rad, m]
    residual: float  # root mean square reprojection error over the keypoints used [px]


def solve_pose(
    keypoints: ArrayLike,
    dimensions: ArrayLike,
    camera_matrix: ArrayLike,
    convention: CuboidConvention = CuboidConvention.CAMERA,
) -> SolvedPose:
    """Solve for the pose of a cuboid from its projected corners and centroid.

    Args:
        keypoints: (9, 2) or (8, 2) [px], corners 0..7 and centroid; NaN where not found.
        dimensions: extents along the object's x, y, z [m].
        camera_matrix: (3, 3) [px].
        convention: vertex order of the keypoints.

    Raises PoseUnsolved: fewer than four keypoints, degenerate geometry, or a pose that is not finite.
    """
    points = np.asarray(keypoints, np.float64)
    K = np.asarray(camera_matrix, np.float64)
    if points.shape not in ((9, 2), (8, 2)):
        raise PoseUnsolved(f"expected (9, 2) or (8, 2) keypoints, not {points.shape}")
    usable = np.asarray(np.isfinite(points).all(axis=1) & (np.abs(points) < 1e5).all(axis=1))
    if usable[:8].sum() < LEAST_KEYPOINTS:
        raise PoseUnsolved(
            f"{int(usable[:8].sum())} corners were found, at least {LEAST_KEYPOINTS} are needed"
        )
    model = cuboid_keypoints(dimensions, convention)[: len(points)][usable]
    seen = points[usable]
    R, t = _start(model, seen, K)
    try:
        # About the pose itself, so that rotations are small: the derivative is by a rotation vector in the camera frame.
        turn, t = (
            np.asarray(part, np.float64).ravel()
            for part in cv2.solvePnPRefineLM(model @ R.T, seen, K, None, np.zeros(3), t)
        )
        R = cv2.Rodrigues(turn)[0] @ R
        projected, jacobian = cv2.projectPoints(model @ R.T, np.zeros(3), t, K, None)
    except cv2.error as error:
        raise PoseUnsolved("the least squares failed") from error
    if not (np.isfinite(R).all() and np.isfinite(t).all()) or t[2] <= 0.0:
        raise PoseUnsolved("the keypoints do not fit a cuboid before the camera")
    residual = np.asarray(projected, np.float64).reshape(-1, 2) - seen
    derivative = jacobian[:, :6]
    # The variance of a keypoint follows from the residuals.
    variance = float((residual**2).sum()) / max(2 * len(seen) - 6, 1)
    try:
        covariance = np.linalg.inv(derivative.T @ derivative) * max(variance, LEAST_SPREAD**2)
    except np.linalg.LinAlgError as error:
        raise PoseUnsolved("the keypoints leave the pose undetermined") from error
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = t
    return SolvedPose(
        T, 0.5 * (covariance + covariance.T), float(np.sqrt((residual**2).mean() * 2.0))
    )


def _start(model: Float64, seen: Float64, K: Float64) -> tuple[Float64, Float64]:
    """EPnP's pose; one behind the camera is mirrored to the front."""
    if np.linalg.matrix_rank(seen - seen.mean(axis=0), tol=1e-3) < 2:
        raise PoseUnsolved("the keypoints lie on a line")
    try:
        found, rotation, translation = cv2.solvePnP(model, seen, K, None, flags=cv2.SOLVEPNP_EPNP)
    except cv2.error as error:
        raise PoseUnsolved("EPnP failed") from error
    if not found or not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
        raise PoseUnsolved("EPnP failed")
    R = np.asarray(cv2.Rodrigues(rotation)[0], np.float64)
    t = np.asarray(translation, np.float64).ravel()
    if t[2] < 0.0:
        R = np.diag([-1.0, -1.0, 1.0]) @ R
        t = -t
    return R, t
