"""The skill Release."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Arm, ForceSensor, Gripper, Workspace
from executive.ports import FORCE, LENGTH, SPEED, Port, Ports, optional
from executive.skill import Work
from skills.approach.straight_line import straight_line
from skills.motion import MOTION_FAILURES, MovingSkill, Watching
from skills.move_to.moving import POSE_FAILURES, move_to_pose
from skills.occupancy import OccupancyMap
from skills.plan.timing import time_curve
from skills.plan.warm import prepare_planning
from skills.robot import RobotModel
from skills.sample_grasp.grasp import Grasp
from skills.slip_avoid_grasp.grip_view import show_grip
from skills.slip_avoid_grasp.hold import Hold, current_hold, take_over
from skills.touch import Touch, load, something_between

Float64 = NDArray[np.float64]

ACCELERATION, JERK = 0.5, 5.0
"""Of lowering and rising [m/s², m/s³]."""
OPENING_SPEED = 0.03
"""Of the opening while the fruit is let go [m/s]."""
LET_GO = 0.02
"""How much wider than the fruit the fingers open before they rise [m]."""


class _Grounded(Exception):
    """The fruit touched something below."""


class Release(MovingSkill):
    """Put a held fruit down: lower it until it touches, open gently, rise again.

    The fingers open only after the fruit has met something that carries it. When it meets nothing within `depth`, the
    fruit stays held and the skill fails: nothing is dropped.
    """

    inputs = Ports(
        into=optional(str, "a pose of the cell file to go to first, above where the fruit is put"),
        depth=Port(LENGTH, default="150 mm", min="1 mm", help="how far down to look for something that carries it"),
        grasp=optional(Grasp, "the grasp by which the fruit is held: it is then part of the robot on the way"),
        hold=optional(Hold, "the grip that goes on until the fruit is let go"),
        map=optional(OccupancyMap, "what is in the way"),
        contact=Port(FORCE, default="0.35 N", min="0.1 N", help="change of load that says the fruit is carried"),
        speed=Port(SPEED, default="0.06 m/s", min="1 mm/s", max="0.3 m/s", help="of lowering"),
    )
    devices = (Arm, Gripper, ForceSensor, Workspace)
    failures = (*MOTION_FAILURES, *POSE_FAILURES, "NOT_HELD", "NO_CONTACT", "NO_WAY_DOWN")

    def prepare(self) -> None:
        prepare_planning(self)

    def run(  # type: ignore[override]
        self,
        into: str | None,
        depth: float,
        grasp: Grasp | None,
        hold: Hold | None,
        map: OccupancyMap | None,
        contact: float,
        speed: float,
    ) -> Work:
        if not self._held():
            raise self.failure("NOT_HELD", "there is nothing between the fingers to put down")
        if into is not None:
            yield from move_to_pose(self, into, map=map, carrying=grasp)
        before = self._tcp()[2, 3]
        yield from self._lower(depth, hold, contact, speed)
        gripper = self.device(Gripper)
        take_over(gripper)
        width = min(gripper.state().width + LET_GO, gripper.limits.width_max)
        yield from self.move_fingers(width, min(OPENING_SPEED, gripper.limits.speed_max))
        yield from self._vertically(before - self._tcp()[2, 3], 2.0 * speed)
        return {}

    def _held(self) -> bool:
        hold = current_hold(self.device(Gripper))
        if hold is not None:
            return hold.holds
        return something_between(self.device(Gripper), self.device(ForceSensor))

    def _lower(self, depth: float, hold: Hold | None, contact: float, speed: float) -> Watching:
        """Straight down until the load on the pads changes: something else carries the fruit."""
        before = float(self._tcp()[2, 3])
        with Touch(self.device(ForceSensor), load) as touch:

            def watch() -> None:
                if hold is not None:
                    show_grip(self, hold)
                if not self._held():
                    raise self.failure("NOT_HELD", "the fruit was lost on the way down")
                if touch.change > contact:
                    raise _Grounded

            try:
                yield from self._vertically(-depth, speed, watch)
            except _Grounded:
                return
        lowered = before - float(self._tcp()[2, 3])
        raise self.failure(
            "NO_CONTACT", f"the fruit met nothing within {1e3 * lowered:.0f} mm and is still held", lowered_m=lowered
        )

    def _vertically(self, way: float, speed: float, watch: Callable[[], None] | None = None) -> Watching:
        """Move the gripper up (or down, for a negative way), as far as the arm reaches."""
        arm = self.device(Arm)
        robot = RobotModel.load(arm.description)
        T_base_goal = self._tcp()
        T_base_goal[2, 3] += way
        line = straight_line(robot, arm.state().q, T_base_goal)
        length = line.reached * line.length
        if len(line.q) < 4:
            raise self.failure("NO_WAY_DOWN", f"the gripper cannot move vertically: {line.reason}")
        yield from self.travel(time_curve(line.q, length, arm.limits, speed, ACCELERATION, JERK), watch)

    def _tcp(self) -> Float64:
        arm = self.device(Arm)
        return RobotModel.load(arm.description).tcp(arm.state().q)
