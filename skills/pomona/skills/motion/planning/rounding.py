"""A timed motion along a free polyline whose rounded corners are free too."""

from __future__ import annotations

import numpy as np

from pomona.drivers.interfaces import ArmLimits, Trajectory
from pomona.executive.values.arrays import Float64
from pomona.skills.motion.planning.errors import PlanningFailed
from pomona.skills.motion.planning.space import Space
from pomona.skills.motion.planning.timing import time_polyline

_SHARPER = {0.0: 0.35, 0.35: 0.7, 0.7: 1.0}


def time_free_path(space: Space, waypoints: Float64, limits: ArmLimits) -> Trajectory:
    """Time a free polyline, shape (n, dof) [rad]; corners that would touch an obstacle are rounded less.

    A corner at which the motion rests follows the polyline exactly, so this ends with a free motion.

    Raises:
        PlanningFailed: NO_PATH: the polyline itself is not free.
    """
    dwells = np.zeros(len(waypoints))
    while True:
        trajectory = time_polyline(waypoints, limits, dwells)
        blocked = space.first_blocked(trajectory.q)
        if blocked is None:
            return trajectory
        corners = [k for k in range(1, len(waypoints) - 1) if dwells[k] < 1.0]
        if not corners:
            raise PlanningFailed("NO_PATH", "the path touches an obstacle between its waypoints")
        near = min(corners, key=lambda k: float(np.linalg.norm(waypoints[k] - trajectory.q[blocked])))
        dwells[near] = _SHARPER[float(dwells[near])]
