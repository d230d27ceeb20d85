"""One trial of a grip controller on a fruit: close, lift, hold, perhaps a pull; and its result."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.grasp_mujoco import MujocoGrasp, least_grasp_force_of_cone
from benchmarks.grasp_patch import GRAVITY, Fruit, PatchGrasp
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.grip import GripPhase
from pomona.skills.grip.limit_surface import SoftContact, least_force, xi
from pomona.skills.grip.settings import GripSettings

TORQUE_LEVER = 0.005
"""Noise of a torque is the noise of a force at this lever [m]."""

GRASPED_WITHIN = 8.0
"""A grasp that takes longer has failed [s]; 20 N take 3.3 s to build up, a bias in noise 1.6 s."""

LOST_AFTER = 0.01
"""A fruit that has moved so far on the pads is lost [m]."""

TOLD_WITHIN = 0.05
"""Deadline for the report of a lost fruit [s]."""

Corrupt = Callable[[int, float, Float64], list[tuple[int, float, Float64]]]
Watch = Callable[[float, GripController, PatchGrasp | MujocoGrasp], None]


@dataclass(frozen=True, slots=True)
class Lifting:
    """Motion of the gripped fruit: the lift of the skill Lift, then a time of holding with a pull in it.

    Attributes:
        height [m], acceleration: peak of the lift [m/s²]; reached within `jerk_time` [s].
        hold: time after the lift [s].
        pull: downward force [N] that grows within `pull_rise` [s] and has gone after `pull_time` [s]; 0 for none.
    """

    height: float = 0.15
    acceleration: float = 2.0
    jerk_time: float = 0.2
    hold: float = 2.0
    pull: float = 0.0
    pull_rise: float = 0.05
    pull_time: float = 0.3

    @property
    def _speeding(self) -> float:
        """Time from rest to top speed [s]: jerk up, constant, jerk down; no cruise."""
        a, j = self.acceleration, self.jerk_time
        constant = 0.5 * (-3.0 * j + math.sqrt(j * j + 4.0 * self.height / a))
        return max(constant, 0.0) + 2.0 * j

    @property
    def duration(self) -> float:
        """Of the lift [s]."""
        return 2.0 * self._speeding

    def acceleration_at(self, t: float) -> float:
        """Of the gripper so long after the lift began [m/s²]."""
        T = self._speeding
        if not 0.0 < t < 2.0 * T:
            return 0.0
        u = t if t < T else t - T
        shape = min(u, T - u, self.jerk_time) / self.jerk_time
        return math.copysign(shape * self.acceleration, T - t)


@dataclass(slots=True)
class Trace:
    """A trial over time, one entry a sample."""

    t: list[float] = field(default_factory=list)
    f_n: list[float] = field(default_factory=list)
    f_ref: list[float] = field(default_factory=list)
    least_sensed: list[float] = field(default_factory=list)
    slip: list[float] = field(default_factory=list)
    turn: list[float] = field(default_factory=list)
    speed: list[float] = field(default_factory=list)
    width: list[float] = field(default_factory=list)
    commands: list[tuple[float, float]] = field(default_factory=list)
    """Time [s] and speed [m/s] of each command, from the first sample on."""


@dataclass(frozen=True, slots=True)
class TrialResult:
    """Result of a trial.

    Attributes:
        grasped: the controller reached its hold; held: the fruit was still there at the end.
        slip [m] and turn [rad]: largest motion of the fruit on the pads since the grip was made.
        steady, peak: grasp force at the end and at most [N].
        least: theoretical least grasp force for the fruit's weight [N].
        pressure: largest contact pressure [Pa].
        contact_peak: largest force of a finger before the force ramp [N].
        grasp_time: from the first sample to the hold [s].
        pull_slip: motion of the fruit on the pads through the pull [m].
        reaction: from the start of the pull to a faster closing [s]; nan without a pull.
        told: a lost fruit was reported with a code within `TOLD_WITHIN`; True without a loss.
    """

    grasped: bool
    held: bool
    slip: float
    turn: float
    steady: float
    peak: float
    least: float
    pressure: float
    contact_peak: float
    grasp_time: float
    pull_slip: float
    reaction: float
    told: bool
    trace: Trace


def least_grasp_force(fruit: Fruit) -> float:
    """Theoretical least grasp force of a fruit that hangs still, from the limit surface's integrals [N]."""
    contact = SoftContact(fruit.mu, fruit.delta, fruit.gamma, fruit.k)
    weight = fruit.mass * GRAVITY
    return 2.0 * float(least_force(0.5 * weight, 0.5 * weight * abs(fruit.offset[0]), contact))


def peak_pressure(f_n: float, fruit: Fruit) -> float:
    """Pressure in the middle of a finger's contact [Pa]."""
    rho = fruit.delta * f_n**fruit.gamma
    return float(xi(fruit.k) * f_n / (math.pi * rho**2))


def run_trial(
    fruit: Fruit,
    settings: GripSettings,
    lifting: Lifting,
    noise: float = 0.0,
    seed: int = 0,
    corrupt: Corrupt | None = None,
    world: type[PatchGrasp] | type[MujocoGrasp] = PatchGrasp,
    watch: Watch | None = None,
    control: type[GripController] = GripController,
) -> TrialResult:
    """Grasp, lift and hold a fruit.

    Args:
        fruit, settings, lifting: the trial.
        noise: standard deviation of the forces' white noise [N].
        seed: of the noise and the bias.
        world: the contact model.
        corrupt: turns a sample (sequence, stamp, wrenches) into those that arrive, after the grip was made.
        watch: sees time, controller and world after every sample.
        control: the controller.
    """
    rng = np.random.default_rng(seed)
    scale = np.array([1.0, 1.0, 1.0, TORQUE_LEVER, TORQUE_LEVER, TORQUE_LEVER])
    bias = rng.uniform(-0.15, 0.15, (2, 6)) * scale
    period = settings.period
    grasp = world(fruit, sample=period)
    least = least_grasp_force(fruit) if world is PatchGrasp else least_grasp_force_of_cone(fruit)
    controller = control(replace(settings, width_min=0.02))
    trace = Trace()
    held_at = pull_at = reaction = lost_at = told_at = math.nan
    origin, turn_0 = (0.0, 0.0), 0.0
    contact_peak = peak = 0.0
    commanded_at = 0.0
    n = 0
    while True:
        t = n * period
        true = grasp.step()
        measured = true + bias + rng.normal(0.0, 1.0, (2, 6)) * (noise * scale)
        arriving = (
            [(n, t, measured)]
            if corrupt is None or math.isnan(held_at)
            else corrupt(n, t, measured)
        )
        for sequence, stamp, wrenches in arriving:
            if controller.wants_width:
                controller.width = grasp.width
            speed = controller.step(stamp, sequence, wrenches)
            if speed is not None:
                grasp.command, commanded_at = speed, t
                trace.commands.append((t, speed))
        if t - commanded_at > 0.1:
            grasp.command = 0.0  # the driver's watchdog
        if watch is not None:
            watch(t, controller, grasp)
        f_n = grasp.f_n
        if controller.phase in (GripPhase.BIAS, GripPhase.CLOSING):
            contact_peak = max(contact_peak, float(-true[:, 2].min()))
        if math.isnan(held_at):
            if controller.phase is GripPhase.HOLDING:
                held_at, origin, turn_0 = t, grasp.place, grasp.turn
            elif controller.phase is GripPhase.FAILED or t > GRASPED_WITHIN:
                return TrialResult(
                    False, False, 0, 0, 0, 0, least, 0, contact_peak, t, 0, math.nan, True, trace
                )
        else:
            since = t - held_at - 0.04
            grasp.acceleration = lifting.acceleration_at(since + 0.5 * period)
            pulled = since - lifting.duration - 0.5 * lifting.hold
            if lifting.pull and pulled >= 0.0:
                if math.isnan(pull_at):
                    pull_at, quiet = t, min(trace.speed[-round(0.12 / period) :])
                share = min(pulled / lifting.pull_rise, 1.0) if pulled < lifting.pull_time else 0.0
                grasp.pull = (0.0, -lifting.pull * share)
                if math.isnan(reaction) and grasp.command < min(quiet, 0.0) - 0.002:
                    reaction = t - pull_at
            peak = max(peak, f_n)
            slip = math.hypot(grasp.place[0] - origin[0], grasp.place[1] - origin[1])
            if math.isnan(lost_at) and (slip > LOST_AFTER or f_n < 0.05):
                lost_at = t
            if math.isnan(told_at) and controller.problem is not None:
                told_at = t
            trace.t.append(t)
            trace.f_n.append(f_n)
            reading = controller.reading
            trace.f_ref.append(reading.f_ref)
            trace.least_sensed.append(reading.f_least)
            trace.slip.append(slip)
            trace.turn.append(grasp.turn - turn_0)
            trace.speed.append(grasp.command)
            trace.width.append(grasp.width)
            if since > lifting.duration + lifting.hold:
                break
        n += 1
    return TrialResult(
        grasped=True,
        held=grasp.off_table and trace.f_n[-1] > 0.05 and trace.slip[-1] < LOST_AFTER,
        slip=max(trace.slip),
        turn=float(np.abs(trace.turn).max()),
        steady=float(np.mean(trace.f_n[-round(0.3 / period) :])),
        peak=peak,
        least=least,
        pressure=peak_pressure(0.5 * peak, fruit),
        contact_peak=contact_peak,
        grasp_time=held_at,
        pull_slip=0.0
        if math.isnan(pull_at)
        else float(np.ptp(trace.slip[round((pull_at - trace.t[0]) / period) :])),
        reaction=reaction,
        told=math.isnan(lost_at) or told_at <= lost_at + TOLD_WITHIN,
        trace=trace,
    )
