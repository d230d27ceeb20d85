"""The skill Detach."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.applications.harvest.detaching import (
    DetachController,
    DetachPhase,
    DetachSettings,
    HeldFruit,
)
from pomona.applications.harvest.felt_pads import FeltPads, MeanWrench
from pomona.applications.harvest.hanging import free_roll, knuckle_of
from pomona.applications.harvest.roll_choice import (
    CLEAR,
    ROLL_NEEDED,
    neighbours_of,
    ordered,
    roll_clearance,
)
from pomona.applications.harvest.set_point import HandAim, inner_robot
from pomona.drivers import (
    Arm,
    BadTrajectory,
    ForceSensor,
    Gripper,
    MotionRefused,
    MotionState,
    SetPoints,
    StreamedArm,
    Workspace,
)
from pomona.executive import (
    ANGLE,
    FORCE,
    LENGTH,
    TIME,
    Angle,
    Force,
    Length,
    Outputs,
    Port,
    Ratio,
    Time,
    Work,
)
from pomona.skills import MOTION_FAILURES, TAKEN, MovingSkill, YieldingFingers, usable_field
from pomona.skills.grip import take_over
from pomona.skills.motion import Grasp, OccupancyMap, arm_space
from pomona.skills.perception import AllDetections, MeasuredFruit, mass_of

DENSITY = 850.0
"""Of an apple [kg/m³], where its kind has no weighed fruit."""

LONGEST = 0.06
"""Longest step of the controller [s]: a tick that comes later was stalled or paused, and the hand has stood since."""
BEYOND = 0.4
"""Time without a step that the arm can follow after which the motion is given up [s]: at the edge of the arm's reach
the hand turns without moving, moves without turning, or waits for the way back."""
WITHIN = 0.9
"""Share of the joints' speeds within which set-points stay: joints that all follow keep the hand on its path."""
TARE = 0.06
"""Time over which the sensors' offset is averaged before the pads touch anything [s]."""
BEARS = 2.0
"""Force of a pad from which fingers that press outwards close no further [N]: no apple bruises by it."""
STALE = 0.06
"""Age of the newest force sample at which the motion ends [s]."""


class Detached(Outputs):
    """Outputs of Detach."""

    stem_force: Annotated[Force, Port(help="largest pull of the stem")]
    rolled: Annotated[Angle, Port(help="turn of the hand when the break was noticed")]


class Detach(MovingSkill):
    """Close on a hanging fruit, draw it out lightly and roll the hand until its stem breaks; then move back.

    The hand rolls away from neighbours first. A stem that holds is rolled the other way, then the branch is let back
    slowly and the fruit is released, if a small pull shows that the stem still holds it. Interrupted, the arm
    decelerates and the grip is kept. Set-points are streamed under a watchdog: without them the arm comes to rest.
    In a pause the force control of the grip goes on.
    """

    devices = (Arm, StreamedArm, Gripper, ForceSensor, Workspace)
    moves = (Arm, StreamedArm, Gripper)
    failures = (
        *MOTION_FAILURES,
        "SENSOR_STALE",
        "CONTACT",
        "NOT_GRIPPED",
        "SLIPPED",
        "NOTHING_BROKE",
        "JAMMED",
        "LOST",
        "NEIGHBOUR_AT_RISK",
        "OUT_OF_REACH",
        "MAP_STALE",
        "STEM_UNCLEAR",
    )

    def run(
        self,
        grasp: Annotated[
            Grasp, Port(help="pose of the hand, with the fruit between its open fingers")
        ],
        others: Annotated[
            AllDetections | None,
            Port(help="other fruit of the same look; the hand rolls away from them"),
        ] = None,
        map: Annotated[OccupancyMap | None, Port(help="obstacles, without the target")] = None,
        clearance: Annotated[
            Length,
            Port(min="0 mm", help="distance of the links to obstacles; less for the gripper"),
        ] = LENGTH("4 mm"),
        pull: Annotated[
            Force, Port(min="0 N", max="10 N", help="force with which the fruit is pulled")
        ] = FORCE("3 N"),
        roll: Annotated[
            Angle, Port(min="60 deg", max="150 deg", help="maximum roll in both directions")
        ] = ANGLE("140 deg"),
        mu: Annotated[Ratio, Port(min=0.1, max=2.0, help="assumed friction of the pads")] = 0.6,
        watchdog: Annotated[
            Time,
            Port(
                min="50 ms",
                max="1 s",
                help="the arm comes to rest when no set-point arrives for this long",
            ),
        ] = TIME("150 ms"),
    ) -> Work[Detached]:
        gripper = self.device(Gripper)
        fruit = held_fruit(grasp.fruit)
        controller = DetachController(
            fruit,
            self._rolls(grasp, fruit, roll, others, map, clearance),
            DetachSettings(pull=pull, mu=mu),
        )
        take_over(gripper)
        pads = FeltPads(self.device(ForceSensor))
        try:
            yield from self.wait(TARE)
            if not pads.tare(controller.settings.untouched):
                raise self.failure(
                    "SENSOR_STALE", f"the fingers sent no force within {1e3 * TARE:.0f} ms"
                )
            yield from self._detach(
                controller, YieldingFingers(gripper, relax=True), pads, watchdog, clearance
            )
        finally:
            pads.close()
        problem = controller.problem
        if problem is not None:
            data = {
                "roll_rad": round(controller.roll, 3),
                "stem_force_n": round(controller.stem_peak, 2),
            }
            raise self.failure(
                problem.code, problem.message, **data, given_back_j=round(controller.given_back, 3)
            )
        return Detached(stem_force=controller.stem_peak, rolled=abs(controller.roll_at_break))

    def _detach(
        self,
        controller: DetachController,
        fingers: YieldingFingers,
        pads: FeltPads,
        watchdog: float,
        clearance: float,
    ) -> Work[None]:
        """Stream the controller's velocities until it is done, then come to rest with the fingers standing."""
        gripper = self.device(Gripper)
        try:
            motion = self.device(StreamedArm).stream(watchdog)
        except MotionRefused as refused:
            raise self.failure(
                "REFUSED", f"{refused}; nothing has moved", device=refused.device
            ) from refused

        def stand(felt: MeanWrench) -> None:
            state = gripper.state()
            speed = controller.stand(felt.duration, felt.wrenches, state.width, state.motor_force)
            fingers.set_speed(speed, felt.press, BEARS)

        pads.between_ticks(stand, lambda: motion.state is MotionState.PAUSED, self.clock.now)
        try:
            yield from self._follow(controller, motion, fingers, pads, clearance)
        except BaseException as ended:
            motion.stop()
            pads.close()
            gripper.set_speed(0.0)
            while not (isinstance(ended, GeneratorExit) or motion.settled):
                yield "stopping"
            raise
        motion.stop()
        pads.close()
        while not motion.settled:
            fingers.set_speed(0.0)
            yield "coming to rest"
        gripper.set_speed(0.0)

    def _follow(
        self,
        controller: DetachController,
        motion: SetPoints,
        fingers: YieldingFingers,
        pads: FeltPads,
        clearance: float,
    ) -> Work[None]:
        arm, gripper = self.device(Arm), self.device(Gripper)
        robot = inner_robot(arm)
        fixed = arm_space(arm, self.device(Workspace), None, gripper.state().width, clearance)
        aim = HandAim(robot, arm.state().q, lambda q: float(fixed.clearances(q[None])[0]))
        before = self.clock.now()
        pads.take()
        while controller.phase is not DetachPhase.DONE:
            yield f"{controller.phase.value}: {np.degrees(controller.roll):.0f}°, stem {controller.stem_force:.1f} N"
            if motion.state not in (MotionState.RUNNING, MotionState.PAUSED):
                code = "STOPPED" if motion.state is MotionState.STOPPED else "MOTION_FAILED"
                raise self.failure(code, motion.problem or "the motion was stopped before its end")
            self._require_fresh()
            if motion.state is MotionState.PAUSED or (felt := pads.take()) is None:
                continue
            now = self.clock.now()
            if now - before > LONGEST:
                controller.rejoin()
            dt, before = min(now - before, LONGEST), now
            state, T, hung = gripper.state(), robot.tcp(arm.state().q), not fingers.holds
            with pads.lock:
                command = controller.step(
                    dt, felt.wrenches, felt.saturated, T, state.width, aim.T, state.motor_force
                )
                fingers.holds = (
                    controller.broke_at is not None
                )  # a detached fruit is not given up to a push
                fingers.set_speed(command.opening, felt.press, BEARS)
            if hung and fingers.holds:
                self.publish("candidates", TAKEN)
            controller.slowed(aim.follow(command, dt, WITHIN * arm.limits.velocity, motion.speed))
            if aim.come_to(arm.state().q, dt):
                controller.give_up("JAMMED", "something holds the arm beside its set-point")
            if aim.unturned > BEYOND:
                controller.end_roll()
            if aim.beyond > BEYOND:
                controller.give_up("OUT_OF_REACH", "the arm reaches no further in this posture")
                aim.beyond = 0.0  # the hand's next motion has its own time
            try:
                motion.aim(aim.q)
            except BadTrajectory as bad:
                raise self.failure("OUT_OF_REACH", f"the roll leaves the limits: {bad}") from bad

    def _require_fresh(self) -> None:
        newest, now = self.device(ForceSensor).latest(), self.clock.now()
        age = np.inf if newest is None else now - newest.stamp
        if age > STALE:
            raise self.failure(
                "SENSOR_STALE", f"the fingers sent no force for {1e3 * age:.0f} ms", age_s=age
            )

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
        space = arm_space(
            arm, self.device(Workspace), field, fruit.diameter, clearance, target=grasp.fruit
        )
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
        return ordered(
            {roll: free_roll(robot, q, knuckle, np.sign(roll), most, space) for roll in kept}, clear
        )


def held_fruit(measured: MeasuredFruit) -> HeldFruit:
    """Return the controller's data of a fruit: diameter, mass and the place of its stem's other end."""
    dimensions = measured.dimensions
    known = mass_of(measured.fruit, dimensions, measured.covariance[3:, 3:])
    mass = DENSITY * np.pi / 6.0 * float(np.prod(dimensions)) if known is None else known[0]
    return HeldFruit(float(dimensions.max()), mass, knuckle_of(measured))
