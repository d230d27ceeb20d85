"""The skill Intercept."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Annotated, ClassVar

from pomona.applications.conveyor.await_fruit import ComingFruit
from pomona.applications.conveyor.belt_skill import BELT_FAILURES, BeltSkill
from pomona.applications.conveyor.belt_watch import BeltWatch
from pomona.applications.conveyor.conveyor import Conveyor
from pomona.applications.conveyor.hand_stream import WATCHDOG, HandStream, OutOfReach
from pomona.applications.conveyor.intercepting import CLOSING, InterceptPlan, ReadyHand
from pomona.applications.conveyor.moving_grip import FIRST_BIAS, grip_settings
from pomona.applications.conveyor.pick_choice import FruitWidth, PickChoice
from pomona.applications.conveyor.tracks import FruitTrack
from pomona.drivers import (
    Arm,
    Camera,
    Cameras,
    ForceSensor,
    Gripper,
    MotionRefused,
    MotionState,
    StreamedArm,
    Workspace,
)
from pomona.executive import LENGTH, Float64, Interrupted, Length, Outputs, Port, Ratio, SkillFailure, Work
from pomona.skills import MOTION_FAILURES, prepare_moving, show_grip
from pomona.skills.grip import GripController, GripPhase, Hold, SoftContact, surface_table, take_over, warm_up
from pomona.skills.motion import Grasp, arm_space
from pomona.skills.perception import MeasuredFruit

CHANGED = 0.02
"""Change of the belt's speed with which a pick is given up [m/s]."""
BESIDE = 8e-3
"""Distance of the hand from its place when the fingers begin to close beyond which the fruit is let pass [m]."""
LATE = 0.8
"""Time beyond `CLOSING` after which fingers that hold nothing are opened [s]."""
CLEARANCE = 5e-3
"""Distance of the arm from fixed objects on its way [m]."""


class Caught(Outputs):
    """Outputs of Intercept."""

    hold: Annotated[Hold, Port(help="grip that continues")]
    grasp: Annotated[Grasp, Port(help="grasp by which the fruit is held")]
    width: Annotated[Length, Port(help="width of the fruit between the pads")]


class Intercept(BeltSkill):
    """Pick a fruit from the running belt: reach it, match its speed, descend, close, and lift; the hand ends at rest.

    Nothing moves before the whole pick is known to lie within reach, limits and uncertainty. After a failure later the
    hand rises from the belt and rests, and so it does after an interruption. A fruit that is held stays held.
    """

    devices = (Camera, Conveyor, Arm, StreamedArm, Gripper, ForceSensor, Workspace)
    optional_devices: ClassVar[tuple[type, ...]] = (Cameras,)
    moves = (Arm, StreamedArm, Gripper)
    failures = (
        *MOTION_FAILURES,
        *BELT_FAILURES,
        *("OUT_OF_REACH", "TOO_UNSURE", "TOO_WIDE", "NEIGHBOUR_AT_RISK", "PATH_BLOCKED"),
        *("TRACK_LOST", "BELT_CHANGED", "BEHIND", "END_OF_REACH"),
        *("NO_CONTACT", "ONE_FINGER", "OUT_OF_STROKE", "FORCE_LIMIT", "SENSOR_STALE", "SENSOR_SATURATED"),
        *("SENSOR_FAULT", "SLIPPED", "LOST"),
    )

    def prepare(self) -> None:
        prepare_moving(self)
        warm_up(self.device(ForceSensor).rate)

    def run(
        self,
        target: Annotated[ComingFruit, Port(help="the fruit, of AwaitFruit")],
        tracks: Annotated[BeltWatch, Port(help="fruit on the belt, of Track")],
        sure: Annotated[
            Length,
            Port(min="0.5 mm", max="20 mm", help="largest error of the place (90 %) with which the arm sets off"),
        ] = LENGTH("4 mm"),
        height: Annotated[Length, Port(min="50 mm", max="400 mm", help="height of the lift")] = LENGTH("150 mm"),
        mu: Annotated[Ratio, Port(min=0.05, max=3.0, help="friction of the pads on this fruit")] = 0.79,
        mu_uncertainty: Annotated[Ratio, Port(min=0.0, max=0.5, help="of it, relative; covered by more force")] = 0.125,
        delta: Annotated[Length, Port(help="contact radius at 1 N")] = LENGTH("6 mm"),
    ) -> Work[Caught]:
        contact = SoftContact(mu, delta, 0.0, 4.0)
        yield from self.compute(surface_table, contact)
        arm, gripper = self.device(Arm), self.device(Gripper)
        take_over(gripper)
        try:
            stream = HandStream(arm, self.device(StreamedArm).stream(WATCHDOG), self.clock)
        except MotionRefused as refused:
            raise self.failure("REFUSED", f"{refused}; nothing has moved", device=refused.device) from refused
        hold: Hold | None = None
        try:
            tracks.newest_frame = self.clock.now()
            pick, track, width = yield from self._plan(target, tracks, stream, sure, height)
            settings = grip_settings(contact, mu_uncertainty, target.measured, width, gripper, self.device(ForceSensor))
            track = yield from self._approach(pick, track, tracks, stream)
            hold = Hold(gripper, self.device(ForceSensor), GripController(settings), self.clock.now).under(gripper)
            yield from self._close(pick, track, tracks, stream, hold)
            grasp = self._grasp(pick, track, tracks, stream)
            yield from stream.rise(height, partial(self._carry, hold))
        except GeneratorExit:
            stream.motion.stop()
            raise
        except (SkillFailure, Interrupted):
            yield from self._end(stream, hold)
            raise
        except BaseException:
            stream.motion.stop()
            raise
        self._carry(hold)
        show_grip(self, hold, everything=True)
        return Caught(hold, grasp, gripper.state().width)

    # ------------------------------------------------------------------------------------------------- before it moves

    def _plan(
        self, target: ComingFruit, tracks: BeltWatch, stream: HandStream, sure: float, height: float
    ) -> Work[tuple[InterceptPlan, FruitTrack, float]]:
        """Stand until a pick is possible; then open the fingers and return it, the fruit and its width."""
        arm, gripper = self.device(Arm), self.device(Gripper)
        grip = FruitWidth.of(target, tracks.tracks.belt.direction)
        opening = grip.opening(gripper.limits.width_max)
        if opening is None:
            words = f"the fruit is {1e3 * grip.width:.0f} mm wide; nothing has moved"
            raise self.failure("TOO_WIDE", words, width=grip.width)
        space = arm_space(arm, self.device(Workspace), None, opening, CLEARANCE).leaving_table()

        def free(way: Float64) -> str:
            blocked = space.first_blocked(way)
            return "" if blocked is None else space.explain(way[min(blocked + 1, len(way) - 1)])[0]

        hand = ReadyHand(stream.robot, arm.limits, stream.q, height, free)
        choice = PickChoice(hand, tracks, grip, opening, sure)
        while True:
            self.look(tracks, search=True)
            self._require(stream)
            track = tracks.tracks.track(target.number)
            if track is None:
                raise self.failure("TRACK_LOST", "the fruit is not seen any more; nothing has moved")
            pick = choice.now(track, self.clock.now())
            if isinstance(pick, InterceptPlan):
                gripper.move(opening, gripper.limits.speed_max)
                return pick, track, grip.width
            if pick.code:
                raise self.failure(pick.code, f"{pick.reason}; nothing has moved")
            stream.stand()
            yield f"waiting: {pick.reason}"

    # --------------------------------------------------------------------------------------------------- while it moves

    def _approach(
        self, pick: InterceptPlan, track: FruitTrack, tracks: BeltWatch, stream: HandStream
    ) -> Work[FruitTrack]:
        """Reach, match and descend until the grip may take its bias; returns the fruit as last seen."""
        speed = tracks.travel.speed
        while self.clock.now() < pick.arrival - FIRST_BIAS:
            self.look(tracks, False, (pick.arrival, tracks.place(track, pick.arrival)[0]))
            self._require(stream)
            seen = tracks.tracks.track(track.number)
            if seen is None or (seen.missed > 0 and seen.likelier < 0.0):
                raise self.failure("TRACK_LOST", "the fruit is not where it should be; the hand has risen")
            track = seen
            self._require_belt(tracks, speed)
            self._lead(stream, pick, track, tracks)
            yield f"reaching, {pick.arrival - self.clock.now():.1f} s to the fruit"
        return track

    def _close(
        self, pick: InterceptPlan, track: FruitTrack, tracks: BeltWatch, stream: HandStream, hold: Hold
    ) -> Work[None]:
        """Close the fingers around the fruit while the hand goes on with it."""
        speed, judged = tracks.travel.speed, False
        while hold.phase is not GripPhase.HOLDING:
            self.look(tracks, search=False)
            self._require(stream)
            self._require_belt(tracks, speed)
            self._lead(stream, pick, track, tracks)
            now = self.clock.now()
            if now >= pick.arrival and not judged:
                judged = True
                if stream.beside > BESIDE:
                    words = f"the hand is {1e3 * stream.beside:.0f} mm from its place beside the fruit"
                    raise self.failure("BEHIND", f"{words}; it has risen", beside_m=stream.beside)
            self._carry(hold)
            if now > pick.arrival + CLOSING + LATE:
                raise self.failure("NO_CONTACT", "the fingers hold nothing; the hand has risen")
            yield f"{hold.phase.value}, {hold.reading.f_n:.1f} N"

    def _lead(self, stream: HandStream, pick: InterceptPlan, track: FruitTrack, tracks: BeltWatch) -> None:
        place = partial(tracks.place, track)
        try:
            stream.follow(lambda t: pick.pose(t, place))
        except OutOfReach as end:
            raise self.failure("END_OF_REACH", f"{end}; the hand has risen") from end

    def _carry(self, hold: Hold) -> None:
        """Show the grip; a problem of it is a failure."""
        show_grip(self, hold)
        problem = hold.problem
        if problem is not None and problem.code in self.failures:
            raise self.failure(problem.code, problem.message, **problem.data)
        if hold.ended:
            raise self.failure("LOST", "another node took the fingers over before the fruit was lifted")

    def _require(self, stream: HandStream) -> None:
        state = stream.motion.state
        if state is MotionState.RUNNING:
            return
        code = {MotionState.STOPPED: "STOPPED", MotionState.PAUSED: "BEHIND"}.get(state, "MOTION_FAILED")
        words = (
            "the run was paused, and the belt goes on" if code == "BEHIND" else "the motion was stopped before its end"
        )
        raise self.failure(code, stream.motion.problem or words)

    def _require_belt(self, tracks: BeltWatch, speed: float) -> None:
        if abs(tracks.travel.speed - speed) > CHANGED:
            words = f"the belt ran at {speed:.2f} m/s and now at {tracks.travel.speed:.2f} m/s; the hand has risen"
            raise self.failure("BELT_CHANGED", words, before=speed, now=tracks.travel.speed)

    def _end(self, stream: HandStream, hold: Hold | None) -> Work[None]:
        """Rise and rest, with the fruit if it is held, else with open fingers."""
        gripper = self.device(Gripper)
        if not stream.moved or stream.motion.state is not MotionState.RUNNING:
            yield from stream.rest()
        elif hold is not None and hold.holds:
            yield from stream.rise(0.1, lambda: None)
        else:
            opens = None if hold is None else partial(self._open, gripper, hold)
            yield from stream.leave(opens)

    @staticmethod
    def _open(gripper: Gripper, hold: Hold) -> None:
        hold.take_over()
        gripper.move(gripper.limits.width_max, gripper.limits.speed_max)

    def _grasp(self, pick: InterceptPlan, track: FruitTrack, tracks: BeltWatch, stream: HandStream) -> Grasp:
        """Return the grasp by which the fruit is held, as it is now."""
        q = self.device(Arm).state().q
        T_base_tcp, T_base_fruit = stream.robot.tcp(q), track.measured.T_base_fruit.copy()
        T_base_fruit[:3, 3] = T_base_tcp[:3, 3] - pick.grip
        fruit: MeasuredFruit = replace(track.measured, T_base_fruit=T_base_fruit)
        above = T_base_tcp.copy()
        above[2, 3] += 0.1
        width = self.device(Gripper).state().width
        return Grasp(0, 0.0, 0.0, above, T_base_tcp, width, q[None], 0.0, 0.0, fruit)
