"""The skill FeelFriction."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np

from pomona.drivers.errors import DeviceFault
from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, Workspace
from pomona.executive.ports import FORCE, Force, Outputs, Port, Ratio
from pomona.executive.skill import Work
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.hold import Hold
from pomona.skills.grip.slide import NoSlideError, Slide, friction_of_slides, moves_with_pads
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.motion.robot import RobotModel
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from pomona.skills.shared.held_fruit import show_grip, watch_grip
from pomona.skills.shared.planning import space_around

# of the slides [m/s²], and time to reach it [s]
ACCELERATION = 0.4
JERK_TIME = 0.05

SLIDING = (0.4, 0.92)
"""Part of the distance, by the arm's joints, on which the pads slide: before it pads and skin deform, after it they
come to rest and creep back."""

RISING = 0.5  # upward path before and beyond the distance, relative to it: the fruit's weight comes on gently
DISTANCE = 2e-3  # path of the slides [m]
FEELING_SPEED = 0.02  # of the pads on it [m/s]
SETTLING = 0.1  # error of the grip force that counts as reached [N]

# of the friction that was felt, relative; the error was 2 % at the median of 15 fruit
LEAST_UNCERTAINTY = 0.04


class Felt(Outputs):
    """Outputs of FeelFriction."""

    mu: Annotated[Ratio, Port(help="friction of the pads on this fruit")]
    mu_uncertainty: Annotated[Ratio, Port(help="of it, relative")]


class FeelFriction(MovingSkill):
    """Measure the friction of a standing fruit by sliding the pads down and up, and use it from then on.

    With a light grip force the fruit stands still and the pads slide. Before, a short way up takes it off what carries
    it: then both pads press alike, and none pushes it down with the force of closing. At the end of the way up the force
    rises while they slide, so that the weight comes on them gently; pads that a linkage moves down meanwhile rise once
    more. A fruit that is lighter than the friction moves with the pads; then only the way down counts. If the pads do
    not slide, the configured friction is kept. The grip presses with `force_after` afterwards, however the slides end.
    """

    devices = (Arm, Gripper, ForceSensor, Workspace)
    moves = (Arm, Gripper)
    own_speed = True  # friction is measured at one speed of sliding
    failures = (*MOTION_FAILURES, "NOT_HELD", "LOST", "SENSOR_STALE", "SENSOR_SATURATED")

    def run(
        self,
        hold: Hold,
        force: Annotated[
            Force, Port(min="0.5 N", max="5 N", help="grip force while the pads slide up")
        ] = FORCE("0.7 N"),
        force_after: Annotated[
            Force,
            Port(
                min="0.6 N", max="10 N", help="grip force afterwards, before the lift", was="then"
            ),
        ] = FORCE("2.2 N"),
    ) -> Work[Felt]:
        if not hold.holds:
            raise self.failure("NOT_HELD", "no fruit is held, so no friction can be measured")
        hold = hold.under(self.device(Gripper))
        configured = hold.settings
        slide = Slide(configured.contact.mu, configured.mu_uncertainty, (np.nan, np.nan))
        try:
            try:
                slide = yield from self._measure(hold, force, force_after)
                slide = replace(slide, uncertainty=max(slide.uncertainty, LEAST_UNCERTAINTY))
                feedback = f"friction {slide.mu:.2f} ± {slide.uncertainty:.0%}"
                feedback += ", from the way down only" if slide.came_along else ""
            except NoSlideError as problem:
                feedback = f"{problem}: {slide.mu:.2f} ± {slide.uncertainty:.0%} is kept"
                yield from self._press(hold, force_after)
        finally:
            hold.slide(None)
        hold.set_friction(replace(configured.contact, mu=slide.mu), slide.uncertainty, force_after)
        show_grip(self, hold, everything=True)
        yield feedback
        return Felt(mu=slide.mu, mu_uncertainty=slide.uncertainty)

    def _measure(self, hold: Hold, force: float, force_after: float) -> Work[Slide]:
        """Slide down, and up with the force rising at the end; NoSlideError: blocked, or the pads did not slide."""
        settings = hold.settings
        more = RISING * DISTANCE
        self._line("down", -DISTANCE)  # a way that is not free is known before anything moves
        hold.slide(force)
        yield from self._slide(hold, self._line("up", more), more)
        down = DISTANCE + more
        wrenches_down = yield from self._slide(hold, self._line("down", -down), down)
        load_down = hold.estimate.load
        yield from self._press(hold, force)
        if moves_with_pads(wrenches_down, force, hold.estimate.force_sum, settings.expected_load):
            hold.slide(force_after)
        up = self._line("up", DISTANCE + more)
        wrenches_up = yield from self._slide(hold, up, DISTANCE + more, force_after)
        yield from self._press(hold, force_after)
        if (
            np.dot(load_down, hold.estimate.load) > 0.0
        ):  # a linkage moves closing pads down: relieve the fruit
            yield from self._slide(hold, self._line("up", more), more)
        return friction_of_slides(wrenches_up, wrenches_down, hold.estimate.bias_std, settings.rate)

    def _line(self, way: str, rise: float) -> Float64:
        """Return the joints of a path up by `rise` [m]; NoSlideError: it is blocked."""
        arm = self.device(Arm)
        robot = RobotModel.load(arm.description)
        q = arm.state().q
        T_base_goal = robot.tcp(q)
        T_base_goal[2, 3] += rise
        line = straight_line(robot, q, T_base_goal, step=0.25 * abs(rise))
        space = space_around(self, None, 0.0)
        blocked = space.first_blocked(line.q)
        if not line.complete or blocked is not None:
            reason = line.reason if blocked is None else space.explain(line.q[blocked + 1])[0]
            raise NoSlideError(f"the slide {way} is blocked: {reason}")
        return line.q

    def _press(self, hold: Hold, force: float) -> Watching:
        """Let the fingers press with this grip force [N], and wait until they do."""
        hold.slide(force)
        began = self.context.elapsed()
        # longest time for the grip force to be reached [s]
        while abs(hold.tracked_force - force) > SETTLING and self.context.elapsed() - began < 1.0:
            self._watch(hold)
            yield f"{hold.tracked_force:.1f} N, on the way to {force:.1f} N"

    def _slide(
        self, hold: Hold, line: Float64, way: float, then: float | None = None
    ) -> Work[Float64]:
        """Follow a line of length `way` [m]; return the wrenches of the slide, bias removed, shape (n, 2, 6).

        Beyond `DISTANCE` the grip force is `then` [N]. DeviceFault: the arm reports an arrival without a motion.
        """
        arm = self.device(Arm)
        trajectory = time_curve(
            line, way, arm.limits, FEELING_SPEED, ACCELERATION, ACCELERATION / JERK_TIME
        )
        robot = RobotModel.load(arm.description)
        start = robot.tcp(line[0])[:3, 3]
        samples: list[tuple[float, Float64]] = []
        stamps = []
        shares = []
        before = max(way - DISTANCE, 0.0) if then is None else 0.0

        def watch() -> None:
            self._watch(hold)
            state = arm.state()
            stamps.append(state.stamp)
            moved = float(np.linalg.norm(robot.tcp(state.q)[:3, 3] - start))
            shares.append((moved - before) / min(way, DISTANCE))
            if then is not None and shares[-1] > SLIDING[1]:
                hold.slide(then)

        listen = self.device(ForceSensor).subscribe
        subscription = listen(lambda sample: samples.append((sample.stamp, sample.wrenches.copy())))
        try:
            yield from self.travel(trajectory, watch)
            watch()
        finally:
            subscription.close()
        if max(shares) < SLIDING[0]:
            moved = f"moved {1e3 * (before + min(way, DISTANCE) * max(shares)):.1f} mm of {1e3 * way:.1f} mm by its joints"
            raise DeviceFault("arm", f"{moved}, but its driver reports its arrival")
        first, last = np.interp(SLIDING, np.maximum.accumulate(shares), stamps)
        sliding = [wrenches for stamp, wrenches in samples if first <= stamp <= last]
        return np.array(sliding).reshape(-1, 2, 6) - hold.bias

    def _watch(self, hold: Hold) -> None:
        watch_grip(self, hold)
        if not hold.holds:
            raise self.failure("LOST", "the grip is no longer under control")
