"""The skill Intercept."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Annotated

from pomona.applications.conveyor.await_fruit import ComingFruit
from pomona.applications.conveyor.belt_skill import BELT_FAILURES, BeltSkill
from pomona.applications.conveyor.belt_view import bare_belt
from pomona.applications.conveyor.belt_watch import BeltWatch
from pomona.applications.conveyor.catch import Catch, ready_hand, require_grip, require_motion
from pomona.applications.conveyor.conveyor import Conveyor
from pomona.applications.conveyor.hand_stream import WATCHDOG, HandStream, end_pick
from pomona.applications.conveyor.intercepting import FAST, InterceptPlan
from pomona.applications.conveyor.moving_grip import felt_width, moving_grip
from pomona.applications.conveyor.pick_choice import FruitWidth, PickChoice
from pomona.applications.conveyor.reach_watch import ReachWatch, prepare_reach_watch
from pomona.applications.conveyor.tracks import FruitTrack
from pomona.drivers import (
    Arm,
    Camera,
    Cameras,
    Carrier,
    ForceSensor,
    Gripper,
    MotionRefused,
    Pads,
    StreamedArm,
    Workspace,
)
from pomona.executive import LENGTH, Interrupted, Length, Outputs, Port, SkillFailure, Work
from pomona.skills import MOTION_FAILURES, prepare_moving, show_grip
from pomona.skills.grip import (
    GripController,
    GripPhase,
    Hold,
    surface_table,
    take_over,
    warm_up,
)
from pomona.skills.motion import Grasp


class Caught(Outputs):
    """Outputs of Intercept."""

    hold: Annotated[Hold, Port(help="grip that continues")]
    grasp: Annotated[Grasp, Port(help="grasp by which the fruit is held")]
    width: Annotated[Length, Port(help="width of the fruit where the pads touched it")]


class Intercept(BeltSkill):
    """Pick a fruit from the running belt: reach it, match its speed, descend, close, and lift; the hand ends at rest.

    Nothing moves before the whole pick is known to lie within reach, limits and uncertainty. After a failure later the
    hand rises from the belt and rests, and so it does after an interruption. A fruit that is held stays held.
    """

    devices = (Camera, Conveyor, Arm, StreamedArm, Gripper, ForceSensor, Pads, Workspace)
    optional_devices = (Cameras, Carrier)
    moves = (Arm, StreamedArm, Gripper)
    failures = (
        *MOTION_FAILURES,
        *BELT_FAILURES,
        "OUT_OF_REACH",
        "TOO_UNSURE",
        "TOO_WIDE",
        "NEIGHBOUR_AT_RISK",
        "TRACK_LOST",
        "BELT_CHANGED",
        "BEHIND",
        "END_OF_REACH",
        "NO_CONTACT",
        "ONE_FINGER",
        "OUT_OF_STROKE",
        "FORCE_LIMIT",
        "SENSOR_STALE",
        "SENSOR_SATURATED",
        "SENSOR_FAULT",
        "SLIPPED",
        "LOST",
    )

    def prepare(self) -> None:
        prepare_moving(self)
        prepare_reach_watch(self)
        warm_up(self.device(ForceSensor).rate)

    def run(
        self,
        target: Annotated[ComingFruit, Port(help="the fruit, of AwaitFruit")],
        tracks: Annotated[BeltWatch, Port(help="fruit on the belt, of Track")],
        sure: Annotated[
            Length,
            Port(
                min="0.5 mm",
                max="20 mm",
                help="largest error of the place (90 %) with which the arm sets off",
            ),
        ] = LENGTH("4 mm"),
        height: Annotated[
            Length, Port(min="50 mm", max="400 mm", help="height of the lift")
        ] = LENGTH("150 mm"),
    ) -> Work[Caught]:
        yield from self.compute(surface_table, moving_grip(self, target.measured, 0.0).contact)
        arm = self.device(Arm)
        gripper = self.device(Gripper)
        take_over(gripper)
        eyes = ReachWatch(self)
        yield from eyes.open()
        try:
            stream = HandStream(arm, self.device(StreamedArm).stream(WATCHDOG), self.clock)
        except MotionRefused as refused:
            raise self.failure(
                "REFUSED", f"{refused}; nothing has moved", device=refused.device
            ) from refused
        hold: Hold | None = None
        try:
            tracks.newest_frame = self.clock.now()
            pick, track, width = yield from self._plan(target, tracks, stream, eyes, sure, height)
            fast = tracks.travel.speed > FAST
            settings = moving_grip(self, target.measured, width, fast)
            catch = Catch(pick, track, tracks, stream, self.failure)
            while catch.reaches(self.clock.now()):
                self.look(tracks, False, catch.meeting())
                ahead = eyes.look()
                catch.reach()
                yield ahead or f"reaching, {pick.arrival - self.clock.now():.1f} s to the fruit"
            hold = Hold(
                gripper, self.device(ForceSensor), GripController(settings), self.clock.now, arm
            ).under(gripper)
            try:
                while hold.phase is not GripPhase.HOLDING:
                    self.look(tracks, search=False)
                    eyes.look()
                    catch.close(self.clock.now())
                    self._carry(hold)
                    catch.require_contact(self.clock.now())
                    yield f"{hold.phase.value}, {hold.reading.f_n:.1f} N"
            except SkillFailure:
                catch.note_touches(self, hold, self.clock.now())
                raise
            catch.note_touches(self, hold, self.clock.now())
            self.publish("belt", bare_belt(tracks))
            grasp = catch.grasp(arm.state().q, gripper.state().width)
            eyes.begin(stream.motion, *stream.way_up(height), holds=True)
            yield from stream.rise(height, partial(self._carry, hold, eyes, tracks))
        except SkillFailure:
            yield from end_pick(stream, hold, gripper, eyes)
            raise
        except Interrupted:
            with suppress(SkillFailure):  # what blocks the way up has stopped arm and belt
                yield from end_pick(stream, hold, gripper, eyes)
            raise
        except BaseException:
            stream.motion.stop()
            raise
        self._carry(hold)
        show_grip(self, hold, everything=True)
        return Caught(hold, grasp, felt_width(hold) or gripper.state().width)

    def _plan(
        self,
        target: ComingFruit,
        tracks: BeltWatch,
        stream: HandStream,
        eyes: ReachWatch,
        sure: float,
        height: float,
    ) -> Work[tuple[InterceptPlan, FruitTrack, float]]:
        """Stand until a pick is possible; then open the fingers and return it, the fruit and its width."""
        arm = self.device(Arm)
        gripper = self.device(Gripper)
        grip = FruitWidth.of(target, tracks.tracks.belt.direction)
        opening = grip.opening(gripper.limits.width_max)
        if opening is None:
            words = f"the fruit is {1e3 * grip.width:.0f} mm wide; nothing has moved"
            raise self.failure("TOO_WIDE", words, width=grip.width)
        hand = ready_hand(stream, arm, self.device(Workspace), opening, height)
        choice = PickChoice(hand, tracks, grip, opening, sure)
        while True:
            self.look(tracks, search=True)
            require_motion(stream, self.failure)
            track = tracks.tracks.track(target.number)
            if track is None:
                raise self.failure(
                    "TRACK_LOST", "the fruit is not seen any more; nothing has moved"
                )
            pick = choice.now(track, self.clock.now())
            if isinstance(pick, InterceptPlan):
                eyes.begin(stream.motion, pick.times, pick.postures)
                if not (yield from eyes.sees_free()):
                    continue
                gripper.move(opening, gripper.limits.speed_max)
                return pick, track, grip.width
            if pick.code:
                raise self.failure(pick.code, f"{pick.reason}; nothing has moved")
            stream.motion.aim(stream.q)  # it stays where it is
            yield f"waiting: {pick.reason}"

    def _carry(
        self, hold: Hold, eyes: ReachWatch | None = None, tracks: BeltWatch | None = None
    ) -> None:
        """Show the grip, and look; a problem of it is a failure."""
        show_grip(self, hold)
        require_grip(hold, self.failures, self.failure)
        if eyes is not None and tracks is not None:
            eyes.look()
            self.require_frames(tracks)
