"""States and errors of a controller as the operator reads them: the problem and the remedy."""

from __future__ import annotations

READY = (1, 2)  # states in which set-points are followed: moving, at rest
STOP = 4  # state, and the command that leads to it
# modes
SERVO = 1
BY_HAND = 2
_ACKNOWLEDGE = "then acknowledge here"
_ERRORS = {
    1: f"the emergency stop of the control box is pressed; release it, {_ACKNOWLEDGE}",
    2: f"an emergency input of the control box is open; close it, {_ACKNOWLEDGE}",
    3: f"the emergency stop of the three-state switch is pressed; release it, {_ACKNOWLEDGE}",
    19: "the end effector does not answer; see its cable and baud rate",
    22: f"it would collide with itself; move it away in UFACTORY Studio, {_ACKNOWLEDGE}",
    23: f"a joint is outside its range; move it back in UFACTORY Studio, {_ACKNOWLEDGE}",
    24: "a set-point is too far from the arm for its largest speed",
    31: f"a collision, or a wrong payload in UFACTORY Studio; look for the cause, {_ACKNOWLEDGE}",
    35: f"it has come to its safety boundary; move it back in UFACTORY Studio, {_ACKNOWLEDGE}",
    60: "the tool is too quick for servo mode; run at a lower speed",
}
_MODES = {
    0: "the queue",
    2: "guiding by hand",
    3: "teaching",
    4: "joint speeds",
    5: "tool speeds",
    6: "planning online",
}


def error_words(code: int) -> str:
    """Return an error of the controller as the rest of a sentence."""
    motor = f"its motor {code - 10} reports an error" if 11 <= code <= 17 else ""
    known = _ERRORS.get(code) or motor or "see the error's number in UFACTORY Studio"
    return f"has the error {code}: {known}"


def interrupted(state: int, mode: int) -> str:
    """Return why the arm does not follow set-points, as the rest of a sentence; empty when it does."""
    if mode != SERVO:
        name = _MODES.get(mode, str(mode))
        return f"was switched to the mode of {name} by another program; one of them only can move the arm"
    if state == 3:
        return "was paused by another program or in UFACTORY Studio; acknowledge here to begin anew"
    return (
        ""
        if state in READY
        else "was stopped by another program or in UFACTORY Studio; acknowledge here"
    )
