"""The skill Detach."""

from __future__ import annotations

from collections import deque
from typing import Annotated

import numpy as np

from pomona.applications.harvest.detaching import (
    DetachController,
    DetachPhase,
    DetachSettings,
    HeldFruit,
    roll_clearance,
)
from pomona.applications.harvest.hanging import free_roll, knuckle_of
from pomona.drivers.errors import BadTrajectory, MotionRefused
from pomona.drivers.interfaces import (
    Arm,
    ForceSensor,
    Gripper,
    MotionState,
    SetPoints,
    StreamedArm,
    Workspace,
    WrenchSample,
)
from pomona.executive.ports import ANGLE, FORCE, LENGTH, TIME, Angle, Force, Length, Outputs, Port, Ratio, Time
from pomona.executive.skill import Work
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import angle_between, rot_z, transform
from pomona.skills.grip.hold import take_over
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.motion.robot import RobotModel, nearest_solution
from pomona.skills.perception.detection.detection import AllDetections
from pomona.skills.perception.fruit.catalogue import mass_of
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill
from pomona.skills.shared.usable_map import usable_field
from pomona.skills.shared.yielding import YieldingFingers

DENSITY = 850.0
"""Of an apple [kg/m³], where its kind has no weighed fruit: docs/decisions/orchard-wall.md."""

LEAD, LEAD_ANGLE = 0.025, 0.5
"""Distance and angle by which the commanded pose may lead the arm [m, rad]: a slow or paused arm is waited for."""
JUMP, BEYOND = 0.3, 0.4
"""Largest step of a joint [rad], and time without a step that the arm can follow after which the motion is given up
[s]: at the edge of the arm's reach the hand turns without moving, moves without turning, or waits for the way back."""
TARE = 0.06
"""Time over which the sensors' offset is averaged before the pads touch anything [s]."""
STALE = 0.06
"""Age of the newest force sample at which the motion ends [s]."""
LIMIT_MARGIN = 0.02
"""Distance of set-points from the joints' limits [rad]: from a limit itself the next path would be refused."""
ROLL_NEEDED = np.radians(60.0)
"""Least roll that the arm must reach one way before the fruit is gripped: stems broke at 57° to 100°."""
ROLL_WANTED = np.radians(100.0)
"""A roll that is free so far is as good as a longer one."""
CLEAR = -0.01
"""Least distance to a neighbour during the roll [m]; a hanging neighbour gives way by 10 mm."""


class Detached(Outputs):
    """Outputs of Detach."""

    stem_force: Force
    rolled: Angle


class Detach(MovingSkill):
    """Close on a hanging fruit, draw it out lightly and roll the hand until its stem breaks; then move back.

    The hand rolls away from neighbours first. A stem that holds is rolled the other way, then the branch is let back
    slowly and the fruit is released. Interrupted, the arm decelerates and the grip is kept. Set-points are streamed
    under a watchdog: without them the arm comes to rest.
    """

    devices = (Arm, StreamedArm, Gripper, ForceSensor, Workspace)
    moves = (Arm, StreamedArm, Gripper)
    failures = (
        *MOTION_FAILURES,
        "SENSOR_STALE",
        "NOT_GRIPPED",
        "SLIPPED",
        "NOTHING_BROKE",
        "JAMMED",
        "LOST",
        "NEIGHBOUR_AT_RISK",
        "OUT_OF_REACH",
        "MAP_STALE",
    )

    def run(
        self,
        grasp: Annotated[Grasp, Port(help="pose of the hand, with the fruit between its open fingers")],
        others: Annotated[
            AllDetections | None, Port(help="other fruit of the same look; the hand rolls away from them")
        ] = None,
        map: Annotated[OccupancyMap | None, Port(help="obstacles, without the target")] = None,
        clearance: Annotated[
            Length, Port(min="0 mm", help="distance of the links to obstacles; less for the gripper")
        ] = LENGTH("4 mm"),
        pull: Annotated[Force, Port(min="0 N", max="10 N", help="force with which the fruit is pulled")] = FORCE("3 N"),
        roll: Annotated[Angle, Port(min="60 deg", max="150 deg", help="maximum roll in both directions")] = ANGLE(
            "140 deg"
        ),
        mu: Annotated[Ratio, Port(min=0.1, max=2.0, help="assumed friction of the pads")] = 0.6,
        watchdog: Annotated[
            Time, Port(min="50 ms", max="1 s", help="the arm comes to rest when no set-point arrives for this long")
        ] = TIME("150 ms"),
    ) -> Work[Detached]:
        gripper = self.device(Gripper)
        fruit = held_fruit(grasp.fruit)
        controller = DetachController(
            fruit, self._rolls(grasp, fruit, roll, others, map, clearance), DetachSettings(pull=pull, mu=mu)
        )
        take_over(gripper)
        recent: deque[WrenchSample] = deque(maxlen=max(1, round(TARE * self.device(ForceSensor).rate)))
        subscription = self.device(ForceSensor).subscribe(recent.append)
        try:
            yield from self.wait(TARE)
            if not recent:
                raise self.failure("SENSOR_STALE", f"the fingers sent no force within {1e3 * TARE:.0f} ms")
            offset = np.mean([sample.wrenches for sample in recent], axis=0)
            fingers = YieldingFingers(gripper, relax=True)
            yield from self._detach(controller, fingers, recent, offset, watchdog)
        finally:
            subscription.close()
        problem = controller.problem
        if problem is not None:
            raise self.failure(
                problem.code,
                problem.message,
                roll_rad=round(controller.roll, 3),
                stem_force_n=round(controller.stem_peak, 2),
            )
        return Detached(stem_force=controller.stem_peak, rolled=abs(controller.roll_at_break))

    def _detach(
        self,
        controller: DetachController,
        fingers: YieldingFingers,
        recent: deque[WrenchSample],
        offset: Float64,
        watchdog: float,
    ) -> Work[None]:
        """Stream the controller's velocities until it is done, then come to rest with the fingers standing."""
        gripper = self.device(Gripper)
        try:
            motion = self.device(StreamedArm).stream(watchdog)
        except MotionRefused as refused:
            raise self.failure("REFUSED", f"{refused}; nothing has moved", device=refused.device) from refused
        try:
            yield from self._follow(controller, motion, fingers, recent, offset)
        except GeneratorExit:
            motion.stop()
            gripper.set_speed(0.0)
            raise
        except BaseException:
            motion.stop()
            gripper.set_speed(0.0)
            while not motion.settled:
                yield "stopping"
            raise
        motion.stop()
        while not motion.settled:
            fingers.set_speed(0.0)
            yield "coming to rest"
        gripper.set_speed(0.0)

    def _follow(
        self,
        controller: DetachController,
        motion: SetPoints,
        fingers: YieldingFingers,
        recent: deque[WrenchSample],
        offset: Float64,
    ) -> Work[None]:
        arm, gripper = self.device(Arm), self.device(Gripper)
        robot = inner_robot(arm)
        q_aimed = arm.state().q
        T_aimed, before, beyond = robot.tcp(q_aimed), self.clock.now(), 0.0
        recent.clear()
        while controller.phase is not DetachPhase.DONE:
            yield f"{controller.phase.value}: {np.degrees(controller.roll):.0f}°, stem {controller.stem_force:.1f} N"
            if motion.state not in (MotionState.RUNNING, MotionState.PAUSED):
                code = "STOPPED" if motion.state is MotionState.STOPPED else "MOTION_FAILED"
                raise self.failure(code, motion.problem or "the motion was stopped before its end")
            now = self.clock.now()
            dt, before = now - before, now
            newest = self.device(ForceSensor).latest()
            age = np.inf if newest is None else now - newest.stamp
            if age > STALE:
                raise self.failure("SENSOR_STALE", f"the fingers sent no force for {1e3 * age:.0f} ms", age_s=age)
            if motion.state is MotionState.PAUSED or not recent:
                fingers.set_speed(0.0)
                continue
            felt = np.mean([sample.wrenches for sample in recent], axis=0) - offset
            saturated = any(any(sample.saturated) for sample in recent)
            recent.clear()
            T = robot.tcp(arm.state().q)
            command = controller.step(dt, felt, saturated, T, gripper.state().width)
            fingers.holds = controller.broke_at is not None  # a detached fruit is not given up to a push
            fingers.set_speed(command.opening)
            T_moved, T_turned = T_aimed.copy(), T_aimed.copy()
            if np.linalg.norm(T_aimed[:3, 3] + dt * command.velocity - T[:3, 3]) < LEAD:
                T_moved[:3, 3] += dt * command.velocity
            if angle_between(T[:3, :3], T_aimed[:3, :3]) < LEAD_ANGLE:
                T_turned[:3, :3] = T_aimed[:3, :3] @ rot_z(dt * command.roll_rate)
            beyond += dt
            for T_next in (transform(T_turned[:3, :3], T_moved[:3, 3]), T_turned, T_moved):
                q_next = nearest_solution(robot, T_next, q_aimed)
                if q_next is not None and np.abs(q_next - q_aimed).max() < JUMP:
                    q_aimed, T_aimed, beyond = q_next, T_next, 0.0
                    break
            if beyond > BEYOND:
                controller.give_up("OUT_OF_REACH", "the arm reaches no further in this posture")
            try:
                motion.aim(q_aimed)
            except BadTrajectory as bad:
                raise self.failure("OUT_OF_REACH", f"the roll leaves the limits: {bad}") from bad

    def _rolls(
        self,
        grasp: Grasp,
        fruit: HeldFruit,
        most: float,
        others: AllDetections | None,
        map: OccupancyMap | None,
        clearance: float,
    ) -> tuple[float, ...]:
        """Return the angles to roll by, the freest way first, each up to the arm's limits."""
        arm, knuckle = self.device(Arm), fruit.p_base_knuckle
        robot = inner_robot(arm)
        q, T = arm.state().q, robot.tcp(arm.state().q)
        field = usable_field(self, map)
        space = arm_space(arm, self.device(Workspace), field, fruit.diameter, clearance, target=grasp.fruit)
        reached = [way * free_roll(robot, q, knuckle, way, most) for way in (1.0, -1.0)]
        reached = [roll for roll in reached if abs(roll) >= ROLL_NEEDED]
        if not reached:
            words = f"the arm cannot roll by {np.degrees(ROLL_NEEDED):.0f}° either way; nothing has moved"
            raise self.failure("OUT_OF_REACH", words, candidate=grasp.index)
        near = neighbours_of(grasp.fruit, others)
        width = self.device(Gripper).state().width
        clear = {roll: roll_clearance(T, roll, width, knuckle, near) for roll in reached}
        kept = [roll for roll in reached if clear[roll] > CLEAR]
        if not kept:
            least = max(clear.values())
            words = f"a finger would come {-1e3 * least:.0f} mm into a neighbour; nothing has moved"
            raise self.failure("NEIGHBOUR_AT_RISK", words, candidate=grasp.index, overlap_m=-least)
        free = {roll: free_roll(robot, q, knuckle, float(np.sign(roll)), most, space) for roll in kept}
        if max(free.values()) >= ROLL_NEEDED:
            kept = [roll for roll in kept if free[roll] >= ROLL_NEEDED]
        return tuple(sorted(kept, key=lambda roll: (-min(free[roll], ROLL_WANTED), -min(clear[roll], 0.03))))


def inner_robot(arm: Arm) -> RobotModel:
    """Return the robot within its joint limits less `LIMIT_MARGIN`."""
    limits = arm.limits
    return RobotModel.load(arm.description).with_limits(limits.lower + LIMIT_MARGIN, limits.upper - LIMIT_MARGIN)


def held_fruit(measured: MeasuredFruit) -> HeldFruit:
    """Return the controller's data of a fruit: diameter, mass and the place of its stem's other end."""
    dimensions = measured.dimensions
    known = mass_of(measured.fruit, dimensions, measured.covariance[3:, 3:])
    mass = DENSITY * np.pi / 6.0 * float(np.prod(dimensions)) if known is None else known[0]
    return HeldFruit(float(dimensions.max()), mass, knuckle_of(measured))


def neighbours_of(target: MeasuredFruit, others: AllDetections | None) -> Float64:
    """Return positions and radii of the other fruit of a look in the base frame, shape (n, 4) [m]."""
    if others is None:
        return np.zeros((0, 4))
    rows = []
    for each in others.detections:
        p = (each.T_base_camera @ each.T_camera_object)[:3, 3]
        if np.linalg.norm(p - target.T_base_fruit[:3, 3]) > float(target.dimensions.max()) / 2.0:
            rows.append([*p, float(each.fruit.dimensions.max()) / 2.0])
    return np.array(rows).reshape(-1, 4)
