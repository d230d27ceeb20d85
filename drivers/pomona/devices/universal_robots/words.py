"""States of a controller as the operator reads them: the problem and the remedy."""

from __future__ import annotations

RUNNING = 7  # robot mode in which the arm can move
# robot modes: without power; powered with the brakes on
POWER_OFF = 3
IDLE = 5
PROTECTIVE_STOP = 3  # safety mode
# runtime states of a program
STOPPED = 1
PLAYING = 2
PAUSED = 4
FREEDRIVE = 1 << 2  # status bit of the freedrive button

_SAFETY = {
    3: "is in a protective stop; look for its cause, then acknowledge here",
    4: "is in recovery mode: a joint is outside a safety limit; move it back at the pendant",
    5: "is in a safeguard stop; close the guard and reset it, then acknowledge here",
    6: "is in an emergency stop of the system; release it, then acknowledge here",
    7: "is in an emergency stop; release the pendant's button, then acknowledge here",
    8: "has violated a safety limit; restart the safety system at the pendant",
    9: "has a fault of its safety system; see the pendant's log",
}
_MODES = {
    -1: "has no controller process",
    0: "is disconnected from its controller",
    1: "waits for a confirmation of its safety settings at the pendant",
    2: "is booting",
    3: "has no power on the arm; switch it on at the pendant",
    4: "is being powered on",
    5: "has its brakes on; release them at the pendant",
    6: "is in freedrive: it is moved by hand",
    8: "updates its firmware",
}
_RUNTIME = {
    0: "its program is being stopped",
    1: "its program was stopped, at the pendant or by the watchdog after a delay of this computer",
    3: "its program is being paused at the pendant",
    4: "its program is paused at the pendant; acknowledge here to begin anew",
    5: "its program resumes after a pause",
}


def stopped(safety: int, mode: int) -> str:
    """Return why the controller itself does not let the arm move, as the rest of a sentence; empty when it does."""
    if safety not in (1, 2):
        return _SAFETY.get(
            safety, f"is in the safety mode {safety}, which this driver has no name for"
        )
    return "" if mode == RUNNING else _MODES.get(mode, f"is in the robot mode {mode}")


def interrupted(runtime: int) -> str:
    """Return why the resident script does not run; empty when a program runs."""
    return (
        ""
        if runtime == PLAYING
        else _RUNTIME.get(runtime, f"its program is in the state {runtime}")
    )


def unfit(safety: int, status: int, slider: float) -> str:
    """Return why an arm that could move would not follow its path; empty when it would."""
    if status & FREEDRIVE:
        return "is in freedrive: release the freedrive button"
    if safety == 2:
        return "is in reduced mode, where a path at full speed ends in a protective stop; leave it, then acknowledge"
    if slider < 0.995:
        remedy = "set it to 100 %, and give the run's speed by `--speed`"
        return f"has its speed slider at {100.0 * slider:.0f} %, so it would lag behind its path: {remedy}"
    return ""
