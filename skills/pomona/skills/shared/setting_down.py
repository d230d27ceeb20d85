"""The last millimetres of a held fruit's way down, until it stands: for skills that put back what they lifted."""

from __future__ import annotations

from collections.abc import Callable

from pomona.drivers.interfaces import ForceSensor, Gripper, Trajectory
from pomona.skills.grip.hold import take_over
from pomona.skills.shared.following import MovingSkill, Watching
from pomona.skills.shared.touch import Touch, load

NEAR = 0.015
"""Height above where it stood below which a fruit may touch down [m]: it may have slid down in the fingers."""

SETTING_DOWN = 0.03
"""Speed near to where it stood [m/s]."""

GENTLE = 0.3
"""Acceleration of the arm near to where the fruit stood [m/s²]."""

CONTACT, CARRIED = 0.35, 0.1
"""Change of load that says the fruit is carried again [N], Release's, and at least this share of the load: what a heavy
fruit resists by being heavy is 3 % of it with the acceleration above."""


class TouchedDown(Exception):
    """The fruit stands again, before the arm is where it began."""


def set_down(skill: MovingSkill, trajectory: Trajectory, watch: Callable[[], None] = lambda: None) -> Watching:
    """Follow a path downwards until the fruit is felt to stand, or to its end.

    The fingers rest from the touch on: force control would answer what carries the fruit by pressing harder.

    Args:
        skill: moves the arm, and has the fingers.
        trajectory: from rest, since what changes while the arm speeds up is the fruit's own inertia.
        watch: called in every tick; raises what should end the motion.

    Raises:
        TouchedDown: it was felt to stand.
    """
    with Touch(skill.device(ForceSensor), load) as touch:
        contact = max(CONTACT, CARRIED * touch.at_first())

        def feel() -> None:
            if touch.change > contact:  # asked first: a floor's push may take the pressing force from a finger
                take_over(skill.device(Gripper))
                raise TouchedDown
            watch()

        yield from skill.travel(trajectory, feel)
        feel()
