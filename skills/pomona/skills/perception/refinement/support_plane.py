"""The plane that a fruit stands on: where it is, seen by the same depth camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64

_BAND = 4e-3
_LEAST_SHARE = 0.3
_LEAST_POINTS = 60
_MAX_SHIFT = 0.015
_MAX_TURN = np.cos(np.radians(5.0))
_ELSEWHERE = 0.06
_MOST_OF_THEM = 0.5
_ABOUT_PARALLEL = np.cos(np.radians(20.0))


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Points p with normal · p + offset = 0; the normal, shape (3,), is a unit vector towards the free side."""

    normal: Float64
    offset: float
    deviation: float = 0.0  # standard deviation of its height [m]; 0 if the same look measured the plane

    def height(self, points: Float64) -> Float64:
        """Signed distance of points (n, 3) from the plane, positive on the free side [m]."""
        height: Float64 = points @ self.normal + self.offset
        return height


def horizontal_plane(T_base_camera: Float64, z: float) -> Plane:
    """Return the plane at height z of the base frame [m], in the camera frame, with 5 mm for calibration errors."""
    return Plane(T_base_camera[2, :3].copy(), float(T_base_camera[2, 3] - z), 5e-3)


def seen_near(known: Plane, points: Float64) -> Plane | None:
    """Return a plane near a known one, as the camera measures it; None if none lies within 15 mm and 5 degrees.

    A fruit and its support in one image share the errors of depth and of the camera's pose.
    """
    near = np.abs(known.height(points)) <= _MAX_SHIFT
    if np.count_nonzero(near) < _LEAST_POINTS or near.mean() < _LEAST_SHARE:
        return None
    offset = float(np.median(known.height(points[near])))
    seen = _least_squares(points, np.abs(known.height(points) - offset) <= 2.0 * _BAND)
    if seen is None or seen.normal @ known.normal < _MAX_TURN:
        return None
    return seen


def seen_elsewhere(known: Plane, points: Float64) -> tuple[float, float] | None:
    """Return height above [m] and tilt against [rad] a known plane of another one in its place; None if there is none.

    Then the plane's height, the camera's pose or its focal length is wrong, or the fruit lies on another object. The
    other plane is about parallel and less than 60 mm away.
    """
    near = np.abs(known.height(points)) <= _ELSEWHERE
    if seen_near(known, points) is not None or np.count_nonzero(near) < _LEAST_POINTS:
        return None
    offset = float(np.median(known.height(points[near])))
    seen = _least_squares(points, near & (np.abs(known.height(points) - offset) <= _MAX_SHIFT))
    if seen is None or float(np.mean(np.abs(seen.height(points)) <= _BAND)) < _MOST_OF_THEM:
        return None
    on_it = points[np.abs(seen.height(points)) <= _BAND].mean(axis=0)
    height, cosine = float(known.height(on_it[None])[0]), min(float(seen.normal @ known.normal), 1.0)
    return (height, float(np.arccos(cosine))) if cosine > _ABOUT_PARALLEL else None


def _least_squares(points: Float64, chosen: NDArray[np.bool_]) -> Plane | None:
    """Return the plane through the chosen points, and then through those near it."""
    plane = None
    for _ in range(4):
        if np.count_nonzero(chosen) < _LEAST_POINTS:
            return None
        centre = points[chosen].mean(axis=0)
        spread = points[chosen] - centre
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        normal = -normal if normal @ centre > 0.0 else normal
        plane = Plane(normal, -float(normal @ centre))
        chosen = np.abs(plane.height(points)) <= _BAND
    return plane
