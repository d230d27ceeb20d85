"""Whether a fruit on the belt can be picked now: sure of its place, no neighbour, a free way to its end."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from pomona.applications.conveyor.await_fruit import ComingFruit
from pomona.applications.conveyor.belt_watch import BeltWatch
from pomona.applications.conveyor.intercepting import (
    CLOSING,
    DESCENTS,
    QUICK,
    REACHES,
    InterceptPlan,
    NoPick,
    ReadyHand,
    ellipse_radius,
    grip_yaws,
    in_the_way,
    is_fast,
    plan_pick,
    plumb,
    reachable,
)
from pomona.applications.conveyor.moving_grip import OPENING
from pomona.applications.conveyor.tracks import FruitTrack
from pomona.executive import Float64

SURE_UNTIL = 1.3
"""Time from now on for which a place must be sure before the hand sets off [s]: a usual reach and descent."""
SOONEST = REACHES[0] + DESCENTS[0] + CLOSING
"""Shortest time from setting off to a closed grip for which reach is kept [s]."""


@dataclass(frozen=True, slots=True)
class FruitWidth:
    """How a fruit is gripped: angles of the hand to the belt, best first [rad], and its width there [m]."""

    yaws: tuple[float, ...]
    width: float

    @classmethod
    def of(cls, target: ComingFruit, along: Float64) -> FruitWidth:
        """Return the narrow grips of a fruit as it was measured; `along` is the belt's direction, shape (3,)."""
        measured = target.measured
        vertices = measured.fruit.vertices * (measured.dimensions / measured.fruit.dimensions)
        return cls(*grip_yaws(vertices, measured.T_base_fruit[:3, :3], along))

    def opening(self, most: float) -> float | None:
        """Return the opening for the way down, where the hand opens to `most` [m]; None if it does not suffice."""
        return None if most < self.width + OPENING / 3.0 else min(self.width + OPENING, most)


class PickChoice:
    """Judges from moment to moment whether one fruit can be picked."""

    def __init__(
        self, hand: ReadyHand, tracks: BeltWatch, grip: FruitWidth, opening: float, sure: float
    ) -> None:
        """
        Args:
            sure: largest half-axis of its place's 90 % ellipse [m].
        """
        self._hand = hand
        self._tracks = tracks
        self._grip = grip
        self._opening = opening
        self._sure = sure
        self._end: float | None = None
        self._why: NoPick | None = None

    def now(self, track: FruitTrack, now: float) -> InterceptPlan | NoPick:
        """Return a pick that begins now, or why there is none; without a code it may be possible later."""
        pick = self._possible(track, now)
        if isinstance(pick, InterceptPlan):
            return pick
        if pick.late:
            return self._why or pick
        self._why = pick if pick.code else self._why
        if self._too_late(track, now):
            beside = 1e3 * abs(
                np.cross(self._tracks.tracks.belt.direction, self._tracks.place(track, now)[0])[2]
            )
            words = f"the fruit has passed; {beside:.0f} mm beside the base the hand reaches"
            return self._why or NoPick(
                "OUT_OF_REACH", f"{words} {1e3 * self._span:.0f} mm along the belt"
            )
        return NoPick("", pick.reason)

    def _possible(self, track: FruitTrack, now: float) -> InterceptPlan | NoPick:
        tracks = self._tracks
        place = partial(self._tracks.place, track)
        if not track.rests:
            return NoPick("TOO_UNSURE", "the fruit rolls on the belt")
        radius = ellipse_radius(tracks.covariance(track, now + SURE_UNTIL))
        if radius > self._sure:
            words = (
                f"its place is known to {1e3 * radius:.1f} mm, {1e3 * self._sure:.1f} are allowed"
            )
            return NoPick("TOO_UNSURE", words)
        pick = plan_pick(
            self._hand, now, place, np.zeros(3), self._grip.yaws, tracks.tracks.belt.direction
        )
        if isinstance(pick, NoPick):
            return pick
        others = [
            (tracks.place(other, pick.arrival)[0], float(other.dimensions.max()) / 2.0)
            for other in tracks.tracks.tracks
            if other.number != track.number
        ]
        overlap = in_the_way(others, place(pick.arrival)[0], pick.R_base_grasp, self._opening)
        if overlap > 0.0:
            return NoPick(
                "NEIGHBOUR_AT_RISK", f"a finger would come {1e3 * overlap:.0f} mm into a neighbour"
            )
        return pick

    def _too_late(self, track: FruitTrack, now: float) -> bool:
        """Return True if even the quickest pick would end beyond the reach."""
        along = self._tracks.tracks.belt.direction
        p, v = self._tracks.place(track, now)
        if self._end is None:
            before, behind = reachable(self._hand, p, plumb(along, self._grip.yaws[0]), along)
            # of the hand's reach
            self._end = float(p @ along) + behind
            self._span = behind - before
        return (
            float(p @ along)
            + max(float(v @ along), 0.0) * (SOONEST - is_fast(v) * (CLOSING - QUICK))
            > self._end
        )
