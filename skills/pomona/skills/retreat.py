"""The skill Retreat."""

from __future__ import annotations

from contextlib import suppress
from enum import Enum
from typing import Annotated, ClassVar

import numpy as np

from pomona.drivers.interfaces import Arm, Gripper, Workspace
from pomona.executive.ports import Port
from pomona.executive.skill import SkillFailure, Work
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import angle_between, inverse
from pomona.skills.grip.hold import take_over
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.lines import StraightLine
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.shared.carrying import JERK_TIME, TouchedDown, lower_until_contact
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from pomona.skills.shared.held_fruit import HAND_DEVICES, is_between, is_held
from pomona.skills.shared.live_watch import KnownAround
from pomona.skills.shared.planning import space_around
from pomona.skills.shared.straight_travel import free_line, tool_pose
from pomona.skills.shared.touch import felt, load
from pomona.skills.shared.yielding import YieldingFingers

LATERAL_TOLERANCE = 0.015
"""How far from the approach line, or from the vertical above the grasp, the TCP still counts as on it [m]."""
TILT_TOLERANCE = 0.2  # how far the gripper may be turned out of the grasp's orientation [rad]
SUPPORTED = 3e-3  # a fruit that is held this little above where it was taken still stands on its support [m]
OPENING_SPEED = 0.05  # of the fingers [m/s]
AT_GOAL = 5e-3
"""Distance below which the tool is back at the pre-grasp [m]."""


BACK = 0.15  # speed of the tool [m/s]
BRISK = 1.0  # its acceleration [m/s²]
CONTACT = 0.8  # change of force that shows contact [N]


class StoppedAt(Enum):
    """Where an attempt has stopped."""

    ELSEWHERE = "not near the grasp"
    ON_APPROACH = "between pre-grasp and grasp"
    ABOVE = "lifted above the grasp"


class Retreat(MovingSkill):
    """Back off from a failed attempt: put a lifted fruit down, open, go straight back to the pre-grasp.

    Safe from any point where an attempt can fail. The fingers open only where the fruit is supported: a lifted fruit is
    first lowered along the line on which it came up. Nothing is held and nothing is near: nothing moves. The paths back
    are those of the attempt; they are still checked against fixed obstacles and the arm itself, and start only while the
    cameras show nothing new near them.
    """

    devices = (Arm, Gripper, Workspace)
    optional_devices = (*MovingSkill.optional_devices, *HAND_DEVICES)
    moves = (Arm, Gripper)
    failures = (*MOTION_FAILURES, "RETREAT_BLOCKED")
    renamed_failures: ClassVar = {"NO_WAY_BACK": "RETREAT_BLOCKED"}

    def run(
        self,
        grasp: Annotated[Grasp | None, Port(help="the grasp that was attempted")] = None,
    ) -> Work[None]:
        if grasp is None:
            return
        arm = self.device(Arm)
        gripper = self.device(Gripper)
        place, height = where(tool_pose(self), grasp)
        held = is_held(self) or is_between(self)
        if place is StoppedAt.ELSEWHERE or (place is StoppedAt.ABOVE and not held):
            return
        if held and height > SUPPORTED:
            yield from self._lower(height)
        open_to = min(max(grasp.width, gripper.state().width), gripper.limits.width_max)
        take_over(gripper)
        if open_to - gripper.state().width > 1e-3:
            yield from self._open(open_to, held)
        back = self._line(grasp.T_base_pre_grasp)
        if back.length > AT_GOAL:
            jerk = BRISK / JERK_TIME
            curve = time_curve(back.q, back.length, arm.limits, BACK, BRISK, jerk)
            yield from self.travel(
                curve,
                around=KnownAround(fruit=(grasp.fruit,)),
                each_tick=YieldingFingers(gripper).rest,
                wary=True,
            )

    def _open(self, width: float, held: bool) -> Watching:
        """Open the fingers; empty ones may be blocked from outside: the way back frees them."""
        try:
            yield from self.move_fingers(
                width, min(OPENING_SPEED, self.device(Gripper).limits.speed_max)
            )
        except SkillFailure as failed:
            if held or failed.failure.code != "MOTION_FAILED":
                raise

    def _lower(self, height: float) -> Watching:
        """Go straight down by the height to which the fruit was lifted, or until it stands on something."""
        T_base_goal = tool_pose(self)
        T_base_goal[2, 3] -= height
        line = self._line(T_base_goal)
        with felt(self, load) as touch:
            limit = touch.limit(CONTACT, BRISK)

            def watch() -> None:
                if touch.change > limit:
                    take_over(
                        self.device(Gripper)
                    )  # force control would answer the push by pressing harder
                    raise TouchedDown

            with suppress(TouchedDown):
                yield from lower_until_contact(self, line, BACK, BRISK, watch)

    def _line(self, T_base_goal: Float64) -> StraightLine:
        """Return the straight line to a pose of the tool; fails with RETREAT_BLOCKED, and then nothing has moved."""
        return free_line(
            self,
            T_base_goal,
            space_around(self, None, 0.0).leaving_table(),
            ("RETREAT_BLOCKED", "RETREAT_BLOCKED"),
            "on the way back",
        )


def where(T_base_tcp: Float64, grasp: Grasp) -> tuple[StoppedAt, float]:
    """Return where an attempt has stopped, and how high above the grasp the TCP is [m]."""
    T_grasp_tcp = inverse(grasp.T_base_grasp) @ T_base_tcp
    reach = float(np.linalg.norm(grasp.T_base_pre_grasp[:3, 3] - grasp.T_base_grasp[:3, 3]))
    height = float(T_base_tcp[2, 3] - grasp.T_base_grasp[2, 3])
    angle = angle_between(grasp.T_base_grasp[:3, :3], T_base_tcp[:3, :3])
    if angle > TILT_TOLERANCE:
        return StoppedAt.ELSEWHERE, height
    back = -T_grasp_tcp[2, 3]
    beside = float(np.linalg.norm(T_grasp_tcp[:2, 3]))
    if beside < LATERAL_TOLERANCE and -LATERAL_TOLERANCE < back < reach + LATERAL_TOLERANCE:
        return StoppedAt.ON_APPROACH, height
    if (
        np.linalg.norm(T_base_tcp[:2, 3] - grasp.T_base_grasp[:2, 3]) < LATERAL_TOLERANCE
        and height > 0.0
    ):
        return StoppedAt.ABOVE, height
    return StoppedAt.ELSEWHERE, height
