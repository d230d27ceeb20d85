"""The skill Track."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from pomona.applications.conveyor.belt_skill import BELT_FAILURES
from pomona.applications.conveyor.belt_watch import BeltWatch
from pomona.applications.conveyor.conveyor import FASTEST, Belt, Conveyor
from pomona.applications.conveyor.drawn_frame import warm_up
from pomona.applications.conveyor.travel import SAME_SPEED, Travel
from pomona.drivers import Arm, Camera, Frame
from pomona.executive import SPEED, Float64, Outputs, Port, Speed, Work
from pomona.skills import LOOKING_FAILURES, LookingSkill

# time over which the encoder is watched before its travel is used [s]: 12 mm at 0.05 m/s
LISTENS = 0.25
# distance from the surface within which depth is its [m], least share: the rest may be fruit
NEAR = 0.02
LEAST = 0.3
FEWEST = 20  # points of the belt's surface that a picture must show


class Tracked(Outputs):
    """Outputs of Track."""

    tracks: Annotated[BeltWatch, Port(help="fruit on the belt, kept up by the skills that take it")]


class Track(LookingSkill):
    """Check that the camera sees the belt and that its encoder counts, and begin to track its fruit.

    The tracks are kept up by the skills that take them, as a grip is by its sensor. Nothing moves.
    """

    devices = (Camera, Conveyor)
    optional_devices: ClassVar[tuple[type, ...]] = (Arm,)
    failures = (*LOOKING_FAILURES, *BELT_FAILURES[2:], "NO_DEPTH", "NO_BELT", "BELT_TOO_FAST")

    def prepare(self) -> None:
        super().prepare()
        if (name := self.known("fruit")) is not None:
            warm_up(self.fruit_model(name), self.device(Conveyor).belt)

    def run(
        self,
        fruit: Annotated[str, Port(help="fruit to look for: a name in the catalogue, or a path")],
        fastest: Annotated[
            Speed, Port(min="0 m/s", max="2 m/s", help="speed of the belt that the arm can follow")
        ] = (SPEED(f"{FASTEST} m/s")),
    ) -> Work[Tracked]:
        model = self.fruit_model(fruit)
        conveyor = self.device(Conveyor)
        frame = self.newest_frame()
        if frame.depth is None:
            raise self.failure(
                "NO_DEPTH", "the camera gives no depth, and a place on the belt needs it"
            )
        share, points = belt_seen(frame, self.camera_pose(frame), conveyor.belt)
        if share < LEAST:
            where = (
                f"{share:.0%} of the depth there lies on it"
                if points
                else "it lies outside the picture"
            )
            words = f"the camera sees no belt where the cell file has one: {where}"
            remedy = "check its `beside` and `top` there, and the pose from which the camera looks"
            raise self.failure("NO_BELT", f"{words}; {remedy}", share=share)
        watch = BeltWatch(model, conveyor.belt, conveyor.travelled() is not None)
        travel = Travel()
        began = self.clock.now()
        while watch.tracks.encoder and self.clock.now() - began < LISTENS:
            travel.note(conveyor.travelled())
            yield "listening to the encoder"
        if watch.tracks.encoder and (problem := travel.problem(self.clock.now(), np.inf)):
            raise self.failure("ENCODER_FAULT", f"{problem}; nothing has moved")
        if travel.speed > fastest + SAME_SPEED:
            words = f"the belt runs at {travel.speed:.2f} m/s, the arm can follow up to {fastest:.2f} m/s"
            raise self.failure("BELT_TOO_FAST", f"{words}; nothing has moved", speed=travel.speed)
        watch.travel = travel
        return Tracked(watch)


def belt_seen(frame: Frame, T_base_camera: Float64, belt: Belt) -> tuple[float, int]:
    """Return the share of a frame's depth on a belt's surface that is the belt's, and how many points it shows."""
    pixels, z, shown = belt.pictured(frame.intrinsics, T_base_camera)
    if frame.depth is None or shown.sum() < FEWEST:
        return 0.0, 0
    u, v = pixels[:, shown]
    return float(np.mean(np.abs(frame.depth[v, u] - z[shown]) < NEAR)), int(shown.sum())
