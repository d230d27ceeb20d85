"""The grip controller: each sample of the sensor steps it, and the result is a speed for the fingers.

    sample -> GripEstimate -> monitors -> ForceReference -> speed

`ForceReference` has the mode, of which the phase is derived: BIAS, CLOSING, RAMP, then HOLDING with slip avoidance for
as long as samples come. The controller uses no device, thread or tree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.closing import Closing
from pomona.skills.grip.estimate import Estimator, GripEstimate
from pomona.skills.grip.grip import (
    FREEZING,
    HELD,
    IN_HAND,
    GripMode,
    GripPhase,
    GripProblem,
    GripReading,
    UnfitSensor,
)
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.monitors import (
    FingerForceMonitor,
    GripState,
    Monitor,
    SaturationMonitor,
    SlipMonitor,
    SlipWatch,
    first_problem,
    has_dead_finger,
    hold_monitors,
)
from pomona.skills.grip.reference import ForceReference, Levels, Mode, usual_modes
from pomona.skills.grip.sensor import BiasRecorder, GripSample, SensorWatch, StreamGuard, check_bias
from pomona.skills.grip.settings import ForceLaw, GripSettings, check_rate
from pomona.skills.grip.tracking import CommandTiming, ForceTracker


class GripController:
    """Steps a grip from bias to slip avoidance.

    A problem before HOLDING ends in phase FAILED with the fingers at rest; while HOLDING the grip is kept with any
    problem.

    Attributes:
        settings: of the grip; its friction is lowered when the fruit slips.
        problem: the most serious one now, or None.
        width, motor_force: opening [m] and, where the gripper reports it, force of the motor [N]; the caller updates
            both whenever `wants_width`.
        speed: rate of the opening that was commanded last [m/s].
        friction_share: estimated over configured friction coefficient.
        rests: set by the caller while something else carries the fruit: fingers and reference stay as they are.
        acceleration: of the hand, as a multiple of gravity, set by the caller.
    """

    def __init__(
        self, settings: GripSettings, modes: Callable[[Levels], Iterable[Mode]] = usual_modes
    ) -> None:
        self.settings = settings
        self.problem: GripProblem | None = None
        self.width = math.nan
        self.speed = 0.0
        self.motor_force: float | None = None
        self.friction_share = 1.0
        self.rests = False
        self.acceleration = 0.0
        self._told = settings.contact
        self._learned_at = -math.inf
        self._guard = StreamGuard(settings.period)
        self._bias = BiasRecorder(settings.bias, settings.rate)
        self._estimator = Estimator(settings)
        self._reference = ForceReference(settings, modes)
        self._tracker = ForceTracker(settings.loop, settings.tracking)
        self._timing = CommandTiming(settings.rate, settings.loop.command_period, settings.command)
        self._closing = Closing(settings, self._reference, self._tracker, self._timing.interval)
        self._sensors = SensorWatch(settings)
        self._slips = SlipWatch(settings.slips, settings.rate)
        self._slip = SlipMonitor(settings, self._slips)
        saturation = SaturationMonitor(settings.watch)
        self._before_hold: tuple[Monitor, ...] = (
            saturation,
            FingerForceMonitor(settings.loop.max_force),
        )
        self._while_holding = hold_monitors(settings, self._sensors, saturation, self._slip)
        self._saturated = (False, False)
        self._pushed_samples = 0
        self._found: GripProblem | None = None

    # --------------------------------------------------------------------------------------------- for skills

    @property
    def estimate(self) -> GripEstimate:
        """Estimate after the newest sample."""
        return self._estimator.estimate

    @property
    def mode(self) -> GripMode:
        """Mode of the grip."""
        return self._reference.mode

    @property
    def phase(self) -> GripPhase:
        """Phase of `mode`."""
        return self._reference.mode.phase

    @property
    def bias(self) -> Float64:
        """Reading of the fingers with nothing between them, shape (2, 6) [N, N·m]; not to be changed."""
        return self._estimator.bias

    @property
    def usable_until(self) -> float:
        """Timestamp of the newest valid sample [s]; -inf before the first."""
        return self._guard.stamp

    @property
    def wants_width(self) -> bool:
        """True when the next step may command a speed and so needs `width`."""
        return self._timing.near

    @property
    def tracked_force(self) -> float:
        """Grip force that is compared with the reference [N].

        That is `GripEstimate.f_n`; if one sensor reads nothing, twice the other finger's force. While the pads slide,
        one finger may press more than the other by `apart`.
        """
        estimate = self.estimate
        watch = self.settings.watch
        if self.mode is GripMode.SLIDING:
            return max(estimate.f_n, estimate.stronger - watch.apart)
        return (
            2.0 * estimate.stronger if has_dead_finger(estimate, self.mode, watch) else estimate.f_n
        )

    @property
    def is_carried(self) -> bool:
        """True for a fruit that hangs in the fingers."""
        return self._reference.is_carried

    @property
    def has_settled(self) -> bool:
        """True when the force has fallen to the requirement of the load."""
        return self._reference.has_settled

    @property
    def is_at_rest(self) -> bool:
        """True for a carried fruit without a problem, when the force has fallen to its requirement."""
        is_held = self.mode in HELD and self.problem is None
        return is_held and self.is_carried and self.has_settled

    @property
    def is_frozen(self) -> bool:
        """True when the force may not fall any more."""
        return bool(self._reference.frozen)

    @property
    def slipped(self) -> float:
        """Distance that the fruit has slid on the pads, by its centre of pressure [m]."""
        return self._slips.slipped

    @property
    def turned(self) -> float:
        """Motion of the load's lever arm since it settled, while the hand keeps its direction [m]."""
        return self._slips.turned

    @property
    def reading(self) -> GripReading:
        """The grip of this moment, for records and viewers."""
        estimate = self.estimate
        return GripReading(
            stamp=self._guard.stamp,
            phase=self.phase,
            f_n=estimate.f_n,
            finger_forces=(estimate.left, estimate.right),
            f_ref=self._reference.f_ref,
            f_least=estimate.f_least,
            f_t=estimate.f_t,
            tau_n=estimate.tau_n,
            slip_speed=estimate.slip_speed,
            slip=self._slip.slip,
            width=self.width,
            speed=self.speed,
            saturated=any(self._saturated),
        )

    def row(self) -> tuple[float, ...]:
        """Return one row of `GripSamples`."""
        e = self.estimate
        return (
            self._guard.stamp,
            e.f_n,
            self._reference.f_ref,
            e.f_least,
            e.f_t,
            e.slip_speed,
            self.width,
        )

    def slide(self, force: float | None) -> None:
        """While holding: press with this grip force [N] and let the pads slide over the fruit; None: hold again."""
        if self._reference.slide(force) and force is None:
            self._start_slip_detection()

    def stand_until_lifted(self, stands: bool) -> None:
        """See `ForceReference.stand_until_lifted`."""
        self._reference.stand_until_lifted(stands)

    def set_friction(
        self, contact: SoftContact, mu_uncertainty: float, initial_force: float
    ) -> None:
        """Use another friction, and another force until the fruit is carried [N].

        The shape of the pressure stays as it was.
        """
        self._told = contact
        self.settings = replace(
            self.settings, mu_uncertainty=mu_uncertainty, initial_force=initial_force
        )
        self._trust(1.0)
        self._reference.set_friction(self.settings)

    # ---------------------------------------------------------------------------------------------- stepping

    def step(
        self,
        stamp: float,
        sequence: int,
        wrenches: Float64,
        saturated: tuple[bool, bool] = (False, False),
    ) -> float | None:
        """Take one sample.

        Args:
            stamp: its time [s].
            sequence: its number.
            wrenches: of both fingers, shape (2, 6) [N, N·m], as in `WrenchSample`.
            saturated: True for a finger with a channel at the end of its range.

        Returns:
            Rate of the opening to command now [m/s]; None most of the time. Never two within the loop's
            `command_period`; while the stream flows, often enough for the driver's watchdog (tracking.py).
        """
        sample = self._guard.accept(stamp, sequence, wrenches, saturated)
        if sample is None:
            return None
        self._saturated = sample.saturated
        if self.mode is GripMode.BIAS:
            self._take_bias(sample)
        else:
            self._observe(sample)
        push_begins = self._push_begins()
        if not self._timing.pass_time(sample.periods) or push_begins:
            return None
        speed = self._command(sample)
        if not self._timing.goes_out(speed, self.speed, self.mode in IN_HAND):
            return None
        self._tracker.commanded(self._reference.f_ref)
        self.speed = speed
        return speed

    def _take_bias(self, sample: GripSample) -> None:
        samples = self._bias.add(sample.wrenches)
        if samples is None:
            return
        try:
            check_bias(samples, self.settings.rate, self.settings.bias)
        except UnfitSensor as unfit:
            self._fail("SENSOR_FAULT", str(unfit), measured=unfit.measured, expected=unfit.expected)
            return
        self._sensors.calibrate(samples)
        self._slips.calibrate(samples)
        self._estimator.calibrate(samples)
        force = float(np.abs(samples[:, :, 2].mean(axis=0)).max())
        if force > self.settings.bias.limit:
            self._fail(
                "FORCE_LIMIT",
                f"a finger reads {force:.1f} N before the fingers close: nothing may touch it",
                felt_n=force,
            )
        else:
            self._reference.close()

    def _fail(self, code: str, message: str, **data: float) -> None:
        self._reference.fail()
        self.problem = GripProblem(code, message, self._guard.stamp, data)

    def _observe(self, sample: GripSample) -> None:
        s = self.settings
        is_carried = self.is_carried
        in_hand = self.mode in IN_HAND
        expected = 0.0
        if in_hand or self.mode is GripMode.RAMP:
            expected = self._tracker.expected(self.speed, self._guard.period, sample.periods)
        may_be_pushed = is_carried and self.mode in HELD
        estimate = self._estimator.advance(sample.wrenches, sample.periods, expected, may_be_pushed)
        now = self._now(sample)
        force_rate = self._tracker.moving * s.loop.stiffness
        # A support that carries the fruit may press on one finger alone.
        hangs = is_carried and not self.rests
        self._sensors.check(sample, estimate, hangs, force_rate, self.acceleration)
        if in_hand:
            self._watch_hold(now)
        elif self.mode is not GripMode.FAILED and self._sensors.reason:
            self._fail("SENSOR_FAULT", self._sensors.reason, width=self.width)
        self._found = None if in_hand else first_problem(self._before_hold, now)
        if self.mode in HELD and not self._sensors.reason and not self.rests:
            if self.friction_share < 1.0:
                lost = (1.0 - self.friction_share) * math.exp(-sample.elapsed / s.slips.forgets)
                self._trust(1.0 - lost)
            slides = self._slips.check(estimate, sample.periods, is_carried)
            # A fruit that was hit bears more than friction for a moment, and moves in soft pads without sliding.
            if slides and estimate.push == 0.0 and self.mode is not GripMode.CATCHING:
                self._learn_friction()

    def _now(self, sample: GripSample) -> GripState:
        reference = self._reference
        estimate = self.estimate
        is_dead = has_dead_finger(estimate, reference.mode, self.settings.watch)
        return GripState(
            sample,
            estimate,
            reference.mode,
            self.width,
            reference.wanted,
            reference.for_weight,
            is_dead,
        )

    def _watch_hold(self, now: GripState) -> None:
        self.problem = first_problem(self._while_holding, now)
        if self._sensors.doubt:
            self._reference.freeze(self._sensors.doubt)
        if self._sensors.reason:
            self._reference.distrust(self._sensors.reason)
        elif self.problem is not None and self.problem.code in FREEZING:
            self._reference.freeze(self.problem.message)
        if self.rests:
            return
        # Both fingers together show the lack of force: a fruit presses on both alike, a drifting sensor does not.
        estimate = now.estimate
        loop = self.settings.loop
        force_sum = 2.0 * estimate.stronger if now.has_dead_finger else max(estimate.force_sum, 0.0)
        coming = -self.speed * loop.lag * loop.stiffness
        self._reference.follow(estimate, force_sum + coming, now.sample.elapsed)

    def _push_begins(self) -> bool:
        """Return True at the first sample of a push, which shows too little of it to answer.

        The gripper takes the next rate only `command_period` later, so one is kept until the push has shown.
        """
        self._pushed_samples = self._pushed_samples + 1 if self.estimate.push > 0.0 else 0
        return 0 < self._pushed_samples < self.settings.command.push_samples

    def _learn_friction(self) -> None:
        """Lower the friction after slip: the load of a sliding fruit lies on the limit surface of the measured force.

        The minimum force is nearly inverse to the friction, so their ratio is the share of it that is there. One slip
        shows several times and counts once; all corrections together stay within what is uncertain.
        """
        s = self.settings.slips
        stamp = self._guard.stamp
        share = self.estimate.f_least / max(self.estimate.f_n, 0.1)
        if (
            self.settings.law is not ForceLaw.SLIP_AVOIDANCE
            or stamp - self._learned_at < s.place_lags[-1]  # as long as the slip still shows
            or not s.least_ratio < share < s.sure_ratio
        ):
            return
        self._learned_at = stamp
        least = 1.0 - s.learns_most * self.settings.mu_uncertainty
        self._trust(max(share * self.friction_share, least))

    def _trust(self, share: float) -> None:
        """Use this share of the friction that was told."""
        self.friction_share = share
        self.settings = replace(
            self.settings, contact=replace(self._told, mu=share * self._told.mu)
        )
        self._estimator.set_friction(self.settings.contact)

    # -------------------------------------------------------------------------------------------- commanding

    def _command(self, sample: GripSample) -> float:
        """Return the rate of the opening for the phase [m/s]."""
        if self.mode is GripMode.BIAS:
            return 0.0
        estimate = self.estimate
        self._sensors.compare_with_motor(
            estimate.force_sum, self.motor_force, self._timing.interval
        )
        if self.mode in (GripMode.CLOSING, GripMode.RAMP):
            return self._close(self._now(sample))
        is_gone = estimate.stronger < self.settings.watch.gone
        if (
            self.mode not in IN_HAND
            or self.rests
            or any(sample.saturated)
            or self._sensors.no_signal
            or is_gone
        ):
            return 0.0
        return self._track(may_open=not self.is_frozen and not estimate.one_presses_more)

    def _close(self, now: GripState) -> float:
        closing = self._closing
        speed = (
            closing.command(now, self.speed) if self._found is None else closing.fail(self._found)
        )
        self.problem = closing.problem
        if self.mode not in HELD:
            return speed
        self._start_slip_detection()
        return self._track(may_open=False)

    def _start_slip_detection(self) -> None:
        self._estimator.restart_observer()
        self._slips.start()

    def _track(self, may_open: bool) -> float:
        """Return the rate that brings the force to its reference [m/s]."""
        estimate = self.estimate
        # A moment shows late and grows fast: with it the gain acts on the whole error.
        feedthrough = min(estimate.twist, 1.0)
        speed = self._tracker.while_holding(
            self._reference.f_ref,
            self.tracked_force,
            self.speed,
            estimate.f_n_band,
            feedthrough,
            2.0 * estimate.stronger,
        )
        return speed if may_open else min(speed, 0.0)


def warm_up(rate: float = 500.0) -> None:
    """Compile the loops of a grip before the clock of a run starts, by stepping a controller through its phases.

    Args:
        rate: of the sensor's samples [Hz].

    Raises:
        UnusableRate: no grip can use such a sensor.
    """
    check_rate(rate)
    controller = GripController(GripSettings())
    controller.width = 0.08
    wrenches = np.zeros((2, 6))
    for i in range(300):
        wrenches[:, 2] = 0.0 if i < 120 else -1.0
        controller.step(0.002 * i, i, wrenches)
