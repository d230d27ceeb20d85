"""The paper's sphere of pre-grasps: eqs. (pre-grasp position attempt) and (pre-grasp orientation attempt).

Conventions, which the paper leaves open:

- World = the robot's base frame, z up. The end-effector frame is the gripper's TCP: z is the approach vector, y the
  sliding vector (the direction in which the fingers move).
- Quaternion products compose from left to right, as rotation matrices do; stored quaternions are (x, y, z, w).
- Q~ = Q_z(-pi/2) * Q_x(pi). It points the approach vector down the world's z, and it is the only such rotation for
  which the approach at every (theta, alpha) runs from the pre-grasp's position through the fruit's centre.
- The gripper is symmetric, so a half turn about the approach vector gives the same grasp. `camera_above` chooses the
  turn for which a camera mounted on the TCP's -x side looks from above on a tilted approach; without it the camera
  is below, as the equation is written.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import rot_x, rot_y, rot_z

Q_TILDE: Float64 = rot_z(-np.pi / 2.0) @ rot_x(
    np.pi
)  # turns the approach vector down the world's z, shape (3, 3)


def pre_grasp_position(p_fruit: Float64, r_o: float, theta: float, alpha: float) -> Float64:
    """Eq. (pre-grasp position attempt): a point (3,) on the sphere with radius r_o [m] around the fruit, base frame."""
    direction = np.array(
        [np.sin(theta) * np.sin(alpha), np.sin(theta) * np.cos(alpha), np.cos(theta)]
    )
    return p_fruit + r_o * direction


def pre_grasp_orientation(theta: float, alpha: float, camera_above: bool = True) -> Float64:
    """Eq. (pre-grasp orientation attempt) as a rotation matrix: TCP axes in the base frame, shape (3, 3)."""
    R_base_tcp = Q_TILDE @ rot_z(alpha) @ rot_y(theta)
    return R_base_tcp @ rot_z(np.pi) if camera_above else R_base_tcp


@dataclass(frozen=True, slots=True)
class Sphere:
    """Which part of the sphere is sampled, and how finely.

    Attributes:
        radius: the paper's r_o [m].
        theta: smallest and largest tilt of the approach from the vertical [rad].
        alpha: first and last azimuth about the world's z [rad]; a full circle does not repeat its start.
        tilts, turns: number of samples of theta and alpha.
    """

    radius: float = 0.12
    theta: tuple[float, float] = (0.0, np.pi / 4.0)
    alpha: tuple[float, float] = (0.0, 2.0 * np.pi)
    tilts: int = 4
    turns: int = 12

    def finer(self) -> Sphere:
        """Return the same part at half the spacing; it contains the attempts of this one."""
        turns = 2 * self.turns if self._is_full else 2 * self.turns - 1
        return replace(self, tilts=2 * self.tilts - 1, turns=turns)

    def attempts(self) -> Sequence[tuple[float, float]]:
        """(theta, alpha) of every attempt in the sampling's own order: by tilt, then by azimuth."""
        thetas = np.linspace(*self.theta, self.tilts)
        alphas = np.linspace(*self.alpha, self.turns, endpoint=not self._is_full)
        return [(float(theta), float(alpha)) for theta in thetas for alpha in alphas]

    @property
    def _is_full(self) -> bool:
        return bool(np.isclose(self.alpha[1] - self.alpha[0], 2.0 * np.pi))


@lru_cache(maxsize=16)
def pre_grasp_orientations(sphere: Sphere) -> Float64:
    """`pre_grasp_orientation` of all attempts of a sphere, shape (n, 3, 3), read-only: the same for every fruit."""
    rotations = np.array(
        [pre_grasp_orientation(theta, alpha) for theta, alpha in sphere.attempts()]
    )
    rotations.setflags(write=False)
    return rotations
