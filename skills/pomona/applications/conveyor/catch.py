"""A pick from the running belt, moment by moment: where the hand goes, and which trouble ends it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from pomona.applications.conveyor.belt_watch import BeltWatch
from pomona.applications.conveyor.hand_stream import HandStream, OutOfReach
from pomona.applications.conveyor.intercepting import CLOSING, FAST, InterceptPlan, ReadyHand
from pomona.applications.conveyor.moving_grip import FIRST_BIAS, SOONER
from pomona.applications.conveyor.tracks import FruitTrack
from pomona.drivers import Arm, MotionState, Workspace
from pomona.executive import Float64, Skill, SkillFailure
from pomona.skills import record_touches
from pomona.skills.grip import Hold
from pomona.skills.motion import Grasp, arm_space
from pomona.skills.perception import MeasuredFruit

BESIDE = 8e-3
"""Distance of the hand from its place when the fingers begin to close beyond which the fruit is let pass [m]."""
SAME_TIME = 6.0
AT_SPEED = 0.3
"""Mean squared innovation of a track beyond which camera, joints and belt do not agree on the time, up to this speed
[m/s]; it grows with the square: 5 ms between colour and depth are 4.0 to 9.6 at 0.5 m/s."""
CLEARANCE = 5e-3  # distance of the arm from fixed objects on its way [m]
LATE = 0.8  # time beyond `CLOSING` after which fingers that hold nothing are opened [s]


Fails = Callable[..., SkillFailure]
"""`Skill.failure` of the skill that picks."""


def ready_hand(
    stream: HandStream, arm: Arm, workspace: Workspace, opening: float, height: float
) -> ReadyHand:
    """Return the hand where it stands; its ways must be free of fixed objects.

    Args:
        opening: of the fingers on the way [m].
        height: of the lift [m].
    """
    space = arm_space(arm, workspace, None, opening, CLEARANCE).leaving_table()

    def free(way: Float64) -> str:
        blocked = space.first_blocked(way)
        return "" if blocked is None else space.explain(way[min(blocked + 1, len(way) - 1)])[0]

    return ReadyHand(stream.robot, arm.limits, stream.q, height, free)


def require_motion(stream: HandStream, fails: Fails) -> None:
    """Raise SkillFailure: the streamed motion does not run any more, or at a part of the arm's speed.

    A hand that follows too slowly comes down beside its fruit, or on another one.
    """
    state = stream.motion.state
    if state is MotionState.RUNNING:
        if stream.motion.speed < 1.0:
            speed = stream.motion.speed
            words = f"the arm goes at {1e2 * speed:.0f} % of its speed, and a running belt needs all of it"
            code, end = (
                ("BEHIND", "the hand has risen")
                if stream.moved
                else ("REFUSED", "nothing has moved")
            )
            raise fails(code, f"{words}; {end}", speed=speed)
        return
    code = {MotionState.STOPPED: "STOPPED", MotionState.PAUSED: "BEHIND"}.get(
        state, "MOTION_FAILED"
    )
    words = (
        "the run was paused, and the belt goes on"
        if code == "BEHIND"
        else "the motion was stopped before its end"
    )
    raise fails(code, stream.motion.problem or words)


def require_grip(hold: Hold, codes: Sequence[str], fails: Fails) -> None:
    """Raise SkillFailure: the grip reports a problem with one of the codes, or another node took the fingers over."""
    problem = hold.problem
    if problem is not None and problem.code in codes:
        raise fails(problem.code, problem.message, **problem.data)
    if hold.ended:
        raise fails("LOST", "another node took the fingers over before the fruit was lifted")


class Catch:
    """A pick under way.

    Attributes:
        pick: the plan; track: the fruit as it was last seen.
    """

    def __init__(
        self,
        pick: InterceptPlan,
        track: FruitTrack,
        tracks: BeltWatch,
        stream: HandStream,
        fails: Fails,
    ) -> None:
        self.pick = pick
        self.track = track
        self._fails = fails
        self._tracks = tracks
        self._stream = stream
        self._speed, self._change = tracks.travel.steady()
        self._first = track
        self._judged = False

    def reaches(self, now: float) -> bool:
        """Return True while the hand comes to the fruit, until the grip may take its bias; `now` [s]."""
        return now < self.pick.arrival - FIRST_BIAS - SOONER * (self._speed > FAST)

    def meeting(self) -> tuple[float, Float64]:
        """Return when [s] and where, shape (3,) [m] in the base frame, the hand will be around the fruit."""
        return self.pick.arrival, self._tracks.place(self.track, self.pick.arrival)[0]

    def reach(self) -> None:
        """Lead the hand to the fruit.

        Raises SkillFailure: TRACK_LOST, POSE_MISMATCH, BELT_CHANGED, END_OF_REACH, or of the motion.
        """
        require_motion(self._stream, self._fails)
        seen = self._tracks.tracks.track(self.track.number)
        if seen is None or (seen.missed > 0 and seen.likelier < 0.0):
            raise self._fails(
                "TRACK_LOST", "the fruit is not where it should be; the hand has risen"
            )
        innovation = seen.innovation_since(self._first)
        if innovation > SAME_TIME * max(self._speed / AT_SPEED, 1.0) ** 2:
            words = "the fruit seems to move with the camera: times of joints and frames differ, or its pose is wrong"
            raise self._fails(
                "POSE_MISMATCH", f"{words}; the hand has risen", innovation=round(innovation, 1)
            )
        self.track = seen
        self._lead()

    def close(self, now: float) -> None:
        """Lead the hand on while its fingers close, at `now` [s].

        Raises SkillFailure: BELT_CHANGED, END_OF_REACH, BEHIND, or of the motion.
        """
        require_motion(self._stream, self._fails)
        self._lead()
        if now >= self.pick.arrival and not self._judged:
            self._judged = True
            if (beside := self._stream.beside) > BESIDE:
                words = f"the hand is {1e3 * beside:.0f} mm from its place beside the fruit"
                raise self._fails("BEHIND", f"{words}; it has risen", beside_m=beside)

    def require_contact(self, now: float) -> None:
        """Raise SkillFailure: the fingers hold nothing although they have had the time, at `now` [s]."""
        if now > self.pick.arrival + CLOSING + LATE:
            raise self._fails("NO_CONTACT", "the fingers hold nothing; the hand has risen")

    def grasp(self, q: Float64, width: float) -> Grasp:
        """Return the grasp by which the fruit is held.

        Args:
            q: joints, shape (dof,) [rad].
            width: between the pads [m].
        """
        T_base_tcp = self._stream.robot.tcp(q)
        T_base_fruit = self.track.measured.T_base_fruit.copy()
        T_base_fruit[:3, 3] = T_base_tcp[:3, 3] - self.pick.grip
        fruit: MeasuredFruit = replace(self.track.measured, T_base_fruit=T_base_fruit)
        above = T_base_tcp.copy()
        above[2, 3] += 0.1
        return Grasp(0, 0.0, 0.0, above, T_base_tcp, width, q[None], 0.0, 0.0, fruit)

    def note_touches(self, skill: Skill, hold: Hold, now: float) -> None:
        """Record the pads' touches beside the fruit as it was seen, carried by the belt until `now` [s]."""
        fruit = self.track.measured
        carried = self._tracks.place(self.track, now)[0] - fruit.T_base_fruit[:3, 3]
        record_touches(skill, fruit, hold.first_touches, carried=carried)

    def _lead(self) -> None:
        speed = self._tracks.travel.speed
        if abs(speed - self._speed) > self._change:
            words = f"the belt ran at {self._speed:.3f} m/s and now at {speed:.3f} m/s; the hand has risen"
            raise self._fails("BELT_CHANGED", words, before=self._speed, now=speed)
        place = partial(self._tracks.place, self.track)
        try:
            self._stream.follow(lambda t: self.pick.pose(t, place))
        except OutOfReach as end:
            raise self._fails("END_OF_REACH", f"{end}; the hand has risen") from end
