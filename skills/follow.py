"""The skill Follow."""

from __future__ import annotations

import numpy as np

from drivers.errors import BadTrajectory
from drivers.interfaces import Arm, Trajectory
from drivers.trajectory import check_trajectory
from executive.skill import Work
from skills.shared.following import MOTION_FAILURES, MovingSkill

START_TOLERANCE = 0.02
"""How far a joint may stand from the path's start [rad]."""


class Follow(MovingSkill):
    """Carry out a planned path.

    Interrupted, the arm stops on its path within its deceleration limits, and stays there.
    """

    devices = (Arm,)
    failures = (*MOTION_FAILURES, "BAD_PATH", "NOT_AT_START")

    def run(
        self,
        path: Trajectory,
    ) -> Work[None]:
        arm = self.device(Arm)
        try:
            check_trajectory(path, arm.limits)
        except BadTrajectory as bad:
            raise self.failure("BAD_PATH", f"{bad}; nothing has moved") from bad
        away = np.abs(arm.state().q - path.q[0])
        if away.max() > START_TOLERANCE:
            joint = int(away.argmax())
            raise self.failure(
                "NOT_AT_START",
                f"joint {joint + 1} stands {np.degrees(away[joint]):.1f}° from the start of the path: plan again",
                joint=joint + 1,
                distance_rad=float(away[joint]),
            )
        yield from self.travel(path)
        return None
