"""The skill Detach."""

from __future__ import annotations

from collections import deque
from typing import Annotated

import numpy as np

from pomona.drivers.errors import BadTrajectory, MotionRefused
from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, MotionState, SetPoints, StreamedArm, WrenchSample
from pomona.executive.ports import ANGLE, FORCE, TIME, Angle, Force, Outputs, Port, Ratio, Time
from pomona.executive.skill import Work
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import angle_between, rot_z, transform
from pomona.skills.grip.hold import take_over
from pomona.skills.motion.detaching import DetachController, DetachPhase, DetachSettings, HeldFruit, roll_clearance
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.robot import RobotModel, nearest_solution
from pomona.skills.perception.detection.detection import AllDetections
from pomona.skills.perception.inventory.mass import mass_of
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill

STEM = 0.025
"""Length of an apple's stem above the middle of its cavity [m]; the wall draws 20 to 30 mm."""
SEAT = 0.44
"""Height of the stem's end above the fruit's middle, over the fruit's height: in its cavity."""
UPRIGHT = 0.5
"""Least vertical component of a measured stem axis that is believed; else the stem is taken as vertical."""
DENSITY = 850.0
"""Of an apple [kg/m³], where its kind has no weighed fruit: docs/decisions/orchard-wall.md."""

LEAD, LEAD_ANGLE = 0.025, 0.5
"""Distance and angle by which the commanded pose may lead the arm [m, rad]: a slow or paused arm is waited for."""
TARE = 0.06
"""Time over which the sensors' offset is averaged before the pads touch anything [s]."""
STALE = 0.06
"""Age of the newest force sample at which the motion ends [s]."""
ROLL_NEEDED = np.radians(60.0)
"""Least roll that the arm must reach one way before the fruit is gripped: stems broke at 57° to 100°."""
ROLL_STEP = np.radians(10.0)
CLEAR = -0.01
"""Least distance to a neighbour during the roll [m]; a hanging neighbour gives way by 10 mm."""
OPENED = 0.03
"""Opening beyond the present one after a failure that leaves the fruit on the tree [m]."""


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

    devices = (Arm, StreamedArm, Gripper, ForceSensor)
    failures = (
        *MOTION_FAILURES,
        "SENSOR_STALE",
        "NO_CONTACT",
        "SLIPPED",
        "NOTHING_BROKE",
        "JAMMED",
        "LOST",
        "NEIGHBOUR_AT_RISK",
        "OUT_OF_REACH",
    )

    def run(
        self,
        grasp: Annotated[Grasp, Port(help="where the hand stands, with the fruit between its open fingers")],
        others: Annotated[
            AllDetections | None, Port(help="fruit of the same look: the hand rolls away from them")
        ] = None,
        pull: Annotated[Force, Port(min="0 N", max="10 N", help="by which the fruit is drawn")] = FORCE("3 N"),
        roll: Annotated[Angle, Port(min="60 deg", max="150 deg", help="at most, either way")] = ANGLE("140 deg"),
        mu: Annotated[Ratio, Port(min=0.1, max=2.0, help="assumed friction of the pads")] = 0.6,
        watchdog: Annotated[
            Time, Port(min="50 ms", max="1 s", help="the arm comes to rest when no set-point arrives for this long")
        ] = TIME("150 ms"),
    ) -> Work[Detached]:
        gripper = self.device(Gripper)
        fruit = held_fruit(grasp.fruit)
        controller = DetachController(fruit, self._rolls(grasp, fruit, roll, others), DetachSettings(pull=pull, mu=mu))
        take_over(gripper)
        recent: deque[WrenchSample] = deque(maxlen=max(1, round(TARE * self.device(ForceSensor).rate)))
        subscription = self.device(ForceSensor).subscribe(recent.append)
        try:
            yield from self.wait(TARE)
            if not recent:
                raise self.failure("SENSOR_STALE", f"the fingers sent no force within {1e3 * TARE:.0f} ms")
            offset = np.mean([sample.wrenches for sample in recent], axis=0)
            yield from self._detach(controller, recent, offset, watchdog)
        finally:
            subscription.close()
        problem = controller.problem
        if problem is not None:
            if problem.code != "LOST":
                width = min(gripper.state().width + OPENED, gripper.limits.width_max)
                yield from self.move_fingers(width, gripper.limits.speed_max / 2.0)
            raise self.failure(
                problem.code,
                problem.message,
                roll_rad=round(controller.roll, 3),
                stem_force_n=round(controller.stem_peak, 2),
            )
        return Detached(stem_force=controller.stem_peak, rolled=abs(controller.roll_at_break))

    def _detach(
        self, controller: DetachController, recent: deque[WrenchSample], offset: Float64, watchdog: float
    ) -> Work[None]:
        """Stream the controller's velocities until it is done, then come to rest with the fingers standing."""
        gripper = self.device(Gripper)
        try:
            motion = self.device(StreamedArm).stream(watchdog)
        except MotionRefused as refused:
            raise self.failure("REFUSED", f"{refused}; nothing has moved", device=refused.device) from refused
        try:
            yield from self._follow(controller, motion, recent, offset)
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
        gripper.set_speed(0.0)
        motion.stop()
        while not motion.settled:
            yield "coming to rest"

    def _follow(
        self, controller: DetachController, motion: SetPoints, recent: deque[WrenchSample], offset: Float64
    ) -> Work[None]:
        arm, gripper = self.device(Arm), self.device(Gripper)
        robot = RobotModel.load(arm.description).with_limits(arm.limits.lower, arm.limits.upper)
        q_aimed = arm.state().q
        T_aimed, before = robot.tcp(q_aimed), self.clock.now()
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
                gripper.set_speed(0.0)
                continue
            felt = np.mean([sample.wrenches for sample in recent], axis=0) - offset
            saturated = any(any(sample.saturated) for sample in recent)
            recent.clear()
            T = robot.tcp(arm.state().q)
            command = controller.step(dt, felt, saturated, T, gripper.state().width)
            gripper.set_speed(command.opening)
            T_next = T_aimed.copy()
            if np.linalg.norm(T_aimed[:3, 3] + dt * command.velocity - T[:3, 3]) < LEAD:
                T_next[:3, 3] += dt * command.velocity
            if angle_between(T[:3, :3], T_aimed[:3, :3]) < LEAD_ANGLE:
                T_next[:3, :3] = T_aimed[:3, :3] @ rot_z(dt * command.roll_rate)
            q_next = nearest_solution(robot, T_next, q_aimed)
            if q_next is None or np.abs(q_next - q_aimed).max() > 0.3:
                controller.give_up("OUT_OF_REACH", "the arm reaches no further in this posture")
                q_next, T_next = q_aimed, T_aimed
            q_aimed, T_aimed = q_next, T_next
            try:
                motion.aim(q_aimed)
            except BadTrajectory as bad:
                raise self.failure("OUT_OF_REACH", f"the roll leaves the limits: {bad}") from bad

    def _rolls(self, grasp: Grasp, fruit: HeldFruit, most: float, others: AllDetections | None) -> tuple[float, ...]:
        """Return the angles to roll by, the side farther from neighbours first, each up to the arm's limits."""
        arm = self.device(Arm)
        robot = RobotModel.load(arm.description).with_limits(arm.limits.lower, arm.limits.upper)
        q, reached = arm.state().q, []
        for way in (1.0, -1.0):
            angle = reachable_roll(robot, q, fruit.p_base_knuckle, way, most)
            if angle >= ROLL_NEEDED:
                reached.append(way * angle)
        if not reached:
            words = f"the arm cannot roll by {np.degrees(ROLL_NEEDED):.0f}° either way; nothing has moved"
            raise self.failure("OUT_OF_REACH", words, candidate=grasp.index)
        near = neighbours_of(grasp.fruit, others)
        width = self.device(Gripper).state().width
        T = robot.tcp(q)
        clear = {roll: roll_clearance(T, roll, width, fruit.p_base_knuckle, near) for roll in reached}
        free = [roll for roll in reached if clear[roll] > CLEAR]
        if not free:
            least = max(clear.values())
            words = f"a finger would come {-1e3 * least:.0f} mm into a neighbour; nothing has moved"
            raise self.failure("NEIGHBOUR_AT_RISK", words, candidate=grasp.index, overlap_m=-least)
        return tuple(sorted(free, key=lambda roll: -min(clear[roll], 0.03)))


def held_fruit(measured: MeasuredFruit) -> HeldFruit:
    """Return the controller's data of a fruit: diameter, mass and the place of its stem's other end."""
    dimensions = measured.dimensions
    known = mass_of(measured.fruit, dimensions, measured.covariance[3:, 3:])
    mass = DENSITY * np.pi / 6.0 * float(np.prod(dimensions)) if known is None else known[0]
    up = -measured.T_base_fruit[:3, 1]
    up = up if up[2] > UPRIGHT else np.array([0.0, 0.0, 1.0])
    knuckle = measured.T_base_fruit[:3, 3] + (STEM + SEAT * float(dimensions[1])) * up
    return HeldFruit(float(dimensions.max()), mass, knuckle)


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


def reachable_roll(robot: RobotModel, q: Float64, p_base_knuckle: Float64, way: float, most: float) -> float:
    """Return how far the hand can roll about its approach through the knuckle, in one posture of the arm [rad]."""
    T = robot.tcp(q)
    lever = T[:3, :3].T @ (T[:3, 3] - p_base_knuckle)
    reached = 0.0
    while reached < most - 1e-9:
        angle = min(reached + ROLL_STEP, most)
        R = T[:3, :3] @ rot_z(way * angle)
        solved = nearest_solution(robot, transform(R, p_base_knuckle + R @ lever), q)
        if solved is None or np.abs(solved - q).max() > 6.0 * ROLL_STEP:
            break
        q, reached = solved, angle
    return reached
