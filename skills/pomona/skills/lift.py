"""The skill Lift."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, ClassVar

from pomona.drivers.interfaces import Arm, Gripper, Trajectory, Workspace
from pomona.executive.ports import (
    ACCELERATION,
    LENGTH,
    SPEED,
    TIME,
    Acceleration,
    Length,
    Port,
    Speed,
    Time,
)
from pomona.executive.skill import Work
from pomona.skills.grip.hold import Hold
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.shared.carrying import (
    BACK,
    JERK_TIME,
    LEAST,
    NEAR,
    RESTING,
    GripOverloaded,
    Hanging,
    OverloadMonitor,
    grip_failure,
    put_back,
)
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from pomona.skills.shared.grasp_view import TAKEN
from pomona.skills.shared.held_fruit import (
    HAND_DEVICES,
    is_held,
    note_held,
    note_press,
    show_grip,
    watch_fruit,
)
from pomona.skills.shared.planning import (
    Clearance,
    HeldGrasp,
    Obstacles,
    ToolAcceleration,
    space_around,
)
from pomona.skills.shared.straight_travel import free_line, tool_pose
from pomona.skills.shared.touch import weighing

STILL = 1e-4
STILL_FOR = 0.15
"""A grip is at rest when the fruit has slid by less than the first [m] within the second [s]: twice the noise, and the
time in which a fruit that slides at 1 mm/s exceeds it."""


class Lift(MovingSkill):
    """Lift straight up with a smooth profile while the grip is controlled, and verify that the fruit came along.

    With a `hold` its controller monitors the fruit; without one, the force and the opening of the fingers do, and
    without a force sensor the opening and the gripper's motor; a fine load sensor must show the weight at the top.
    `settle_within` and `hold_time` watch the fruit at the top, since a fruit that creeps falls later.
    If the grip cannot hold the fruit, the fruit is put back before it falls. The code is TOO_HEAVY if the weight alone
    needs more than the allowed force, FORCE_LIMIT if the moment does, otherwise SLIPPED.
    After an interruption the arm stops on its line and the grip goes on holding.
    """

    devices = (Arm, Gripper, Workspace)
    optional_devices = (*MovingSkill.optional_devices, *HAND_DEVICES)
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
    measures = True

    def run(
        self,
        height: Annotated[Length, Port(min="1 mm", max="1 m", help="height of the lift")] = LENGTH(
            "150 mm"
        ),
        hold: Annotated[Hold | None, Port(help="grip that continues during the lift")] = None,
        grasp: HeldGrasp = None,
        map: Obstacles = None,
        clearance: Clearance = LENGTH("5 mm"),
        speed: Annotated[Speed, Port(min="1 mm/s", max="1 m/s")] = SPEED("0.25 m/s"),
        acceleration: ToolAcceleration = ACCELERATION("1 m/s²"),
        deceleration: Annotated[
            Acceleration,
            Port(
                min="0 m/s²",
                max="3 m/s²",
                help="deceleration at the top, where it unloads the pads; 0: as the acceleration",
            ),
        ] = ACCELERATION("0 m/s²"),
        hold_time: Annotated[
            Time,
            Port(min="0 s", help="time for which the fruit is monitored at the top", was="keep"),
        ] = TIME("0 s"),
        settle_within: Annotated[
            Time, Port(min="0 s", help="maximum wait at the top until the grip is at rest")
        ] = TIME("0 s"),
    ) -> Work[None]:
        arm = self.device(Arm)
        if not is_held(self, hold):
            raise grip_failure(
                self, "NOT_HELD", "there is nothing between the fingers to lift", hold
            )
        self.publish("candidates", TAKEN)
        T_base_start = tool_pose(self)
        T_base_goal = T_base_start.copy()
        T_base_goal[2, 3] += height
        space = space_around(self, map, clearance, held=grasp).leaving(arm.state().q)
        jerk = acceleration / JERK_TIME
        braking = deceleration or acceleration
        active = None if hold is None or hold.ended else hold.under(self.device(Gripper))
        hanging = None if active is None else Hanging(active)
        overload = None if active is None else OverloadMonitor(active)
        lost = watch_fruit(self, hold)

        def risen() -> float:
            return float(tool_pose(self)[2, 3] - T_base_start[2, 3])

        def way_up() -> Trajectory:
            line = free_line(
                self, T_base_goal, space, ("LIFT_BLOCKED", "LIFT_BLOCKED"), "on the way up"
            )
            left = height - risen()
            return time_curve(
                line.q, left, arm.limits, speed, acceleration, jerk, deceleration=braking
            )

        trajectory = way_up()
        if active is not None:
            active.lift(0.0)
        scale = weighing(self)
        hangs = False

        def watch() -> None:
            gone = ""
            if hold is not None:
                show_grip(self, hold)
            if active is not None:
                active.lift(risen())
            if overload is not None:
                overload.require_bearable()
            if hanging is not None:
                gone = hanging.look(self.pace if risen() < NEAR else 1.0)
            if hangs and scale is not None and scale.present < scale.limit(LEAST, 0.0):
                gone = gone or f"no weight hangs on the hand: {scale.present:.2f} N"
            if gone := gone or lost():
                raise grip_failure(
                    self, "LOST", f"the fruit was lost {1e3 * risen():.0f} mm up: {gone}", hold
                )

        try:
            try:
                yield from self.travel(trajectory, watch, carrying=grasp)
            except GripOverloaded:
                if active is None or active.problem is not None or height - risen() < BACK:
                    raise
                # It has let go of the fruit. Its force is not measured: the grip force that the load needed stands for it.
                note_press(
                    self, "a wall or a neighbour", active.peaks[3], grasp.fruit if grasp else None
                )
                yield from self.travel(way_up(), watch, carrying=grasp)
            watch()
            if scale is not None:
                yield from self.wait(RESTING)
                hangs = True
                watch()
            up_since = self.context.elapsed()
            while self.context.elapsed() - up_since < hold_time - 1e-9:
                yield "held up"
                watch()
            if active is not None:
                yield from self._settle(active, settle_within, watch)
        except GripOverloaded as overloaded:
            stands = yield from put_back(self, T_base_start, acceleration, hold, overloaded.load)
            code, words = overloaded.outcome(0.0 if stands else risen())
            raise grip_failure(self, code, words, hold, overloaded.problem) from overloaded
        finally:
            if scale is not None:
                scale.close()
        if hanging is not None and (missing := hanging.missing()):
            raise grip_failure(self, "LOST", f"the fruit was not lifted: {missing}", hold)
        if hold is not None:
            show_grip(self, hold, everything=True)
        note_held(self, hold, grasp.fruit if grasp else None)

    def _settle(self, hold: Hold, within: float, watch: Callable[[], None]) -> Watching:
        """Wait until the force has fallen to the requirement of the load, and the fruit does not slide any more."""
        began = since = self.context.elapsed()
        slid = hold.slipped
        while (
            now := self.context.elapsed()
        ) - began < within - 1e-9 and now - since < STILL_FOR - 1e-9:
            yield "held up, until the grip has come to rest"
            watch()
            if not hold.is_at_rest or abs(hold.slipped - slid) > STILL:
                since = self.context.elapsed()
                slid = hold.slipped
