"""The grip of a fruit that moves with the hand: settings for the width between the pads."""

from __future__ import annotations

from pomona.drivers import ForceSensor, Gripper
from pomona.skills.grip import (
    ForceLoopSettings,
    GripSettings,
    Hold,
    SoftContact,
    WatchSettings,
    bruising_force,
)
from pomona.skills.perception import MeasuredFruit, mass_of

# time before the arrival at which the fingers begin to close [s], 17 mm over their place
EARLY = 0.15
FIRST_BIAS = 0.23 + EARLY  # time before the arrival at which the grip begins to record its bias [s]
SOONER = 0.07  # time by which all that begins sooner on a fast belt [s]
OPENING = 0.018  # opening over the fruit's width with which the hand comes down [m]
SLOWS = 0.008
SLOWS_LATER = 0.005
"""Opening over the fruit's width at which the fingers slow down, also on a fast belt [m]: it may lie off the middle."""
NARROWEST = 0.5  # smallest width of a fruit between the fingers, relative to its smallest dimension
# force before the lift and the largest force of both fingers [N], as of SlipAvoidGrasp
FIRST_FORCE = 2.2
MOST = 14.0
GRAVITY = 9.81  # [m/s²]
PUSH = 0.5
"""Largest force with which one finger may push a fruit, over the force that bruises it. A large apple rests on the belt
with more than 3 N."""


def grip_settings(
    contact: SoftContact,
    mu_uncertainty: float,
    fruit: MeasuredFruit,
    width: float,
    gripper: Gripper,
    sensor: ForceSensor,
    fast: bool = False,
) -> GripSettings:
    """Return settings of a grip that slows down at the width of the fruit between the pads [m].

    At the largest dimension instead, a lemon held across would be closed on for 0.4 m of belt.
    """
    known = mass_of(fruit.fruit, fruit.dimensions, fruit.covariance[3:, 3:])
    limits = gripper.limits
    return GripSettings(
        contact=contact,
        margin=1.125,
        expected_load=0.0 if known is None else 1.1 * GRAVITY * (known[0] + 2.0 * known[1]),
        offset=0.003,
        mu_uncertainty=mu_uncertainty,
        initial_force=FIRST_FORCE,
        contact_width=width + (SLOWS_LATER if fast else SLOWS),
        narrowest=NARROWEST * float(fruit.dimensions.min()),
        loop=ForceLoopSettings(
            max_force=min(MOST, 2.0 * limits.force_max),
            closing_speed=min(ForceLoopSettings().closing_speed, limits.speed_max),
        ),
        watch=WatchSettings(
            push_limit=max(WatchSettings().push_limit, PUSH * bruising_force(width / 2.0))
        ),
        width_min=limits.width_min,
        rate=sensor.rate,
    )


def felt_width(hold: Hold) -> float | None:
    """Return the width of the fruit between the pads when both had touched it [m]; None: they did not."""
    left, right = hold.first_touches
    return None if left is None or right is None else min(left.width, right.width)
