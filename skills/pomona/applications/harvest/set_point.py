"""The set-point of a detaching hand: its commands as joints, as far as the arm reaches."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pomona.applications.harvest.detaching import DetachCommand
from pomona.drivers import Arm
from pomona.executive import Float64
from pomona.skills.motion import RobotModel, nearest_solution

JUMP = 0.3
"""Largest step of a joint [rad]: more is another posture."""
CRAWL = 0.05
"""Share of a command below which an arm at full speed does not follow it: near a singular posture the joints' speeds
leave the hand next to none, and it would be on its way for ever."""
HELD, HELD_FOR, STANDS = 0.01, 0.4, 2e-3
"""Distance from its set-point and time at which an arm that stands is held [rad, s]; it stands within the last [rad].
Set-points pass through the arm within 0.2 to 0.3 s. A supervisor ends the run at 0.02 rad after 0.7 s."""
AWAY, PASSING = 0.035, 0.2
"""Distance from every set-point of the last time at which they come back to an arm; 0.08 rad end a run [rad, s]."""
TRIES, MOVED = 2, 0.02
"""How often a set-point comes to an arm that is held at one place, within the second [rad]: a stuck arm looks like one
that wood holds, and must be found."""
LIMIT_MARGIN = 0.02
"""Distance of set-points from the joints' limits [rad]: from a limit itself the next path would be refused."""


class HandAim:
    """Joints to aim at, and their pose, moved by the controller's commands as far as the arm reaches.

    Attributes:
        q: joints, shape (dof,) [rad]; T: pose of the hand there, shape (4, 4).
        beyond, unturned: time without any step, and without a turn, that the arm can follow [s].
        held: how often the arm was held at the place where it is.
    """

    def __init__(
        self, robot: RobotModel, q: Float64, clear: Callable[[Float64], float] = lambda _q: 0.0
    ) -> None:
        """
        Args:
            q: where the arm stands, shape (dof,) [rad].
            clear: distance of joints to obstacles beyond the margins [m]; no step leads where it is negative, unless
                it leads away.
        """
        self.q, self.T = q, robot.tcp(q)
        self.beyond, self.unturned, self.held = 0.0, 0.0, 0
        self._robot, self._clear, self._cleared = robot, clear, clear(q)
        self._stands, self._held_at, self._off = q, q, 0.0
        self._passing: list[tuple[float, Float64]] = []

    def follow(self, command: DetachCommand, dt: float, most: Float64, speed: float = 1.0) -> float:
        """Move by a command for `dt` [s]: turn and move, else turn alone, else move alone, else stay.

        Returns the share of the time that was used: 1 unless a joint would pass `speed` (0 to 1) times `most`, shape
        (dof,) [rad/s].
        """
        turned, moved = command.roll_rate != 0.0, bool(command.velocity.any())
        self.beyond = self.beyond + dt if turned or moved else 0.0
        self.unturned = self.unturned + dt if turned else 0.0
        for turns, moves in ((turned, moved), (True, False), (False, True)):
            if not (turns and turned) and not (moves and moved):
                continue  # no step at all
            q, share = (
                nearest_solution(self._robot, command.moved(self.T, dt, turns, moves), self.q),
                1.0,
            )
            if (
                q is not None
                and (fastest := float((np.abs(q - self.q) / (dt * speed * most)).max())) > 1.0
            ):
                share = 1.0 / fastest
                if share < CRAWL * speed:
                    continue
                q = nearest_solution(
                    self._robot, command.moved(self.T, share * dt, turns, moves), self.q
                )
            if (
                q is not None
                and np.abs(q - self.q).max() < JUMP
                and (clear := self._clear(q)) >= min(self._cleared, 0.0)
            ):
                self._cleared = clear
                self.q, self.T, self.beyond = (
                    q,
                    command.moved(self.T, share * dt, turns, moves),
                    0.0,
                )
                self.unturned = 0.0 if turns else self.unturned
                return share
        return 1.0

    def come_to(self, q: Float64, dt: float) -> bool:
        """Bring the set-point to an arm that is held beside it, at `q`, shape (dof,) [rad].

        Returns True if the tries at this place are used up: at the last one, and each time that the arm is held again.
        """
        if np.abs(q - self._stands).max() > STANDS:
            self._stands, self._off = q.copy(), 0.0
        if np.abs(q - self._held_at).max() > MOVED:
            self.held, self._held_at = 0, q.copy()
        self._off = self._off + dt if np.abs(self.q - q).max() > HELD else 0.0
        self._passing = [(age + dt, each) for age, each in self._passing if age < PASSING] + [
            (0.0, self.q)
        ]
        left = (
            self._passing[0][0] >= PASSING
            and min(np.abs(each - q).max() for _, each in self._passing) > AWAY
        )
        if self._off <= HELD_FOR and not left:
            return False
        self._off, self._passing = 0.0, []
        if self.held < TRIES:
            self.held += 1
            self.q, self.T = q.copy(), self._robot.tcp(q)
        return self.held == TRIES


def inner_robot(arm: Arm) -> RobotModel:
    """Return the robot within its joint limits less `LIMIT_MARGIN`, and never nearer to them than it stands now."""
    limits, q = arm.limits, arm.state().q
    lower, upper = (
        np.minimum(limits.lower + LIMIT_MARGIN, q),
        np.maximum(limits.upper - LIMIT_MARGIN, q),
    )
    return RobotModel.load(arm.description).with_limits(lower, upper)
