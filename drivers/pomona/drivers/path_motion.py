"""The motion of an arm along a path: state for the caller, end, stop and pause."""

from __future__ import annotations

import math
from enum import Enum

from pomona.drivers.interfaces import ArmLimits, MotionState, Trajectory
from pomona.drivers.path_follower import PathFollower
from pomona.executive.values.arrays import Float64

HELD_UP = 1.0  # time after which joints that rest beside the path's end count as blocked [s]


class Phase(Enum):
    """State of the set-point: it follows the path, brakes on it, or rests."""

    RUNNING = "running"
    BRAKING = "braking"
    RESTING = "resting"


class PathMotion:
    """A `Motion` over a trajectory, stepped by the arm's driver at a fixed period."""

    def __init__(
        self,
        trajectory: Trajectory,
        limits: ArmLimits,
        period: float,
        speed: float = 1.0,
        q_from: Float64 | None = None,
    ) -> None:
        """The arguments are those of `PathFollower`."""
        self._follower = PathFollower(trajectory, limits, period, speed, q_from)
        self.state = MotionState.RUNNING
        self.settled = False
        self.problem = ""
        self._stopping = False
        self._resting_since = math.inf

    @property
    def progress(self) -> float:
        return self._follower.progress

    @property
    def time_left(self) -> float:
        """Seconds to the path's end at the present speed."""
        return self._follower.time_left

    @property
    def speed(self) -> float:
        """Share of the path's own pace at which it is followed, above 0 to 1."""
        return self._follower.speed

    @property
    def phase(self) -> Phase:
        """RESTING once nothing moves any more, as `at_rest`."""
        if self.at_rest:
            return Phase.RESTING
        return Phase.BRAKING if self._stopping or self.state is not MotionState.RUNNING else Phase.RUNNING

    @property
    def set_point_rests(self) -> bool:
        """True when the set-point stands: at the end, stopped, or paused."""
        return self._follower.at_rest

    @property
    def set_point_arrived(self) -> bool:
        """True when the set-point has come to the path's end."""
        return self._follower.finished

    @property
    def at_rest(self) -> bool:
        """True when nothing moves: settled, or paused and standing."""
        return self.settled or (self.state is MotionState.PAUSED and self._follower.at_rest)

    def stop(self) -> None:
        if self.state in (MotionState.RUNNING, MotionState.PAUSED):
            self._stopping = True
            self._follower.slow_down()

    def come_to_rest(self, follower: PathFollower) -> None:
        """Brake as `follower` does: an earlier `braking()`, from a set-point that lay further back."""
        self._stopping, self._follower = True, follower

    def fail(self, problem: str) -> None:
        """Stop on the path and end as FAILED."""
        if self.state in (MotionState.RUNNING, MotionState.PAUSED):
            self.problem = self.problem or problem
            self.stop()

    def abandon(self, problem: str) -> None:
        """End as FAILED where the arm is: its controller has stopped, or does not go on."""
        if self.state in (MotionState.RUNNING, MotionState.PAUSED):
            self.problem, self.state, self._stopping = problem, MotionState.FAILED, True
            self._follower.halt()

    def pause(self) -> None:
        """Slow down to rest on the path."""
        if self.state is MotionState.RUNNING and not self._stopping:
            self.state = MotionState.PAUSED
            self._follower.slow_down()

    def resume(self) -> None:
        """Go on along the path after a pause."""
        if self.state is MotionState.PAUSED and not self._stopping:
            self.state = MotionState.RUNNING
            self._resting_since = math.inf  # it rested because it was paused
            self._follower.go_on()

    def set_speed(self, speed: float) -> None:
        """Follow the path at this share of its own pace from now on."""
        self._follower.set_speed(speed)

    def step(self) -> tuple[Float64, Float64]:
        """Advance one period; joint positions [rad] and velocities [rad/s] of the set-point, (dof,) each."""
        return self._follower.step()

    def braking(self) -> PathFollower:
        """How the set-point would come to rest if it were stopped now."""
        return self._follower.braking()

    def look(self, resting: bool, beside: float, now: float) -> None:
        """Update the state, from whether the measured joints rest and their largest distance from the set-point [rad].

        An arm that was stopped against something rests beside its set-point: that is stopped all the same.
        """
        self._resting_since = min(self._resting_since, now) if resting else math.inf
        if self._follower.finished and not self._stopping:
            if resting and beside < 2e-3:  # joints so near to the path's end are there [rad]
                self.state, self.settled = MotionState.DONE, True
            elif now - self._resting_since > HELD_UP:
                self.fail(f"the arm rests {math.degrees(beside):.1f}° off the end of its path: something holds it")
        elif self._stopping and self._follower.at_rest:
            self.state = MotionState.FAILED if self.problem else MotionState.STOPPED
            self.settled = resting
