"""Meaning of a MotoROS controller's codes for the operator: the problem and the remedy."""

from __future__ import annotations

from pomona.devices.motoman.codec import MotionReply, Result, RobotStatus

_INVALID = {
    3000: "invalid for an unspecified reason",
    3001: "the message has the wrong size",
    3002: "the message has a wrong header",
    3003: "the message has an unknown type",
    3004: "the robot has no such group",
    3005: "the sequence number is wrong",
    3006: "the command is unknown",
    3010: "the point's values are invalid",
    3011: "the trajectory does not start where the arm stands; plan again from the present position",
    3012: "a position lies outside the joint's limits",
    3013: "a joint would move too fast; slow the trajectory down",
    3014: "an acceleration is invalid",
    3015: "a point needs time, position and velocity",
    3016: "the point's time is invalid",
    3017: "the tool number is invalid",
}
_NOT_READY = {
    5000: "not ready for an unspecified reason",
    5001: "an alarm is active; clear it on the pendant or acknowledge here",
    5002: "an error is active; clear it on the pendant or acknowledge here",
    5003: "the emergency stop is pressed; release it, then acknowledge",
    5004: "not in play mode; turn the pendant's key to PLAY",
    5005: "not in remote mode; turn the pendant's key to REMOTE",
    5006: "the servos are off; acknowledge to switch them on",
    5007: "the hold button is pressed; release it",
    5008: "the INIT_ROS job was not started; check that it is the master job",
    5009: "the controller waits for its ROS job; start trajectory mode again",
    5010: "the SKILLSEND job is missing in INIT_ROS",
    5011: "the power-and-force limiting unit stopped the arm; acknowledge it on the pendant",
    5012: "the incremental move was refused",
}
_RESULTS = {
    Result.BUSY: "busy",
    Result.FAILURE: "failed",
    Result.INVALID: "invalid",
    Result.ALARM: "in alarm",
    Result.NOT_READY: "not ready",
    Result.MOTION_FAILURE: "the motion failed",
}


def refusal(reply: MotionReply) -> str:
    """Why the controller refused, as a sentence."""
    words = _INVALID.get(reply.subcode) or _NOT_READY.get(reply.subcode)
    if reply.result == Result.ALARM:
        return f"the controller is in alarm {reply.subcode}; clear it on the pendant or acknowledge here"
    if words is None:
        words = (
            _RESULTS.get(Result(reply.result), "refused")
            if reply.result in list(Result)
            else "refused"
        )
        return f"{words} (result {reply.result}, subcode {reply.subcode})"
    return f"{words} ({reply.subcode})"


def fault(status: RobotStatus) -> str:
    """Return the reason why the arm cannot move, as a sentence; empty without one."""
    if status.e_stopped == 1:
        return _NOT_READY[5003]
    if status.in_error == 1:
        return f"the controller is in alarm {status.error_code}; clear it on the pendant or acknowledge here"
    if status.mode == 1:
        return "the controller is in teach mode; turn the pendant's key to REMOTE, then acknowledge"
    if status.drives_powered == 0:
        return _NOT_READY[5006]
    return ""
