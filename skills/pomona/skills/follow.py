"""The skill Follow."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.drivers.errors import BadTrajectory
from pomona.drivers.interfaces import Arm, Trajectory
from pomona.drivers.trajectory import check_trajectory
from pomona.executive.ports import Port
from pomona.executive.skill import Work
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill
from pomona.skills.shared.live_watch import KnownAround

START_TOLERANCE = 0.02  # how far a joint may stand from the path's start [rad]


class Follow(MovingSkill):
    """Carry out a planned path.

    Interrupted, the arm stops on its path within its deceleration limits, and stays there. It does so, too, when a
    camera sees something new in the way (a cell file with `workspace.watch`), and fails with PATH_BLOCKED.
    """

    devices = (Arm,)
    failures = (*MOTION_FAILURES, "BAD_PATH", "NOT_AT_START")

    def run(
        self,
        path: Trajectory,
        map: Annotated[
            OccupancyMap | None,
            Port(help="known obstacles; the watched path does not report them as new"),
        ] = None,
        grasp: Annotated[Grasp | None, Port(help="grasp of a fruit that is known, too")] = None,
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
        yield from self.travel(
            path, around=KnownAround(map, () if grasp is None else (grasp.fruit,))
        )
