"""Settings of a grip, with defaults that hold an apple.

Every line has the quantity with its unit, the effect of a larger value, and the source: the paper, or an entry of
docs/decisions.md (lying-sensors is "Grip: lying sensors"). Those of the force loop have the quantity alone. Defaults were
found on the random lifts of `make bench-grasp` and on picks of the simulated cell. Another gripper, sensor or fruit may
need other values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from pomona.skills.grip.grip import UnusableRate
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.observer import DynamicSettings, ObserverSettings

RATES = (100.0, 2000.0)
"""Sample rates that a grip can use [Hz]: slower sensors miss a load that passes within 20 ms, faster ones leave no time
for a step."""


class ForceLaw(Enum):
    """Slip avoidance (the classes `Mode` of reference.py), or a baseline to compare it with (`Levels.baseline`)."""

    SLIP_AVOIDANCE = "slip_avoidance"
    STATIC = "static"
    COULOMB = "coulomb"
    CONSTANT = "constant"


@dataclass(frozen=True, slots=True)
class BiasSettings:
    """Recording of the bias, and the check of the sensor by it."""

    dropped: float = 0.02  # start of the stream that is left out [s]; later grip; paper
    time: float = 0.2  # samples of the mean [s]; later grip, smaller error; paper
    longest: float = 1.6  # bound of that time in noise [s]; later grip, smaller error; hump
    error: float = 0.0085  # accepted error of the mean [N]; sooner grip, light fruit turns; hump
    # force of a finger that touches something already [N]; fewer FORCE_LIMIT; bad-input
    limit: float = 3.0
    step: float = 0.2  # coarsest resolution of a force [N], of a torque at 10 mm; coarser sensors pass; lying-sensors
    # largest ratio of repeated samples beyond chance; slower sensors pass; lying-sensors
    copies: float = 0.1


class FilterSettings(NamedTuple):
    """Filters from wrenches to loads, and detection of pushes and jumps."""

    # time constant of the fast filter [s]; less noise, later response; beyond-the-paper
    fast_lag: float = 0.005
    normal_lag: float = 0.06  # of the slow filter of normal forces [s]; less noise, later response; beyond-the-paper
    # of the slow filter of the other channels [s]; the same; beyond-the-paper
    load_lag: float = 0.08
    centre_lag: float = 0.1  # of the centre of rotation [s]; steadier slip speed; beyond-the-paper
    # of the high-pass on the minimum force and the load [s]; larger rise; hump
    rise_lag: float = 0.03
    calm_lag: float = 0.2  # of load and lever while nothing pushes [s]; steadier reserve; bumps
    noise_stds: float = 2.5  # jump of the fast filter that counts [std of noise]; less noise, later; beyond-the-paper
    # bound of the centre of rotation [m]; more weight of translation; beyond-the-paper
    farthest_centre: float = 0.02
    twist_bound: float = 2.0  # bound of the twist; more lead where the load twists; hump
    longest_push: float = 1.0  # a longer push counts as load [s]; longer use of the reserve; bumps
    # growth of the load that is a push [std of its noise]; fewer pushes found; bumps
    push_stds: float = 4.0
    # and relative to the load (a lift of 3 m/s²: 0.05); fewer pushes found; bumps
    push_ratio: float = 0.1
    # jump beyond noise of one finger alone, or of both [N]; fewer faults; lying-sensors
    jump: float = 0.4
    quiet: float = 0.05  # change beyond noise of a finger that is quiet [N]; more jumps of one finger; lying-sensors
    # and its recent change relative to the jump; more jumps of one; lying-sensors
    swing: float = 0.15
    # time constant of that change [s]; fewer jumps of one; lying-sensors
    swing_memory: float = 0.02
    aside: float = 0.15  # part of a jump across the load of a contact that breaks; fewer jumps found; lying-sensors


@dataclass(frozen=True, slots=True)
class ReferenceSettings:
    """Reference of the grip force in its modes."""

    low_pass: float = 1.0 / (
        2.0 * math.pi * 50.0
    )  # time constant of a rise [s]; slower response; paper
    # change of the load that ends STANDING [N]; later LIFTING; feel-friction
    load_changed: float = 0.3
    carried_load: float = 0.25  # load of a carried fruit [N]; later CARRIED; hump
    carried_after: float = 0.1  # steady load until CARRIED [s]; longer caution; hump
    carried_rise: float = 0.05  # relative rise of a steady load; sooner CARRIED; hump
    least_margin: float = 1.06  # factor on the force for the worst friction; more force; own-motion
    # errors of the bias that are covered [std]; more force on light fruit; hump
    bias_stds: float = 2.0
    # factor on the reserve's part, which has no noise; more force; bumps
    reserve_margin: float = 1.09
    rise_average: float = 0.3  # average of the static part while it rises [s]; less noise; hump
    # average while it falls [s]; less force lost when a lift slows down; hump
    fall_average: float = 0.6
    # excess over the average that counts at once [std of noise]; later response; hump
    average_stds: float = 2.0
    # force per growth of the moment's ratio, over Coulomb's force; more force; hump
    creep_gain: float = 6.0
    creep_fast: float = 0.15  # fast average of that ratio [s]; later response; hump
    creep_slow: float = 0.6  # slow average of that ratio [s]; longer response; hump
    creep_noise: float = 0.06  # growth that is noise; fewer responses; hump
    lead: float = 1.5  # force per rise of the minimum force; less slip, higher peak; hump
    edge: float = 0.95  # ratio of minimum to coming force above which force is added; later response; beyond-the-paper
    edge_gain: float = 5.0  # force per excess over `edge`; less slip, higher peak; beyond-the-paper
    urgent_base: float = 1.0  # bound of the momentary part beyond the minimum force [N]; higher peak, light fruit; hump
    most_urgent: float = 10.0  # and its upper bound [N]: the fingers' full speed; higher peak; hump
    # and its bound after doubt about the sensors [N]; higher peak; bad-input
    most_doubtful: float = 3.0
    # bound of the force after a sensor fault, over that before; more force; lying-sensors
    fault_ratio: float = 2.0
    # rate of an excess of force [1/s], at least `relax_rate`; faster fall; hump
    relax_gain: float = 2.5
    excess: float = 1.2  # ratio of force to need that falls faster; slower fall; hump
    excess_gain: float = 12.0  # rate of what is beyond `excess` [1/s]; faster fall; hump
    excess_lag: float = 0.15  # average of the need for `excess` [s]; slower fall; hump
    # force per newton of a push, over mu; fewer fruits lost, higher peak; bumps
    push_gain: float = 16.0
    # ratio of minimum to measured force of a fruit that slides; fewer catches; bumps
    sliding_ratio: float = 0.8
    # rise of the force while the pads slide [N/s]; harder; feel-friction
    sliding_rate: float = 12.0


@dataclass(frozen=True, slots=True)
class ForceLoopSettings:
    """Gain and limits of the force loop."""

    gain: float = 20.0  # c [1/s]
    # of fingers and measurement: delay of a commanded motion in the measured force [s]
    lag: float = 0.015
    # rise of the grip force (both fingers) as the opening closes on the fruit [N/m]: two pads in series
    stiffness: float = 2000.0
    max_force: float = 14.0  # largest grip force [N]; each finger presses with at most half of it
    # closing_speed, opening_speed: bounds of the opening's rate, both positive [m/s]
    closing_speed: float = 0.2
    opening_speed: float = 0.012
    # time between two rates [s]; the WSG's finger script reaches 50 Hz
    command_period: float = 0.02
    step: float = 0.0  # of the opening that the fingers can be moved by [m], 0 for none; less force is no excess


@dataclass(frozen=True, slots=True)
class TrackingSettings:
    """Tracking of the reference by the fingers."""

    # rate of the reference that is not fed forward [N/s]; calmer, later fingers; hump
    quiet_rate: float = 5.0
    # error at which fingers rest, relative to the reference; calmer fingers; hump
    near: float = 0.015
    # error within which the gain is `calm_gain` [noise band]; calmer fingers; hump
    calm: float = 4.0
    calm_gain: float = 3.0  # that gain [1/s]; faster correction, swinging fingers; hump
    foreseen: float = 0.012  # bound of the finger speed that is fed forward to the filter [m/s]; more trust; own-motion
    too_much: float = 0.6  # excess at which fingers rest [noise band]; calmer fingers; own-motion
    # lack at which fingers rest [noise band]; calmer fingers, less force; own-motion
    too_little: float = 0.35


@dataclass(frozen=True, slots=True)
class CommandSettings:
    """Times at which a rate of the fingers is commanded."""

    # a lasting rate is repeated this often [s]; nearer to the watchdog; command-timing
    keep_alive: float = 0.06
    heartbeat: float = 0.5  # rest is repeated this often [s]; fewer commands; command-timing
    # change of the rate that is only a trim [m/s]; fewer commands; command-timing
    trim: float = 2e-3
    # trims wait after this time without anything else [s]; more commands; command-timing
    calm_after: float = 0.15
    push_samples: int = 2  # samples of a push before it is answered; later, larger response; bumps


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """Limits of the monitors and of closing."""

    contact: float = 0.4  # force of a finger that touches [N]; later contact; bad-input
    # force with which one finger may push the fruit [N]; fewer ONE_FINGER; bad-input
    push_limit: float = 3.0
    stroke_end: float = 0.0003  # distance to the end of the stroke that is its end [m]; sooner OUT_OF_STROKE; bad-input
    stuck_after: float = 0.5  # time of fingers that do not move [s]; later NO_CONTACT; bad-input
    gone: float = 0.15  # force of both fingers without a fruit [N]; sooner LOST; bad-input
    # its time, also of a dead finger [s]; later LOST, ONE_FINGER; bad-input
    gone_after: float = 0.06
    # ratio of a dead finger's force to the other one's; sooner ONE_FINGER; bad-input
    dead: float = 0.25
    alive: float = 0.6  # force of the other finger [N]; later ONE_FINGER; bad-input
    # excess of one finger's force while the pads slide [N]; less force; feel-friction
    apart: float = 1.2
    # time of a channel at the end of its range [s]; later SENSOR_SATURATED; bad-input
    saturated_after: float = 0.05
    # ratio of minimum to measured force that is slipping; later SLIPPED; bad-input
    beyond: float = 1.02
    beyond_after: float = 0.3  # its time [s]; later SLIPPED; bad-input
    slipping: float = 0.95  # ratio above which the estimated slip adds up; later SLIPPED; bad-input


@dataclass(frozen=True, slots=True)
class SensorWatchSettings:
    """Detection of faulty force readings."""

    # time of a noisy channel that repeats its value [s]; later fault; lying-sensors
    frozen_after: float = 0.02
    fewest: int = 5  # and its samples; later fault of slow sensors; lying-sensors
    # and its ratio to the longest run at calibration; coarse sensors pass; lying-sensors
    longer: float = 5.0
    own_motion_memory: float = 0.1  # time constant of that motion [s]; fewer faults; own-motion
    # difference of the fingers with a hanging fruit [N]; fewer faults; lying-sensors
    apart: float = 0.5
    apart_ratio: float = 0.4  # and relative to the load; fewer faults; lying-sensors
    apart_after: float = 0.04  # its time [s]; later fault; lying-sensors
    # ratio of the load to its recent maximum that hangs; fewer faults; lying-sensors
    hanging: float = 0.7
    load_memory: float = 1.0  # time constant of that maximum [s]; fewer faults; lying-sensors
    motor_error: float = 1.5  # difference of fingers and motor [N], twice the worst pick's; fewer faults; lying-sensors
    motor_ratio: float = 0.25  # and relative to the force; fewer faults; lying-sensors
    motor_lag: float = 0.03  # average of the motor's force [s]; later fault; lying-sensors
    motor_after: float = 0.02  # its time [s]; later fault; lying-sensors


@dataclass(frozen=True, slots=True)
class SlipWatchSettings:
    """Detection of slip and turning without the coefficient of friction, and the correction of that coefficient."""

    place_lags: tuple[float, float, float] = (
        0.02,
        0.1,
        0.5,
    )  # averages of the contact's place [s]; slower slip found
    # motion between two averages that is slip [m]; later detection; wrong-friction
    moved: float = 1.5e-4
    # and since the start [m] (soft contacts give 0.8 mm); later detection; wrong-friction
    moved_far: float = 9e-4
    # motion of pads and skin by a change of load [m/N]; later detection; wrong-friction
    compliance: float = 4e-4
    stds: float = 5.5  # motion by noise [std]; later detection; wrong-friction
    lever_lags: tuple[float, float] = (
        0.02,
        0.3,
    )  # averages of a carried lever [s]; later turning; wrong-friction
    # change of the lever that is turning [m]; later detection; wrong-friction
    lever_moved: float = 3e-4
    lever_ratio: float = 0.15  # and relative to the lever; later detection; wrong-friction
    lever_stds: float = 8.0  # and in noise [std]; later detection; wrong-friction
    # ratio of minimum to measured force below which motion is no slip; fewer corrections
    least_ratio: float = 0.6
    # most that is learned, in uncertainties of mu; more force; wrong-friction
    learns_most: float = 2.0
    # time constant in which a correction fades [s]; less force, more slip; wrong-friction
    forgets: float = 10.0
    sure_ratio: float = 0.9  # and above which slip is expected at the configured mu; more corrections; wrong-friction


@dataclass(frozen=True, slots=True)
class GripSettings:
    """Settings of a grip.

    Raises:
        UnusableRate: the sensor's rate lies outside `RATES`.
    """

    contact: SoftContact = field(default_factory=SoftContact)  # configured friction
    law: ForceLaw = ForceLaw.SLIP_AVOIDANCE  # of the force while holding
    margin: float = 1.125  # factor on the minimum force; more force, less slip; hump
    mu_uncertainty: float = 0.0  # relative uncertainty of mu that the margin covers; more force
    floor: float = 0.5  # smallest grip force [N]; more force on light fruit
    # offset of the fruit's centre until it is carried [m]; more force in the lift; hump
    offset: float = 0.005
    reserve: float = 0.0  # tangential force held beyond the load, for pushes [N]; more force, fewer fruits lost; bumps
    expected_load: float = 0.0  # largest load of a fruit of this size in a lift [N], 0: unknown; higher peak; pick-pace
    # grip force before the lift, and of the law CONSTANT [N]; higher start
    initial_force: float = 2.2
    ramp_rate: float = 6.0  # rise of the force from contact to `initial_force` [N/s]; sooner held
    relax_rate: float = 2.0  # slowest fall of an excess of force while holding [N/s]; sooner down
    approach_speed: float = 0.08  # closing before contact is near [m/s]; sooner held
    # closing where contact may come [m/s]; sooner held, harder contact
    contact_speed: float = 0.024
    # widest opening at which a finger may touch [m], None: all; slower closing
    contact_width: float | None = None
    narrowest: float = 0.0  # smallest opening that the fruit can have [m]; sooner NO_CONTACT
    off_centre: float = 0.010  # distance that one finger may push the fruit [m]; fewer ONE_FINGER
    slip_limit: float = 0.005  # slip that is SLIPPED [m]; later SLIPPED
    width_min: float = 0.0  # end of the gripper's stroke [m]
    rate: float = 500.0  # of the sensor's samples [Hz], within `RATES`
    loop: ForceLoopSettings = field(default_factory=ForceLoopSettings)
    observer: ObserverSettings = field(default_factory=ObserverSettings)
    dynamic: DynamicSettings = field(default_factory=DynamicSettings)
    bias: BiasSettings = field(default_factory=BiasSettings)
    filters: FilterSettings = field(default_factory=FilterSettings)
    reference: ReferenceSettings = field(default_factory=ReferenceSettings)
    tracking: TrackingSettings = field(default_factory=TrackingSettings)
    command: CommandSettings = field(default_factory=CommandSettings)
    watch: WatchSettings = field(default_factory=WatchSettings)
    sensors: SensorWatchSettings = field(default_factory=SensorWatchSettings)
    slips: SlipWatchSettings = field(default_factory=SlipWatchSettings)

    def __post_init__(self) -> None:
        check_rate(self.rate)

    @property
    def period(self) -> float:
        """Time between two samples [s]."""
        return 1.0 / self.rate


def check_rate(rate: float) -> None:
    """Refuse the sample rate [Hz] of a sensor that no grip can use.

    Raises:
        UnusableRate: the rate lies outside `RATES`.
    """
    if not RATES[0] <= rate <= RATES[1]:
        raise UnusableRate(rate, RATES)
