"""The skill Approach."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.drivers.interfaces import (
    Arm,
    ForceSensor,
    Gripper,
    LoadSensor,
    Motion,
    PressSensor,
    Workspace,
)
from pomona.executive.ports import (
    ACCELERATION,
    FORCE,
    LENGTH,
    SPEED,
    Force,
    Length,
    Port,
    Speed,
)
from pomona.executive.skill import SkillFailure, Work
from pomona.executive.views import Line3, SceneView
from pomona.skills.geometry import angle_between
from pomona.skills.grip.hold import take_over
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.grasps.gripper_shape import gripper_shape
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.motion.robot import RobotModel
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from pomona.skills.shared.live_watch import KnownAround
from pomona.skills.shared.planning import Clearance, OtherObstacles, ToolAcceleration, space_around
from pomona.skills.shared.straight_travel import free_line, tool_pose
from pomona.skills.shared.touch import SINKS, Touch, felt, hand_felt, landing_speeds
from pomona.skills.shared.touch_view import record_landing
from pomona.skills.shared.yielding import YieldingFingers

# how far the TCP may stand from the pre-grasp [m, rad]
START_DISTANCE = 0.01
START_ANGLE = 0.1

WIDTH_TOLERANCE = 1e-3
JERK_TIME = 0.1
PUSHED = 2e-3
"""Motion of the resting fingers that shows contact outside the pads [m]; a gripper's supervisor allows 3 mm."""


class Approach(MovingSkill):
    """Open the fingers, then go straight from the pre-grasp to the grasp, feeling the way.

    Any lasting change of force stops the arm, at a finger or, without force fingers, at the hand. So does a push that
    moves the fingers: nothing is to be touched before they close.
    """

    devices = (Arm, Gripper, Workspace)
    optional_devices = (*MovingSkill.optional_devices, ForceSensor, PressSensor, LoadSensor)
    moves = (Arm, Gripper)
    failures = (
        *MOTION_FAILURES,
        "NOT_AT_PRE_GRASP",
        "NO_STRAIGHT_LINE",
        "IN_COLLISION",
        "CONTACT",
        "SENSOR_STALE",
        "MAP_STALE",
    )

    def run(
        self,
        grasp: Grasp,
        map: OtherObstacles = None,
        speed: Annotated[Speed, Port(min="1 mm/s", max="1 m/s")] = SPEED("0.25 m/s"),
        acceleration: ToolAcceleration = ACCELERATION("1 m/s²"),
        contact: Annotated[
            Force, Port(min="0.3 N", help="change of force that counts as a touch")
        ] = FORCE("1.5 N"),
        clearance: Clearance = LENGTH("5 mm"),
        unseen: Annotated[
            Length,
            Port(
                min="1 mm",
                max="100 mm",
                help="by which fruit may lie aside of its place: slow above skin there",
            ),
        ] = LENGTH("18 mm"),
    ) -> Work[None]:
        arm = self.device(Arm)
        gripper = self.device(Gripper)
        robot = RobotModel.load(arm.description)
        self._require_pre_grasp(tool_pose(self), grasp)
        width = min(grasp.width, gripper.limits.width_max)
        space = space_around(self, map, clearance, width, grasp.fruit)
        line = free_line(
            self,
            grasp.T_base_grasp,
            space,
            ("NO_STRAIGHT_LINE", "IN_COLLISION"),
            "on the approach",
            candidate=grasp.index,
        )
        tcp_line = np.array([robot.tcp(state)[:3, 3] for state in line.q])
        self.publish("approach", SceneView(lines=(Line3(tcp_line, "approach", "approach"),)))
        if abs(gripper.state().width - width) > WIDTH_TOLERANCE:
            take_over(gripper)
            yield from self._open(width, grasp)
        boxes = self.device(Workspace).obstacles
        rates = (speed, acceleration, acceleration / JERK_TIME)
        most = landing_speeds(gripper_shape(robot), grasp, boxes, width, line.length, unseen)
        most /= 1.0 + arm.limits.reaction / SINKS
        trajectory = time_curve(line.q, line.length, arm.limits, *rates, most=most)
        opened = gripper.state().width
        fingers = YieldingFingers(gripper)
        with felt(self) as fingertips, hand_felt(self) as hand:
            limits = {each: each.limit(contact, acceleration) for each in (fingertips, hand)}

            def feel() -> None:
                for touch, limit in limits.items():
                    self._feel(touch, limit, opened, grasp, unseen)

            def stop_at_touch(motion: Motion) -> None:
                for touch, limit in limits.items():
                    touch.at_change(limit, motion.stop)

            known = KnownAround(map, (grasp.fruit,))
            yield from self.travel(trajectory, feel, known, None, stop_at_touch, fingers.rest)

    def _open(self, width: float, grasp: Grasp) -> Watching:
        try:
            yield from self.move_fingers(width, self.device(Gripper).limits.speed_max)
        except SkillFailure as failed:
            if failed.failure.code != "MOTION_FAILED":
                raise
            reason = f"at the pre-grasp {failed.failure.message}"
            raise self.failure("CONTACT", reason, candidate=grasp.index) from failed

    def _require_pre_grasp(self, T_base_tcp: np.ndarray, grasp: Grasp) -> None:
        T_base_pre_grasp = grasp.T_base_pre_grasp
        distance = float(np.linalg.norm(T_base_tcp[:3, 3] - T_base_pre_grasp[:3, 3]))
        angle = angle_between(T_base_tcp[:3, :3], T_base_pre_grasp[:3, :3])
        if distance > START_DISTANCE or angle > START_ANGLE:
            where = f"the gripper stands {1e3 * distance:.0f} mm and {np.degrees(angle):.0f}° from the pre-grasp"
            message = f"{where}: follow a path to it first"
            raise self.failure("NOT_AT_PRE_GRASP", message, distance_m=distance, angle_rad=angle)

    def _feel(
        self, touch: Touch, contact: float, opened: float, grasp: Grasp, unseen: float
    ) -> None:
        if stale := touch.stale_for(self.clock.now()):
            raise self.failure("SENSOR_STALE", f"no force has come for {1e3 * stale:.0f} ms")
        width = self.device(Gripper).state().width
        if touch.change <= contact and abs(width - opened) <= PUSHED:
            return
        left = float(np.linalg.norm(grasp.T_base_grasp[:3, 3] - tool_pose(self)[:3, 3]))
        words = f"{1e3 * left:.0f} mm before the grasp"
        found = {
            "before_grasp_m": left,
            "candidate": grasp.index,
            "unexpected": left > max(grasp.fruit.dimensions) / 2.0 + unseen,
        }
        if touch.change <= contact:
            ways = f"from {1e3 * opened:.0f} to {1e3 * width:.0f} mm"
            raise self.failure("CONTACT", f"something pushed the fingers {ways}, {words}", **found)
        if touch.finger:
            record_landing(self, grasp.fruit, touch.finger, touch.change)
        part = f"{touch.finger} finger" if touch.finger else "hand"
        message = f"the {part} touched something {words} ({touch.change:.1f} N)"
        raise self.failure("CONTACT", message, finger=touch.finger, force_n=touch.change, **found)
