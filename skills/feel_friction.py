"""The skill FeelFriction."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np

from drivers.interfaces import Arm, ForceSensor, Gripper, Workspace, WrenchSample
from executive.ports import FORCE, LENGTH, SPEED, Force, Length, Outputs, Port, Ratio, Speed
from executive.skill import Work
from executive.values.arrays import Float64
from skills.grip.hold import Hold
from skills.grip.slide import NoSlideError, Slide, friction_of_slides
from skills.motion.planning.arm_space import arm_space
from skills.motion.planning.timing import time_curve
from skills.motion.robot import RobotModel
from skills.motion.straight_line import straight_line
from skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from skills.shared.grip_view import show_grip
from skills.shared.warm_motion import prepare_moving

JERK_TIME = 0.05
"""Seconds in which the acceleration is reached."""

ACCELERATION = 0.2
"""Of the slides [m/s²]."""

SLIDING = (0.4, 0.92)
"""The pads slide between these shares of the way, as the arm says where it is: before, they and the fruit's skin give;
afterwards they come to rest and creep back."""

SETTLING = 0.1
"""Within so many newtons of what is wanted the grasp force has come down or up."""

PATIENCE = 1.0
"""How long the grasp force may take for that [s]."""


class Felt(Outputs):
    """What FeelFriction gives."""

    mu: Ratio
    mu_uncertainty: Ratio


class FeelFriction(MovingSkill):
    """Slide the pads a little up and down a fruit that still stands, and hold it from then on for the friction felt.

    Pressed lightly the fruit stays where it is and the pads slide: their friction is measured, fruit by fruit, instead
    of being told. Where they do not slide, since the fruit is lighter than the friction, what was told is kept. However
    the slides end, the grip presses with `force_after` afterwards and the fruit may be lifted.
    """

    devices = (Arm, Gripper, ForceSensor, Workspace)
    moves = (Arm, Gripper)
    failures = (*MOTION_FAILURES, "NOT_HELD", "LOST", "LIFT_BLOCKED", "SENSOR_STALE", "SENSOR_SATURATED")
    renamed_failures: ClassVar = {"NO_WAY_UP": "LIFT_BLOCKED"}

    def prepare(self) -> None:
        prepare_moving(self)

    def run(
        self,
        hold: Hold,
        force: Annotated[Force, Port(min="0.5 N", max="5 N", help="grasp force while the pads slide")] = FORCE("0.6 N"),
        force_after: Annotated[
            Force, Port(min="0.6 N", max="10 N", help="grasp force afterwards, before the lift", was="then")
        ] = FORCE("2.2 N"),
        distance: Annotated[Length, Port(min="0.5 mm", max="5 mm", help="how far the pads slide")] = LENGTH("2 mm"),
        speed: Annotated[Speed, Port(min="1 mm/s", max="30 mm/s")] = SPEED("10 mm/s"),
        min_rel_uncertainty: Annotated[
            Ratio, Port(min=0.0, max=0.5, help="least relative uncertainty of what was felt", was="least")
        ] = 0.04,
    ) -> Work[Felt]:
        if not hold.holds:
            raise self.failure("NOT_HELD", "no fruit is held whose friction could be felt")
        settings = hold.controller.settings
        up, down = self._lines(distance)
        hold.slide(force)
        try:
            yield from self._press(hold, force)
            felt_up = yield from self._slide(hold, up, distance, speed)
            felt_down = yield from self._slide(hold, down, distance, speed)
            hold.slide(force_after)
            yield from self._press(hold, force_after)
        finally:
            hold.slide(None)
        try:
            bias_std = hold.controller.sense.bias_std
            slide = friction_of_slides(felt_up, felt_down, settings.contact, bias_std, settings.rate)
        except NoSlideError as problem:
            slide = Slide(settings.contact.mu, settings.mu_uncertainty, (np.nan, np.nan), 0.0)
            said = f"{problem}: {slide.mu:.2f} ± {slide.uncertainty:.0%} is kept"
        else:
            slide = replace(slide, uncertainty=max(slide.uncertainty, min_rel_uncertainty))
            said = f"friction {slide.mu:.2f} ± {slide.uncertainty:.0%}"
        contact = replace(settings.contact, mu=slide.mu)
        hold.set_friction(contact, slide.uncertainty, force_after)
        show_grip(self, hold, everything=True)
        yield said
        return Felt(mu=slide.mu, mu_uncertainty=slide.uncertainty)

    def _lines(self, distance: float) -> tuple[Float64, Float64]:
        """Joints straight up by the distance, and back."""
        arm = self.device(Arm)
        robot = RobotModel.load(arm.description)
        q = arm.state().q
        T_base_goal = robot.tcp(q)
        T_base_goal[2, 3] += distance
        line = straight_line(robot, q, T_base_goal, step=0.25 * distance)
        if not line.complete:
            raise self.failure("LIFT_BLOCKED", line.reason)
        width = self.device(Gripper).state().width
        space = arm_space(arm, self.device(Workspace), None, width, 0.0).leaving_table()
        blocked = space.first_blocked(line.q)
        if blocked is not None:
            reason, found = space.explain(line.q[blocked + 1])
            raise self.failure("LIFT_BLOCKED", f"on the way up {reason}", **found)
        return line.q, line.q[::-1]

    def _press(self, hold: Hold, force: float) -> Watching:
        """Wait until the fingers press with a force [N]."""
        began = self.context.elapsed()
        while abs(hold.controller.tracked_force - force) > SETTLING and self.context.elapsed() - began < PATIENCE:
            self._watch(hold)
            yield f"{hold.controller.tracked_force:.1f} N, on the way to {force:.1f} N"

    def _slide(self, hold: Hold, line: Float64, distance: float, speed: float) -> Generator[str | None, None, Float64]:
        """Go along a line; the wrenches while the pads slid, bias removed, shape (n, 2, 6)."""
        arm = self.device(Arm)
        trajectory = time_curve(line, distance, arm.limits, speed, ACCELERATION, ACCELERATION / JERK_TIME)
        samples_in: list[tuple[float, Float64]] = []

        def on_sample(sample: WrenchSample) -> None:
            samples_in.append((sample.stamp, sample.wrenches.copy()))

        robot = RobotModel.load(arm.description)
        start = robot.tcp(line[0])[:3, 3]
        stamps, shares = [], []

        def watch() -> None:
            self._watch(hold)
            state = arm.state()
            stamps.append(state.stamp)
            shares.append(float(np.linalg.norm(robot.tcp(state.q)[:3, 3] - start)) / distance)

        subscription = self.device(ForceSensor).subscribe(on_sample)
        try:
            yield from self.travel(trajectory, watch)
            watch()
        finally:
            subscription.close()
        first, last = np.interp(SLIDING, np.maximum.accumulate(shares), stamps)
        samples = [wrenches for stamp, wrenches in samples_in if first <= stamp <= last]
        return np.array(samples).reshape(-1, 2, 6) - hold.controller.sense.bias

    def _watch(self, hold: Hold) -> None:
        show_grip(self, hold)
        problem = hold.problem
        if problem is not None and problem.code in self.failures:
            raise self.failure(problem.code, problem.message, **problem.data)
        if not hold.holds:
            raise self.failure("LOST", "the grip is not under control any more")
