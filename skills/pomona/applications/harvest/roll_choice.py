"""The rolls by which a fruit may be detached: reached by the arm, clear of neighbours, the freest way first."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pomona.executive import Float64
from pomona.skills.perception import AllDetections, MeasuredFruit

ROLL_NEEDED = np.radians(60.0)
"""Least roll that the arm must reach one way before the fruit is gripped: stems broke at 57° to 100°."""
ROLL_WANTED = np.radians(100.0)
"""A roll that is free so far is as good as a longer one."""
CLEAR = -0.01
"""Least distance to a neighbour during the roll [m]; a hanging neighbour gives way by 10 mm."""
HAND_POINTS = np.array(
    [[0.0, side, z] for side in (-1.0, 1.0) for z in (0.0, -0.025, -0.05, -0.075)]
)
"""Points along both fingers in the TCP's frame: y in half openings, z in metres."""
FINGER_BESIDE, FINGER_RADIUS = 0.0075, 0.013
"""Distance of a finger's middle from its pad's face, and radius that encloses its section [m]."""


def roll_clearance(
    T_base_grasp: Float64, roll: float, width: float, p_base_knuckle: Float64, neighbours: Float64
) -> float:
    """Return the least distance between fingers and neighbours while the hand rolls about the knuckle [m].

    Args:
        T_base_grasp: of the TCP, shape (4, 4).
        roll: angle about the approach [rad].
        width: opening [m].
        p_base_knuckle: where the stem sits on its spur, shape (3,) [m].
        neighbours: positions and radii in the base frame, shape (n, 4) [m]. Negative distances are overlaps.
    """
    if not len(neighbours):
        return float("inf")
    scale = np.array([1.0, width / 2.0 + FINGER_BESIDE, 1.0])
    points = (HAND_POINTS * scale) @ T_base_grasp[:3, :3].T + T_base_grasp[:3, 3] - p_base_knuckle
    axis = T_base_grasp[:3, 2]
    least = np.inf
    for share in np.linspace(0.0, 1.0, 9):
        c, s = np.cos(share * roll), np.sin(share * roll)
        turned = (
            points * c
            + np.cross(axis, points) * s
            + np.outer(points @ axis, axis) * (1.0 - c)
            + p_base_knuckle
        )
        apart = (
            np.linalg.norm(turned[:, None] - neighbours[None, :, :3], axis=2)
            - neighbours[None, :, 3]
        )
        least = min(least, float(apart.min()) - FINGER_RADIUS)
    return least


def neighbours_of(target: MeasuredFruit, others: AllDetections | None) -> Float64:
    """Return positions and radii of the other fruit of a look in the base frame, shape (n, 4) [m]."""
    if others is None:
        return np.zeros((0, 4))
    rows = []
    for each in others.detections:
        p = (each.T_base_camera @ each.T_camera_object)[:3, 3]
        if np.linalg.norm(p - target.T_base_fruit[:3, 3]) > float(target.dimensions.max()) / 2.0:
            rows.append([*p, float(each.fruit.dimensions.max()) / 2.0])
    return np.array(rows).reshape(-1, 4)


def ordered(free: Mapping[float, float], clear: Mapping[float, float]) -> tuple[float, ...]:
    """Return the rolls to try one after the other, the freest first, then the one further from neighbours.

    Args:
        free: signed rolls [rad], and how far each is free of obstacles [rad].
        clear: and the least distance to a neighbour in each [m].
    """
    far = [roll for roll in free if free[roll] >= ROLL_NEEDED] or list(free)
    return tuple(
        sorted(far, key=lambda roll: (-min(free[roll], ROLL_WANTED), -min(clear[roll], 0.03)))
    )
