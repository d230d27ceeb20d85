"""Lower a fruit until something carries it, and confirm that, before the fingers open."""

from __future__ import annotations

import math
from typing import NamedTuple

from pomona.drivers.fruit_body import HARD_MODULUS
from pomona.drivers.interfaces import Gripper, Motion
from pomona.executive.skill import Work
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.hold import current_hold
from pomona.skills.motion.grasp import Grasp
from pomona.skills.shared.carrying import CONTACT, RESTING, TouchedDown, rest_on_contact
from pomona.skills.shared.following import MovingSkill
from pomona.skills.shared.held_fruit import is_pressed, note_press, show_grip, watch_fruit
from pomona.skills.shared.straight_travel import Manner, follow_way, tool_pose, vertical_way
from pomona.skills.shared.touch import Touch, felt, hand_felt, load

RAISED = 0.002
"""Height of raising the fruit from its support [m]: a fruit that hangs again loads the pads as before, while a drift
continues."""

RAISING = Manner(0.05, 2.0, 40.0)
"""Of raising it and of setting it down again: the load is read at rest."""

# acceleration up to which inertia stays below a contact, and of gravity [m/s²]
GENTLE = 0.5
GRAVITY = 9.81

PUSHED = 0.8e-3
"""Motion of fingers that no grip controls which shows something beside them [m]: a supervisor allows 3 mm, and the
arm stops within a millimetre of it."""

EXPECTED = 0.004
"""Height beside that of the known support within which a contact is believed as it is [m]: a drift drops the fruit by
no more."""

BLOCKED = "LOWERING_BLOCKED"

LOST = "the fruit was lost on the way down"


class Descent(NamedTuple):
    """The way down: postures (n, dof) [rad], and the tool's motion on them."""

    way: Float64
    manner: Manner
    most: Float64 | None = None  # largest speeds at equal steps along it [m/s]
    slow_below: float = math.inf  # height of the tool below which inertia stays below a contact [m]
    stands: float = math.nan  # height of the tool at which the fruit stands on a known support [m]


class Jolted(Exception):
    """A change of load has gone again: it was no contact."""


def lower_to_support(
    skill: MovingSkill,
    descent: Descent,
    grasp: Grasp | None,
    opened: float,
    ends_on: bool,
) -> Work[str]:
    """Go down until a support carries the fruit.

    Returns an empty text then, or why none does. A higher acceleration than `GENTLE` adds the inertia of the fruit to
    the change of load that shows contact. A contact where the fruit is known to stand needs no other proof. Fingers that
    something beside the fruit pushes end the way down with `BLOCKED`; `opened` is their width before it [m]. `ends_on`:
    the way ends on a known support.

    Raises:
        Jolted, SkillFailure: as `contact_doubt`.
    """
    limit = most = CONTACT
    moving: Motion | None = None
    gripper = skill.device(Gripper)
    lost = watch_fruit(skill)
    with felt(skill, load) as touch, hand_felt(skill) as hand:

        def expect(motion: Motion, accelerated: float) -> None:
            nonlocal limit, most
            inertia = touch.at_first() * (accelerated - GENTLE) / GRAVITY
            limit = touch.limit(CONTACT, accelerated) + inertia
            # a support takes the fruit's weight from it
            most = hand.limit(CONTACT + touch.at_first(), accelerated)
            touch.begin_anew()
            hand.begin_anew()
            rest_on_contact(skill, limit)
            touch.at_change(limit, motion.stop)
            hand.at_change(most, motion.stop)

        def begin(motion: Motion) -> None:
            nonlocal moving
            moving = motion
            expect(motion, descent.manner.acceleration)

        def watch() -> None:
            nonlocal moving
            hold = current_hold(gripper)
            if hold is not None:
                show_grip(skill, hold)
            if touch.change > limit:  # first: the support's push may unload a finger
                raise TouchedDown
            if why := lost():
                raise skill.failure("LOST", f"{LOST}: {why}")
            width = gripper.state().width
            if hold is None and abs(width - opened) > PUSHED:
                raise skill.failure(
                    BLOCKED,
                    f"something pushes the fingers from {1e3 * opened:.1f} to {1e3 * width:.1f} mm; "
                    "the fruit is still held",
                )
            if hand.change > most:
                raise skill.failure(
                    BLOCKED,
                    f"a finger met something ({hand.change:.1f} N); the fruit is still held",
                )
            if moving is not None and tool_pose(skill)[2, 3] < descent.slow_below:
                expect(moving, GENTLE)
                moving = None

        try:
            yield from follow_way(
                skill, descent.way, descent.manner, watch, grasp, begin, descent.most
            )
        except TouchedDown:
            off = abs(tool_pose(skill)[2, 3] - descent.stands)
            doubt = yield from contact_doubt(skill, touch, off < EXPECTED)
            if not doubt:
                note_press(
                    skill,
                    "its support",
                    touch.pressed,
                    grasp.fruit if grasp else None,
                    HARD_MODULUS,
                )
            return doubt
    return "" if ends_on else "the fruit met nothing"


def contact_doubt(skill: MovingSkill, touch: Touch, known: bool) -> Work[str]:
    """Return why a change of load is no contact with a support, or an empty text if something carries the fruit.

    The caller has let the fingers rest (`rest_on_contact`), and declares LOST and `BLOCKED`: the tool cannot move
    vertically. `touch` has the load since the fruit hung freely. Where the fruit is `known` to stand, a change that
    stays is enough.

    Raises Jolted: the change of load has gone again, and the arm is where it was; SkillFailure: LOST, or `BLOCKED`.
    """
    yield from skill.wait(RESTING)
    _require_fruit(skill)
    least = 0.5 * touch.limit(CONTACT, 0.0)
    if touch.present <= least or touch.stale_for(skill.clock.now()):
        raise Jolted
    if known or (yield from _hangs_when_raised(skill, touch, least)):
        return ""
    _require_fruit(skill)
    return "the change of load stays when the fruit is raised again: the fingers drift"


def _require_fruit(skill: MovingSkill) -> None:
    if not is_pressed(skill):
        raise skill.failure("LOST", f"{LOST}: it presses on neither finger")


def _hangs_when_raised(skill: MovingSkill, touch: Touch, least: float) -> Work[bool]:
    """Return True if the load goes back by at least so much [N] while the fruit is raised; ends where it began.

    The load of sensors that drift or get another bias does not go back with a motion.
    """
    below = touch.average()
    yield from follow_way(skill, vertical_way(skill, RAISED, BLOCKED), RAISING)
    yield from skill.wait(RESTING)
    raised = touch.average()
    yield from follow_way(skill, vertical_way(skill, -RAISED, BLOCKED), RAISING)
    return touch.gone_back(below, raised) > least
