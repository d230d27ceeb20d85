"""Everything that a grip can be told, with defaults that hold an apple."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from pomona.skills.grip.dynamic_term import DynamicSettings
from pomona.skills.grip.errors import UnusableRate
from pomona.skills.grip.force_loop import ForceLoopSettings
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.observer import ObserverSettings
from pomona.skills.grip.tuning import (
    BiasCheckSettings,
    BiasSettings,
    CommandSettings,
    FilterSettings,
    ReferenceSettings,
    SensorWatchSettings,
    SlipWatchSettings,
    TrackingSettings,
    WatchSettings,
)

RATES = (100.0, 2000.0)
"""Of a sensor that a grip can use [Hz]: slower ones miss a load that passes within 20 ms, faster ones leave no time
for a step."""


class ForceLaw(Enum):
    """How the grasp force is chosen while holding: the paper's law, or one of the baselines beside it."""

    SLIP_AVOIDANCE = "slip_avoidance"
    STATIC = "static"
    COULOMB = "coulomb"
    CONSTANT = "constant"


@dataclass(frozen=True, slots=True)
class GripSettings:
    """Settings of a grip.

    Attributes:
        contact: friction between pad and fruit.
        law: how the force is chosen while holding.
        margin: on the least force.
        mu_uncertainty: relative uncertainty of mu that the margin covers too.
        floor: least grasp force ever [N].
        offset: the fruit's centre may lie so far off the grasp axis [m]; held for until the fruit is carried, when its
            moment has shown.
        reserve: tangential force that is held beyond the load, with its lever, for pushes at the fruit's centre that
            come faster than the fingers [N].
        expected_load: the largest tangential load that a fruit of this size may be while it is lifted [N]; 0 where
            nobody knows. A load below it is not answered as if it were to grow beyond it.
        initial_force: grasp force before the fruit is lifted, and of the law CONSTANT [N].
        ramp_rate: of the force from contact to `initial_force` [N/s].
        relax_rate: the reference falls at most this fast while holding [N/s].
        approach_speed: rate of the opening before contact is near [m/s].
        contact_speed: rate of the opening where contact may come [m/s].
        contact_width: widest opening at which a finger may touch [m]; None for all.
        narrowest: an opening that no fruit of this kind can have [m].
        off_centre: the fruit may be pushed so far by one finger until the other touches [m].
        slip_limit: estimated slip that is reported as SLIPPED [m].
        loop, observer, dynamic, bias, bias_check, filters, reference, tracking, command, watch, sensors, slips: of the
            parts.
        width_min: end of the gripper's stroke [m].
        rate: of the sensor's samples [Hz], within `RATES`.

    Raises:
        UnusableRate: the sensor's rate lies outside `RATES`.
    """

    contact: SoftContact = field(default_factory=SoftContact)
    law: ForceLaw = ForceLaw.SLIP_AVOIDANCE
    margin: float = 1.125
    mu_uncertainty: float = 0.0
    floor: float = 0.5
    offset: float = 0.005
    reserve: float = 0.0
    expected_load: float = 0.0
    initial_force: float = 2.2
    ramp_rate: float = 6.0
    relax_rate: float = 2.0
    approach_speed: float = 0.08
    contact_speed: float = 0.024
    contact_width: float | None = None
    narrowest: float = 0.0
    off_centre: float = 0.010
    slip_limit: float = 0.005
    loop: ForceLoopSettings = field(default_factory=ForceLoopSettings)
    observer: ObserverSettings = field(default_factory=ObserverSettings)
    dynamic: DynamicSettings = field(default_factory=DynamicSettings)
    bias: BiasSettings = field(default_factory=BiasSettings)
    bias_check: BiasCheckSettings = field(default_factory=BiasCheckSettings)
    filters: FilterSettings = field(default_factory=FilterSettings)
    reference: ReferenceSettings = field(default_factory=ReferenceSettings)
    tracking: TrackingSettings = field(default_factory=TrackingSettings)
    command: CommandSettings = field(default_factory=CommandSettings)
    watch: WatchSettings = field(default_factory=WatchSettings)
    sensors: SensorWatchSettings = field(default_factory=SensorWatchSettings)
    slips: SlipWatchSettings = field(default_factory=SlipWatchSettings)
    width_min: float = 0.0
    rate: float = 500.0

    def __post_init__(self) -> None:
        check_rate(self.rate)

    @property
    def period(self) -> float:
        """Seconds between two samples."""
        return 1.0 / self.rate


def check_rate(rate: float) -> None:
    """Refuse a sensor that no grip can use.

    Raises:
        UnusableRate: the rate [Hz] lies outside `RATES`.
    """
    if not RATES[0] <= rate <= RATES[1]:
        raise UnusableRate(rate, RATES)
