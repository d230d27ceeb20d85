"""Friction from two short slides of the pads over a standing fruit: one up, one back down.

Friction changes its sign between the two; pads that are not square to the skin and the sensors' bias do not. Half the
difference is friction, half the sum is the rest. A light fruit moves with the pads on the way up, never downwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.pads import MIRROR, loads_of_finger

# smallest duration [s] and number of samples of each half of a slide
SHORTEST = 0.02
FEW = 4
PRESSING = 0.1  # smallest normal force of a finger that measures friction [N]
STEADY = 0.15  # largest relative difference of a slide's halves: until the pads slide, the force still rises

CAME_ALONG = 0.2  # ratio of unchanged to changing part above which the fruit was lifted; tilted pads give 0.05

LIGHT = 0.4
LIGHT_NOW = 0.65
"""Ratios of friction to the largest weight of a fruit of this size above which it counts as light: with the tracked
force, and with the sum of both fingers, of which one may press more (docs/decisions.md#grip-pick-pace)."""

# relative uncertainty of friction from one direction (15 fruits of the simulated cell)
NOT_SQUARE = 0.04
UNMODELLED = 0.03  # relative uncertainty that repetition does not reduce: other places of the skin, other speeds


class NoSlideError(Exception):
    """The pads did not slide over the fruit, so its friction is unknown."""


@dataclass(frozen=True, slots=True)
class Slide:
    """Friction by a slide."""

    mu: float  # friction coefficient of both fingers together
    uncertainty: float  # its relative standard deviation
    fingers: tuple[float, float]  # mu of each
    # True when the fruit was lifted on the way up, so that only the way down counts
    came_along: bool = False


def friction_of_slides(
    up: Float64, down: Float64, bias_std: float = 0.0, rate: float = 500.0
) -> Slide:
    """Return the friction of both pads, which may press differently on both ways.

    A twist meanwhile takes its part of the friction. How large a part depends on a torsion that is not measured, so it
    counts as none: the friction is not overestimated.

    Args:
        up, down: wrenches while the pads slid, bias removed, shape (n, 2, 6), as in `WrenchSample`.
        bias_std: standard deviation of a force's error by the bias [N].
        rate: of the samples [Hz].

    Raises NoSlideError: too few samples, too little normal force, or friction that still changed.
    """
    halves = [half for way in (up, down) for half in np.array_split(way, 2)]
    if min(len(half) for half in halves) < max(SHORTEST * rate, FEW):
        raise NoSlideError(f"the slides have only {len(up)} and {len(down)} samples")
    f_n_up, going_up = _ratios(up)
    f_n_down, going_down = _ratios(down)
    f_n = np.minimum(f_n_up, f_n_down)
    rubs = 0.5 * (going_down - going_up)
    rests = 0.5 * (going_down + going_up)
    came_along = _size((f_n[:, None] * rests).sum(axis=0)) > CAME_ALONG * _size(
        (f_n[:, None] * rubs).sum(axis=0)
    )
    if came_along:
        f_n = f_n_down
        rubs = going_down
    mu, fingers = _mu(f_n, rubs)
    early, late = (
        _mu(f_n, second if came_along else 0.5 * (second - first))[0]
        for first, second in (
            (_ratios(halves[0])[1], _ratios(halves[2])[1]),
            (_ratios(halves[1])[1], _ratios(halves[3])[1]),
        )
    )
    if abs(early - late) > STEADY * late:
        raise NoSlideError(f"the friction still changed from {early:.2f} to {late:.2f}")
    apart = abs(float(fingers[0] - fingers[1])) / (2.0 * mu)
    spread = abs(early - late) / (2.0 * mu)
    bias = bias_std / float(f_n.mean())
    one_way = max(NOT_SQUARE, bias / mu) if came_along else 0.0
    uncertainty = math.hypot(UNMODELLED, apart, spread, bias, one_way)
    return Slide(mu, uncertainty, (float(fingers[0]), float(fingers[1])), bool(came_along))


def moves_with_pads(down: Float64, force: float, force_sum: float, expected_load: float) -> bool:
    """Return True if friction may exceed the fruit's weight, so that the upward slide would lift it.

    `down` are the wrenches of the downward slide, shape (n, 2, 6); `force` is the grip force of the slide, `force_sum`
    that of both fingers now, `expected_load` the largest weight of a fruit of this size, 0 if unknown [N].
    """
    if not len(down) or expected_load <= 0.0:
        return False
    f_n = -down[:, :, 2].sum(axis=1).mean()
    f_t = np.linalg.norm(down[:, :, :2], axis=2).sum(axis=1).mean()
    ratio = f_t / max(f_n, 0.1) / max(expected_load, 1e-3)
    return bool(force * ratio > LIGHT or force_sum * ratio > LIGHT_NOW)


def _ratios(wrenches: Float64) -> tuple[Float64, Float64]:
    """Return the mean normal force of each finger, shape (2,), and its mean tangential force over that, shape (2, 2)."""
    first = wrenches[:, 0].mean(axis=0)
    second = wrenches[:, 1].mean(axis=0)
    loads = np.array([loads_of_finger(first), loads_of_finger(MIRROR * second)])
    f_n = loads[:, 0]
    if f_n.min() < PRESSING:
        raise NoSlideError(
            f"a finger presses with {f_n.min():.2f} N, at least {PRESSING:g} N are needed"
        )
    return f_n, loads[:, 1:3] / f_n[:, None]


def _mu(f_n: Float64, rubs: Float64) -> tuple[float, Float64]:
    """mu of both fingers together, weighted by their normal forces, and of each, shape (2,)."""
    fingers = np.linalg.norm(rubs, axis=1)
    return float((f_n * fingers).sum() / f_n.sum()), fingers


def _size(load: Float64) -> float:
    """Tangential magnitude of a load of both fingers together."""
    return float(np.hypot(load[0], load[1]))
