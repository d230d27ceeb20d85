"""The skill OpenFingers."""

from __future__ import annotations

from typing import Annotated

from pomona.drivers.interfaces import Arm, Gripper, Trajectory, Workspace
from pomona.executive.ports import LENGTH, Port
from pomona.executive.skill import Work
from pomona.skills.grip.hold import take_over
from pomona.skills.motion.grasp import Grasp
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill
from pomona.skills.shared.planning import Clearance, OtherObstacles, space_around


class OpenFingers(MovingSkill):
    """Open the fingers for a grasp while the arm follows a path, as a child of a `parallel` beside `Follow`.

    The path was planned with the fingers as they were: where it is too narrow for open ones nothing is done, and
    `Approach` opens them at the pre-grasp.
    """

    devices = (Arm, Gripper, Workspace)
    moves = (Gripper,)
    failures = (*MOTION_FAILURES, "MAP_STALE")

    def run(
        self,
        grasp: Grasp,
        path: Annotated[Trajectory, Port(help="path that the arm follows at the same time")],
        map: OtherObstacles = None,
        clearance: Clearance = LENGTH("5 mm"),
    ) -> Work[None]:
        gripper = self.device(Gripper)
        width = min(grasp.width, gripper.limits.width_max)
        if (
            abs(gripper.state().width - width) <= 1e-3
        ):  # an opening that differs by less is the one asked for [m]
            return
        space = space_around(self, map, clearance, width, grasp.fruit)
        blocked = space.first_blocked(path.q)
        if blocked is not None:
            yield f"not on the way: with open fingers {space.explain(path.q[blocked + 1])[0]}"
            return
        take_over(gripper)
        yield from self.move_fingers(width, gripper.limits.speed_max)
