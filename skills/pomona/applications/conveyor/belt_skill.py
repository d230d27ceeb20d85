"""Base of the skills at a belt: they look at it while they last."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import ClassVar

from pomona.applications.conveyor.belt_view import belt_scene, belt_table
from pomona.applications.conveyor.belt_watch import BeltWatch
from pomona.applications.conveyor.conveyor import FASTEST, Conveyor
from pomona.drivers import Arm, Camera, Cameras, Frame, FrameUnreadable
from pomona.executive import Float64, Skill
from pomona.skills.motion import RobotModel
from pomona.skills.perception import DetectError

SHOWN_EVERY = 0.2  # time between two views of the belt [s]

BELT_FAILURES = (
    "NO_FRAME",
    "STALE_FRAME",
    "ENCODER_FAULT",
)  # codes of every skill that looks at a belt


class BeltSkill(Skill):
    """A skill that keeps the tracks of a belt up; it must declare `BELT_FAILURES`."""

    devices: ClassVar[tuple[type, ...]] = (Camera, Conveyor)
    optional_devices: ClassVar[tuple[type, ...]] = (Arm, Cameras)
    moves: ClassVar[tuple[type, ...] | None] = ()

    def eye(self) -> Camera:
        """Return the camera that sees the belt: the cell's first."""
        cameras = self.optional_device(Cameras)
        return self.device(Camera) if cameras is None or not cameras.all else cameras.all[0]

    def poses(self) -> Callable[[Frame], Float64]:
        """Return the function that gives T_base_camera of a frame, shape (4, 4)."""
        arm = self.optional_device(Arm)
        robot = None if arm is None else RobotModel.load(arm.description)

        def pose(frame: Frame) -> Float64:
            if frame.q is None:
                return frame.T_mount_camera
            if robot is None:
                raise self.failure(
                    "NO_FRAME", "the frame was taken from an arm, and the cell has no arm"
                )
            T_base_camera: Float64 = robot.fk(frame.q) @ frame.T_mount_camera
            return T_base_camera

        return pose

    def require_frames(self, watch: BeltWatch) -> None:
        """Fail when the camera has stopped, while nothing is followed."""
        with suppress(FrameUnreadable):
            watch.note_frame(self.eye(), self.clock.now())
        if problem := watch.problem(self.clock.now()):
            raise self.failure("STALE_FRAME", problem)

    def look(
        self, watch: BeltWatch, search: bool, meeting: tuple[float, Float64] | None = None
    ) -> None:
        """Keep the tracks up, in each tick, and show them; fails when camera or encoder do not.

        `meeting` is when [s] and where, shape (3,) [m], the hand will be around its fruit, for the operator.
        """
        try:
            watch.step(self, self.eye(), self.device(Conveyor), self.poses(), search)
        except (FrameUnreadable, DetectError) as error:
            raise self.failure("NO_FRAME", f"the camera's frame cannot be used: {error}") from error
        now = self.clock.now()
        if now - watch.shown_at >= SHOWN_EVERY:
            watch.shown_at = now
            self.publish("belt", belt_scene(watch, now, meeting))
            self.publish("fruit", belt_table(watch, now))
        if watch.tracks.encoder and (problem := watch.travel.problem(now, FASTEST)):
            raise self.failure("ENCODER_FAULT", problem)
        if problem := watch.problem(now):
            raise self.failure("STALE_FRAME", problem)
