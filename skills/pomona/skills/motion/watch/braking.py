"""How long an arm takes to come to rest on its path: tried out with the follower that all drivers here step."""

from __future__ import annotations

import copy

from pomona.drivers.interfaces import ArmLimits, Trajectory
from pomona.drivers.path_follower import PathFollower

PERIOD = 0.005  # of the trial's steps [s]; drivers step finer (a test compares)


class Braking:
    """How long the arm brakes, at any time of a trajectory that it follows at the trajectory's own pace."""

    def __init__(self, trajectory: Trajectory, limits: ArmLimits) -> None:
        self._follower = PathFollower(trajectory, limits, PERIOD)

    def time(self, t: float) -> float:
        """Return seconds from the order to stop at time `t` [s] of the trajectory until the arm rests on its path."""
        follower = copy.copy(self._follower)  # the path itself is only read
        follower.path_time = t
        follower.slow_down()
        steps = 0
        while not follower.at_rest:
            follower.step()
            steps += 1
        return steps * PERIOD
