"""Closed-form inverse kinematics of seven-joint arms with a spherical shoulder and a spherical wrist.

The SIA5 family, KUKA iiwa and the like: axes 1-3 meet in the shoulder point, axes 5-7 in the wrist point, consecutive
axes of both are perpendicular; the elbow's axis may lie anywhere (the SIA5's has offsets of 85 and 60 mm). The distance
between shoulder and wrist gives the elbow's two angles; turning the arm about the line between them (the arm angle)
leaves the tool where it is; shoulder and wrist are then two rotations about three known axes each.

All axes and points are given at q = 0 in the base frame, so nothing depends on how a file names frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import acos, atan2, cos, floor, hypot, pi, sin, sqrt

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.geometry import inverse
from pomona.skills.motion.robot.model import RobotModel

Vector = tuple[float, float, float]
Rows = tuple[Vector, Vector, Vector]

_MEETING = 1e-9  # axes closer than this meet [m], and are perpendicular [1]


@dataclass(frozen=True, slots=True, eq=False)
class SphericalArm:
    """The arm's geometry at q = 0 in the base frame."""

    axes: Float64  # unit vectors of the joints' axes, shape (7, 3)
    shoulder: (
        Float64  # shoulder, elbow, wrist: points [m], shape (3,); the elbow is any point of axis 4
    )
    elbow: Float64
    wrist: Float64
    T_tcp_base_zero: Float64  # inverse of the TCP's pose at q = 0

    def solve(
        self, T_base_tcp: Float64, arm_angles: Float64, lower: Float64, upper: Float64
    ) -> Float64:
        """Return all solutions for the given arm angles within limits, shape (n, 7) [rad].

        Args:
            T_base_tcp: target pose of the TCP.
            arm_angles: angles of the elbow about the line from shoulder to wrist [rad], shape (m,); 0 puts axis 4
                horizontal, seen along the first joint's axis.
            lower, upper: limits, shape (7,).
        """
        solutions = np.empty((8 * len(arm_angles), 7))
        motion = T_base_tcp @ self.T_tcp_base_zero
        count = _solve(
            self.axes,
            self.shoulder,
            self.elbow,
            self.wrist,
            motion,
            np.ascontiguousarray(arm_angles),
            lower,
            upper,
            solutions,
        )
        return solutions[:count]

    def arm_angle(self, q: Float64, T_base_tcp: Float64) -> float:
        """Return the arm angle that keeps the elbow where it is at q, while the TCP goes to `T_base_tcp` [rad]."""
        return float(
            _arm_angle(self.axes, self.shoulder, self.wrist, T_base_tcp @ self.T_tcp_base_zero, q)
        )


@lru_cache(maxsize=16)
def as_spherical_arm(model: RobotModel) -> SphericalArm | None:
    """Return the model as a member of this family, or None when its geometry does not fit."""
    if model.dof != 7 or model.sliding.any():
        return None
    links = model.link_poses(np.zeros(7))[1:]
    axes = np.ascontiguousarray(links[:, :3, 2])
    points = np.ascontiguousarray(links[:, :3, 3])
    shoulder = _meeting_point(axes[:3], points[:3])
    wrist = _meeting_point(axes[4:], points[4:])
    consecutive = [axes[i] @ axes[i + 1] for i in (0, 1, 4, 5)]
    if shoulder is None or wrist is None or max(map(abs, consecutive)) > _MEETING:
        return None
    return SphericalArm(axes, shoulder, points[3], wrist, inverse(model.tcp(np.zeros(7))))


def _meeting_point(axes: Float64, points: Float64) -> Float64 | None:
    """Return the point where lines meet, in the least-squares sense, or None when they do not."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    if np.linalg.matrix_rank(across.sum(axis=0), tol=1e-6) < 3:
        return None
    point: Float64 = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, points))
    distances = np.linalg.norm(np.einsum("nij,nj->ni", across, point - points), axis=1)
    return point if distances.max() < _MEETING else None


@kernel(nogil=True)
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel(nogil=True)
def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@kernel(nogil=True)
def _rotate(axis: Vector, c: float, s: float, v: Vector) -> Vector:
    """Return a vector turned about a unit axis by the angle with cosine c and sine s (Rodrigues)."""
    along = _dot(axis, v) * (1.0 - c)
    across = _cross(axis, v)
    return (
        v[0] * c + across[0] * s + axis[0] * along,
        v[1] * c + across[1] * s + axis[1] * along,
        v[2] * c + across[2] * s + axis[2] * along,
    )


@kernel(nogil=True)
def _unit(v: Vector) -> Vector:
    length = sqrt(_dot(v, v))
    return (v[0] / length, v[1] / length, v[2] / length)


@kernel(nogil=True)
def _unit_across(v: Vector, along: Vector) -> Vector:
    """Return a unit vector perpendicular to the unit vector `along`, towards v, or any when v is parallel to it."""
    part = _dot(v, along)
    across = (v[0] - part * along[0], v[1] - part * along[1], v[2] - part * along[2])
    if _dot(across, across) < 1e-18:
        across = _cross(along, (1.0, 0.0, 0.0) if abs(along[0]) < 0.6 else (0.0, 1.0, 0.0))
    perpendicular: Vector = _unit(across)
    return perpendicular


@kernel(nogil=True)
def _frame_of_line(line: Vector, sideways: Vector) -> tuple[Vector, Vector, Vector]:
    """Unit vectors along a line, across it towards `sideways`, and perpendicular to both."""
    forward = _unit(line)
    side = _unit_across(sideways, forward)
    return forward, side, _cross(forward, side)


@kernel(nogil=True)
def _three_axes(
    a: Vector, b: Vector, c: Vector, rows: Rows, branch: float, angles: Float64, first: int
) -> None:
    """Write angles with R = Rot(a, x) Rot(b, y) Rot(c, z) for unit axes a ⟂ b ⟂ c into angles[first:first + 3].

    `rows` are those of R. It maps c to t; the part of t along a fixes y up to its sign, `branch`; the direction of the
    rest fixes x; the remainder of R is z.
    """
    t = (_dot(rows[0], c), _dot(rows[1], c), _dot(rows[2], c))
    along = _dot(a, t)
    rest = _cross(a, t)
    sideways = sqrt(_dot(rest, rest))
    y = atan2(_dot(a, _cross(b, c)), _dot(a, c)) + branch * atan2(sideways, along)
    m = _rotate(b, cos(y), sin(y), c)
    x = 0.0  # singular configuration (t parallel to a): x and z turn about one line, so z takes all of it
    if sideways > 1e-12:
        x = atan2(_dot(a, _cross(m, t)), _dot(m, t) - _dot(a, m) * along)
    start = b  # perpendicular to c
    turned = (_dot(rows[0], start), _dot(rows[1], start), _dot(rows[2], start))
    turned = _rotate(b, cos(y), -sin(y), _rotate(a, cos(x), -sin(x), turned))
    angles[first], angles[first + 1] = x, y
    angles[first + 2] = atan2(_dot(c, _cross(start, turned)), _dot(start, turned))


@kernel(nogil=True)
def _into_limits(angles: Float64, lower: Float64, upper: Float64, solution: Float64) -> bool:
    """Write angles, shifted by whole turns towards the middle of their ranges; False when one stays outside."""
    for i in range(angles.shape[0]):
        middle = 0.5 * (lower[i] + upper[i])
        solution[i] = angles[i] - 2.0 * pi * floor((angles[i] - middle) / (2.0 * pi) + 0.5)
        if solution[i] < lower[i] or solution[i] > upper[i]:
            return False
    return True


@kernel(nogil=True)
def _vector(values: Float64) -> Vector:
    return (values[0], values[1], values[2])


@kernel(nogil=True)
def _to_wrist(shoulder: Float64, wrist: Float64, motion: Float64) -> Vector:
    """Return the line from the shoulder to where a motion takes the wrist."""
    w = _vector(wrist)
    return (
        _dot(_vector(motion[0]), w) + motion[0, 3] - shoulder[0],
        _dot(_vector(motion[1]), w) + motion[1, 3] - shoulder[1],
        _dot(_vector(motion[2]), w) + motion[2, 3] - shoulder[2],
    )


@kernel(nogil=True)
def _arm_angle(
    axes: Float64, shoulder: Float64, wrist: Float64, motion: Float64, q: Float64
) -> float:
    """Return the angle of the elbow's axis at q about the line to where a motion takes the wrist."""
    elbow_axis = _vector(axes[3])
    for i in range(2, -1, -1):
        elbow_axis = _rotate(_vector(axes[i]), cos(q[i]), sin(q[i]), elbow_axis)
    to_wrist = _to_wrist(shoulder, wrist, motion)
    _, side, up = _frame_of_line(to_wrist, _cross(_vector(axes[0]), to_wrist))
    return atan2(_dot(elbow_axis, up), _dot(elbow_axis, side))


@kernel(nogil=True)
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
    e1 = _vector(axes[0])
    e2 = _vector(axes[1])
    e3 = _vector(axes[2])
    e4 = _vector(axes[3])
    e5 = _vector(axes[4])
    e6 = _vector(axes[5])
    e7 = _vector(axes[6])
    m0 = _vector(motion[0])
    m1 = _vector(motion[1])
    m2 = _vector(motion[2])
    forearm = _vector(wrist - elbow)
    upper_arm = _vector(elbow - shoulder)
    to_wrist = _to_wrist(shoulder, wrist, motion)
    # |upper_arm + Rot(e4, q4) forearm| = |to_wrist|  is  A cos q4 + B sin q4 = rhs
    along = _dot(upper_arm, e4) * _dot(e4, forearm)
    A = _dot(upper_arm, forearm) - along
    B = _dot(upper_arm, _cross(e4, forearm))
    rhs = (
        0.5 * (_dot(to_wrist, to_wrist) - _dot(forearm, forearm) - _dot(upper_arm, upper_arm))
        - along
    )
    ratio = rhs / hypot(A, B)
    if abs(ratio) > 1.0 or _dot(to_wrist, to_wrist) < 1e-18:
        return 0
    forward, side, up = _frame_of_line(to_wrist, _cross(e1, to_wrist))
    angles = np.empty(7)
    both = np.empty((2, 7))  # the two solutions of shoulder and wrist
    count = 0
    for elbow_branch in (1.0, -1.0):
        angles[3] = atan2(B, A) + elbow_branch * acos(ratio)
        c4 = cos(angles[3])
        s4 = sin(angles[3])
        turned = _rotate(e4, c4, s4, forearm)
        line = (upper_arm[0] + turned[0], upper_arm[1] + turned[1], upper_arm[2] + turned[2])
        f, s, u = _frame_of_line(line, e4)
        for k in range(arm_angles.shape[0]):
            cosine = cos(arm_angles[k])
            sine = sin(arm_angles[k])
            a = (
                cosine * side[0] + sine * up[0],
                cosine * side[1] + sine * up[1],
                cosine * side[2] + sine * up[2],
            )
            b = (
                cosine * up[0] - sine * side[0],
                cosine * up[1] - sine * side[1],
                cosine * up[2] - sine * side[2],
            )
            # The shoulder's rotation takes the frame (f, s, u) of the bent arm to (forward, a, b).
            R0 = _row(forward[0], a[0], b[0], f, s, u)
            R1 = _row(forward[1], a[1], b[1], f, s, u)
            R2 = _row(forward[2], a[2], b[2], f, s, u)
            # The wrist's is (R · Rot(e4, q4))ᵀ · motion: its columns first, then its rows.
            x = _rotate(e4, c4, -s4, _row(m0[0], m1[0], m2[0], R0, R1, R2))
            y = _rotate(e4, c4, -s4, _row(m0[1], m1[1], m2[1], R0, R1, R2))
            z = _rotate(e4, c4, -s4, _row(m0[2], m1[2], m2[2], R0, R1, R2))
            of_wrist = ((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]))
            for branch in range(2):
                _three_axes(e1, e2, e3, (R0, R1, R2), 1.0 - 2.0 * branch, both[branch], 0)
                _three_axes(e5, e6, e7, of_wrist, 1.0 - 2.0 * branch, both[branch], 4)
            for branches in range(4):
                for i in range(3):
                    angles[i], angles[4 + i] = both[branches // 2, i], both[branches % 2, 4 + i]
                if count < solutions.shape[0] and _into_limits(
                    angles, lower, upper, solutions[count]
                ):
                    count += 1
    return count


@kernel(nogil=True)
def _row(a: float, b: float, c: float, f: Vector, s: Vector, u: Vector) -> Vector:
    """a f + b s + c u."""
    return (
        a * f[0] + b * s[0] + c * u[0],
        a * f[1] + b * s[1] + c * u[1],
        a * f[2] + b * s[2] + c * u[2],
    )
