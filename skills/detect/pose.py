"""A pose from the cuboid's keypoints: EPnP, then weighted least squares on the reprojection error."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from skills.detect.cuboid import CuboidConvention, cuboid_keypoints
from skills.detect.errors import PoseUnsolved

F64 = NDArray[np.float64]

LEAST_KEYPOINTS = 4
LEAST_SPREAD = 0.3
"""No keypoint is trusted better than this [px]."""


@dataclass(frozen=True, slots=True, eq=False)
class SolvedPose:
    """The pose of a cuboid.

    Attributes:
        T_camera_object: object's frame to camera frame [m].
        covariance: of (rotation vector, translation) in the camera frame, (6, 6) [rad, m].
        residual: root mean square reprojection error over the keypoints used [px].
    """

    T_camera_object: F64
    covariance: F64
    residual: float


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

    Raises:
        PoseUnsolved: fewer than four keypoints, degenerate geometry, or a pose that is not finite.
    """
    points = np.asarray(keypoints, np.float64)
    K = np.asarray(camera_matrix, np.float64)
    if points.shape not in ((9, 2), (8, 2)):
        raise PoseUnsolved(f"expected (9, 2) or (8, 2) keypoints, not {points.shape}")
    usable = np.asarray(np.isfinite(points).all(axis=1) & (np.abs(points) < 1e5).all(axis=1))
    if usable[:8].sum() < LEAST_KEYPOINTS:
        raise PoseUnsolved(f"{int(usable[:8].sum())} corners were found, at least {LEAST_KEYPOINTS} are needed")
    model = cuboid_keypoints(dimensions, convention)[: len(points)][usable]
    seen = points[usable]
    deviation = np.ones(len(seen)) if spreads is None else np.asarray(spreads, np.float64)[usable]
    deviation = np.maximum(np.nan_to_num(deviation, nan=1e3), LEAST_SPREAD)
    R, t = _refine(*_start(model, seen, K), model, seen, K, deviation)
    if not (np.isfinite(R).all() and np.isfinite(t).all()) or t[2] <= 0.0:
        raise PoseUnsolved("the keypoints do not fit a cuboid before the camera")
    residual, jacobian = _linearise(R, t, model, seen, K)
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
    T[:3, :3], T[:3, 3] = R, t
    return SolvedPose(T, 0.5 * (covariance + covariance.T), float(np.sqrt((residual**2).mean() * 2.0)))


def _start(model: F64, seen: F64, K: F64) -> tuple[F64, F64]:
    """EPnP's pose; one behind the camera is mirrored to the front."""
    if np.linalg.matrix_rank(seen - seen.mean(axis=0), tol=1e-3) < 2:
        raise PoseUnsolved("the keypoints lie on a line")
    try:
        found, rotation, translation = cv2.solvePnP(model, seen, K, None, flags=cv2.SOLVEPNP_EPNP)
    except cv2.error as error:
        raise PoseUnsolved("EPnP failed") from error
    if not found or not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
        raise PoseUnsolved("EPnP failed")
    R, t = np.asarray(cv2.Rodrigues(rotation)[0], np.float64), np.asarray(translation, np.float64).ravel()
    if t[2] < 0.0:
        R, t = np.diag([-1.0, -1.0, 1.0]) @ R, -t
    return R, t


def _linearise(R: F64, t: F64, model: F64, seen: F64, K: F64) -> tuple[F64, F64]:
    """Residuals (2n,) [px] and their derivative (2n, 6) by a rotation vector and translation in the camera frame."""
    turned = model @ R.T
    a, b, c = turned.T
    x, y, z = (turned + t).T
    z = np.where(np.abs(z) < 1e-6, 1e-6, z)
    u, v = K[0, 0] * x / z, K[1, 1] * y / z
    residual = np.empty((len(model), 2))
    residual[:, 0] = u + (K[0, 2] - seen[:, 0])
    residual[:, 1] = v + (K[1, 2] - seen[:, 1])
    # By the point: (fx / z, 0, -u / z) and (0, fy / z, -v / z); d(exp(w) p)/dw at w = 0 is -[p]x.
    by_x, by_y, u, v = K[0, 0] / z, K[1, 1] / z, u / z, v / z
    jacobian = np.zeros((len(model), 2, 6))
    jacobian[:, 0, 0], jacobian[:, 0, 1], jacobian[:, 0, 2] = -u * b, by_x * c + u * a, -by_x * b
    jacobian[:, 1, 0], jacobian[:, 1, 1], jacobian[:, 1, 2] = -by_y * c - v * b, v * a, by_y * a
    jacobian[:, 0, 3], jacobian[:, 0, 5] = by_x, -u
    jacobian[:, 1, 4], jacobian[:, 1, 5] = by_y, -v
    return residual.reshape(-1), jacobian.reshape(-1, 6)


def _refine(R: F64, t: F64, model: F64, seen: F64, K: F64, deviation: F64) -> tuple[F64, F64]:
    """Levenberg-Marquardt on the weighted reprojection error."""
    scale = 1.0 / deviation.repeat(2)
    damping = 1e-3
    residual, jacobian = _linearise(R, t, model, seen, K)
    cost = float(((residual * scale) ** 2).sum())
    for _ in range(20):
        weighted = jacobian * scale[:, None]
        normal = weighted.T @ weighted
        try:
            step = -np.linalg.solve(
                normal + damping * np.diag(np.diag(normal) + 1e-12), weighted.T @ (residual * scale)
            )
        except np.linalg.LinAlgError:
            break
        R_new, t_new = np.asarray(cv2.Rodrigues(step[:3])[0]) @ R, t + step[3:]
        residual_new, jacobian_new = _linearise(R_new, t_new, model, seen, K)
        cost_new = float(((residual_new * scale) ** 2).sum())
        if not np.isfinite(cost_new) or cost_new > cost:
            damping *= 8.0
            if damping > 1e6:
                break
            continue
        small = cost - cost_new < 1e-8 * cost + 1e-12
        R, t, residual, jacobian, cost, damping = R_new, t_new, residual_new, jacobian_new, cost_new, damping * 0.2
        if small:
            break
    return R, t
