"""The motion of an arm that follows a path: what a caller watches, and how it ends, stops and pauses."""

from __future__ import annotations

from drivers.interfaces import ArmLimits, Float64, MotionState, Trajectory
from drivers.path_follower import PathFollower


class PathMotion:
    """A `Motion` over a trajectory, stepped by the arm's driver at a fixed period."""

    def __init__(self, trajectory: Trajectory, limits: ArmLimits, period: float) -> None:
        self._follower = PathFollower(trajectory, limits, period)
        self.state = MotionState.RUNNING
        self.settled = False
        self.problem = ""
        self._stopping = False

    @property
    def progress(self) -> float:
        return self._follower.progress

    @property
    def set_point_rests(self) -> bool:
        """True when the set-point stands: at the end, stopped, or paused."""
        return self._follower.at_rest

    @property
    def at_rest(self) -> bool:
        """True when nothing moves: settled, or paused and standing."""
        return self.settled or (self.state is MotionState.PAUSED and self._follower.at_rest)

    def stop(self) -> None:
        if self.state in (MotionState.RUNNING, MotionState.PAUSED):
            self._stopping = True
            self._follower.slow_down()

    def fail(self, problem: str) -> None:
        """Stop on the path and end as FAILED."""
        if self.state in (MotionState.RUNNING, MotionState.PAUSED):
            self.problem = self.problem or problem
            self.stop()

    def pause(self) -> None:
        if self.state is MotionState.RUNNING and not self._stopping:
            self.state = MotionState.PAUSED
            self._follower.slow_down()

    def resume(self) -> None:
        if self.state is MotionState.PAUSED and not self._stopping:
            self.state = MotionState.RUNNING
            self._follower.go_on()

    def step(self) -> tuple[Float64, Float64]:
        """Advance one period; joint positions [rad] and velocities [rad/s] of the set-point."""
        return self._follower.step()

    def look(self, arrived: bool) -> None:
        """Update the state; `arrived` tells whether the measured joints rest at the set-point."""
        if self._follower.finished and not self._stopping:
            if arrived:
                self.state, self.settled = MotionState.DONE, True
        elif self._stopping and self._follower.at_rest:
            self.state = MotionState.FAILED if self.problem else MotionState.STOPPED
            self.settled = arrived
