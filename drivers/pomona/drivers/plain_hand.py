"""An object between a gripper's fingers, by width and motor, without a measured force."""

from __future__ import annotations

from pomona.drivers.interfaces import GripperLimits, GripperState

GIVE = 0.01  # change of the opening that releases a fruit [m]: skin and pads yield at 14 N with 1.5 N/mm
NO_ROOM = 2e-3  # fingers this near to an end of their travel hold nothing [m]: no fruit is so thin
# grasp force by the motor's current that presses on something [N]: twice a WSG's friction
MOTOR_FORCE = 1.0
SHORT = 2e-3  # distance to the commanded width from which closing fingers were stopped [m]: a WSG ends a move within it
STEPS = 2.0  # the same of a gripper that moves in steps [steps], and ends a move within 1.5 of them


def has_room(width: float, limits: GripperLimits) -> bool:
    """Return True at an opening [m] at which fingers can hold something, and for one that is not finite."""
    return not (width <= limits.width_min + NO_ROOM or width >= limits.width_max - NO_ROOM)


def short(limits: GripperLimits) -> float:
    """Return the distance to their commanded width from which closing fingers at rest were stopped [m]."""
    return STEPS * limits.step or SHORT


def between(state: GripperState, limits: GripperLimits) -> str:
    """Return the evidence of an object between fingers at rest, without a measured force; empty without evidence.

    A motor that presses, and fingers that were stopped before the width of their move. Closed fingers press on each
    other.
    """
    if state.width <= limits.width_min + NO_ROOM:
        return ""
    if presses(state):
        return f"the gripper's motor presses with {state.motor_force:.1f} N at {1e3 * state.width:.1f} mm"
    if (
        state.aim is not None
        and state.width > state.aim + short(limits)
        and has_room(state.width, limits)
    ):
        return f"the fingers stopped at {1e3 * state.width:.1f} mm on their way to {1e3 * state.aim:.1f} mm"
    return ""


def gone(before: GripperState, now: GripperState, limits: GripperLimits, give: float = GIVE) -> str:
    """Return why an object that was held `before` may not be there `now`; empty while nothing indicates it.

    `give` is the change of the width that shows it [m].
    """
    if not abs(now.width - before.width) <= give:  # so that a width that is no number shows it
        return f"the fingers moved from {1e3 * before.width:.1f} to {1e3 * now.width:.1f} mm"
    if now.width <= limits.width_min + NO_ROOM:
        return "the fingers are closed"
    if presses(before) and not presses(now):
        return f"the gripper's motor pressed with {before.motor_force:.1f} N and presses no more"
    return ""


def presses(state: GripperState) -> bool:
    """Return True if the gripper reports its motor's force, and the motor presses inwards."""
    return state.motor_force is not None and state.motor_force > MOTOR_FORCE
