"""The grip controller: one object, stepped by the sensor's samples, that answers with a speed for the fingers.

bias -> closing -> ramp -> holding, with slip avoidance from there on for as long as it is stepped. It knows no device,
thread or tree: give `step` each sample, command what it returns.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.bias_check import check_bias
from pomona.skills.grip.command_timing import CommandTiming
from pomona.skills.grip.errors import UnfitSensor
from pomona.skills.grip.grip import IN_HAND, GripPhase, GripProblem, GripReading
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.reference import ForceReference
from pomona.skills.grip.sensor_watch import SensorWatch
from pomona.skills.grip.settings import ForceLaw, GripSettings
from pomona.skills.grip.slip_sense import SlipSense
from pomona.skills.grip.slip_watch import SlipWatch
from pomona.skills.grip.stream_guard import StreamGuard
from pomona.skills.grip.tracking import ForceTracker


class GripController:
    """Steps a grip from bias to slip avoidance.

    `width` and, where the gripper tells it, `motor_force` are to be kept up to date by the caller whenever
    `wants_width`. `problem` is what is wrong now, `friction_share` what is left of the friction told, `warnings`
    what was odd in the stream. A problem before HOLDING ends in phase FAILED with the fingers at rest; while HOLDING
    the grip is kept whatever the problem.
    """

    def __init__(self, settings: GripSettings) -> None:
        self.settings = settings
        self.phase = GripPhase.BIAS
        self.problem: GripProblem | None = None
        self.width = math.nan
        self.speed = 0.0
        self.slip = 0.0
        self.sense = SlipSense(
            settings.contact, settings.observer, settings.dynamic, settings.rate, settings.offset, settings.reserve,
            settings.filters,
        )  # fmt: skip
        self.reference = ForceReference(settings)
        self.motor_force: float | None = None
        self._guard = StreamGuard(settings.period)
        self._sensors = SensorWatch(settings.sensors, settings.rate)
        self._slips = SlipWatch(settings.slips, settings.rate)
        self.friction_share = 1.0
        self._hit_for = 0
        self._bias: list[Float64] = []
        self._dropped = 0
        self._timing = CommandTiming(settings.rate, settings.loop.command_period, settings.command)
        self._tracker = ForceTracker(settings.loop, settings.tracking)
        self._saturated = False
        self._pressed_alone = ""
        self._lasting = dict.fromkeys(("saturated", "gone", "beyond", "reached", "stuck", "dead"), 0.0)
        self._touched_at = math.nan
        self._last_width = math.nan

    # -------------------------------------------------------------------------------------------- for people

    @property
    def usable_until(self) -> float:
        """Stamp of the newest usable sample [s]; -inf before the first."""
        return self._guard.stamp

    @property
    def wants_width(self) -> bool:
        """True when the next step may command a speed and so needs `width`."""
        return self._timing.near

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is doubtful about the grip now, as sentences."""
        notes = (self.reference.frozen, self._pressed_alone)
        return (*self._guard.findings(), *(sentence for sentence in notes if sentence))

    @property
    def slip_speed(self) -> float:
        """Estimated speed of the fruit along the pads [m/s]."""
        return abs(self.sense.omega) * self.sense.centre

    @property
    def tracked_force(self) -> float:
        """The grasp force that is compared with the reference [N]: `SlipSense.f_n`, but where one finger says little.

        Twice the other one's where one finger feels nothing any more; while the pads slide one may press more.
        """
        highest = max(self.sense.finger_forces)
        if self._lasting["dead"] > 0.0:
            return 2.0 * highest
        apart = self.settings.watch.apart
        return max(self.sense.f_n, highest - apart) if self.phase is GripPhase.SLIDING else self.sense.f_n

    @property
    def at_rest(self) -> bool:
        """Whether a carried fruit is held as it will be: the force has come down to what it needs, nothing is wrong."""
        is_held = self.phase is GripPhase.HOLDING and self.problem is None
        return is_held and self.reference.carried and self.reference.settled

    @property
    def slipped(self) -> float:
        """How far the fruit has slid on the pads, as its contact's place says [m]."""
        return self._slips.slipped

    @property
    def reading(self) -> GripReading:
        """The grip of this moment, for records and viewers."""
        sense = self.sense
        return GripReading(
            self._guard.stamp, self.phase, sense.f_n, sense.finger_forces, self.reference.f_ref, sense.least, sense.f_t,
            sense.tau_n, self.slip_speed, self.slip, self.width, self.speed, self._saturated,
        )  # fmt: skip

    def row(self) -> tuple[float, ...]:
        """Stamp, f_n, f_ref, least, f_t, slip speed, width: one row of `GripSamples`."""
        sense = self.sense
        return (
            self._guard.stamp, sense.f_n, self.reference.f_ref, sense.least, sense.f_t, self.slip_speed, self.width
        )  # fmt: skip

    def pivot(self, on: bool) -> None:
        """While holding: let the fruit turn under gravity until it hangs plumb, or hold it again as it hangs."""
        if self.phase in (GripPhase.HOLDING, GripPhase.PIVOTING):
            self.phase = GripPhase.PIVOTING if on else GripPhase.HOLDING
            self.reference.pivoting = on
            self._slips.start()

    def slide(self, force: float | None) -> None:
        """While holding: press with this grasp force [N] and let the pads slide over the fruit; None: hold again."""
        if self.phase in (GripPhase.HOLDING, GripPhase.SLIDING):
            self.phase = GripPhase.HOLDING if force is None else GripPhase.SLIDING
            self.reference.sliding = force
            if force is None:
                self.sense.start_observer()
                self._slips.start()

    def set_friction(self, contact: SoftContact, mu_uncertainty: float, initial_force: float) -> None:
        """Take another friction, and another force to press with until the fruit is carried [N].

        The shape of the pressure stays as it was.
        """
        self.settings = replace(
            self.settings, contact=contact, mu_uncertainty=mu_uncertainty, initial_force=initial_force
        )
        self.sense.set_friction(contact)
        self.reference.set_friction(self.settings)

    # ---------------------------------------------------------------------------------------------- stepping

    def step(
        self, stamp: float, sequence: int, wrenches: Float64, saturated: tuple[bool, bool] = (False, False)
    ) -> float | None:
        """Take one sample.

        Args:
            stamp: when it was taken [s].
            sequence: its number.
            wrenches: of both fingers, shape (2, 6) [N, N·m], as in `WrenchSample`.
            saturated: whether a channel of a finger is at the end of its range.

        Returns:
            Rate of the opening to command now [m/s]; None most of the time. Never two within the loop's
            `command_period`; while the stream flows, often enough for the driver's watchdog (command_timing.py).
        """
        periods = self._guard.periods(stamp, sequence, wrenches)
        if periods == 0:
            return None
        self._saturated = saturated[0] or saturated[1]
        if self.phase is GripPhase.BIAS:
            self._take_bias(wrenches)
        else:
            touching = self.phase is GripPhase.RAMP or self.phase in IN_HAND
            expected = 0.0
            if touching:
                expected = self._tracker.expected(self.speed, self.sense.f_n, self.settings.period, periods)
            self.sense.carries = self.phase is GripPhase.HOLDING and self.reference.carried
            self.sense.advance(wrenches, periods, expected)
            self._last("saturated", self._saturated, periods)
            elapsed = periods * self.settings.period
            carried = self.reference.carried
            force_rate = self._tracker.moving * self.settings.loop.stiffness.slope(self.sense.f_n)
            self._sensors.look(wrenches, elapsed, saturated, self.sense, carried, force_rate)
            if self._sensors.reason and self.phase is not GripPhase.FAILED:
                self._distrust()
            if self.phase in IN_HAND:
                self._watch_hold(periods)
            sound = self.phase is GripPhase.HOLDING and not self._sensors.reason
            slides = sound and self._slips.look(wrenches, periods, self.sense, carried)
            # A fruit that is hit bears more than friction for a moment, and moves in soft pads without sliding.
            if slides and self.sense.hit == 0.0 and not self.reference.catching:
                self._learn_friction()
        hit_begins = self._hit_begins()
        if not self._timing.pass_time(periods) or hit_begins:
            return None
        if self.phase is not GripPhase.BIAS:
            self._sensors.compare_with_motor(self.sense.force_sum, self.motor_force, self._timing.interval)
        speed = self._command()
        if not self._timing.goes_out(speed, self.speed, self.phase in IN_HAND):
            return None
        self._tracker.commanded(self.reference.f_ref)
        self._last_width = self.width
        self.speed = speed
        return speed

    def _last(self, condition: str, true: bool, periods: int) -> float:
        """For how long a condition has lasted now [s]."""
        self._lasting[condition] = self._lasting[condition] + periods * self.settings.period if true else 0.0
        return self._lasting[condition]

    def _hit_begins(self) -> bool:
        """Whether something has just begun to push at the fruit: the first sample of it says too little to answer.

        The gripper takes the next rate only `command_period` later, so one is kept until the push has shown.
        """
        self._hit_for = self._hit_for + 1 if self.sense.hit > 0.0 else 0
        return 0 < self._hit_for < self.settings.command.hit_samples

    def _take_bias(self, wrenches: Float64) -> None:
        s, rate = self.settings.bias, self.settings.rate
        self._dropped += 1
        if self._dropped <= round(s.dropped * rate):
            return
        self._bias.append(np.array(wrenches))
        count, enough, most = len(self._bias), round(s.time * rate), round(s.longest * rate)
        if count < enough or (count % max(enough // 2, 1) and count < most):
            return
        samples = np.array(self._bias)
        error = float(samples[:, :, :3].std(axis=0).max()) / math.sqrt(count)
        if error > s.error and count < most:
            return
        self._bias.clear()
        try:
            check_bias(samples, rate, self.settings.bias_check)
        except UnfitSensor as unfit:
            self._fail("SENSOR_FAULT", str(unfit), measured=unfit.measured, expected=unfit.expected)
            return
        felt = float(np.abs(samples[:, :, 2].mean(axis=0)).max())
        self._sensors.calibrate(samples)
        self._slips.calibrate(samples)
        self.sense.calibrate_bias(samples)
        if felt > s.limit:
            self._fail(
                "FORCE_LIMIT", f"a finger feels {felt:.1f} N before the fingers close: nothing may touch", felt_n=felt
            )
        else:
            self.phase = GripPhase.CLOSING

    def _fail(self, code: str, message: str, **data: float) -> None:
        self.phase = GripPhase.FAILED
        self.problem = GripProblem(code, message, self._guard.stamp, data)

    def _learn_friction(self) -> None:
        """The fruit slides: its load lies on the limit surface of the force that presses, whatever was told.

        The least force is as good as inverse to the friction, so their ratio is the share of it that is there.
        """
        s, contact = self.settings.slips, self.settings.contact
        share = self.sense.least / max(self.sense.f_n, 0.1)
        if self.settings.law is not ForceLaw.SLIP_AVOIDANCE or not s.least_share < share < s.sure_share:
            return
        self.friction_share *= share
        self.settings = replace(self.settings, contact=replace(contact, mu=share * contact.mu))
        self.sense.set_friction(self.settings.contact)

    def _distrust(self) -> None:
        """The fingers' samples are not believed any more: a grip is kept as it is, none is made."""
        if self.phase in IN_HAND:
            self.reference.distrust(self._sensors.reason)
        else:
            self._fail("SENSOR_FAULT", self._sensors.reason, width=self.width)

    def _command(self) -> float:
        if self.phase is GripPhase.CLOSING:
            return self._close()
        if self.phase is GripPhase.RAMP:
            return self._ramp()
        if self.phase in IN_HAND:
            return self._hold()
        return 0.0

    # --------------------------------------------------------------------------------------- before the hold

    def _close(self) -> float:
        s, sense = self.settings, self.sense
        touch = [force > s.watch.contact for force in sense.finger_forces]
        if self._refused_before_hold():
            return 0.0
        if all(touch):
            self.phase = GripPhase.RAMP
            self.reference.begin(sense.f_n)
            return 0.0
        if any(touch) and math.isnan(self._touched_at):
            self._touched_at = self.width
        at_end = self.width <= max(s.width_min + s.watch.stroke_end, s.narrowest)
        pushed = 0.5 * (self._touched_at - self.width)
        if any(touch) and (pushed > s.off_centre or max(sense.finger_forces) > s.watch.push_limit or at_end):
            side = ("left", "right")[touch[1]]
            message = f"only the {side} finger touches: it pushed the fruit {1e3 * pushed:.1f} mm with "
            self._fail("ONE_FINGER", f"{message}{max(sense.finger_forces):.1f} N", pushed=pushed, width=self.width)
            return 0.0
        if at_end:
            message = (
                f"no finger touched anything down to an opening of {1e3 * self.width:.1f} mm: the fruit has moved, or "
            )
            self._fail("NO_CONTACT", f"{message}camera or tool are not where the cell says", width=self.width)
            return 0.0
        if self._stuck():
            self._fail("NO_CONTACT", "the fingers do not move although they should close", width=self.width)
            return 0.0
        far = s.contact_width is not None and self.width > s.contact_width and not any(touch)
        braking = s.approach_speed * s.loop.command_period * 2.0
        if far and s.contact_width is not None and self.width - s.contact_width > braking:
            return -s.approach_speed
        return -s.contact_speed

    def _ramp(self) -> float:
        s, sense = self.settings, self.sense
        if self._refused_before_hold():
            return 0.0
        if self.width <= s.width_min + s.watch.stroke_end and sense.f_n < s.initial_force - 0.2:
            message = f"the gripper's stroke ends at {1e3 * self.width:.1f} mm with {sense.f_n:.1f} N"
            self._fail("OUT_OF_STROKE", message, width=self.width, f_n=sense.f_n)
            return 0.0
        if self._last("gone", min(sense.finger_forces) < s.watch.gone, self._timing.every) > 2.0 * s.watch.gone_after:
            self._lost_in_ramp()
            return 0.0
        f_ref = self.reference.ramp(self._timing.interval)
        reached = f_ref >= s.initial_force and sense.f_n >= 0.9 * s.initial_force
        if self._last("reached", reached, self._timing.every) > 1.5 * self._timing.interval:
            self.phase = GripPhase.HOLDING
            self.reference.stand(self.sense.load)
            self.sense.start_observer()
            self._slips.start()
        elif f_ref >= s.initial_force and not reached and self._stuck():
            message = f"the fingers stand still at {sense.f_n:.1f} N and do not reach {s.initial_force:.1f} N"
            self._fail("FORCE_LIMIT", message, f_n=sense.f_n, f_ref=f_ref)
            return 0.0
        return self._track(opening=False)

    def _lost_in_ramp(self) -> None:
        # A fruit that one finger pushes may hop to the other one and back: closing goes on, and is bounded as before.
        if max(self.sense.finger_forces) > self.settings.watch.contact:
            self.phase = GripPhase.CLOSING
        else:
            self._fail("NO_CONTACT", "the fruit slipped away while the force rose", width=self.width)

    def _refused_before_hold(self) -> bool:
        sense, loop = self.sense, self.settings.loop
        if self._lasting["saturated"] > self.settings.watch.saturated_after:
            self._fail("SENSOR_SATURATED", "a finger's channel is at the end of its range", f_n=sense.f_n)
        elif max(sense.finger_forces) > 0.5 * loop.max_force:
            message = f"a finger feels {max(sense.finger_forces):.1f} N, more than half of {loop.max_force:.1f} N"
            self._fail("FORCE_LIMIT", message, left=sense.finger_forces[0], right=sense.finger_forces[1])
        return self.phase is GripPhase.FAILED

    def _stuck(self) -> bool:
        """Whether the fingers have not moved for a while although they were told to close."""
        still = self.speed < -1e-3 and abs(self.width - self._last_width) < 1e-5
        return self._last("stuck", still, self._timing.every) > self.settings.watch.stuck_after

    # -------------------------------------------------------------------------------------------- the hold

    def _watch_hold(self, periods: int) -> None:
        s, sense, limits = self.settings, self.sense, self.settings.watch
        elapsed = periods * s.period
        if sense.one_sided_jump and self.reference.carried:
            self.reference.freeze("one finger's signal jumped alone: the force is not lowered any more")
        if sense.one_sided_press and self.reference.carried:
            self._pressed_alone = "one finger's normal force jumped alone: the smaller one counts"
        if self._sensors.doubt:
            self.reference.freeze(f"{self._sensors.doubt}: the force is not lowered any more")
        left, right = sense.finger_forces
        low, high = min(left, right), max(left, right)
        slides = self.phase is GripPhase.SLIDING
        dead = self._last("dead", low < limits.dead * high and high > limits.alive and not slides, periods) > 0.0
        f_n = 2.0 * high if dead else sense.f_n
        needed = sense.coulomb if self.phase is GripPhase.PIVOTING else sense.least
        beyond = self._last("beyond", needed > limits.beyond * f_n and not slides, periods)
        if needed > limits.slipping * f_n and not slides:
            self.slip += self.slip_speed * elapsed
        stamp, slipped = self._guard.stamp, self._slips.slipped if self.phase is GripPhase.HOLDING else 0.0
        if self._sensors.reason:
            message = f"{self._sensors.reason}; the grip is kept"
            self.problem = GripProblem("SENSOR_FAULT", message, stamp, {"left_force_n": left, "right_force_n": right})
        elif self._lasting["saturated"] > limits.saturated_after:
            message = "a finger's channel is at the end of its range; the force is neither raised nor lowered"
            self.problem = GripProblem("SENSOR_SATURATED", message, stamp, {"force_n": f_n})
        elif self._last("gone", high < limits.gone, periods) > limits.gone_after:
            message = f"the fruit is gone: {left:.2f} N and {right:.2f} N at {1e3 * self.width:.1f} mm"
            self.problem = GripProblem("LOST", message, stamp, {"width_m": self.width})
        elif dead and self._lasting["dead"] > limits.gone_after:
            self.reference.freeze("one finger feels nothing any more: the other one's force counts twice")
            message = f"one finger feels nothing any more ({left:.2f} N, {right:.2f} N); the grip is kept"
            self.problem = GripProblem("ONE_FINGER", message, stamp, {"left_force_n": left, "right_force_n": right})
        elif max(self.slip, slipped) > s.slip_limit or beyond > limits.beyond_after:
            slip = max(self.slip, slipped)
            message = f"the fruit slips: about {1e3 * slip:.1f} mm, needs {needed:.1f} N, has {f_n:.1f} N"
            self.problem = GripProblem("SLIPPED", message, stamp, {"slip_m": slip, "least_force_n": needed})
        elif self.reference.wanted > s.loop.max_force:
            message = f"the load needs {self.reference.wanted:.1f} N, the limit is {s.loop.max_force:.1f} N"
            data = {
                "wanted_force_n": self.reference.wanted,
                "for_weight_alone_n": self.reference.for_weight,
                "limit_n": s.loop.max_force,
            }
            self.problem = GripProblem("FORCE_LIMIT", message, stamp, data)
        else:
            self.problem = None
        # What is missing is judged by both fingers together: a fruit presses on both alike, a drifting sensor does not.
        force_sum = 2.0 * high if dead else max(sense.force_sum, 0.0)
        coming = -self.speed * s.loop.lag * s.loop.stiffness.slope(force_sum)
        self.reference.follow(sense, force_sum + coming, elapsed)

    def _hold(self) -> float:
        if self._saturated or self._sensors.still or self._lasting["gone"] > 0.0:
            return 0.0
        return self._track(opening=not self.reference.frozen and not self.sense.one_sided_press)

    def _track(self, opening: bool) -> float:
        f_n, f_ref = self.tracked_force, self.reference.f_ref
        if self.phase is GripPhase.RAMP:
            speed = self._tracker.on_ramp(f_ref, f_n, self.speed)
        else:
            # A moment shows late and grows fast: rather too much force than too little.
            feedthrough = min(self.sense.twist, 1.0)
            band = self.sense.normal_noise_band
            hardest = 2.0 * max(self.sense.finger_forces)
            speed = self._tracker.while_holding(f_ref, f_n, self.speed, band, feedthrough, hardest)
        return speed if opening else min(speed, 0.0)
