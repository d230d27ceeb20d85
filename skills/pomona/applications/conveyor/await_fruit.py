"""The skill AwaitFruit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pomona.applications.conveyor.belt_skill import BELT_FAILURES, BeltSkill
from pomona.applications.conveyor.belt_watch import BeltWatch
from pomona.applications.conveyor.conveyor import AT_REST
from pomona.applications.conveyor.tracks import FruitTrack
from pomona.executive import LENGTH, TIME, Float64, Length, Outputs, Port, Time, Work
from pomona.skills.perception import MeasuredFruit


@dataclass(frozen=True, slots=True, eq=False)
class ComingFruit:
    """A fruit that comes on the belt.

    Attributes:
        number: of its track.
        measured: its first measurement.
        place, speed: in the base frame, shape (3,) [m], and along the belt [m/s], when it was chosen.
    """

    number: int
    measured: MeasuredFruit
    place: Float64
    speed: float

    @property
    def sentence(self) -> str:
        """Text for the operator."""
        size = " × ".join(f"{1e3 * d:.0f}" for d in self.measured.dimensions)
        return f"fruit {self.number}, {size} mm, at {self.speed:.2f} m/s"


class Awaited(Outputs):
    """Outputs of AwaitFruit."""

    target: Annotated[ComingFruit, Port(help="the fruit that comes next")]
    measured: Annotated[MeasuredFruit, Port(help="its first measurement, for KeepTally")]


class AwaitFruit(BeltSkill):
    """Wait for a fruit that rests on the belt and was not tried yet; the one that will be gone soonest is chosen."""

    failures = (*BELT_FAILURES, "NOTHING_COMES")

    def run(
        self,
        tracks: Annotated[BeltWatch, Port(help="fruit on the belt, of Track")],
        within: Annotated[
            Time, Port(min="0 s", help="time without a fruit after which the task ends")
        ] = TIME("20 s"),
        until: Annotated[
            Length,
            Port(
                min="-2 m",
                max="2 m",
                help="place along the belt, from its middle, beyond which fruit is let pass",
            ),
        ] = LENGTH("-100 mm"),
    ) -> Work[Awaited]:
        began = self.context.elapsed()
        tracks.newest_frame = self.clock.now()
        while True:
            self.look(tracks, search=True)
            now = self.clock.now()
            coming = [
                (self._along(tracks, track, now), track)
                for track in tracks.tracks.tracks
                if track.rests
            ]
            tracks.passed |= {
                track.number
                for x, track in coming
                if until <= x < np.inf and track.number not in tracks.tried
            }
            if passed := len(tracks.passed):
                self.account("passed", f"{passed} fruit passed the hand untried")
            ready = [
                (x, track) for x, track in coming if x < until and track.number not in tracks.tried
            ]
            if ready:
                chosen = max(ready, key=lambda each: each[0])[1]
                tracks.tried.add(chosen.number)
                p, v = tracks.place(chosen, now)
                speed = float(v @ tracks.tracks.belt.direction)
                return Awaited(
                    ComingFruit(chosen.number, chosen.measured, p, speed), chosen.measured
                )
            if self.context.elapsed() - began > within:
                seen = len(tracks.tracks.tracks)
                words = f"no fruit came within {within:.0f} s" + (
                    f"; {seen} are seen that roll or pass" if seen else ""
                )
                if tracks.tracks.encoder and abs(speed := tracks.travel.speed) < AT_REST:
                    words += f": the belt stands still, at {speed:.3f} m/s; start it, or check its encoder"
                self.account(
                    "fruit on the belt", f"{seen} fruit on the belt not tried" if seen else ""
                )
                self.account("nothing_left", f"picture: {words}")
                raise self.failure("NOTHING_COMES", words, seen=seen)
            yield tracks.sentence

    @staticmethod
    def _along(tracks: BeltWatch, track: FruitTrack, now: float) -> float:
        place, _ = tracks.tracks.expected(track, now, tracks.travel.at(now))
        return float(place[0]) if np.isfinite(place[0]) else np.inf
