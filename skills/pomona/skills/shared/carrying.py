"""Steps of the skills that carry a fruit: is the load too much, put it down, put it back; does it still hang."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pomona.drivers.errors import DeviceFault
from pomona.drivers.interfaces import Arm, ForceSensor, Gripper
from pomona.executive.skill import SkillFailure, Work
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.grip import LIES, GripProblem
from pomona.skills.grip.hold import Hold, current_hold, take_over
from pomona.skills.motion.lines import StraightLine, straight_line
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.motion.robot import RobotModel
from pomona.skills.shared.following import MovingSkill, Watching
from pomona.skills.shared.held_fruit import is_held, is_pressed, show_grip
from pomona.skills.shared.touch import felt, load, pressing_forces

JERK_TIME = 0.1  # time in which the arm reaches its acceleration [s]
NEAR = 0.015  # height above the support below which a fruit may touch down [m]: it may have slid down in the fingers
GENTLE = 0.3  # acceleration of the tool near the support [m/s²]

CONTACT = 0.35
CARRIED = 0.1
"""Change of load that shows contact [N], as in Release, and the least change relative to the load. The inertia of a
heavy fruit is 3 % of its load with the acceleration above."""

# duration of an overload that ends a lift [s]; that of an acceleration is shorter
OVERLOAD_TIME = 0.06
LOWERING = 0.1  # speed of the tool while a fruit is put back, until it is `NEAR` [m/s]
BACK = 1e-3  # height above its first place below which a fruit is back [m]
RESTING = 0.1  # delay after touchdown before the pads are read [s]

LOST_PUT_BACK = "the fruit was lost while it was put back"


class TouchedDown(Exception):
    """The fruit stands before the arm has reached the end of its line."""


class GripOverloaded(Exception):
    """The grip cannot hold the load."""

    def __init__(self, problem: GripProblem, load: PadLoad) -> None:
        self.problem = problem
        self.load = load
        super().__init__(problem.message)

    def outcome(self, risen: float) -> tuple[str, str]:
        """Return the failure code and the sentence for a fruit that is now `risen` above its first place [m]."""
        problem = self.problem
        code = self.problem.code
        if code == "FORCE_LIMIT" and problem.data["for_weight_alone_n"] > problem.data["limit_n"]:
            code = "TOO_HEAVY"
        elsewhere = {
            "TOO_HEAVY": "at any grip position",
            "FORCE_LIMIT": "at this grip position (nearer its centre it may be held)",
            "SLIPPED": "with the configured and with the measured friction",
        }[code]
        back = "put back where it stood"
        where = (
            back if risen < BACK else f"still {1e3 * risen:.0f} mm up, with no straight way back"
        )
        return code, f"{where}; {elsewhere}"


class PadLoad:
    """Load on the pads along the direction of the load that was too much."""

    def __init__(self, hold: Hold) -> None:
        self._hold = hold
        self._along = np.array(hold.estimate.load)
        self._along /= max(float(np.linalg.norm(self._along)), 1e-9)

    @property
    def is_gone(self) -> bool:
        """True if nothing hangs on the pads: the fruit stands, and pads that go on downwards would press on it.

        A fruit that has slid until the pads close over its top is pressed down and lifts the pads.
        """
        return float(self._along @ self._hold.estimate.load) < LEAST


class OverloadMonitor:
    """Detects a load that the grip cannot hold."""

    def __init__(self, hold: Hold) -> None:
        self._hold = hold
        self._since = math.nan

    def require_bearable(self) -> None:
        """Check the grip, once a tick.

        Raises GripOverloaded: for `OVERLOAD_TIME` the load has needed more than the allowed force, or the fruit has
        slipped.
        """
        problem = self._hold.problem
        if problem is None or problem.code not in ("FORCE_LIMIT", "SLIPPED"):
            self._since = math.nan
            return
        if math.isnan(self._since):
            self._since = problem.stamp
        if problem.stamp - self._since > OVERLOAD_TIME:
            raise GripOverloaded(problem, PadLoad(self._hold))


def grip_failure(
    skill: MovingSkill,
    code: str,
    message: str,
    hold: Hold | None,
    problem: GripProblem | None = None,
) -> SkillFailure:
    """Return a failure with the state of the fingers, and with the grip's problem where it has one.

    Data of the time when the problem arose precede those of now.
    """
    if problem is None and hold is not None:
        problem = hold.problem
    state = skill.device(Gripper).state()
    sensor = skill.optional_device(ForceSensor)
    now = {"width_m": float(np.round(state.width, 5))}
    if sensor is not None:
        left, right = pressing_forces(sensor)
        now |= {"left_force_n": round(left, 3), "right_force_n": round(right, 3)}
    elif state.motor_force is not None:
        now["motor_force_n"] = round(state.motor_force, 3)
    if problem is None:
        return skill.failure(code, message, grip="", **now)
    return skill.failure(
        code, f"{message}: {problem.message}", **{**now, **problem.data, "grip": problem.code}
    )


def rest_on_contact(skill: MovingSkill, contact: float | None) -> None:
    """Let the fingers rest from a change of the load [N] on: see `Hold.rest_on_contact`; harmless without a grip."""
    hold = current_hold(skill.device(Gripper))
    if hold is not None:
        hold.rest_on_contact(contact)


def lower_until_contact(
    skill: MovingSkill,
    line: StraightLine,
    speed: float,
    acceleration: float,
    watch: Callable[[], None],
) -> Watching:
    """Follow a line downwards, gently below `NEAR`, to its end or until the fruit touches down.

    `speed` [m/s] and `acceleration` [m/s²] hold above `NEAR`; `watch` is called in each tick and raises to end the
    motion.

    Raises TouchedDown: the fruit has touched down.
    """
    limits = skill.device(Arm).limits
    steps = len(line.q) - 1
    split = steps - min(math.ceil(NEAR / line.length * steps), steps)
    split = 0 if min(split, steps - split) < 3 else split
    if split:
        height = split / steps * line.length
        quickly = time_curve(
            line.q[: split + 1], height, limits, speed, acceleration, acceleration / JERK_TIME
        )
        yield from skill.travel(quickly, watch)
    height = (steps - split) / steps * line.length
    # speed of the tool near the support [m/s]
    gently = time_curve(line.q[split:], height, limits, 0.03, GENTLE, GENTLE / JERK_TIME)
    with felt(skill, load) as touch:
        contact = touch.limit(max(CONTACT, CARRIED * touch.at_first()), GENTLE)

        def feel() -> None:
            if touch.change > contact:  # first: the support's push may unload a finger
                take_over(skill.device(Gripper))
                raise TouchedDown
            watch()

        rest_on_contact(skill, contact)
        yield from skill.travel(gently, feel)
        feel()


def put_back(
    skill: MovingSkill,
    T_base_start: Float64,
    acceleration: float,
    hold: Hold | None,
    pad_load: PadLoad,
) -> Work[bool]:
    """Lower a fruit to its first place, on the line on which it came up. Without such a line the arm stays.

    Returns True if the fruit stands, there or where it touched down before; the fingers then rest.

    Args:
        skill: moves the arm, and has the fingers; it must declare LOST.
        T_base_start: pose of the TCP at the first place.
        pad_load: load that was too much.

    Raises SkillFailure: LOST.
    """
    arm = skill.device(Arm)
    robot = RobotModel.load(arm.description)
    q = arm.state().q
    line = straight_line(robot, q, T_base_start)
    if line.length < BACK or not line.complete:
        return line.length < BACK

    def watch() -> None:
        if pad_load.is_gone:
            take_over(skill.device(Gripper))
            raise TouchedDown
        if hold is not None:
            show_grip(skill, hold)
            require_truth(hold)
        if not is_held(skill, hold):
            raise grip_failure(skill, "LOST", LOST_PUT_BACK, hold)

    try:
        watch()
        yield from lower_until_contact(skill, line, LOWERING, acceleration, watch)
    except TouchedDown:
        yield from skill.wait(RESTING)
        if not is_pressed(skill):
            raise grip_failure(skill, "LOST", LOST_PUT_BACK, hold) from None
    return True


LEAST = 0.25  # the tangential load of a fruit that hangs [N]; the lightest weighs 0.5 N, noise and bias are 0.1 N
LASTING = 0.06  # minimum duration at full speed [s]

# time of the load's average, and in which its largest value fades [s]
AVERAGED = 0.1
REMEMBERED = 1.0


class Hanging:
    """Watches the load of a held fruit during the lift, and decides whether it hangs at the end."""

    def __init__(self, hold: Hold) -> None:
        self._hold = hold
        self._stamp = math.nan
        self._load = self._most = 0.0
        self._light_for = 0.0

    def look(self, pace: float = 1.0) -> str:
        """Check the newest sample, once a tick; return why the fruit cannot hang any more, or an empty text.

        `pace`: share of its speed at which the arm takes the weight over: pads that were loaded upwards, or across, bear
        nothing in between for longer then.

        Raises DeviceFault: the finger readings are not valid.
        """
        require_truth(self._hold)
        reading = self._hold.reading
        elapsed = 0.0 if math.isnan(self._stamp) else max(reading.stamp - self._stamp, 0.0)
        self._stamp = reading.stamp
        self._load += (1.0 - math.exp(-elapsed / AVERAGED)) * (reading.f_t - self._load)
        self._most = max(self._load, self._most * math.exp(-elapsed / REMEMBERED))
        # Less than this share of the load that was there has gone: a lift that slows down with 3 m/s² leaves 0.5
        light = self._most > LEAST and reading.f_t < 0.35 * self._most
        self._light_for = self._light_for + elapsed if light else 0.0
        if self._light_for * pace > LASTING:
            return f"its weight has gone from the fingers: {reading.f_t:.1f} N of {self._most:.1f} N are left"
        return ""

    def missing(self) -> str:
        """Return the evidence against a hanging fruit, at rest; empty without any."""
        if self._load < LEAST:
            return f"no weight hangs on the fingers: {self._load:.2f} N"
        return ""


def require_truth(hold: Hold) -> None:
    """Refuse to continue a grip with invalid finger readings; the run ends in the safe state.

    Raises DeviceFault: they stand still, contradict each other or the motor, or have gone silent.
    """
    problem = hold.problem
    if problem is not None and problem.code in LIES:
        raise DeviceFault("fingers", problem.message)
