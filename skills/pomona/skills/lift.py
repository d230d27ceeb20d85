"""The skill Lift."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, ClassVar

import numpy as np

from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, Workspace
from pomona.executive.ports import ACCELERATION, LENGTH, SPEED, TIME, Acceleration, Length, Port, Speed, Time
from pomona.executive.skill import Work
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.grip import GripProblem
from pomona.skills.grip.hold import Hold, take_over
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.straight_line import StraightLine, straight_line
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from pomona.skills.shared.grip_view import show_grip
from pomona.skills.shared.hanging import LEAST, Hanging, require_truth
from pomona.skills.shared.setting_down import GENTLE, NEAR, SETTING_DOWN, TouchedDown, set_down
from pomona.skills.shared.touch import HELD_FORCE, pressing_forces, something_between
from pomona.skills.shared.usable_map import usable_field
from pomona.skills.shared.warm_motion import prepare_moving

JERK_TIME = 0.1
"""Seconds in which the acceleration is reached."""

TOO_MUCH_FOR = 0.06
"""A grip that wants more than it may, or a fruit that slips, for so long ends the lift [s]; the load of an acceleration
that is just beginning passes within `JERK_TIME`."""

LOWERING = 0.1
"""Speed with which a fruit that cannot be held is put back, until it is near to where it stood [m/s]."""

STILL, STILL_FOR = 1e-4, 0.15
"""A grip is at rest when the fruit has slid by less [m] for so long [s]: twice what noise shows, and the time in which
a fruit that slides at 1 mm/s goes beyond it."""

BACK = 1e-3
"""A fruit that is lower than this above where it stood is back [m]."""

RESTING = 0.1
"""So long after it was felt to stand, what has fallen presses on no finger any more [s]."""

LOST_PUT_BACK = "the fruit was lost while it was put back"


class _TooMuch(Exception):
    """The grip cannot hold what it has begun to lift."""

    def __init__(self, problem: GripProblem, borne: _Borne) -> None:
        self.problem, self.borne = problem, borne
        super().__init__(problem.message)


class _Borne:
    """What the pads bear of the fruit's weight, along the load that was too much for them."""

    def __init__(self, hold: Hold) -> None:
        self._hold = hold
        self._along = np.array(hold.controller.sense.load)
        self._along /= max(float(np.linalg.norm(self._along)), 1e-9)

    @property
    def nothing(self) -> bool:
        """Whether nothing hangs on them: the fruit stands, and pads that go on downwards only press it there.

        One that has slid so far that the pads close over its top is pressed down, and lifts the pads.
        """
        return float(self._along @ self._hold.controller.sense.load) < LEAST


class _Bearable:
    """Whether the grip can hold what hangs on it, seen in the first millimetres and all the way up."""

    def __init__(self, hold: Hold) -> None:
        self._hold, self._since = hold, math.nan

    def require(self) -> None:
        """Look once a tick.

        Raises:
            _TooMuch: the load needs more force than is allowed, or the fruit slips, and not just for a moment.
        """
        problem = self._hold.problem
        if problem is None or problem.code not in ("FORCE_LIMIT", "SLIPPED"):
            self._since = math.nan
            return
        if math.isnan(self._since):
            self._since = problem.stamp
        if problem.stamp - self._since > TOO_MUCH_FOR:
            raise _TooMuch(problem, _Borne(self._hold))


class Lift(MovingSkill):
    """Lift straight up with a smooth profile while the grip is controlled, and verify that the fruit came along.

    With a `hold` its controller says whether the fruit is still there; without one the fingers' force and opening do.
    A fruit that creeps out of the grip falls later: `settle_within` watches it until the grip has come to rest, and
    `hold_time` for a while in any case. What the grip cannot hold is
    put back where it stood, before it falls: TOO_HEAVY when its weight alone needs more force than is allowed, wherever
    it is gripped, FORCE_LIMIT when its moment does, SLIPPED when it slips all the same.
    Interrupted, the arm stops on its line and the grip goes on holding.
    """

    devices = (Arm, Gripper, ForceSensor, Workspace)
    moves = (Arm, Gripper)
    failures = (
        *MOTION_FAILURES,
        "NOT_HELD",
        "LOST",
        "TOO_HEAVY",
        "FORCE_LIMIT",
        "SLIPPED",
        "LIFT_BLOCKED",
        "MAP_STALE",
    )
    renamed_failures: ClassVar = {"NO_WAY_UP": "LIFT_BLOCKED"}

    def prepare(self) -> None:
        prepare_moving(self)

    def run(
        self,
        height: Annotated[Length, Port(min="1 mm", max="1 m", help="how far up")] = LENGTH("150 mm"),
        hold: Annotated[Hold | None, Port(help="the grip that goes on while lifting")] = None,
        grasp: Annotated[
            Grasp | None, Port(help="of the held fruit, which is then checked for collision as part of the robot")
        ] = None,
        map: Annotated[OccupancyMap | None, Port(help="what is in the way")] = None,
        clearance: Annotated[
            Length, Port(min="0 mm", help="kept by the links; gripper and fingers keep a share")
        ] = LENGTH("5 mm"),
        speed: Annotated[Speed, Port(min="1 mm/s", max="1 m/s")] = SPEED("0.25 m/s"),
        acceleration: Annotated[Acceleration, Port(min="0.01 m/s²", max="3 m/s²")] = ACCELERATION("1 m/s²"),
        hold_time: Annotated[Time, Port(min="0 s", help="how long it is watched at the top", was="keep")] = TIME("0 s"),
        settle_within: Annotated[
            Time, Port(min="0 s", help="wait at the top until the grip has come to rest, at most so long")
        ] = TIME("0 s"),
    ) -> Work[None]:
        arm = self.device(Arm)
        if not self._held(hold):
            raise self._not_held("NOT_HELD", "there is nothing between the fingers to lift", hold)
        robot = RobotModel.load(arm.description)
        T_base_start = robot.tcp(arm.state().q)
        T_base_goal = T_base_start.copy()
        T_base_goal[2, 3] += height
        line = straight_line(robot, arm.state().q, T_base_goal)
        if not line.complete:
            raise self.failure(
                "LIFT_BLOCKED",
                f"{line.reason} after {1e3 * line.reached * height:.0f} of {1e3 * height:.0f} mm",
                reached_m=line.reached * height,
            )
        self._require_free(line.q, grasp, map, clearance)
        trajectory = time_curve(line.q, height, arm.limits, speed, acceleration, acceleration / JERK_TIME)

        hanging = None if hold is None or hold.ended else Hanging(hold)
        bearable = None if hold is None or hold.ended else _Bearable(hold)

        def watch() -> None:
            gone = ""
            if hold is not None:
                show_grip(self, hold)
            if bearable is not None:
                bearable.require()
            if hanging is not None:
                gone = hanging.look()
            if gone or not self._held(hold):
                risen = robot.tcp(arm.state().q)[2, 3] - T_base_start[2, 3]
                words = f"the fruit was lost {1e3 * risen:.0f} mm up"
                raise self._not_held("LOST", f"{words}: {gone}" if gone else words, hold)

        try:
            yield from self.travel(trajectory, watch, carrying=grasp)
            watch()
            up_since = self.context.elapsed()
            while self.context.elapsed() - up_since < hold_time - 1e-9:
                yield "held up"
                watch()
            if hold is not None and hanging is not None:
                yield from self._settle(hold, settle_within, watch)
        except _TooMuch as much:
            stands = yield from self._put_back(robot, T_base_start, acceleration, hold, much.borne)
            risen = float(robot.tcp(arm.state().q)[2, 3] - T_base_start[2, 3])
            raise self._cannot_hold(much.problem, hold, 0.0 if stands else risen) from much
        if hanging is not None and (missing := hanging.missing()):
            raise self._not_held("LOST", f"nothing came up: {missing}", hold)
        if hold is not None:
            show_grip(self, hold, everything=True)
        return None

    def _settle(self, hold: Hold, within: float, watch: Callable[[], None]) -> Watching:
        """Wait until the force has come down to what the load needs, and the fruit slides no more."""
        began = since = self.context.elapsed()
        slid = hold.controller.slipped
        while (now := self.context.elapsed()) - began < within - 1e-9 and now - since < STILL_FOR - 1e-9:
            yield "held up, until the grip has come to rest"
            watch()
            if not hold.controller.at_rest or abs(hold.controller.slipped - slid) > STILL:
                since, slid = self.context.elapsed(), hold.controller.slipped

    def _put_back(
        self, robot: RobotModel, T_base_start: Float64, acceleration: float, hold: Hold | None, borne: _Borne
    ) -> Work[bool]:
        """Lower the fruit to where it stood, on the line that it came up; where there is no such line, stay.

        Returns:
            Whether it stands: it is where it stood, or was felt to touch down before. The fingers rest then, or the
            grip would answer what carries the fruit by pressing harder.
        """
        arm = self.device(Arm)
        q = arm.state().q
        way = float(np.linalg.norm(robot.tcp(q)[:3, 3] - T_base_start[:3, 3]))
        line = straight_line(robot, q, T_base_start)
        if way < BACK or not line.complete:
            return way < BACK

        def watch() -> None:
            if borne.nothing:
                take_over(self.device(Gripper))
                raise TouchedDown
            if hold is not None:
                show_grip(self, hold)
                require_truth(hold)
            if not self._held(hold):
                raise self._not_held("LOST", LOST_PUT_BACK, hold)

        try:
            watch()
            yield from self._lower(line, way, acceleration, watch)
        except TouchedDown:
            yield from self.wait(RESTING)
            if max(pressing_forces(self.device(ForceSensor))) <= HELD_FORCE:
                raise self._not_held("LOST", LOST_PUT_BACK, hold) from None
        return True

    def _lower(self, line: StraightLine, way: float, acceleration: float, watch: Callable[[], None]) -> Watching:
        """Go down a line [m] until the fruit touches down, which ends it by `TouchedDown`, or to its end."""
        arm = self.device(Arm)
        steps = len(line.q) - 1
        split = steps - min(math.ceil(NEAR / way * steps), steps)
        split = 0 if min(split, steps - split) < 3 else split
        if split:
            curve = time_curve(
                line.q[: split + 1], split / steps * way, arm.limits, LOWERING, acceleration, acceleration / JERK_TIME
            )
            yield from self.travel(curve, watch)
        slowly = (steps - split) / steps * way
        curve = time_curve(line.q[split:], slowly, arm.limits, SETTING_DOWN, GENTLE, GENTLE / JERK_TIME)
        yield from set_down(self, curve, watch)

    def _cannot_hold(self, problem: GripProblem, hold: Hold | None, risen: float) -> Exception:
        code = problem.code
        if code == "FORCE_LIMIT" and problem.data["for_weight_alone_n"] > problem.data["limit_n"]:
            code = "TOO_HEAVY"
        elsewhere = {
            "TOO_HEAVY": "at any grip position",
            "FORCE_LIMIT": "at this grip position (nearer its centre it may be held)",
            "SLIPPED": "with the configured and with the measured friction",
        }[code]
        where = (
            "put back where it stood" if risen < BACK else f"still {1e3 * risen:.0f} mm up, with no straight way back"
        )
        return self._not_held(code, f"{where}; {elsewhere}", hold, problem)

    def _require_free(self, q_line: Float64, grasp: Grasp | None, map: OccupancyMap | None, clearance: float) -> None:
        width = self.device(Gripper).state().width
        field = usable_field(self, map)
        space = arm_space(self.device(Arm), self.device(Workspace), field, width, clearance, held=grasp)
        space = space.leaving_table()
        blocked = space.first_blocked(q_line)
        if blocked is not None:
            reason, found = space.explain(q_line[blocked + 1])
            raise self.failure("LIFT_BLOCKED", f"on the way up {reason}", **found)

    def _held(self, hold: Hold | None) -> bool:
        if hold is not None and not hold.ended:
            return hold.holds
        return something_between(self.device(Gripper), self.device(ForceSensor))

    def _not_held(self, code: str, message: str, hold: Hold | None, problem: GripProblem | None = None) -> Exception:
        if problem is None and hold is not None:
            problem = hold.problem
        left, right = pressing_forces(self.device(ForceSensor))
        now = {
            "width_m": float(np.round(self.device(Gripper).state().width, 5)),
            "left_force_n": round(left, 3),
            "right_force_n": round(right, 3),
        }
        if problem is None:
            return self.failure(code, message, grip="", **now)
        # What was so when the problem arose stands before what is so now.
        return self.failure(code, f"{message}: {problem.message}", **{**now, **problem.data, "grip": problem.code})
