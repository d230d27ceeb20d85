"""The common part of both manoeuvres: a hand over a fruit that feels its way down, across and up again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pomona.drivers import Arm, ForceSensor, Gripper, Motion
from pomona.executive import Float64, SkillFailure, Work
from pomona.skills import MOTION_FAILURES, Manner, MovingSkill, Touch, follow_way, tool_pose, vertical_way
from pomona.skills.grip import take_over
from pomona.skills.motion import Grasp, RobotModel, straight_line

START, START_ANGLE = 0.01, 0.1
"""How far the TCP may stand from the place over the fruit [m, rad]."""
OPEN = 1e-3
"""Deviation of the opening that is none [m]."""
PUSHED = 2e-3
"""Motion of the resting fingers that shows a push [m]; a gripper's supervisor allows 3 mm."""
REST = 0.15
"""Time after a motion of the fingers until the motor's force shows rest [s]: it brakes them."""
PRESSED = 2.0
"""Force of the motor of resting fingers that shows something at them before a motion [N]."""
UP = Manner(0.10, 1.0, 10.0)

FEELING_FAILURES = (*MOTION_FAILURES, "NOT_AT_PRE_GRASP", "NO_STRAIGHT_LINE", "CONTACT", "SENSOR_STALE")


class OuterFaces:
    """Pushes on the resting fingers, by the gripper's motor and width: outer faces have no sensor of their own."""

    def __init__(self, gripper: Gripper) -> None:
        self._gripper, state = gripper, gripper.state()
        self._opened, self._resting = state.width, state.motor_force or 0.0

    @property
    def moved(self) -> float:
        """How far the fingers were pushed [m]."""
        return abs(self._gripper.state().width - self._opened)

    @property
    def force(self) -> float:
        """Force that pushes the fingers together [N]; 0 where the gripper does not report its motor's."""
        now = self._gripper.state().motor_force
        return 0.0 if now is None else max(self._resting - now, 0.0)

    def pushed(self, limit: float) -> bool:
        """Return True if a force [N], or a motion of the fingers, shows a push."""
        return self.force > limit or self.moved > PUSHED


class ManoeuvreHand(NamedTuple):
    """The senses of a manoeuvre."""

    pads: Touch
    outer: OuterFaces


class _Pushed(Exception):
    """Something pushes the fingers from outside."""


class FeelingSkill(MovingSkill):
    """A skill that begins over a fruit and feels with pads, motor and width; its failures: `FEELING_FAILURES`."""

    def stand_over(self, grasp: Grasp) -> Work[Float64]:
        """Require the hand at the pre-grasp, open the fingers as the grasp needs them, and return T_base_tcp, (4, 4).

        Raises SkillFailure: NOT_AT_PRE_GRASP; CONTACT, if something keeps the fingers from it or pushes them; the arm
        has not moved.
        """
        gripper, pose = self.device(Gripper), tool_pose(self)
        apart = float(np.linalg.norm(pose[:3, 3] - grasp.T_base_pre_grasp[:3, 3]))
        cosine = (float(np.trace(pose[:3, :3].T @ grasp.T_base_pre_grasp[:3, :3])) - 1.0) / 2.0
        angle = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        if apart > START or angle > START_ANGLE:
            words = (
                f"the gripper stands {1e3 * apart:.0f} mm and {np.degrees(angle):.0f}° from the place over the fruit"
            )
            raise self.failure("NOT_AT_PRE_GRASP", f"{words}: follow a path to it first")
        width = min(grasp.width, gripper.limits.width_max)
        if abs(gripper.state().width - width) > OPEN:
            take_over(gripper)
            try:
                yield from self.move_fingers(width, gripper.limits.speed_max)
            except SkillFailure as failed:
                if failed.failure.code != "MOTION_FAILED":
                    raise
                raise self.failure("CONTACT", f"over the fruit {failed.failure.message}") from failed
            yield from self.wait(REST)
        force = gripper.state().motor_force or 0.0
        if abs(force) > PRESSED:
            words = f"something pushes the fingers with {abs(force):.1f} N over the fruit; the arm has not moved"
            raise self.failure("CONTACT", words, force_n=force)
        return pose

    def feel_way(self, way: Float64, manner: Manner, hand: ManoeuvreHand, pads: float, outer: float) -> Work[bool]:
        """Follow a way until a pad's force has changed, or the outer faces are pushed, by a limit [N]; return True.

        Raises SkillFailure: SENSOR_STALE, or a failure of the motion.
        """

        def look() -> None:
            self.require_fresh(hand)
            if hand.outer.pushed(outer):
                raise _Pushed

        def stop_at_touch(motion: Motion) -> None:
            hand.pads.at_change(pads, motion.stop)

        if hand.pads.change > pads or hand.outer.pushed(outer):
            return True
        try:
            yield from follow_way(self, way, manner, look, started=stop_at_touch)
        except _Pushed:
            return True
        except SkillFailure as failed:
            if failed.failure.code != "STOPPED" or hand.pads.change <= pads:
                raise
            return True
        return False

    def require_fresh(self, hand: ManoeuvreHand) -> None:
        """Raise SkillFailure SENSOR_STALE if the fingers feel nothing any more."""
        if stale := hand.pads.stale_for(self.clock.now()):
            raise self.failure("SENSOR_STALE", f"the fingers have sent no force for {1e3 * stale:.0f} ms")

    def hand(self) -> ManoeuvreHand:
        """Return the senses; use `pads` as a context manager."""
        return ManoeuvreHand(Touch(self.device(ForceSensor)), OuterFaces(self.device(Gripper)))

    def line_to(self, p_goal: Float64) -> Float64:
        """Return postures straight to a place of the tool, shape (3,) [m] -> (n, dof) [rad]."""
        return straight_to(self, p_goal)

    def rise_to(self, before: Float64) -> Work[None]:
        """Go straight up to the height of a pose, shape (4, 4)."""
        rise = float(before[2, 3] - tool_pose(self)[2, 3])
        if rise > 1e-4:
            yield from follow_way(self, vertical_way(self, rise, "NO_STRAIGHT_LINE"), UP)


def straight_to(skill: MovingSkill, p_goal: Float64) -> Float64:
    """Return postures straight to a place of the tool, shape (3,) [m] -> (n, dof) [rad].

    Raises SkillFailure: NO_STRAIGHT_LINE; nothing has moved.
    """
    arm, goal = skill.device(Arm), tool_pose(skill)
    goal[:3, 3] = p_goal
    line = straight_line(RobotModel.load(arm.description), arm.state().q, goal)
    if not line.complete:
        raise skill.failure("NO_STRAIGHT_LINE", f"the way cannot be followed: {line.reason}")
    return line.q
