"""A hand that is led along moving poses by streamed set-points, and that rises and rests at the end in any case."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from pomona.applications.conveyor.intercepting import BRAKES, Rise, aim_of, is_fast
from pomona.applications.conveyor.reach_watch import ReachWatch
from pomona.drivers import Arm, BadTrajectory, Gripper, MotionState, SetPoints
from pomona.executive import Clock, Float64, SkillFailure, Work
from pomona.skills.grip import Hold
from pomona.skills.motion import RobotModel, nearest_solution

WATCHDOG = 0.15  # time without a set-point after which the arm comes to rest [s]
# half of the time between set-points [s]: each is the best for the middle of its time
HALF_TICK = 0.01
LIMIT_MARGIN = 0.02
"""Distance of set-points from the joints' limits [rad]: from a limit itself the next path would be refused."""
CLEAR = 0.10  # height to which a hand rises that has not picked [m]
SLIGHTLY = 1.15  # speed of a joint over its limit that is cut off to the limit [relative]: near the end of the reach
HOVER = 0.35
"""Time for which the hand goes on with the belt while its fingers open [s]: 20 mm at 0.1 m/s and some more."""


class OutOfReach(Exception):
    """A pose that the arm cannot follow to."""


class HandStream:
    """The hand's set-points.

    Attributes:
        motion: the streamed motion; q: joints of the newest set-point, shape (dof,) [rad].
        moved: whether it was led anywhere; rises: its way up, once it has begun.
    """

    def __init__(self, arm: Arm, motion: SetPoints, clock: Clock) -> None:
        self.motion = motion
        self.moved = False
        self.robot = inner_robot(arm)
        self.q: Float64 = arm.state().q.copy()
        self._arm = arm
        self._clock = clock
        self._pose: Callable[[float], Float64] | None = None
        self.rises: Rise | None = None

    @property
    def ahead(self) -> float:
        """Time on the cell's clock for which a set-point is sent now [s]."""
        return self._clock.now() + self.motion.delay + HALF_TICK

    @property
    def beside(self) -> float:
        """Distance of the hand from where it should be now [m]."""
        if self._pose is None:
            return 0.0
        p = self.robot.tcp(self._arm.state().q)[:3, 3]
        return float(np.linalg.norm(p - self._pose(self._clock.now())[:3, 3]))

    def follow(self, pose: Callable[[float], Float64]) -> None:
        """Lead the hand along T_base_tcp as a function of time [s]. Raises OutOfReach: the arm cannot."""
        self._pose = pose
        self.moved = True
        found = aim_of(self.robot, pose, self.ahead, self.q)
        if found is None:
            raise OutOfReach("the arm reaches no further along the belt in this posture")
        q, qd = found
        most = self._arm.limits.velocity
        if (np.abs(qd) <= SLIGHTLY * most).all():  # it falls behind a little
            qd = np.clip(qd, -most, most)
        try:
            self.motion.aim(q, qd, self.ahead)
        except BadTrajectory as bad:
            raise OutOfReach(f"the hand would leave the arm's limits: {bad}") from bad
        self.q = q

    def way_up(self, height: float, after: float = 0.0) -> tuple[Float64, Float64]:
        """Return postures of a rise, shape (n,) [s] and (n, dof) [rad], as far as the arm reaches.

        Args:
            height: of the rise [m].
            after: time for which the hand goes on as it does before it rises [s].
        """
        begin = self.ahead
        on = self._pose
        up = self.rises or self._up(height, begin + after)
        times = np.linspace(begin, begin + 0.1 if up is None else up.end, 12 + round(after / 0.05))
        still = np.tile(self.q, (len(times), 1))
        if up is None or on is None:
            return times, still
        way = self._way(lambda t: on(t) if t < begin + after else up.pose(t), times)
        still[:] = way[-1]
        still[: len(way)] = way
        return times, still

    def _way(self, pose: Callable[[float], Float64], times: Float64) -> Float64:
        """Return postures from the newest set-point on, as far as the arm reaches, shape (n, dof) [rad]."""
        found = [self.q]
        for t in times[1:]:
            if (q := nearest_solution(self.robot, pose(float(t)), found[-1])) is None:
                break
            found.append(q)
        return np.array(found)

    def rise(self, height: float, meanwhile: Callable[[], str | None]) -> Work[None]:
        """Rise from the moving pose, slow down along the belt, and come to rest. `meanwhile` is called in each tick.

        Where the arm reaches no further it comes to rest at once. A rise that has begun goes on as it is.
        """
        up = self.rises = self.rises or self._up(height, self.ahead)
        if up is not None:
            while self._clock.now() < up.end and self.motion.state is MotionState.RUNNING:
                try:
                    self.follow(up.pose)
                except OutOfReach:
                    break
                yield meanwhile() or "rising"
        yield from self.rest(meanwhile)

    def _up(self, height: float, t: float) -> Rise | None:
        """Return the rise from where the hand is at a time [s], with the softest brakes for which it lies within reach
        and the joints' speeds; None if it was not led anywhere.
        """
        if self._pose is None:
            return None
        T = self._pose(t)
        velocity = (self._pose(t + 0.01)[:3, 3] - T[:3, 3]) / 0.01
        for brakes in BRAKES[is_fast(velocity) :]:
            up = Rise(t, T, velocity, height, brakes)
            times = np.linspace(self.ahead, up.end, 12)
            speeds = np.abs(np.diff(way := self._way(up.pose, times), axis=0)) / (
                times[1] - times[0]
            )
            if len(way) == len(times) and (speeds <= self._arm.limits.velocity).all():
                break
        return up

    def leave(
        self, opens: Callable[[], object] | None, look: Callable[[], str | None]
    ) -> Work[None]:
        """Give the fruit up: let `opens` open the fingers while the hand goes on with the belt, then rise and rest.

        `look` is called in each tick.
        """
        pose = self._pose
        began = self._clock.now()
        if opens is not None and pose is not None:
            opens()
            while self._clock.now() - began < HOVER and self.motion.state is MotionState.RUNNING:
                try:
                    self.follow(pose)
                except OutOfReach:
                    break
                look()
                yield "letting the fruit go"
        yield from self.rise(CLEAR, lambda: look() or "rising without the fruit")

    def rest(self, meanwhile: Callable[[], str | None] = lambda: None) -> Work[None]:
        """Come to rest."""
        self.motion.stop()
        while not self.motion.settled:
            yield meanwhile() or "coming to rest"


def end_pick(
    stream: HandStream, hold: Hold | None, gripper: Gripper, eyes: ReachWatch
) -> Work[None]:
    """Rise and rest after a pick that failed or was interrupted: with the fruit if it is held, else with open fingers.

    Without a running motion the hand comes to rest where it is.

    Raises SkillFailure: PATH_BLOCKED and others of `ReachWatch.look`, once the hand rests.
    """

    if not stream.moved or stream.motion.state is not MotionState.RUNNING:
        yield from stream.rest()
        return
    holds = hold is not None and hold.holds
    lets_go = None if hold is None or holds else partial(_open, hold, gripper)
    if not stream.rises:
        eyes.begin(stream.motion, *stream.way_up(CLEAR, HOVER if lets_go else 0.0), holds=holds)
    try:
        if holds:
            yield from stream.rise(CLEAR, lambda: eyes.look() or "rising with the fruit")
        else:
            yield from stream.leave(lets_go, eyes.look)
    except SkillFailure:
        yield from stream.rest()
        raise


def _open(hold: Hold, gripper: Gripper) -> None:
    hold.take_over()
    gripper.move(gripper.limits.width_max, gripper.limits.speed_max)


def inner_robot(arm: Arm) -> RobotModel:
    """Return the robot within its joint limits less `LIMIT_MARGIN`."""
    limits = arm.limits
    return replace(
        RobotModel.load(arm.description),
        lower=limits.lower + LIMIT_MARGIN,
        upper=limits.upper - LIMIT_MARGIN,
        endless=np.zeros(len(limits.lower), np.bool_),
    )
