"""Many threads call an arm and a gripper of ROS 2 at once; only one of them may write to the wire."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("zenoh", reason="the extra ros2 is not installed")

from pomona.devices.ros2.arm import Ros2Arm, Ros2ArmFile
from pomona.devices.ros2.gripper import Ros2Gripper, Ros2GripperOptions
from pomona.drivers.interfaces import GripperLimits, Motion, MotionState
from pomona.drivers.motion_supervisor import Supervision
from pomona.executive.clock import SystemClock
from tests.drivers.devices.ros2.test_ros2_arm import LIMITS, WALL, Controller, swing
from tests.drivers.devices.ros2.test_ros2_gripper import Fingers
from tests.drivers.one_thread import PATIENCE, OneThread, hammer

FAR = np.array([0.05, -0.04, 0.03])


class LiveController(Controller, OneThread):
    """Follows its commands in real time, in a thread of its own as the wire has one."""

    def __init__(self) -> None:
        OneThread.__init__(self)
        Controller.__init__(self, SystemClock())  # type: ignore[arg-type]

    def publish(self, topic: str, kind: str, coded: Any, stamp: int) -> None:
        self.enter()
        super().publish(topic, kind, coded, stamp)

    def go_on(self) -> None:
        if self._plan is not None:
            self._sample(*self._plan)
        self.take(self.state())


class LiveFingers(Fingers, OneThread):
    """The same of two fingers."""

    def __init__(self) -> None:
        OneThread.__init__(self)
        Fingers.__init__(self, Standing())  # type: ignore[arg-type]

    def publish(self, topic: str, kind: str, coded: Any, stamp: int) -> None:
        self.enter()
        super().publish(topic, kind, coded, stamp)

    def go_on(self) -> None:
        self.advance(0.005)


class Standing(SystemClock):
    """Time passes by itself."""

    def advance(self, duration: float) -> None:
        """Do not wait."""


@contextmanager
def going_on(device: LiveController | LiveFingers) -> Iterator[None]:
    over = threading.Event()

    def live() -> None:
        while not over.wait(0.004):
            device.go_on()

    thread = threading.Thread(target=live)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def ends_well(begin: Callable[[], Motion], again: Callable[[], None]) -> bool:
    """Whether a motion comes to its end; where this computer was held up meanwhile it is begun anew."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        again()
        motion = begin()
        while not motion.settled and time.monotonic() < until:
            time.sleep(0.002)
        if motion.state is MotionState.DONE:
            return True
    return False


def test_calls_of_many_threads_break_nothing_and_the_arm_moves_afterwards() -> None:
    wire = LiveController()
    # A loaded machine may hold threads up for long; silence and lag are not what this is about.
    slow = Supervision(lag=1.0, following_error=0.5, margin=30.0, stall=5.0)
    options = Ros2ArmFile(
        robot=Path("none.xml"),
        joints=("shoulder", "elbow", "wrist"),
        lead=0.5,
        silence=PATIENCE,
        supervision=slow,
    )
    arm = Ros2Arm(
        wire,
        SystemClock(),
        LIMITS,
        options,
        host_time=lambda: WALL + wire.clock.now(),
    )
    with going_on(wire):
        arm.connect()
        arm.start()

        def follow() -> Motion:
            return arm.follow(swing(arm.state().q, FAR if wire.q[0] < 0.2 else -FAR, 0.3))

        wrong = hammer(
            {
                "follow": lambda rng: follow(),
                "follow and stop": lambda rng: follow().stop(),
                "look": lambda rng: (arm.state(), arm.link(), arm.last_seen(), arm.settled()),
                "check": lambda rng: arm.check(),
                "pause": lambda rng: arm.pause(),
                "resume": lambda rng: arm.resume(),
                "safe stop": lambda rng: arm.safe_stop("stress"),
                "acknowledge": lambda rng: arm.acknowledge(),
            },
            rounds=40,
        )
        assert wrong == []
        arm.safe_stop("the end of the stress")

        def again() -> None:
            until = time.monotonic() + PATIENCE
            while not arm.settled() and time.monotonic() < until:
                time.sleep(0.002)
            arm.acknowledge()

        assert ends_well(follow, again)
        arm.close()
    assert len(wire.used_by) == 1
    assert threading.get_ident() not in wire.used_by


def test_calls_of_many_threads_break_nothing_and_the_fingers_move_afterwards() -> None:
    wire = LiveFingers()
    limits, options = (
        GripperLimits(0.01, 0.08, 0.1, 20.0),
        Ros2GripperOptions("finger", 2.0, 0.002, silence=PATIENCE),
    )
    gripper = Ros2Gripper(wire, SystemClock(), limits, options, host_time=lambda: wire.wall)
    with going_on(wire):
        gripper.connect()
        gripper.start()
        wrong = hammer(
            {
                "move": lambda rng: gripper.move(rng.uniform(0.02, 0.07), 0.1),
                "move and stop": lambda rng: gripper.move(rng.uniform(0.02, 0.07), 0.1).stop(),
                "speed": lambda rng: gripper.set_speed(rng.uniform(-0.05, 0.05)),
                "look": lambda rng: (
                    gripper.state(),
                    gripper.link(),
                    gripper.last_seen(),
                    gripper.settled(),
                ),
                "check": lambda rng: gripper.check(),
                "pause": lambda rng: gripper.pause(),
                "resume": lambda rng: gripper.resume(),
                "safe stop": lambda rng: gripper.safe_stop("stress"),
                "acknowledge": lambda rng: gripper.acknowledge(),
            },
            rounds=40,
        )
        assert wrong == []
        assert ends_well(
            lambda: gripper.move(0.04 if gripper.state().width > 0.05 else 0.06, 0.1),
            gripper.acknowledge,
        )
        gripper.close()
    assert len(wire.used_by) == 1
    assert threading.get_ident() not in wire.used_by
