"""The skill Retreat."""

from __future__ import annotations

from enum import Enum
from typing import Annotated, ClassVar

import numpy as np

from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, Trajectory, Workspace
from pomona.executive.ports import ACCELERATION, FORCE, SPEED, Acceleration, Force, Port, Speed
from pomona.executive.skill import Work
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import angle_between, inverse
from pomona.skills.grip.hold import current_hold, take_over
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.straight_line import straight_line
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from pomona.skills.shared.setting_down import GENTLE, NEAR, SETTING_DOWN, TouchedDown, set_down
from pomona.skills.shared.touch import Touch, load, something_between
from pomona.skills.shared.warm_motion import prepare_moving

LATERAL_TOLERANCE = 0.015
"""How far from the approach line, or from the vertical above the grasp, the TCP still counts as on it [m]."""
TILT_TOLERANCE = 0.2
"""How far the gripper may be turned out of the grasp's orientation [rad]."""
SUPPORTED = 3e-3
"""A fruit that is held this little above where it was taken still stands on its support [m]."""
OPENING_SPEED = 0.05
JERK_TIME = 0.1


class StoppedAt(Enum):
    """Where an attempt has stopped."""

    ELSEWHERE = "not near the grasp"
    ON_APPROACH = "between pre-grasp and grasp"
    ABOVE = "lifted above the grasp"


class Retreat(MovingSkill):
    """Back off from a failed attempt: put a lifted fruit down, open, go straight back to the pre-grasp.

    Safe from any point where an attempt can fail. The fingers open only where the fruit is supported: a lifted fruit is
    first lowered along the line on which it came up. Nothing is held and nothing is near: nothing moves. The ways back
    are the ways that the attempt came; all the same they are checked against what is fixed and the arm itself.
    """

    devices = (Arm, Gripper, ForceSensor, Workspace)
    moves = (Arm, Gripper)
    failures = (*MOTION_FAILURES, "RETREAT_BLOCKED")
    renamed_failures: ClassVar = {"NO_WAY_BACK": "RETREAT_BLOCKED"}

    def prepare(self) -> None:
        prepare_moving(self)

    def run(
        self,
        grasp: Annotated[Grasp | None, Port(help="the grasp that was attempted")] = None,
        speed: Annotated[Speed, Port(min="1 mm/s", max="0.5 m/s")] = SPEED("0.15 m/s"),
        acceleration: Annotated[Acceleration, Port(min="0.01 m/s²", max="3 m/s²")] = ACCELERATION("1 m/s²"),
        contact: Annotated[Force, Port(min="0.2 N", help="change of force that shows contact")] = FORCE("0.8 N"),
    ) -> Work[None]:
        if grasp is None:
            return None
        arm, gripper = self.device(Arm), self.device(Gripper)
        robot = RobotModel.load(arm.description)
        place, height = where(robot.tcp(arm.state().q), grasp)
        held = self._held()
        if place is StoppedAt.ELSEWHERE or (place is StoppedAt.ABOVE and not held):
            return None
        if held and height > SUPPORTED:
            yield from self._lower(robot, height, speed, acceleration, contact)
        open_to = min(max(grasp.width, gripper.state().width), gripper.limits.width_max)
        take_over(gripper)
        if open_to - gripper.state().width > 1e-3:
            yield from self.move_fingers(open_to, min(OPENING_SPEED, gripper.limits.speed_max))
        back = self._line(robot, grasp.T_base_pre_grasp, speed, acceleration)
        if back is not None:
            yield from self.travel(back)
        return None

    def _held(self) -> bool:
        hold = current_hold(self.device(Gripper))
        if hold is not None and hold.holds:
            return True
        return something_between(self.device(Gripper), self.device(ForceSensor))

    def _lower(self, robot: RobotModel, height: float, speed: float, acceleration: float, contact: float) -> Watching:
        """Straight down by the height to which the fruit was lifted, or until it stands on something."""
        T_base_goal = robot.tcp(self.device(Arm).state().q)
        T_base_goal[2, 3] -= height
        self._line(robot, T_base_goal, speed, acceleration)  # all of it is free, or nothing moves
        T_base_near = T_base_goal.copy()
        T_base_near[2, 3] += min(NEAR, height)
        with Touch(self.device(ForceSensor), load) as touch:

            def watch() -> None:
                if touch.change > contact:
                    take_over(self.device(Gripper))  # or the grip answers what carries the fruit by pressing harder
                    raise TouchedDown

            try:
                quickly = self._line(robot, T_base_near, speed, acceleration)
                if quickly is not None:
                    yield from self.travel(quickly, watch)
                gently = self._line(robot, T_base_goal, SETTING_DOWN, GENTLE)
                if gently is not None:
                    yield from set_down(self, gently)
            except TouchedDown:
                return

    def _line(self, robot: RobotModel, T_base_goal: Float64, speed: float, acceleration: float) -> Trajectory | None:
        """The straight way to a pose of the tool; None where it is there already.

        Raises:
            SkillFailure: RETREAT_BLOCKED; nothing has moved.
        """
        arm = self.device(Arm)
        line = straight_line(robot, arm.state().q, T_base_goal)
        if not line.complete:
            raise self.failure(
                "RETREAT_BLOCKED",
                f"{line.reason} after {1e3 * line.reached * line.length:.0f} of {1e3 * line.length:.0f} mm",
                reached_m=line.reached * line.length,
            )
        space = arm_space(arm, self.device(Workspace), None, self.device(Gripper).state().width, 0.0).leaving_table()
        blocked = space.first_blocked(line.q)
        if blocked is not None:
            reason, found = space.explain(line.q[blocked + 1])
            raise self.failure("RETREAT_BLOCKED", f"on the way back {reason}", **found)
        if line.length <= 1e-4:
            return None
        return time_curve(line.q, line.length, arm.limits, speed, acceleration, acceleration / JERK_TIME)


def where(T_base_tcp: Float64, grasp: Grasp) -> tuple[StoppedAt, float]:
    """Where an attempt has stopped, and how high above the grasp the TCP is [m].

    Args:
        T_base_tcp: where the TCP is.
        grasp: that was attempted.
    """
    T_grasp_tcp = inverse(grasp.T_base_grasp) @ T_base_tcp
    reach = float(np.linalg.norm(grasp.T_base_pre_grasp[:3, 3] - grasp.T_base_grasp[:3, 3]))
    height = float(T_base_tcp[2, 3] - grasp.T_base_grasp[2, 3])
    angle = angle_between(grasp.T_base_grasp[:3, :3], T_base_tcp[:3, :3])
    if angle > TILT_TOLERANCE:
        return StoppedAt.ELSEWHERE, height
    back, beside = -T_grasp_tcp[2, 3], float(np.linalg.norm(T_grasp_tcp[:2, 3]))
    if beside < LATERAL_TOLERANCE and -LATERAL_TOLERANCE < back < reach + LATERAL_TOLERANCE:
        return StoppedAt.ON_APPROACH, height
    if np.linalg.norm(T_base_tcp[:2, 3] - grasp.T_base_grasp[:2, 3]) < LATERAL_TOLERANCE and height > 0.0:
        return StoppedAt.ABOVE, height
    return StoppedAt.ELSEWHERE, height
