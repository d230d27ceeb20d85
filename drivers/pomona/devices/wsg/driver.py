"""The WSG gripper as a `Gripper`, to be called from any thread; its owner is in `pomona.devices.wsg.jaws`."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from pomona.devices.wsg.codec import Command, Plain, SystemState
from pomona.devices.wsg.handshake import WsgIdentity, WsgOptions
from pomona.devices.wsg.jaws import FAULTS, Jaws, words
from pomona.drivers import (
    Device,
    DeviceFault,
    DeviceLost,
    Gripper,
    GripperLimits,
    GripperMotion,
    GripperState,
    Link,
    MotionRefused,
    MotionState,
    Owner,
    require_move,
)
from pomona.executive import Clock


class WsgGripper(Device):
    """A WSG gripper on any link."""

    interfaces = (Gripper,)
    outlives = True

    def __init__(
        self, open_link: Callable[[], Link], clock: Clock, options: WsgOptions | None = None, name: str = "gripper"
    ) -> None:
        super().__init__(name)
        self._jaws = Jaws(self, open_link, clock, options or WsgOptions())
        self._clock = clock
        self._owner = Owner(name, self._jaws.step, self._jaws.lose, clock)
        self._asked: GripperMotion | None = None  # the last requested one, before the owner gets it

    @property
    def identity(self) -> WsgIdentity | None:
        """Identity that the gripper reported in the last handshake."""
        return self._jaws.identity

    def connect(self) -> None:
        """Open the wire and shake hands. Raises DeviceError: no such gripper there, or it refuses the handshake."""
        self._jaws.session = self._jaws.open()
        self._jaws.problem = None

    def start(self) -> None:
        """Serve the wire in a thread of its own from now on."""
        self._owner.start()

    def step(self) -> None:
        """Serve the wire for a few milliseconds, where no thread does."""
        self._jaws.step()

    # --------------------------------------------------------------------------------------- the interface

    @property
    def limits(self) -> GripperLimits:
        return self._jaws.limits

    def state(self) -> GripperState:
        """See the Protocol. Raises DeviceLost: there is no fresh state."""
        self._need_link()
        return self._jaws.state

    def move(self, width: float, speed: float) -> GripperMotion:
        limits = self._jaws.limits
        refusal = self._jaws.unready()
        if refusal:
            raise MotionRefused(self.name, refusal)
        require_move(self.name, limits, width, speed)
        motion = GripperMotion(width, min(speed, limits.speed_max), self._jaws.state.width, self._leave_stop)
        self._asked = motion
        self._owner.post(lambda: self._jaws.begin(motion))
        return motion

    def _leave_stop(self, motion: GripperMotion) -> None:
        self._owner.post(lambda: self._jaws.stop_motion(motion))

    def set_speed(self, speed: float) -> None:
        """See the Protocol; while latched the fingers may close and hold but not open.

        Raises:
            DeviceLost: the gripper is lost, or an earlier loss is not acknowledged.
            DeviceFault: it has no finger script for streamed speeds, or is in fast stop.
        """
        self._need_link()
        jaws = self._jaws
        if jaws.lost_since_ack:
            raise DeviceLost(self.name, f"was lost; acknowledge the loss before it moves: {words(jaws.problem)}")
        if jaws.identity is None or not jaws.identity.has_script:
            raise DeviceFault(
                self.name, "has no finger script for streamed speeds: load drivers/pomona/devices/wsg/velocity.lua"
            )
        if jaws.bits & SystemState.FAST_STOP:
            raise DeviceFault(self.name, FAULTS[SystemState.FAST_STOP])
        self._owner.post(lambda: jaws.stream(speed))

    def tare(self) -> None:
        """Tare the gripper's own force sensor; nothing must touch the fingers."""
        self._need_link()
        self._owner.post(lambda: self._jaws.send(Plain(Command.TARE), Command.TARE))

    def _need_link(self) -> None:
        if self._jaws.session is None:
            raise DeviceLost(self.name, words(self._jaws.problem))

    # ------------------------------------------------------------------------------------------ the device

    def link(self) -> str:
        problem = self._jaws.problem
        return "ok" if problem is None else problem.message

    def check(self) -> None:
        problem = self._jaws.problem
        if problem is not None:
            raise problem
        self._owner.check()

    def safe_stop(self, reason: str) -> None:
        """Latch, and send a stop in any reported state; a gripper that does not obey it gets a fast stop."""
        if self._jaws.latched is None:
            self._jaws.latched = reason
        self._owner.post(lambda: self._jaws.stop_safely(reason))

    def acknowledge(self) -> None:
        """Release the latch, and a fast stop of the gripper. Raises DeviceLost: it is still lost."""
        if self._jaws.session is None:
            raise DeviceLost(self.name, f"is still lost: {words(self._jaws.problem)}")
        self._owner.ask(self._jaws.release)

    def pause(self) -> None:
        self._owner.post(self._jaws.pause)

    def resume(self) -> None:
        motion, refusal = self._asked, self._jaws.unready()
        if motion is not None and motion.state is MotionState.PAUSED and refusal:
            raise MotionRefused(self.name, refusal)
        self._owner.post(self._jaws.resume)

    def settled(self) -> bool:
        """Return True if the fingers were measured to rest, and a stop was obeyed.

        Streamed speeds do not count as motion: force control may go on for hours. For a lost gripper only the latest
        end of its last command is known.
        """
        if self._jaws.session is None:
            return self._clock.now() > self._jaws.supervisor.rest_by
        motion = self._asked
        ended = motion is None or motion.settled or motion.state is MotionState.PAUSED
        return ended and self._jaws.obeys()

    def close(self) -> None:
        """Stop the fingers at their place and close the session: a gripper that loses its client makes a fast stop."""
        self.safe_stop("closed")
        self._owner.close()
        session, self._jaws.session = self._jaws.session, None
        if session is not None:
            with contextlib.suppress(OSError):
                session.send(Plain(Command.DISCONNECT), Command.DISCONNECT)
            session.close()
        self._jaws.problem = DeviceLost(self.name, "is closed")
