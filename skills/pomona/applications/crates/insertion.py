"""The law of an insertion: places of a hand that goes down around a fruit and gives way sideways, step by step.

The hand stops at a touch, shifts along the force by a part of it, and goes on down: an admittance in steps. Where it
cannot shift, beside a wall, the fruit shall, by a force up to the limit. An arm
that follows streamed set-points lags them by 0.1 s, in which a contact of 5 N/mm would ring.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pomona.applications.crates.feeling import FELT
from pomona.executive import Float64

COMPLIANCE = 1e-3
"""Way sideways in a step per force [m/N]: less than a contact of 1 N/mm gives."""
LONGEST = 1.5e-3
SHORTEST = 0.4e-3
"""Steps sideways [m]."""
CENTRING = 0.4e-3
"""Step sideways of a hand whose pads close on the fruit [m]."""
RELIEF = 1.5e-3
"""Step back up [m]."""
GAIN = 0.5e-3
"""Way down between two stops that counts as progress [m]."""
STOPS = 8
"""Stops without progress after which the hand ends."""
ENOUGH = 9e-3
"""Distance before the lowest place at which the pads hold a fruit as well [m]: half of a pad's height."""
FARTHEST = 0.015
"""Way sideways beyond which the hand gives way no further [m]."""
ARRIVED = 3e-4
"""Distance before the lowest place that is none [m]."""
OVER = 2.0
"""Multiple of the limit that ends a step sideways or up [1]: such a step takes the force away."""


class InsertStep(NamedTuple):
    """A straight way of the hand."""

    kind: str  # down, aside, up
    p_end: Float64  # end of it, shape (3,) [m]
    stop: float  # force on a face that ends it [N]


@dataclass(frozen=True, slots=True, eq=False)
class FeltByHand:
    """Forces on the fingers.

    Attributes:
        wrenches: on the pads' inner faces, without their offset, as in `WrenchSample`, shape (2, 3) or wider [N].
        outer: of a push on the fingers' outer faces, by the gripper's motor, or on their edges, by the wrist [N].
    """

    wrenches: Float64
    outer: float

    def on_hand(self, crowded: float) -> Float64:
        """Return the force on the hand in the frame of the TCP, shape (3,) [N].

        Args:
            crowded: the finger that is pushed from outside: 1 along y, -1 the other one, 0 unknown.
        """
        left = self.wrenches[0, :3]
        right = self.wrenches[1, :3]
        return np.array(
            [right[1] - left[1], right[2] - left[2] - crowded * self.outer, left[0] + right[0]]
        )

    @property
    def most(self) -> float:
        """Largest force on one face [N]."""
        return max(float(np.linalg.norm(self.wrenches[:, :3], axis=1).max()), self.outer)


class Insertion:
    """A hand on its way down.

    Attributes:
        left: distance to the lowest place [m].
        most: largest force on one face so far [N].
        shifted: way sideways from the start [m].
        arrived: whether the pads are beside the fruit.
    """

    def __init__(
        self,
        T_start: Float64,
        height: float,
        limit: float,
        crowded: float,
        blocked: Callable[[Float64], bool],
    ) -> None:
        """
        Args:
            T_start: T_base_tcp over the fruit, shape (4, 4).
            height: of the lowest place in the base frame [m].
            limit: force that the fingers shall not exceed [N].
            crowded: see `FeltByHand.on_hand`.
            blocked: whether the hand at a place, shape (3,) [m], would touch a wall.
        """
        self.left = float(T_start[2, 3]) - height
        self.most = 0.0
        self.shifted = 0.0
        self.arrived = False
        self._start = T_start[:3, 3].copy()
        self._R = T_start[:3, :3]
        self._height = height
        self._limit = limit
        self._crowded = crowded
        self._blocked = blocked
        self._lowest = self.left
        self._stops = 0

    @property
    def touch(self) -> float:
        """Force at which a way down is stopped, and that of an outer face at most [N]."""
        return 0.5 * self._limit

    def next(self, p: Float64, felt: FeltByHand, stopped: bool) -> InsertStep | None:
        """Return the next step; None at the end: see `arrived`.

        Args:
            p: place of the TCP, shape (3,) [m].
            felt: forces now.
            stopped: whether the last step has ended at a touch.
        """
        self.left = max(float(p[2]) - self._height, 0.0)
        self.shifted = float(np.linalg.norm((p - self._start)[:2]))
        self.most = max(self.most, felt.most)
        if self.left < ARRIVED:
            self.arrived = True
            return None
        down = np.array([p[0], p[1], self._height])
        if felt.most <= (FELT if stopped else self.touch):
            return InsertStep("down", down, self.touch)
        self._stops = 0 if self.left < self._lowest - GAIN else self._stops + 1
        self._lowest = min(self._lowest, self.left)
        if self._stops > STOPS:
            self.arrived = self.left < ENOUGH
            return None
        aside = self._aside(felt.on_hand(self._crowded))
        if self._blocked(p + aside) or np.linalg.norm((p + aside - self._start)[:2]) > FARTHEST:
            aside = np.zeros(3)
        if felt.most > 0.9 * self._limit:
            return InsertStep("up", p + aside + [0.0, 0.0, RELIEF], OVER * self._limit)
        if (
            felt.outer > self.touch
        ):  # a push downwards on a neighbour is felt by less than half, and never by the pads
            return InsertStep("up", p + aside + [0.0, 0.0, RELIEF], OVER * self._limit)
        if aside.any():
            return InsertStep("aside", p + aside, OVER * self._limit)
        return InsertStep("down", down, self._limit)

    def centred(self, p: Float64, pressed: Float64) -> Float64 | None:
        """Return where the hand goes that one pad alone presses on the fruit, shape (3,) [m]; None if none does.

        Args:
            p: place of the TCP, shape (3,) [m].
            pressed: normal forces of the left and the right pad, negative where they press, shape (2,) [N].
        """
        place = centred(p, self._R, pressed)
        return None if place is None or self._blocked(place) else place

    def _aside(self, force: Float64) -> Float64:
        """Return the way sideways that a force asks for in the base frame, shape (3,) [m]."""
        size = float(np.linalg.norm(force[:2]))
        if size < FELT:
            return np.zeros(3)
        way: Float64 = self._R @ np.append(force[:2] / size, 0.0)
        return float(np.clip(COMPLIANCE * size, SHORTEST, LONGEST)) * way * [1.0, 1.0, 0.0]


def centred(p: Float64, R_base_tcp: Float64, pressed: Float64) -> Float64 | None:
    """Return where a hand goes that one pad alone presses on the fruit, shape (3,) [m]; None if none or both do.

    Args:
        p: place of the TCP, shape (3,) [m].
        R_base_tcp: turn of the tool, shape (3, 3).
        pressed: normal forces of the left and the right pad, negative where they press, shape (2,) [N].
    """
    alone = pressed < -FELT
    if alone.all() or not alone.any():
        return None
    place: Float64 = p + (1.0 if alone[0] else -1.0) * CENTRING * R_base_tcp[:, 1]
    return place
