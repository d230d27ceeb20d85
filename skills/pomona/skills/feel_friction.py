"""The skill FeelFriction."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import Annotated

import numpy as np

from pomona.drivers.errors import DeviceFault
from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, Workspace, WrenchSample
from pomona.executive.ports import FORCE, LENGTH, SPEED, Force, Length, Outputs, Port, Ratio, Speed
from pomona.executive.skill import Work
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.hold import Hold
from pomona.skills.grip.slide import NoSlideError, Slide, friction_of_slides
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.straight_line import straight_line
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from pomona.skills.shared.grip_view import show_grip
from pomona.skills.shared.warm_motion import prepare_moving

JERK_TIME = 0.05  # time to full acceleration [s]
ACCELERATION = 0.4  # acceleration of the slides [m/s²]

SLIDING = (0.4, 0.92)
"""Part of the distance, by the arm's joints, on which the pads slide: before it pads and skin deform, after it they
come to rest and creep back."""

RISING = 0.5
"""Additional upward path, relative to the distance, on which the force rises: the fruit's weight comes on the fingers
gently."""

LIGHT, LIGHT_NOW = 0.4, 0.65
"""Ratios of friction to the largest weight of a fruit of this size above which it counts as light: with the tracked
force, and with the sum of both fingers, of which one may press more (docs/decisions/pick-pace.md)."""

SETTLING = 0.1  # error of the grip force that counts as reached [N]
PATIENCE = 1.0  # longest time for the grip force to be reached [s]


class Felt(Outputs):
    """Outputs of FeelFriction."""

    mu: Ratio
    mu_uncertainty: Ratio


class FeelFriction(MovingSkill):
    """Measure the friction of a standing fruit by sliding the pads down and up, and use it from then on.

    With a light grip force the fruit stands still and the pads slide. At the end of the way up the force rises while
    they slide, so that the weight comes on them gently. A fruit that is lighter than the friction moves with the pads;
    then only the way down counts. If the pads do not slide, the configured friction is kept. The grip presses with
    `force_after` afterwards, however the slides end.
    """

    devices = (Arm, Gripper, ForceSensor, Workspace)
    moves = (Arm, Gripper)
    own_speed = True  # friction is measured at one speed of sliding
    failures = (*MOTION_FAILURES, "NOT_HELD", "LOST", "SENSOR_STALE", "SENSOR_SATURATED")

    def prepare(self) -> None:
        prepare_moving(self)

    def run(
        self,
        hold: Hold,
        force: Annotated[Force, Port(min="0.5 N", max="5 N", help="grip force while the pads slide up")] = FORCE(
            "0.7 N"
        ),
        force_after: Annotated[
            Force, Port(min="0.6 N", max="10 N", help="grip force afterwards, before the lift", was="then")
        ] = FORCE("2.2 N"),
        distance: Annotated[Length, Port(min="0.5 mm", max="5 mm", help="path of the slides")] = LENGTH("2 mm"),
        speed: Annotated[Speed, Port(min="1 mm/s", max="30 mm/s")] = SPEED("20 mm/s"),
        min_rel_uncertainty: Annotated[
            Ratio, Port(min=0.0, max=0.5, help="smallest relative uncertainty of the result", was="least")
        ] = 0.04,
    ) -> Work[Felt]:
        if not hold.holds:
            raise self.failure("NOT_HELD", "no fruit is held, so no friction can be measured")
        hold = hold.under(self.device(Gripper))
        configured = hold.settings
        slide = Slide(configured.contact.mu, configured.mu_uncertainty, (np.nan, np.nan))
        try:
            try:
                slide = yield from self._measure(hold, force, force_after, distance, speed)
                slide = replace(slide, uncertainty=max(slide.uncertainty, min_rel_uncertainty))
                feedback = f"friction {slide.mu:.2f} ± {slide.uncertainty:.0%}"
                feedback += ", from the way down only" if slide.came_along else ""
            except NoSlideError as problem:
                feedback = f"{problem}: {slide.mu:.2f} ± {slide.uncertainty:.0%} is kept"
            hold.slide(force_after)
            yield from self._press(hold, force_after)
        finally:
            hold.slide(None)
        hold.set_friction(replace(configured.contact, mu=slide.mu), slide.uncertainty, force_after)
        show_grip(self, hold, everything=True)
        yield feedback
        return Felt(mu=slide.mu, mu_uncertainty=slide.uncertainty)

    def _measure(
        self, hold: Hold, force: float, force_after: float, distance: float, speed: float
    ) -> Generator[str | None, None, Slide]:
        """Slide down, and up with the force rising at the end.

        Raises:
            NoSlideError: the path is blocked, or the pads did not slide.
        """
        settings = hold.settings
        down, up = self._lines(distance)
        hold.slide(force)
        # Down at once: the pads slide also while the force of closing comes down.
        wrenches_down = yield from self._slide(hold, down, distance, distance, speed)
        yield from self._press(hold, force)
        if _moves_with_pads(wrenches_down, force, hold.estimate.force_sum, settings.expected_load):
            hold.slide(force_after)
        wrenches_up = yield from self._slide(hold, up, (1.0 + RISING) * distance, distance, speed, force_after)
        return friction_of_slides(wrenches_up, wrenches_down, settings.contact, hold.estimate.bias_std, settings.rate)

    def _lines(self, distance: float) -> tuple[Float64, Float64]:
        """Return the joints of a straight path down by the distance, and of one up beyond its start.

        Raises:
            NoSlideError: a path is blocked or out of reach.
        """
        arm = self.device(Arm)
        robot = RobotModel.load(arm.description)
        q = arm.state().q
        T_base_low, T_base_high = robot.tcp(q), robot.tcp(q)
        T_base_low[2, 3] -= distance
        T_base_high[2, 3] += RISING * distance
        down = straight_line(robot, q, T_base_low, step=0.25 * distance)
        up = straight_line(robot, down.q[-1], T_base_high, step=0.25 * distance)
        space = arm_space(arm, self.device(Workspace), None, self.device(Gripper).state().width, 0.0)
        for line, way in ((down, "down"), (up, "up")):
            blocked = space.first_blocked(line.q)
            if not line.complete or blocked is not None:
                reason = line.reason if blocked is None else space.explain(line.q[blocked + 1])[0]
                raise NoSlideError(f"on the way {way} {reason}")
        return down.q, up.q

    def _press(self, hold: Hold, force: float) -> Watching:
        """Wait until the fingers press with this grip force [N]."""
        began = self.context.elapsed()
        while abs(hold.tracked_force - force) > SETTLING and self.context.elapsed() - began < PATIENCE:
            self._watch(hold)
            yield f"{hold.tracked_force:.1f} N, on the way to {force:.1f} N"

    def _slide(
        self, hold: Hold, line: Float64, way: float, distance: float, speed: float, then: float | None = None
    ) -> Generator[str | None, None, Float64]:
        """Follow a line of length `way` [m], with the force `then` [N] beyond the distance.

        Returns:
            The wrenches while the pads slid, bias removed, shape (n, 2, 6).

        Raises:
            DeviceFault: the arm reports its arrival, but its joints have hardly moved.
        """
        arm = self.device(Arm)
        trajectory = time_curve(line, way, arm.limits, speed, ACCELERATION, ACCELERATION / JERK_TIME)
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
            if then is not None and shares[-1] > SLIDING[1]:
                hold.slide(then)

        subscription = self.device(ForceSensor).subscribe(on_sample)
        try:
            yield from self.travel(trajectory, watch)
            watch()
        finally:
            subscription.close()
        if max(shares) < SLIDING[0]:
            moved = f"moved {1e3 * distance * max(shares):.1f} mm of {1e3 * way:.1f} mm by its joints"
            raise DeviceFault("arm", f"{moved}, but its driver reports its arrival")
        first, last = np.interp(SLIDING, np.maximum.accumulate(shares), stamps)
        samples = [wrenches for stamp, wrenches in samples_in if first <= stamp <= last]
        return np.array(samples).reshape(-1, 2, 6) - hold.bias

    def _watch(self, hold: Hold) -> None:
        show_grip(self, hold)
        problem = hold.problem
        if problem is not None and problem.code in self.failures:
            raise self.failure(problem.code, problem.message, **problem.data)
        if not hold.holds:
            raise self.failure("LOST", "the grip is no longer under control")


def _moves_with_pads(down: Float64, force: float, force_sum: float, expected_load: float) -> bool:
    """Return True if friction may exceed the fruit's weight, so that the upward slide would lift it.

    Args:
        down: wrenches of the downward slide, shape (n, 2, 6).
        force, force_sum: grip force of the slide, and sum of both fingers now [N].
        expected_load: largest weight of a fruit of this size [N].
    """
    if not len(down):
        return False
    f_n, f_t = -down[:, :, 2].sum(axis=1).mean(), np.linalg.norm(down[:, :, :2], axis=2).sum(axis=1).mean()
    share = f_t / max(f_n, 0.1) / max(expected_load, 1e-3)
    return expected_load > 0.0 and bool(force * share > LIGHT or force_sum * share > LIGHT_NOW)
