"""The grip of a fruit that moves with the hand: settings for the width between the pads."""

from __future__ import annotations

from dataclasses import replace

from pomona.executive import Skill
from pomona.skills import bruising, grip_settings
from pomona.skills.grip import GripSettings, Hold, WatchSettings
from pomona.skills.perception import MeasuredFruit

# time before the arrival at which the fingers begin to close [s], 17 mm over their place
EARLY = 0.15
FIRST_BIAS = 0.23 + EARLY  # time before the arrival at which the grip begins to record its bias [s]
SOONER = 0.07  # time by which all that begins sooner on a fast belt [s]
OPENING = 0.018  # opening over the fruit's width with which the hand comes down [m]
SLOWS = 0.008
SLOWS_LATER = 0.005
"""Opening over the fruit's width at which the fingers slow down, also on a fast belt [m]: it may lie off the middle."""
MOST = 14.0  # largest force of both fingers [N]
PUSH = 0.5
"""Largest force with which one finger may push a fruit, over the force that bruises it. A large apple rests on the belt
with more than 3 N."""


def moving_grip(
    skill: Skill, fruit: MeasuredFruit, width: float, fast: bool = False
) -> GripSettings:
    """Return settings of a grip that slows down at the width of the fruit between the pads [m].

    At the largest dimension instead, a lemon held across would be closed on for 0.4 m of belt.
    """
    push_limit = max(WatchSettings().push_limit, PUSH * bruising(fruit))
    return replace(
        grip_settings(skill, fruit, MOST),
        contact_width=width + (SLOWS_LATER if fast else SLOWS),
        watch=WatchSettings(push_limit=push_limit),
    )


def felt_width(hold: Hold) -> float | None:
    """Return the width of the fruit between the pads when both had touched it [m]; None: they did not."""
    left, right = hold.first_touches
    return None if left is None or right is None else min(left.width, right.width)
