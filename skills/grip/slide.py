"""Friction from two short slides of the pads over a fruit that stands still: one up, one back down.

What rubs changes its sign between the two, what does not (the sensors' bias, a load that the fruit hangs on the
fingers) stays: half the difference is friction, half the sum is the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from executive.values.arrays import Float64
from skills.grip.limit_surface import SoftContact
from skills.grip.pads import MIRROR, loads_of_finger

SHORTEST, FEW = 0.02, 4
"""Each half of a slide must last so long [s] and have so many samples."""

PRESSING = 0.1
"""A finger must press with this much to rub [N]."""

STEADY = 0.15
"""A slide's two halves may differ by this share: before the pads slide, the force still rises."""

CAME_ALONG = 0.5
"""More load than this share of the friction that did not change its sign: the fruit was lifted, and did not slide."""

UNMODELLED = 0.03
"""Relative uncertainty that no repetition shows: the skin elsewhere, friction that changes with the speed."""


class NoSlideError(Exception):
    """The pads did not slide over the fruit, so its friction is not known; the message says what happened instead."""


@dataclass(frozen=True, slots=True)
class Slide:
    """What a slide tells.

    Attributes:
        mu: friction coefficient, of both fingers together.
        uncertainty: its standard deviation, relative.
        fingers: mu of each.
        load: what the fingers bore beside friction [N].
    """

    mu: float
    uncertainty: float
    fingers: tuple[float, float]
    load: float


def friction_of_slides(
    up: Float64, down: Float64, contact: SoftContact, bias_std: float = 0.0, rate: float = 500.0
) -> Slide:
    """Friction of both pads.

    Each finger slides on its limit surface; as an ellipsoid, (f_t / mu f_n)² + (tau_n / tau_max)² = 1, which is solved
    for mu, since tau_max is proportional to it too.

    Args:
        up, down: wrenches while the pads slid, bias removed, shape (n, 2, 6), as in `WrenchSample`.
        contact: what is known of the contact's torsion.
        bias_std: standard deviation of the normal force's error by the bias [N].
        rate: of the samples [Hz].

    Raises:
        NoSlideError: too few samples, a finger that hardly presses, a force that still rises, a fruit that came along.
    """
    halves = [half for way in (up, down) for half in np.array_split(way, 2)]
    if min(len(half) for half in halves) < max(SHORTEST * rate, FEW):
        raise NoSlideError(f"only {len(up)} and {len(down)} samples of the slides")
    early, late = (_both(first, second) for first, second in ((halves[0], halves[2]), (halves[1], halves[3])))
    (mu_early, _), (mu_late, _) = (_friction(*way, contact) for way in (early, late))
    if abs(mu_early - mu_late) > STEADY * mu_late:
        raise NoSlideError(f"the friction still changed from {mu_early:.2f} to {mu_late:.2f}")
    rubbing, resting = _both(up, down)
    load = float(np.linalg.norm(resting[:, 1:3].sum(axis=0)))
    friction = float(np.linalg.norm(rubbing[:, 1:3].sum(axis=0)))
    if load > CAME_ALONG * friction:
        raise NoSlideError(f"the fruit came along: {load:.2f} N hung on the fingers, {friction:.2f} N rubbed")
    mu, fingers = _friction(rubbing, resting, contact)
    apart = abs(float(fingers[0] - fingers[1])) / (2.0 * mu)
    pressed = float(resting[:, 0].mean())
    spread = abs(mu_early - mu_late) / (2.0 * mu)
    uncertainty = math.sqrt(UNMODELLED**2 + apart**2 + spread**2 + (bias_std / pressed) ** 2)
    return Slide(mu, uncertainty, (float(fingers[0]), float(fingers[1])), load)


def _both(up: Float64, down: Float64) -> tuple[Float64, Float64]:
    """Half the difference and half the sum of both ways' mean loads, shape (finger, (f_n, f_x, f_y, tau_n))."""
    means = []
    for way in (up, down):
        first, second = way[:, 0].mean(axis=0), way[:, 1].mean(axis=0)
        means.append(np.array([loads_of_finger(first), loads_of_finger(MIRROR * second)]))
    return 0.5 * (means[0] - means[1]), 0.5 * (means[0] + means[1])


def _friction(rubbing: Float64, resting: Float64, contact: SoftContact) -> tuple[float, Float64]:
    """mu of both fingers together, who presses more counting more, and of each, shape (2,)."""
    f_n = resting[:, 0]
    if f_n.min() < PRESSING:
        raise NoSlideError(f"a finger presses with {f_n.min():.2f} N only")
    f_t = np.hypot(rubbing[:, 1], rubbing[:, 2])
    radius = contact.torsion / contact.mu * f_n**contact.gamma
    rubs: Float64 = np.hypot(f_t, rubbing[:, 3] / radius)
    return float(rubs.sum() / f_n.sum()), rubs / f_n
