"""The gripper's driver under random commands, faults and passing time, against the emulated gripper's truth.

In every case a stopped gripper does not move. A lost or stopped one stays so until it is acknowledged, moving fingers
never count as settled, and when the faults are over it works again.
"""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import Phase, settings, strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from pomona.devices.wsg.codec import SystemState
from pomona.devices.wsg.driver import WsgGripper
from pomona.devices.wsg.handshake import WsgOptions
from pomona.drivers.base.parallel_gripper import RECONNECT
from pomona.drivers.errors import DeviceError, DeviceLost
from pomona.drivers.gripper_supervisor import GripperMotion
from pomona.drivers.interfaces import MotionState
from tests.drivers.devices.wsg.test_driver import OFFSET, Wire

OBEYED = 0.15
"""A stop is sent, answered and seen within this time [s], when the wire is there."""
DISOBEYED = 1.0
"""Fingers that run away are found, stopped, found to go on, and stopped by force within this time [s]."""
SEEN = 0.05
"""Delay after which the driver knows the fingers' motion [s]."""


FAULTS = ("silent", "cut", "busy", "hot", "current", "fast stop", "obstacle", "opens", "closes")


class GripperMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.wire = Wire()
        self.clock = self.wire.clock
        self.gripper = WsgGripper(self.wire.open, self.clock, WsgOptions(finger_offset=OFFSET))
        self.gripper.connect()
        self.motions: list[GripperMotion] = []
        self.moving_since: float | None = None
        self.wire_since = self.clock.now()  # since when the wire has been whole
        self.streamed_at = self.closed_at = -1.0
        self.stopped_at: float | None = None  # a safe stop that nobody has acknowledged
        self.lost = False
        self.ran_away_at = -1.0
        self.serve(0.3)

    # ---------------------------------------------------------------------------------------------- time

    def serve(self, seconds: float) -> None:
        end = self.clock.now() + seconds
        while self.clock.now() < end:
            before = self.clock.now()
            self.gripper.step()
            if self.clock.now() == before:
                self.clock.advance(0.001)
            if self.wire.device._peer is None or self.wire.device.silent or self.wire.cut:
                self.wire.device.advance(
                    self.clock.now()
                )  # it lives on without anybody who listens
                self.wire_since = self.clock.now()
            self.look()

    def look(self) -> None:
        now, speed = self.clock.now(), self.wire.fingers.state().speed
        if speed == 0.0:
            self.moving_since = None
        elif self.moving_since is None:
            self.moving_since = now
        self.lost = self.lost or isinstance(self.gripper._problem, DeviceLost)
        moved_for = 0.0 if self.moving_since is None else now - self.moving_since
        whole = now - self.wire_since
        allowed = DISOBEYED if now - self.ran_away_at < 2.0 * DISOBEYED else OBEYED
        if self.stopped_at is not None and min(now - self.stopped_at, whole) > allowed:
            assert speed <= 0.0, "it opens although it was stopped"
            assert speed == 0.0 or now - self.closed_at < 0.3, "it moves although it was stopped"
        if self.lost and min(whole, moved_for) > RECONNECT + allowed:
            raise AssertionError("it moves although it was lost and nobody has acknowledged that")
        if self.gripper.settled() and now - self.streamed_at > 0.3 and min(whole, moved_for) > SEEN:
            raise AssertionError("it is said to have settled, and moves")

    # ------------------------------------------------------------------------------------------ commands

    @rule(seconds=st.sampled_from([0.002, 0.02, 0.1, 0.4]))
    def pass_time(self, seconds: float) -> None:
        self.serve(seconds)

    @rule(width=st.sampled_from([0.036, 0.060, 0.102]), speed=st.sampled_from([0.01, 0.03, 0.1]))
    def move(self, width: float, speed: float) -> None:
        was_free = self.stopped_at is None and not self.lost
        with contextlib.suppress(DeviceError):
            self.motions.append(self.gripper.move(width, speed))
            assert was_free, "a move was started although it was stopped or lost"
            self.serve(0.05)

    @rule(speed=st.sampled_from([-0.03, -0.005, 0.0, 0.01, 0.05]), times=st.integers(1, 5))
    def stream(self, speed: float, times: int) -> None:
        for _ in range(times):
            with contextlib.suppress(DeviceError):
                self.gripper.set_speed(speed)
                assert not self.lost, "a speed was taken although it was lost"
                self.streamed_at = self.clock.now()
                if speed < 0.0:
                    self.closed_at = self.clock.now()
            self.serve(0.02)

    @precondition(lambda self: self.motions)
    @rule()
    def stop_motion(self) -> None:
        self.motions[-1].stop()

    @rule()
    def pause(self) -> None:
        self.gripper.pause()

    @rule()
    def resume(self) -> None:
        with contextlib.suppress(DeviceError):
            self.gripper.resume()

    @rule()
    def safe_stop(self) -> None:
        self.gripper.safe_stop("test")
        if self.stopped_at is None:
            self.stopped_at = self.clock.now()
        self.serve(OBEYED + 0.1)

    @rule()
    def acknowledge(self) -> None:
        with contextlib.suppress(DeviceError):
            self.gripper.acknowledge()
            self.stopped_at, self.lost = None, False

    # -------------------------------------------------------------------------------------------- faults

    @rule(kind=st.sampled_from(FAULTS))
    def something_breaks(self, kind: str) -> None:
        device = self.wire.device
        match kind:
            case "silent" | "busy":
                setattr(device, kind, True)
            case "cut" if not self.wire.cut:
                self.wire.cut = True
                if device._peer is not None:
                    device.disconnected(device._peer)
            case "hot" | "current":
                device.faults |= SystemState.TEMPERATURE if kind == "hot" else SystemState.CURRENT
            case "fast stop":
                device.fast_stop()
            case "obstacle":
                self.wire.fingers.obstacle = 0.030
            case "opens" | "closes":
                device.runaway = 0.03 if kind == "opens" else -0.03
                self.ran_away_at = self.clock.now()

    @rule(acknowledge=st.sampled_from([True, True, True, False]))
    def mend(self, acknowledge: bool) -> None:
        device = self.wire.device
        device.silent = self.wire.cut = device.busy = False
        device.faults, device.runaway, self.wire.fingers.obstacle = SystemState(0), 0.0, None
        self.serve(2.0 * RECONNECT)
        if acknowledge:
            self.acknowledge()
            self.serve(0.1)

    @rule(
        width=st.sampled_from([0.036, 0.102]),
        by=st.sampled_from(("safe stop", "pause", "stream", *FAULTS)),
    )
    def interrupt_a_move(self, width: float, by: str) -> None:
        """Interrupt a move in progress, the most important case."""
        self.mend(acknowledge=True)
        self.move(width, 0.03)
        if by == "safe stop":
            self.safe_stop()
        elif by == "pause":
            self.pause()
        elif by == "stream":
            self.stream(-0.005, 2)
        else:
            self.something_breaks(by)
        self.serve(OBEYED + 0.1)

    @rule(how=st.sampled_from(("silent", "cut")), speed=st.sampled_from([-0.03, 0.03]))
    def come_back_from_a_loss(self, how: str, speed: float) -> None:
        """Force control that never noticed goes on streaming."""
        self.mend(acknowledge=True)
        self.stream(speed, 3)
        self.something_breaks(how)
        self.serve(0.3)
        self.mend(acknowledge=False)
        self.stream(speed, 3)

    # ------------------------------------------------------------------------------------- what always holds

    @invariant()
    def what_is_wrong_is_told(self) -> None:
        wrong = self.gripper.link() != "ok"
        with pytest.raises(DeviceError) if wrong else contextlib.nullcontext():
            self.gripper.check()

    @invariant()
    def motions_settle_only_when_they_have_ended(self) -> None:
        assert all(motion.ended for motion in self.motions if motion.settled)

    def teardown(self) -> None:
        """When everything is well again, so is the driver."""
        self.mend(acknowledge=False)
        self.serve(2.0)
        self.gripper.safe_stop("end")
        self.serve(0.5)
        assert all(motion.settled for motion in self.motions)
        assert self.gripper.settled()
        self.gripper.acknowledge()
        self.stopped_at, self.lost = None, False
        self.serve(0.5)
        self.gripper.check()
        motion = self.gripper.move(0.050, 0.2)
        self.serve(1.0)
        assert motion.state is MotionState.DONE
        self.gripper.check()


GripperMachine.TestCase.settings = settings(
    max_examples=15,
    stateful_step_count=20,
    phases=(Phase.generate,),  # shrinking costs minutes
)
TestGripper = GripperMachine.TestCase
