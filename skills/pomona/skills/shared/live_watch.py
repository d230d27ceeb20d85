"""Watch of the path while the arm moves: every camera of the cell, every new frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from pomona.drivers.depth_model import DepthModel
from pomona.drivers.errors import FrameUnreadable
from pomona.drivers.interfaces import (
    Arm,
    ArmState,
    Camera,
    Cameras,
    Carrier,
    DepthCamera,
    Frame,
    Gripper,
    Intrinsics,
    Motion,
    MotionState,
    Trajectory,
    Workspace,
)
from pomona.executive.lease import BLOCKED, notice_of
from pomona.executive.skill import Skill, Work
from pomona.executive.values.arrays import Float64
from pomona.executive.views import Points3, SceneView
from pomona.skills.geometry import apply, inverse, transform
from pomona.skills.motion.collision import Convex, RobotShape, fruit_points
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.occupancy import OccupancyMap, pose_of_camera
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.watch import Ahead, PathWatch
from pomona.skills.motion.watch.path_watch import spot
from pomona.skills.perception.frame_check import MISMATCHES, frame_problem
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.frame_trust import earlier_poses, mismatch, note_pose, require_sound_pose
from pomona.skills.shared.warm_motion import warm_checks

WATCH_FAILURES = (
    BLOCKED,
    *MISMATCHES,
)  # of watched motions: an obstacle, or a camera with implausible frames
TOO_OLD = 0.3  # age from which a frame is stale [s]; a camera that sends no others is lost, which its driver reports


@dataclass(frozen=True, slots=True)
class KnownAround:
    """Known obstacles around the arm."""

    map: OccupancyMap | None = None  # obstacles from earlier frames, or None
    fruit: tuple[MeasuredFruit, ...] = ()  # measured fruit that is left out of the map
    carrying: Grasp | None = None  # the grasp by which a fruit is held, or None


PATIENCE = 10.0  # wait for a person to leave, before the operator is asked [s]
UNSEEN = 1.0  # nobody has been seen for so long when a motion starts [s]: a hand beside the robot shows in some frames only


class LiveWatch:
    """Watches one motion of a skill that declares `WATCH_FAILURES`; made by `of`."""

    def __init__(
        self,
        skill: Skill,
        arm: Arm,
        cameras: tuple[Camera, ...],
        workspace: Workspace,
        watch: PathWatch,
    ) -> None:
        self._skill = skill
        self._arm = arm
        self._cameras = cameras
        self._watch = watch
        self._robot = RobotModel.load(arm.description)
        self._workspace = workspace
        self._stamps: dict[int, float] = {}
        # postures that are remembered, to know where the arm was when a fixed camera looked: a second of ticks
        self._states: deque[ArmState] = deque(maxlen=64)
        self._motion: Motion | None = None
        self._gripper = skill.optional_device(Gripper)

    @staticmethod
    def of(skill: Skill, trajectory: Trajectory | None, around: KnownAround) -> LiveWatch | None:
        """Return the watch of a trajectory, or of a resting arm.

        None in a cell without an arm or a camera, or whose file requests no watch.
        """
        cameras = _watching(skill)
        arm = skill.optional_device(Arm)
        workspace = skill.optional_device(Workspace)
        if not cameras or workspace is None or arm is None:
            return None
        trajectory = trajectory or _still(arm.state().q)
        shape = RobotShape.of(RobotModel.load(arm.description))
        held = around.carrying
        if held is not None:
            shape = shape.holding(apply(inverse(held.T_base_grasp), fruit_points(held.fruit)))
        gripper = skill.optional_device(Gripper)
        width = shape.model.width_max if gripper is None else gripper.state().width
        fruit = [Convex.of_fruit(measured) for measured in around.fruit]
        watch = PathWatch(shape, trajectory, arm.limits, width, workspace, around.map, fruit)
        notice = notice_of(skill.clock)
        if notice.watch is not None and (notice.why or around.map is None):
            watch.inherit(notice.watch, bool(notice.why))
        notice.watch = watch
        return LiveWatch(skill, arm, cameras, workspace, watch)

    def check_cameras(self) -> None:
        """Compare the table in every camera's newest frame with the cell file's, before the motion starts.

        Raises SkillFailure: POSE_MISMATCH or DEPTH_MISMATCH; nothing has moved.
        """
        for _number, frame, T_base_camera in self._fresh():
            require_sound_pose(self._skill, frame, T_base_camera, self._workspace)

    def _fresh(self) -> Iterator[tuple[int, Frame, Float64]]:
        """Yield the number, newest frame and pose of each camera whose depth is fresh and has a place."""
        for number, camera in enumerate(self._cameras):
            frame = _newest(camera)
            if (
                frame is not None
                and frame.depth is not None
                and frame.placed
                and abs(self._skill.clock.now() - frame.stamp) < TOO_OLD
            ):
                yield number, frame, pose_of_camera(frame, self._robot)

    def obstructed(self, noticed: bool = False) -> Work[str]:
        """Return what the newest frames show against a start, empty if they show the way free; one camera a tick.

        After a notice the whole volume that the robot passes through must be in view; if `noticed`, nothing counts before.
        """
        notice = notice_of(self._skill.clock)
        if noticed and not notice.why:
            return ""
        views = []
        for number, frame, T_base_camera in self._fresh():
            q = self._arm.state().q if frame.q is None else frame.q
            if seen := self._watch.entered(frame, T_base_camera, q, number):
                notice.beside = self._watch.beside
                return seen
            views.append((frame, T_base_camera, q))
            yield None
        if not notice.why:
            return ""
        if notice.beside:
            return "what came in was last seen beside the robot"
        return self._watch.hidden(views)

    def slowed(self) -> Trajectory | None:
        """Return the path, slower where unmapped objects that stand now could meet the moving arm; None if as before.

        The objects of the fixed cameras' newest frames may set off at once: see `PathWatch.slowed`. A camera
        on the hand shows too little of the cell for that, and much that the skills have put down themselves.
        """
        seen = [np.empty((0, 3))]
        oldest = 0.0
        for number, frame, T_base_camera in self._fresh():
            if frame.q is None:
                oldest = max(oldest, self._skill.clock.now() - frame.stamp)
                seen.append(self._watch.standing(frame, T_base_camera, self._arm.state().q, number))
        slower = self._watch.slowed(np.concatenate(seen), oldest)
        if slower is not None:
            self._watch = self._watch.on(slower)
        return slower

    def begin(
        self, motion: Motion, along: Trajectory | None = None, shape: RobotShape | None = None
    ) -> None:
        """The motion has been started; `along`: on this path instead, as a robot of this shape if it is another now."""
        if along is not None:
            self._watch = self._watch.on(along, shape)
        self._motion = motion

    def look(self) -> str | None:
        """Compare new frames with the rest of the path; return a text for an obstacle ahead that is not near yet.

        Before a motion has begun the arm rests, while the fingers may move.

        Raises SkillFailure: PATH_BLOCKED, or POSE_MISMATCH or DEPTH_MISMATCH if the camera's frames are implausible.
        """
        motion = self._motion
        self._states.append(self._arm.state())
        if self._gripper is not None:
            self._watch.width = self._gripper.state().width
        passed = 0.0
        if motion is not None:
            passed = motion.progress * self._watch.duration
            if motion.state is not MotionState.RUNNING:
                return None
        said = None
        for number, frame, T_base_camera in self._fresh():
            if self._stamps.get(number) == frame.stamp:
                continue
            self._stamps[number] = frame.stamp
            ahead = self._watch.look(
                frame,
                T_base_camera,
                self._posture(frame.stamp) if frame.q is None else frame.q,
                max(self._skill.clock.now() - frame.stamp, 0.0),
                passed,
                number,
            )
            if ahead is not None and ahead.stop:
                if motion is not None:
                    motion.stop()
                if (carrier := self._skill.optional_device(Carrier)) is not None:
                    carrier.stop()
                self._refuse(ahead, self._cameras[number], frame)
            note_pose(self._skill, frame, T_base_camera)
            if ahead is not None:
                said = f"unmapped object on the path, {ahead.after:.1f} s ahead"
        return said

    def _posture(self, stamp: float) -> Float64:
        """Return joints when a fixed camera looked, (dof,) [rad], from the states around that time."""
        times = [state.stamp for state in self._states]
        return np.array(
            [np.interp(stamp, times, q) for q in np.transpose([state.q for state in self._states])]
        )

    def _refuse(self, ahead: Ahead, camera: Camera, frame: Frame) -> None:
        self._refuse_untrue(camera, frame)
        what = "a moving object entered" if ahead.moved else "an unmapped object stands"
        words = f"{what} at {spot(ahead.point)}"
        shown = Points3(np.array([ahead.point]), "obstacle", "occupied", 0.04)
        self._skill.publish("blocked", SceneView(points=(shown,), caption=words))
        words += f", {1e3 * ahead.distance:.0f} mm from the path of {ahead.part}"
        self._watch.suspect(ahead.point)
        notice_of(self._skill.clock).why = words
        raise self._skill.failure(
            BLOCKED,
            f"{words}: detect again, or clear the path",
            point_m=list(ahead.point),
            distance_m=round(ahead.distance, 4),
            after_s=round(ahead.after, 3),
            part=ahead.part,
            moved=ahead.moved,
            camera=frame.label,
        )

    def _refuse_untrue(self, camera: Camera, frame: Frame) -> None:
        """Depth that is no depth of its frame shows obstacles where nothing is: name the camera instead."""
        looked = camera.latest() if isinstance(camera, DepthCamera) else frame
        for shown in (frame, looked):
            if shown is None or shown.depth is None:
                continue
            T_base_camera = pose_of_camera(shown, self._robot)
            earlier = tuple(earlier_poses(self._skill, shown))
            if problem := frame_problem(shown, T_base_camera, self._workspace, earlier):
                raise mismatch(self._skill, shown, problem)


def watched(
    skill: Skill,
    path: Trajectory | None = None,
    around: KnownAround | None = None,
    wary: bool = False,
    carrying: Grasp | None = None,
) -> Work[LiveWatch | None]:
    """Return the watch of a motion once it may start, without a path of the fingers; None where nothing watches it.

    The lease of the skill then lets it start.

    After a notice, and if it is `wary`, it may only start while the cameras show its way free: else the arm rests, after
    `PATIENCE` an operator is asked, and without one it fails.

    Raises SkillFailure: PATH_BLOCKED, POSE_MISMATCH or DEPTH_MISMATCH; nothing has moved.
    """
    notice = notice_of(skill.clock)
    since = seen = skill.context.elapsed()
    known = around or KnownAround(carrying=carrying)
    eyes = LiveWatch.of(skill, path, known) if around or notice.why else None
    if eyes is not None:
        eyes.check_cameras()
    while notice.why or (wary and eyes is not None):
        why = "no camera watches the way" if eyes is None else (yield from eyes.obstructed())
        now = skill.context.elapsed()
        if why:
            seen = now
        elif not notice.why or now - seen >= UNSEEN:
            break
        if why and (eyes is None or not notice.why or now - since > PATIENCE):
            yield from ask_operator(skill, why)
            eyes = LiveWatch.of(skill, path, known)
            break
        yield f"at rest: {why or 'nobody is seen'}"
    notice.watched.add(skill.path)
    return eyes


def ask_operator(skill: Skill, why: str) -> Work[None]:
    """Rest until an operator says that nobody is near. Raises SkillFailure: PATH_BLOCKED, without one."""
    if not (yield from skill.confirm(f"{why}; is nobody near the arm?")):
        raise skill.failure(BLOCKED, f"{why}; nothing has moved")
    notice = notice_of(skill.clock)
    notice.why = ""
    notice.beside = False


def _still(q: Float64) -> Trajectory:
    still = np.zeros((2, len(q)))
    return Trajectory(np.array([0.0, 0.1]), still + q, still, still)


def prepare_watch(skill: Skill) -> None:
    """For `prepare` of a skill that watches its path: compile the loops, and read a frame of every camera."""
    cameras = _watching(skill)
    arm = skill.optional_device(Arm)
    if cameras and arm is not None:
        _warm(arm.description)
        for camera in cameras:
            _newest(camera)


def _watching(skill: Skill) -> tuple[Camera, ...]:
    """Return the cameras that watch paths; none in a cell whose file requests no watch."""
    cameras = skill.optional_device(Cameras)
    workspace = skill.optional_device(Workspace)
    if cameras is None or workspace is None or workspace.watch is None:
        return ()
    return cameras.all


@lru_cache(maxsize=8)
def _warm(description: Path) -> None:
    """Watch a short motion once, with an obstacle on its path."""
    robot, q, _space, limits = warm_checks(description)
    at = robot.tcp(q)[:3, 3]
    watch = PathWatch(
        RobotShape.of(robot),
        _still(q),
        limits,
        robot.width_max,
        Workspace(None, at - 0.3, at + 0.3),
    )
    colour = np.zeros((2, 2, 3), np.uint8)
    T_base_camera = transform(None, at - np.array([0.0, 0.0, 0.3]))
    lens = Intrinsics(0.5, 0.5, 0.5, 0.5, 2, 2)  # four points 0.2 m beside the tool
    depth = np.full((2, 2), 0.2, np.float32)
    frame = Frame(0.0, 0, colour, depth, lens, None, T_base_camera, depth_model=DepthModel())
    watch.look(frame, T_base_camera, q, 0.0, 0.0)


def _newest(camera: Camera) -> Frame | None:
    try:
        return camera.latest_depth() if isinstance(camera, DepthCamera) else camera.latest()
    except FrameUnreadable:
        return None
