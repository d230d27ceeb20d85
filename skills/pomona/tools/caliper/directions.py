"""Directions in which picks show a camera's error: eigenvectors of its covariance; picks that would show the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.tools.caliper.estimate import CameraErrors
from pomona.tools.caliper.pick import Pick

KNOWN_PLACE = 1e-3
KNOWN_ANGLE = float(np.radians(0.2))
"""Largest standard deviation of a place [m] and an angle [rad] that is known: what a correction has to reach."""
# the same of the depth's scale and of z [m]
KNOWN_SCALE = 3e-3
KNOWN_ZERO = 0.3e-3

FINGERS = "picks with fingers that feel the touch of each pad"
NO_LANDING = "picks in which no finger lands on the fruit before both close on it"
UPRIGHT = 0.5  # part of a direction along the vertical from which horizontal fingers cannot close along it
TURNED = np.radians(20.0)  # turn of the grasps below which only more picks of the same kind help


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """One direction of the camera's error, towards the estimated error."""

    axis: Float64  # in the camera's frame, shape (3,); of an angle, the axis of the turn
    value: float  # the estimated error along it, at least 0 [m or rad]
    std: float  # its standard deviation
    is_known: bool


def place_directions(found: CameraErrors) -> tuple[Direction, ...]:
    """Return three directions of the fruit's shift at the centre of the picks, the best known first."""
    return _directions(*found.shift, KNOWN_PLACE)


def angle_directions(found: CameraErrors) -> tuple[Direction, ...]:
    """Return three axes of the camera's turn, the best known first."""
    return _directions(found.error[3:6], found.covariance[3:6, 3:6], KNOWN_ANGLE)


def further_picks(direction: Float64, picks: Sequence[Pick]) -> str:
    """Describe picks that would show the place along a direction, beside those that were made.

    Args:
        direction: unit vector in the camera's frame, shape (3,).
        picks: those that were made.
    """
    axes = np.array([pick.axis for pick in picks if pick.side and not pick.landed])
    if not len(axes):
        return NO_LANDING if any(pick.landed for pick in picks) else FINGERS
    up = np.mean([pick.up for pick in picks], axis=0)
    if abs(float(direction @ up)) > UPRIGHT * float(np.linalg.norm(up)):
        return "grasps tilted by 30° and more, whose fingers do not close level,"
    usual = np.linalg.eigh(axes.T @ axes)[1][:, -1]
    turn = _between(_level(usual, up), _level(direction, up))
    if turn < TURNED:
        return "more picks with the fingers as they were"
    return f"grasps turned by {10.0 * round(np.degrees(turn) / 10.0):.0f}° about the vertical"


def _directions(value: Float64, covariance: Float64, limit: float) -> tuple[Direction, ...]:
    variances, vectors = np.linalg.eigh(covariance)
    known = int(np.count_nonzero(variances <= limit**2))
    found = []
    for part, is_known in ((vectors[:, :known], True), (vectors[:, known:], False)):
        for axis in _nearest_to_axes(part):
            along = float(axis @ value)
            towards = axis if along >= 0.0 else -axis
            found.append(
                Direction(towards, abs(along), float(np.sqrt(axis @ covariance @ axis)), is_known)
            )
    return tuple(found)


def _nearest_to_axes(part: Float64) -> list[Float64]:
    """Return orthonormal vectors that span a subspace, shape (3, k), the first ones as near to x, y, z as it allows."""
    basis: list[Float64] = []
    projector = part @ part.T
    for _ in range(part.shape[1]):
        lengths = np.linalg.norm(
            projector, axis=0
        )  # of each coordinate axis within the rest of the subspace
        best = int(np.argmax(np.round(lengths, 6)))
        vector = np.asarray(projector[:, best] / lengths[best], np.float64)
        basis.append(vector)
        projector = projector - np.outer(vector, vector)
    return basis


def _level(vector: Float64, up: Float64) -> Float64:
    return np.asarray(vector - up * float(vector @ up) / float(up @ up), np.float64)


def _between(one: Float64, other: Float64) -> float:
    """Return the angle between two lines, 0 to π/2 [rad]."""
    lengths = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.arccos(min(abs(float(one @ other)) / lengths, 1.0))) if lengths > 0.0 else 0.0
