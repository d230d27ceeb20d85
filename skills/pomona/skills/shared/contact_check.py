"""Lower a fruit until something carries it, and confirm that, before the fingers open."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pomona.drivers.interfaces import Arm, Gripper
from pomona.executive.skill import Work
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.hold import Hold, current_hold
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.robot import RobotModel
from pomona.skills.shared.carrying import RESTING, TouchedDown, rest_on_contact
from pomona.skills.shared.following import MovingSkill
from pomona.skills.shared.held_fruit import is_pressed, show_grip, watch_fruit
from pomona.skills.shared.straight_travel import Manner, follow_way, tool_pose, vertical_way
from pomona.skills.shared.touch import Touch, felt, load

RAISED = 0.002
"""Height of raising the fruit from its support [m]: a fruit that hangs again loads the pads as before, while a drift
continues."""

RAISING = Manner(0.05, 2.0, 40.0)
"""Of raising it and of setting it down again: the load is read at rest."""

GENTLE, GRAVITY = 0.5, 9.81  # acceleration up to which inertia stays below a contact, and of gravity [m/s²]
SURE_SLOW = 1e-3  # way at the lower speed after which nothing brakes any more [m]

PUSHED = 0.8e-3
"""Motion of fingers that no grip controls which shows something beside them [m]: a supervisor allows 3 mm, and the
arm stops within a millimetre of it."""

LOST = "the fruit was lost on the way down"


class Descent(NamedTuple):
    """A straight way down: postures, shape (n, dof) [rad], with a quick motion up to one of them, then a slow one."""

    way: Float64
    slow_from: int
    quick: Manner
    slow: Manner


class Jolted(Exception):
    """A change of load has gone again: it was no contact."""


def lower_to_support(
    skill: MovingSkill,
    down: Descent,
    hold: Hold | None,
    grasp: Grasp | None,
    contact: float,
    code: str,
    opened: float,
    ends_on: bool = False,
) -> Work[str]:
    """Go down until a support carries the fruit.

    Returns an empty text then, or why none does. `contact` [N] is the change of load that shows contact; the inertia of
    a fruit in quick motion is added. Fingers that something beside it pushes end the way down with `code`; `opened` is
    their width before it [m]. `ends_on`: the way ends on a known support.

    Raises:
        Jolted, SkillFailure: as `contact_doubt`.
    """
    (way, slow_from, quick, slow), gripper, lost = down, skill.device(Gripper), watch_fruit(skill)
    manner, most = quick if slow_from else slow, np.where(np.arange(len(way)) < slow_from, quick.speed, slow.speed)
    slow_below = RobotModel.load(skill.device(Arm).description).tcp(way[slow_from])[2, 3] - SURE_SLOW
    with felt(skill, load) as touch:

        def feels(accelerated: float) -> float:
            """Let the fingers rest from a contact on; return its change of load."""
            limit = touch.limit(contact, accelerated) + touch.at_first() * (accelerated - GENTLE) / GRAVITY
            touch.forget_change()
            rest_on_contact(skill, limit)
            return limit

        limit = feels(manner.acceleration)

        def watch() -> None:
            nonlocal limit, slow_below
            if hold is not None:
                show_grip(skill, hold)
            if touch.change > limit:  # first: the support's push may unload a finger
                raise TouchedDown
            if tool_pose(skill)[2, 3] < slow_below:
                limit, slow_below = feels(slow.acceleration), -np.inf
            if why := lost():
                raise skill.failure("LOST", f"{LOST}: {why}")
            width = gripper.state().width
            if current_hold(gripper) is None and abs(width - opened) > PUSHED:
                words = f"something pushes the fingers from {1e3 * opened:.1f} to {1e3 * width:.1f} mm"
                raise skill.failure(code, f"{words}; the fruit is still held")

        try:
            yield from follow_way(skill, way, manner, watch, grasp, most=most)
        except TouchedDown:
            return (yield from contact_doubt(skill, touch, touch.limit(contact, 0.0), code))
    return "" if ends_on else "the fruit met nothing"


def contact_doubt(skill: MovingSkill, touch: Touch, contact: float, code: str) -> Work[str]:
    """Return why a change of load is no contact with a support, or an empty text if something carries the fruit.

    The caller has let the fingers rest (`rest_on_contact`), and declares LOST and `code`: the tool cannot move
    vertically. `touch` has the load since the fruit hung freely, `contact` [N] is the change that shows contact.

    Raises Jolted: the change of load has gone again, and the arm is where it was; SkillFailure: LOST, or the code.
    """
    yield from skill.wait(RESTING)
    _require_fruit(skill)
    if touch.present <= 0.5 * contact or touch.stale_for(skill.clock.now()):
        raise Jolted
    if (yield from _hangs_when_raised(skill, touch, contact, code)):
        return ""
    _require_fruit(skill)
    return "the change of load stays when the fruit is raised again: the fingers drift"


def _require_fruit(skill: MovingSkill) -> None:
    if not is_pressed(skill):
        raise skill.failure("LOST", f"{LOST}: it presses on neither finger") from None


def _hangs_when_raised(skill: MovingSkill, touch: Touch, contact: float, code: str) -> Work[bool]:
    """Return True if the load goes back by at least half a contact while the fruit is raised; ends where it began.

    The load of sensors that drift or get another bias does not go back with a motion.
    """
    below = touch.average()
    yield from follow_way(skill, vertical_way(skill, RAISED, code), RAISING)
    yield from skill.wait(RESTING)
    raised = touch.average()
    yield from follow_way(skill, vertical_way(skill, -RAISED, code), RAISING)
    return touch.gone_back(below, raised) > 0.5 * contact
