"""Motion of the camera between two frames without poses, estimated from their contents.

Points that both pictures show (SIFT) and that have depth in both are brought into line by a rigid motion. It is
accepted only if many points all over the picture agree on it, and if two disjoint halves of them give the same motion.
A rejected motion counts fruit twice, which is visible; a wrong one would merge fruit, which is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pomona.drivers import Frame
from pomona.executive import Float64

FEATURES = 4000

LEAST_POINTS = 60
LEAST_SHARE = 0.3  # minimum ratio of matches that agree with the motion; the others are moving or similar objects

ROUNDS = 500


@dataclass(frozen=True, slots=True, eq=False)
class CameraMotion:
    """The later camera's pose in the earlier camera's frame."""

    T_earlier_later: Float64 | None  # shape (4, 4); None if it is unknown
    deviation: float  # standard deviation of the resulting positions [m]
    why: str  # reason why it is unknown; empty if it is known


def camera_motion(earlier: Frame, later: Frame) -> CameraMotion:
    """Where the camera of the later frame stood, seen from the earlier one's.

    Args:
        earlier, later: frames with depth, of one scene in which most things stand still.
    """
    if earlier.depth is None or later.depth is None:
        return _unknown("a frame has no depth")
    pixels, first, second = _matches(earlier, later)
    if len(first) < LEAST_POINTS:
        return _unknown(
            f"the two frames have {len(first)} points in common, {LEAST_POINTS} are needed"
        )
    allowed = _allowed(earlier, first) + _allowed(later, second)
    rng = np.random.default_rng(0)
    T, agree = _robust(first, second, allowed, rng)
    count, share = int(agree.sum()), float(agree.mean())
    if count < LEAST_POINTS or share < LEAST_SHARE:
        return _unknown(
            f"{count} of {len(first)} points agree on a motion, {LEAST_POINTS} and {LEAST_SHARE:.0%} are needed"
        )
    size = np.array([earlier.intrinsics.width, earlier.intrinsics.height])
    spread = float((pixels[agree].std(axis=0) / size).min())
    # Standard deviation of the agreeing points in the picture, as a share of its width and of its height
    if spread < 0.15:
        return _unknown("the points that agree on a motion all lie close together")
    order = rng.permutation(np.flatnonzero(agree))
    halves = [_rigid(first[half], second[half]) for half in (order[::2], order[1::2])]
    moved = [_apply(half, second[agree]) for half in halves]
    deviation = float(np.sqrt(np.mean(np.sum((moved[0] - moved[1]) ** 2, axis=1))))
    if (
        deviation > 0.01
    ):  # two halves must put the scene at the same place within this [m]: a tenth of a fruit
        return _unknown(f"two halves of the points put the scene {1e3 * deviation:.0f} mm apart")
    return CameraMotion(T, 0.5 * deviation, "")


def _unknown(why: str) -> CameraMotion:
    return CameraMotion(None, float("inf"), why)


def _matches(earlier: Frame, later: Frame) -> tuple[Float64, Float64, Float64]:
    """Return points of both frames: pixels of the earlier (n, 2), and in both cameras' frames, (n, 3) each [m]."""
    sift: Any = cv2.SIFT.create(FEATURES)
    found = [
        sift.detectAndCompute(cv2.cvtColor(f.colour, cv2.COLOR_RGB2GRAY), None)
        for f in (earlier, later)
    ]
    nothing = np.empty((0, 2)), np.empty((0, 3)), np.empty((0, 3))
    if any(descriptors is None or len(descriptors) < 2 for _points, descriptors in found):
        return nothing
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(found[0][1], found[1][1], k=2)
    # a point's best match must be nearer than this share of its second best (Lowe, 2004)
    best = [a for a, b in pairs if a.distance < 0.75 * b.distance]
    if not best:
        return nothing
    pixels = [
        np.array([found[0][0][match.queryIdx].pt for match in best]),
        np.array([found[1][0][match.trainIdx].pt for match in best]),
    ]
    first, second = (
        _in_space(frame, at) for frame, at in zip((earlier, later), pixels, strict=True)
    )
    there = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    return pixels[0][there], first[there], second[there]


def _in_space(frame: Frame, pixels: Float64) -> Float64:
    """Return points in the camera's frame, (n, 3) [m]; NaN where there is no depth."""
    assert frame.depth is not None
    columns, rows = np.round(pixels).astype(int).T
    z = frame.depth[
        rows.clip(0, frame.depth.shape[0] - 1), columns.clip(0, frame.depth.shape[1] - 1)
    ].astype(np.float64)
    z[z <= 0.0] = np.nan
    optics = frame.intrinsics
    return np.column_stack(
        [(pixels[:, 0] - optics.cx) / optics.fx * z, (pixels[:, 1] - optics.cy) / optics.fy * z, z]
    )


def _allowed(frame: Frame, points: Float64) -> Float64:
    """How far points may be wrong, (n,) [m]: three standard deviations of their depth, and two pixels."""
    z = points[:, 2]
    allowed: Float64 = (
        3.0 * frame.depth_model.deviation(z, frame.intrinsics.fx) + 2.0 * z / frame.intrinsics.fx
    )
    return allowed


def _robust(
    first: Float64, second: Float64, allowed: Float64, rng: np.random.Generator
) -> tuple[Float64, NDArray[np.bool_]]:
    """Return the motion on which most points agree, and which do."""
    best = np.zeros(len(first), bool)
    for _ in range(ROUNDS):
        T = _rigid(
            *(
                points[chosen]
                for chosen in [rng.choice(len(first), 3, replace=False)]
                for points in (first, second)
            )
        )
        agree = np.linalg.norm(_apply(T, second) - first, axis=1) <= allowed
        if agree.sum() > best.sum():
            best = agree
    T = np.eye(4)
    for _ in range(3):
        if best.sum() < 3:
            break
        T = _rigid(first[best], second[best])
        best = np.linalg.norm(_apply(T, second) - first, axis=1) <= allowed
    return T, best


def _rigid(first: Float64, second: Float64) -> Float64:
    """Return the motion that brings the second points onto the first, with the least squares (Kabsch), (4, 4)."""
    a, b = first.mean(axis=0), second.mean(axis=0)
    U, _, Vt = np.linalg.svd((first - a).T @ (second - b))
    turn = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    T = np.eye(4)
    T[:3, :3] = U @ turn @ Vt
    T[:3, 3] = a - T[:3, :3] @ b
    return T


def _apply(T: Float64, points: Float64) -> Float64:
    moved: Float64 = points @ T[:3, :3].T + T[:3, 3]
    return moved
