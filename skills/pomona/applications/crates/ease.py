"""The skill Ease."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.applications.crates.feeling import straight_to
from pomona.drivers import Arm, Gripper, Workspace
from pomona.executive import LENGTH, Length, Outputs, Port, Work
from pomona.skills import MOTION_FAILURES, Manner, MovingSkill, follow_way, prepare_moving, show_grip, tool_pose
from pomona.skills.grip import Hold
from pomona.skills.motion import Grasp

GENTLE = Manner(0.02, 0.3, 10.0)
"""Way of the hand with the fruit."""
EVEN = 0.4
"""Difference of the pads' forces that is none [N]; the fingers' errors are 0.1 N."""
COMPLIANCE, LONGEST = 1e-3, 1.5e-3
"""Way of a step per difference [m/N], and the longest step [m]."""
STEPS = 8
"""Steps at most."""
SETTLE = 0.1
"""Time after a step until the forces are read [s]."""


class Eased(Outputs):
    """Outputs of Ease."""

    shifted: Annotated[Length, Port(help="way of the hand along its sliding direction")]


class Ease(MovingSkill):
    """Shift a gripped fruit along the fingers until both pads press alike: it then leans on no wall and no neighbour.

    A fruit that leans is pressed harder the more it rubs on its way up: the grip's force follows its load.
    """

    devices = (Arm, Gripper, Workspace)
    moves = (Arm,)
    failures = (*MOTION_FAILURES, "NO_STRAIGHT_LINE")

    def prepare(self) -> None:
        prepare_moving(self)

    def run(
        self,
        hold: Annotated[Hold, Port(help="the grip, which goes on")],
        grasp: Annotated[Grasp, Port(help="the grasp by which the fruit is held")],
        most: Annotated[Length, Port(min="1 mm", max="15 mm", help="largest way")] = LENGTH("6 mm"),
    ) -> Work[Eased]:
        begin = tool_pose(self)
        shifted = 0.0
        for _ in range(STEPS):
            yield from self.wait(SETTLE)
            show_grip(self, hold)
            leans = hold.estimate.left - hold.estimate.right  # pushes the hand along its y axis [N]
            step = float(np.clip(COMPLIANCE * leans, -LONGEST, LONGEST))
            if abs(leans) < EVEN or abs(shifted + step) > most:
                break
            shifted += step
            way = straight_to(self, begin[:3, 3] + shifted * begin[:3, 1])
            yield from follow_way(self, way, GENTLE, held=grasp)
        return Eased(abs(shifted))
