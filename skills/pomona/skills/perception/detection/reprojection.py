"""Least squares on the reprojection error of a rigid body's points, compiled with numba."""

from __future__ import annotations

import numpy as np
from numba import njit

from pomona.executive.values.arrays import Float64

MOST_STEPS = 20


@njit(cache=True, nogil=True)
def linearise(R: Float64, t: Float64, model: Float64, seen: Float64, K: Float64) -> tuple[Float64, Float64]:
    """Residuals (2n,) [px] and their derivative (2n, 6) by a rotation vector and translation in the camera frame.

    Args:
        R, t: pose of the body in the camera frame, (3, 3) and (3,) [m].
        model: points in the body's frame, (n, 3) [m].
        seen: the same points in the picture, (n, 2) [px].
        K: camera matrix (3, 3) [px].
    """
    count = model.shape[0]
    residual, jacobian = np.empty(2 * count), np.zeros((2 * count, 6))
    for i in range(count):
        a = R[0, 0] * model[i, 0] + R[0, 1] * model[i, 1] + R[0, 2] * model[i, 2]
        b = R[1, 0] * model[i, 0] + R[1, 1] * model[i, 1] + R[1, 2] * model[i, 2]
        c = R[2, 0] * model[i, 0] + R[2, 1] * model[i, 1] + R[2, 2] * model[i, 2]
        z = c + t[2]
        if abs(z) < 1e-6:
            z = 1e-6
        by_x, by_y = K[0, 0] / z, K[1, 1] / z
        u, v = by_x * (a + t[0]), by_y * (b + t[1])
        residual[2 * i] = u + K[0, 2] - seen[i, 0]
        residual[2 * i + 1] = v + K[1, 2] - seen[i, 1]
        # By the point: (fx / z, 0, -u / z) and (0, fy / z, -v / z); d(exp(w) p)/dw at w = 0 is -[p]x.
        u, v = u / z, v / z
        row = jacobian[2 * i]
        row[0], row[1], row[2], row[3], row[5] = -u * b, by_x * c + u * a, -by_x * b, by_x, -u
        row = jacobian[2 * i + 1]
        row[0], row[1], row[2], row[4], row[5] = -by_y * c - v * b, v * a, by_y * a, by_y, -v
    return residual, jacobian


@njit(cache=True, nogil=True)
def refine_pose(
    R: Float64, t: Float64, model: Float64, seen: Float64, K: Float64, scale: Float64
) -> tuple[Float64, Float64]:
    """Levenberg-Marquardt from a first pose (3, 3), (3,) on the reprojection errors, times their `scale` (2n,)."""
    damping = 1e-3
    residual, jacobian = linearise(R, t, model, seen, K)
    cost = ((residual * scale) ** 2).sum()
    normal, right, step = np.empty((6, 6)), np.empty(6), np.empty(6)
    for _ in range(MOST_STEPS):
        for i in range(6):
            right[i] = -(jacobian[:, i] * residual * scale * scale).sum()
            for j in range(i + 1):
                normal[i, j] = (jacobian[:, i] * jacobian[:, j] * scale * scale).sum()
        for i in range(6):
            normal[i, i] += damping * (normal[i, i] + 1e-12)
        if not _solve(normal, right, step):
            break
        R_new, t_new = _exp(step[:3]) @ R, t + step[3:]
        residual_new, jacobian_new = linearise(R_new, t_new, model, seen, K)
        cost_new = ((residual_new * scale) ** 2).sum()
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
