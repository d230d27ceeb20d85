"""A pose from the cuboid's keypoints: EPnP, then weighted least squares on the reprojection error, compiled."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.errors import PoseUnsolved
from pomona.skills.perception.detection.instances import CuboidConvention, cuboid_keypoints

MOST_STEPS = 20


@njit(cache=True, nogil=True)
def linearise(
    R: Float64, t: Float64, model: Float64, seen: Float64, K: Float64
) -> tuple[Float64, Float64]:
    """Residuals (2n,) [px] and their derivative (2n, 6) by a rotation vector and translation in the camera frame.

    Args:
        R, t: pose of the body in the camera frame, (3, 3) and (3,) [m].
        model: points in the body's frame, (n, 3) [m].
        seen: the same points in the picture, (n, 2) [px].
        K: camera matrix (3, 3) [px].
    """
    count = model.shape[0]
    residual = np.empty(2 * count)
    jacobian = np.zeros((2 * count, 6))
    for i in range(count):
        a = R[0, 0] * model[i, 0] + R[0, 1] * model[i, 1] + R[0, 2] * model[i, 2]
        b = R[1, 0] * model[i, 0] + R[1, 1] * model[i, 1] + R[1, 2] * model[i, 2]
        c = R[2, 0] * model[i, 0] + R[2, 1] * model[i, 1] + R[2, 2] * model[i, 2]
        z = c + t[2]
        if abs(z) < 1e-6:
            z = 1e-6
        by_x = K[0, 0] / z
        by_y = K[1, 1] / z
        u = by_x * (a + t[0])
        v = by_y * (b + t[1])
        residual[2 * i] = u + K[0, 2] - seen[i, 0]
        residual[2 * i + 1] = v + K[1, 2] - seen[i, 1]
        # By the point: (fx / z, 0, -u / z) and (0, fy / z, -v / z); d(exp(w) p)/dw at w = 0 is -[p]x.
        u = u / z
        v = v / z
        row = jacobian[2 * i]
        row[0] = -u * b
        row[1] = by_x * c + u * a
        row[2] = -by_x * b
        row[3] = by_x
        row[5] = -u
        row = jacobian[2 * i + 1]
        row[0] = -by_y * c - v * b
        row[1] = v * a
        row[2] = by_y * a
        row[4] = by_y
        row[5] = -v
    return residual, jacobian


@njit(cache=True, nogil=True)
def refine_pose(
    R: Float64, t: Float64, model: Float64, seen: Float64, K: Float64, scale: Float64
) -> tuple[Float64, Float64]:
    """Levenberg-Marquardt from a first pose (3, 3), (3,) on the reprojection errors, times their `scale` (2n,)."""
    damping = 1e-3
    residual, jacobian = linearise(R, t, model, seen, K)
    cost = ((residual * scale) ** 2).sum()
    normal = np.empty((6, 6))
    right = np.empty(6)
    step = np.empty(6)
    for _ in range(MOST_STEPS):
        for i in range(6):
            right[i] = -(jacobian[:, i] * residual * scale * scale).sum()
            for j in range(i + 1):
                normal[i, j] = (jacobian[:, i] * jacobian[:, j] * scale * scale).sum()
        for i in range(6):
            normal[i, i] += damping * (normal[i, i] + 1e-12)
        if not _solve(normal, right, step):
            break
        R_new = _exp(step[:3]) @ R
        t_new = t + step[3:]
        residual_new, jacobian_new = linearise(R_new, t_new, model, seen, K)
        cost_new = ((residual_new * scale) ** 2).sum()
        if not np.isfinite(cost_new) or cost_new > cost:
            damping *= 8.0
            if damping > 1e6:
                break
            continue
        small = cost - cost_new < 1e-8 * cost + 1e-12
        R = R_new
        t = t_new
        residual = residual_new
        jacobian = jacobian_new
        cost = cost_new
        damping = damping * 0.2
        if small:
            break
    return R, t


@njit(cache=True, nogil=True)
def _solve(normal: Float64, right: Float64, step: Float64) -> bool:
    """Solve by Cholesky on the lower triangle, in place; False where the matrix is not positive definite."""
    for i in range(6):
        for j in range(i + 1):
            value = normal[i, j]
            for k in range(j):
                value -= normal[i, k] * normal[j, k]
            if i == j:
                if not value > 0.0:
                    return False
                normal[i, i] = np.sqrt(value)
            else:
                normal[i, j] = value / normal[j, j]
    for i in range(6):
        step[i] = right[i]
        for k in range(i):
            step[i] -= normal[i, k] * step[k]
        step[i] /= normal[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            step[i] -= normal[k, i] * step[k]
        step[i] /= normal[i, i]
    return True


@njit(cache=True, nogil=True)
def _exp(w: Float64) -> Float64:
    """Return the rotation matrix of a rotation vector [rad]."""
    angle = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    s = 1.0 - angle * angle / 6.0 if angle < 1e-6 else np.sin(angle) / angle
    c = 0.5 if angle < 1e-6 else (1.0 - np.cos(angle)) / (angle * angle)
    W = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    rotation: Float64 = np.eye(3) + s * W + c * (W @ W)
    return rotation


LEAST_KEYPOINTS = 4
LEAST_SPREAD = 0.3  # no keypoint is trusted better than this [px]


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
    spreads: ArrayLike | None = None,
) -> SolvedPose:
    """Solve for the pose of a cuboid from its projected corners and centroid.

    Args:
        keypoints: (9, 2) or (8, 2) [px], corners 0..7 and centroid; NaN where not found.
        dimensions: extents along the object's x, y, z [m].
        camera_matrix: (3, 3) [px].
        convention: vertex order of the keypoints.
        spreads: deviation of each keypoint [px], one per keypoint; None: equal, estimated from the residuals.

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
    deviation = np.ones(len(seen)) if spreads is None else np.asarray(spreads, np.float64)[usable]
    deviation = np.maximum(np.nan_to_num(deviation, nan=1e3), LEAST_SPREAD)
    R, t = refine_pose(*_start(model, seen, K), model, seen, K, 1.0 / deviation.repeat(2))
    if not (np.isfinite(R).all() and np.isfinite(t).all()) or t[2] <= 0.0:
        raise PoseUnsolved("the keypoints do not fit a cuboid before the camera")
    residual, jacobian = linearise(R, t, model, seen, K)
    weighted = jacobian / deviation.repeat(2)[:, None]
    # Excess of the residuals over the expected spread; with unit spreads this is their variance.
    freedom = max(2 * len(seen) - 6, 1)
    excess = float(((residual / deviation.repeat(2)) ** 2).sum()) / freedom
    floor = LEAST_SPREAD**2 if spreads is None else 1.0
    information = weighted.T @ weighted
    try:
        covariance = np.linalg.inv(information) * max(excess, floor)
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
