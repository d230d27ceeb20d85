"""Closed-form inverse kinematics of seven-joint arms with a spherical shoulder and a spherical wrist.

The SIA5 family, KUKA iiwa and their like: axes 1-3 meet in the shoulder point, axes 5-7 in the wrist point, consecutive
axes of both are perpendicular; the elbow's axis may lie anywhere (the SIA5's has offsets of 85 and 60 mm). The distance
between shoulder and wrist gives the elbow's two angles; turning the arm about the line between them (the arm angle)
leaves the tool where it is; shoulder and wrist are then two rotations about three known axes each.

Everything is written with axes and points at q = 0 in the base frame, so it does not depend on how a file names frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import acos, atan2, cos, floor, hypot, pi, sin, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skills.geometry import inverse
from skills.robot.model import RobotModel

Float64 = NDArray[np.float64]

_MEETING = 1e-9  # axes closer than this meet [m], and are perpendicular [1]


@dataclass(frozen=True, slots=True, eq=False)
class SphericalArm:
    """The arm's geometry at q = 0 in the base frame.

    Attributes:
        axes: unit vectors of the joints' axes, shape (7, 3).
        shoulder, elbow, wrist: points [m], shape (3,); the elbow is any point of axis 4.
        T_tcp_base_zero: inverse of the TCP's pose at q = 0.
    """

    axes: Float64
    shoulder: Float64
    elbow: Float64
    wrist: Float64
    T_tcp_base_zero: Float64

    def solve(self, T_base_tcp: Float64, arm_angles: Float64, lower: Float64, upper: Float64) -> Float64:
        """All solutions for the given arm angles within limits, shape (n, 7) [rad].

        Args:
            T_base_tcp: where the TCP shall be.
            arm_angles: angles of the elbow about the line from shoulder to wrist [rad], shape (m,); 0 puts axis 4
                horizontal, seen along the first joint's axis.
            lower, upper: limits, shape (7,).
        """
        solutions = np.empty((8 * len(arm_angles), 7))
        motion = T_base_tcp @ self.T_tcp_base_zero
        count = _solve(
            self.axes, self.shoulder, self.elbow, self.wrist, motion, np.ascontiguousarray(arm_angles), lower, upper,
            solutions,
        )  # fmt: skip
        return solutions[:count]

    def arm_angle(self, q: Float64, T_base_tcp: Float64) -> float:
        """The arm angle that keeps the elbow where it is at q, while the TCP goes to `T_base_tcp` [rad]."""
        motion = T_base_tcp @ self.T_tcp_base_zero
        elbow_axis = self.axes[3].copy()
        for axis, angle in zip(self.axes[2::-1], q[2::-1], strict=True):
            elbow_axis = _rotate(axis, angle, elbow_axis)
        to_wrist = motion[:3, :3] @ self.wrist + motion[:3, 3] - self.shoulder
        forward, side = _reference(self.axes[0], to_wrist)
        up = np.cross(forward, side)
        return float(np.arctan2(elbow_axis @ up, elbow_axis @ side))


@lru_cache(maxsize=16)
def as_spherical_arm(model: RobotModel) -> SphericalArm | None:
    """The model as a member of this family, or None when its geometry is another."""
    if model.dof != 7 or model.sliding.any():
        return None
    links = model.link_poses(np.zeros(7))[1:]
    axes, points = np.ascontiguousarray(links[:, :3, 2]), np.ascontiguousarray(links[:, :3, 3])
    shoulder, wrist = _meeting_point(axes[:3], points[:3]), _meeting_point(axes[4:], points[4:])
    consecutive = [axes[i] @ axes[i + 1] for i in (0, 1, 4, 5)]
    if shoulder is None or wrist is None or max(map(abs, consecutive)) > _MEETING:
        return None
    return SphericalArm(axes, shoulder, points[3], wrist, inverse(model.tcp(np.zeros(7))))


def _meeting_point(axes: Float64, points: Float64) -> Float64 | None:
    """The point where lines meet, in the least-squares sense, or None when they do not."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    if np.linalg.matrix_rank(across.sum(axis=0), tol=1e-6) < 3:
        return None
    point: Float64 = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, points))
    distances = np.linalg.norm(np.einsum("nij,nj->ni", across, point - points), axis=1)
    return point if distances.max() < _MEETING else None


@njit(cache=True, nogil=True)
def _rotate(axis: Float64, angle: float, v: Float64) -> Float64:
    """A vector turned about a unit axis (Rodrigues)."""
    c, s = cos(angle), sin(angle)
    along = (axis[0] * v[0] + axis[1] * v[1] + axis[2] * v[2]) * (1.0 - c)
    turned = np.empty(3)
    turned[0] = v[0] * c + (axis[1] * v[2] - axis[2] * v[1]) * s + axis[0] * along
    turned[1] = v[1] * c + (axis[2] * v[0] - axis[0] * v[2]) * s + axis[1] * along
    turned[2] = v[2] * c + (axis[0] * v[1] - axis[1] * v[0]) * s + axis[2] * along
    return turned


@njit(cache=True, nogil=True)
def _dot(a: Float64, b: Float64) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True)
def _cross(a: Float64, b: Float64) -> Float64:
    out = np.empty(3)
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return out


@njit(cache=True, nogil=True)
def _unit_across(v: Float64, along: Float64) -> Float64:
    """A unit vector perpendicular to the unit vector `along`, towards v, or any when v is parallel to it."""
    across = v - _dot(v, along) * along
    length = sqrt(_dot(across, across))
    if length < 1e-9:
        smallest = np.zeros(3)
        smallest[np.argmin(np.abs(along))] = 1.0
        across = smallest - _dot(smallest, along) * along
        length = sqrt(_dot(across, across))
    return across / length


@njit(cache=True, nogil=True)
def _reference(first_axis: Float64, to_wrist: Float64) -> tuple[Float64, Float64]:
    """Unit vectors along the line from shoulder to wrist, and across it where the arm angle is 0."""
    forward = to_wrist / sqrt(_dot(to_wrist, to_wrist))
    return forward, _unit_across(_cross(first_axis, forward), forward)


@njit(cache=True, nogil=True)
def _three_axes(
    a: Float64, b: Float64, c: Float64, R: Float64, branch: int, angles: Float64, first: int
) -> None:
    """Write angles with R = Rot(a, x) Rot(b, y) Rot(c, z) for unit axes a ⟂ b ⟂ c into angles[first:first + 3].

    Of the two solutions, `branch` chooses one. R maps c to t; the part of t along a fixes y, the direction of the rest
    fixes x, and what is then left of R is z.
    """
    t = np.empty(3)
    for i in range(3):
        t[i] = _dot(R[i], c)
    along = _dot(a, t)
    rest = _cross(a, t)
    sideways = sqrt(_dot(rest, rest))
    y = atan2(_dot(a, _cross(b, c)), _dot(a, c)) + (atan2(sideways, along) if branch == 0 else -atan2(sideways, along))
    m = _rotate(b, y, c)
    x = 0.0  # in the singular posture (c parallel to a) x and z turn about one line: all of it goes to z
    if sideways > 1e-12:
        x = atan2(_dot(a, _cross(m, t)), _dot(m, t) - _dot(a, m) * along)
    start = _unit_across(a, c) if abs(_dot(a, c)) < 0.9 else _unit_across(b, c)
    turned = np.empty(3)
    for i in range(3):
        turned[i] = _dot(R[i], start)
    turned = _rotate(b, -y, _rotate(a, -x, turned))
    angles[first], angles[first + 1] = x, y
    angles[first + 2] = atan2(_dot(c, _cross(start, turned)), _dot(start, turned))


@njit(cache=True, nogil=True)
def _into_limits(q: Float64, lower: Float64, upper: Float64) -> bool:
    """Shift every joint by whole turns towards the middle of its range; False when one stays outside."""
    for i in range(q.shape[0]):
        middle = 0.5 * (lower[i] + upper[i])
        q[i] -= 2.0 * pi * floor((q[i] - middle) / (2.0 * pi) + 0.5)
        if q[i] < lower[i] or q[i] > upper[i]:
            return False
    return True


@njit(cache=True, nogil=True)
def _solve(
    axes: Float64,
    shoulder: Float64,
    elbow: Float64,
    wrist: Float64,
    motion: Float64,
    arm_angles: Float64,
    lower: Float64,
    upper: Float64,
    solutions: Float64,
) -> int:
    """Write solutions for the motion (target pose · inverse pose at q = 0) and return their number."""
    to_wrist = np.empty(3)
    for i in range(3):
        to_wrist[i] = _dot(motion[i, :3], wrist) + motion[i, 3] - shoulder[i]
    forearm, upper_arm = wrist - elbow, elbow - shoulder
    axis = axes[3]
    # |upper_arm + Rot(axis, q4) forearm| = |to_wrist|  is  A cos q4 + B sin q4 = rhs
    along = _dot(upper_arm, axis) * _dot(axis, forearm)
    A, B = _dot(upper_arm, forearm) - along, _dot(upper_arm, _cross(axis, forearm))
    rhs = 0.5 * (_dot(to_wrist, to_wrist) - _dot(forearm, forearm) - _dot(upper_arm, upper_arm)) - along
    ratio = rhs / hypot(A, B)
    if abs(ratio) > 1.0 or _dot(to_wrist, to_wrist) < 1e-18:
        return 0
    forward, side = _reference(axes[0], to_wrist)
    up = _cross(forward, side)
    R = np.empty((3, 3))
    R_wrist = np.empty((3, 3))
    angles = np.empty(7)
    count = 0
    for elbow_branch in range(2):
        angles[3] = atan2(B, A) + (acos(ratio) if elbow_branch == 0 else -acos(ratio))
        arm_forward = upper_arm + _rotate(axis, angles[3], forearm)
        arm_forward = arm_forward / sqrt(_dot(arm_forward, arm_forward))
        arm_side = _unit_across(axis, arm_forward)
        arm_up = _cross(arm_forward, arm_side)
        for k in range(arm_angles.shape[0]):
            c, s = cos(arm_angles[k]), sin(arm_angles[k])
            for i in range(3):
                for j in range(3):
                    R[i, j] = (
                        forward[i] * arm_forward[j]
                        + (c * side[i] + s * up[i]) * arm_side[j]
                        + (c * up[i] - s * side[i]) * arm_up[j]
                    )
            # R_wrist = (R · Rot(axis, q4))ᵀ · motion, column by column
            for j in range(3):
                column = np.empty(3)
                for i in range(3):
                    column[i] = R[0, i] * motion[0, j] + R[1, i] * motion[1, j] + R[2, i] * motion[2, j]
                R_wrist[:, j] = _rotate(axis, -angles[3], column)
            for shoulder_branch in range(2):
                _three_axes(axes[0], axes[1], axes[2], R, shoulder_branch, angles, 0)
                for wrist_branch in range(2):
                    _three_axes(axes[4], axes[5], axes[6], R_wrist, wrist_branch, angles, 4)
                    solutions[count] = angles
                    if _into_limits(solutions[count], lower, upper):
                        count += 1
                    if count == solutions.shape[0]:
                        return count
    return count
