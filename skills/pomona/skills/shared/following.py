"""Motions of skills: start, watch, and come to rest after any end."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import replace
from typing import ClassVar

from pomona.drivers.errors import MotionRefused
from pomona.drivers.interfaces import (
    Arm,
    Cameras,
    Carrier,
    Gripper,
    Motion,
    MotionState,
    Trajectory,
    Workspace,
)
from pomona.executive.lease import notice_of
from pomona.executive.skill import Skill
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.motion.robot import RobotModel
from pomona.skills.shared.live_watch import (
    WATCH_FAILURES,
    KnownAround,
    LiveWatch,
    prepare_watch,
    watched,
)
from pomona.skills.shared.warm_motion import prepare_moving

Watching = Generator["str | None", None, None]

MOTION_FAILURES = (
    "REFUSED",
    "STOPPED",
    "MOTION_FAILED",
    *WATCH_FAILURES,
)  # refused; stopped from outside; failed during the motion; stopped by what the cameras show


class MotionEnded(Exception):
    """A motion that ended before its goal."""

    def __init__(self, state: MotionState, problem: str) -> None:
        self.state = state
        self.problem = problem
        super().__init__(problem or f"the motion was {state.value} before its end")


def follow_motion(
    motion: Motion,
    watch: Callable[[], str | None] | None = None,
    each_tick: Callable[[], None] | None = None,
) -> Watching:
    """Watch a motion that was just started until it is done and nothing moves any more.

    `watch` is called in each tick, and after a stop; it raises to end the motion, or returns feedback. When it raises
    or the caller is interrupted, the motion is stopped, and the exception passes once all is at rest, until which
    `each_tick` is called.

    Raises MotionEnded: it was stopped from outside, or failed.
    """
    each_tick = each_tick or (lambda: None)
    try:
        while motion.state in (MotionState.RUNNING, MotionState.PAUSED):
            each_tick()
            said = watch() if watch is not None else None
            words = f"{motion.progress:.0%}" if motion.state is MotionState.RUNNING else "paused"
            yield f"{words}, {said}" if said else words
    except GeneratorExit:
        motion.stop()
        raise
    except BaseException:
        motion.stop()
        while not motion.settled:
            each_tick()
            yield "stopping"
        raise
    while not motion.settled:
        each_tick()
        yield "coming to rest"
    if motion.state is MotionState.STOPPED and watch is not None:
        watch()  # a touch may have stopped it, in its sensor's own loop
    if motion.state is not MotionState.DONE:
        raise MotionEnded(motion.state, motion.problem)


class MovingSkill(Skill):
    """A skill that moves the arm or the gripper; its `failures` must contain `MOTION_FAILURES`."""

    failures: ClassVar[tuple[str, ...]] = MOTION_FAILURES
    optional_devices: ClassVar[tuple[type, ...]] = (Arm, Gripper, Workspace, Cameras, Carrier)
    """The zones and the watched path need them."""

    def prepare(self) -> None:
        prepare_moving(self)
        prepare_watch(self)

    def travel(
        self,
        trajectory: Trajectory,
        watch: Callable[[], str | None] | None = None,
        around: KnownAround | None = None,
        carrying: Grasp | None = None,
        started: Callable[[Motion], None] | None = None,
        each_tick: Callable[[], None] | None = None,
        wary: bool = False,
    ) -> Watching:
        """Let the arm follow a trajectory to its end.

        Args:
            watch: as in `follow_motion`.
            around: known obstacles. The cell's cameras then watch the path: an unknown obstacle too near fails with
                PATH_BLOCKED, and a camera with implausible frames with POSE_MISMATCH or DEPTH_MISMATCH.
            carrying: the grasp by which a fruit is held.
            started: called with the motion, once it has been started.
            each_tick: called in each tick until the arm is at rest, also while it stops.
            wary: start only while the cameras show the way free; after something has come near, every motion does so:
                see `live_watch.watched`.

        Raises SkillFailure: REFUSED, if the path leads through a zone of the cell, or begins in one.
        """
        arm = self.device(Arm)
        entered = zone_entered(self, arm, trajectory, carrying)
        if entered:
            raise self.failure("REFUSED", f"{entered}; nothing has moved", device="zones")
        eyes = yield from watched(self, trajectory, around, wary, carrying)
        if eyes is not None and (slower := eyes.slowed()) is not None:
            trajectory = slower
            yield "slower, beside an unmapped object; if it always stands there, add it to the cell file"

        def start() -> Motion:
            motion = arm.follow(trajectory)
            if started is not None:
                started(motion)
            return motion

        yield from self._carry_out(start, watch, each_tick, eyes)

    def move_fingers(self, width: float, speed: float) -> Watching:
        """Move the fingers to an opening [m] at a speed [m/s]."""
        gripper = self.device(Gripper)
        eyes = yield from watched(self)
        yield from self._carry_out(lambda: gripper.move(width, speed), eyes=eyes)

    def _carry_out(
        self,
        start: Callable[[], Motion],
        watch: Callable[[], str | None] | None = None,
        each_tick: Callable[[], None] | None = None,
        eyes: LiveWatch | None = None,
    ) -> Watching:
        def look() -> str | None:
            progress = None if watch is None else watch()
            ahead = None if eyes is None else eyes.look()
            return ", ".join(filter(None, (progress, ahead))) or None

        try:
            motion = start()
        except MotionRefused as refused:
            raise self.failure(
                "REFUSED", f"{refused}; nothing has moved", device=refused.device
            ) from refused
        if eyes is not None:
            eyes.begin(motion)
        try:
            yield from follow_motion(motion, look, each_tick)
        except MotionEnded as ended:
            code = "STOPPED" if ended.state is MotionState.STOPPED else "MOTION_FAILED"
            raise self.failure(code, str(ended), progress=round(motion.progress, 3)) from ended
        finally:
            notice_of(self.clock).watched.discard(self.path)


def zone_entered(
    skill: Skill, arm: Arm, trajectory: Trajectory, carrying: Grasp | None = None
) -> str:
    """Describe which part of the robot or of a held fruit would enter a zone on a path, and where; empty without one.

    Args:
        skill: that moves; in a cell without a workspace or zones the text is empty.
        trajectory: to be followed.
        carrying: the grasp by which a fruit is held.
    """
    workspace = skill.optional_device(Workspace)
    gripper = skill.optional_device(Gripper)
    if workspace is None or not workspace.zones:
        return ""
    width = RobotModel.load(arm.description).width_max if gripper is None else gripper.state().width
    only = replace(workspace, table_z=None, obstacles=(), hulls=())
    space = arm_space(arm, only, None, width, 0.0, held=carrying)
    world = space.world.with_margins(replace(space.world.margins, itself=-1.0))
    entered = world.check_path(trajectory.q, width)
    if entered is None:
        return ""
    return (
        f"at the arm's present position, {entered}"
        if entered.at == 0.0
        else f"on the way {entered}"
    )
