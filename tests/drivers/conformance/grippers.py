"""A bench of every gripper that ships, and of the one that `pomona new gripper` writes."""

from __future__ import annotations

import math
import runpy
import sys
from collections.abc import Callable
from functools import partial
from typing import Any, cast

from pomona.devices.emulators.free_gripper import FreeGripper
from pomona.devices.emulators.pipes import Pipe
from pomona.devices.emulators.switches import gripper_switch
from pomona.devices.emulators.virtual_time import VirtualTime
from pomona.devices.emulators.wsg import WsgEmulator
from pomona.devices.laboratory_emulators.robotiq import RobotiqEmulator
from pomona.devices.robotiq.driver import RobotiqGripper
from pomona.devices.robotiq.options import MODELS, RobotiqFile
from pomona.devices.robotiq.session import RtuSession, UrcapSession
from pomona.devices.wsg.driver import WsgGripper
from pomona.devices.wsg.handshake import WsgOptions
from pomona.drivers import FaultSwitch, GripperLimits
from pomona.drivers.conformance import BenchClock, GripperBench, Wire
from pomona.tools.kit.pieces import TEMPLATES
from pomona.tools.mock import MockClock, MockGripper
from tests.drivers.conformance.simulated import simulated

STIFFNESS = 6000.0  # of an object, for one finger [N/m]


def timed() -> tuple[BenchClock, VirtualTime]:
    """Return a device's time, and the driver's."""
    clock = BenchClock()
    return clock, VirtualTime(clock, 2e-3)


def wsg(limit: float | None = 30.0, *, script: bool = True) -> GripperBench:
    """The WSG, with or without the finger script."""
    clock, time = timed()
    hand = FreeGripper(clock.now, stiffness=2e4)
    device = WsgEmulator(hand, has_script=script)
    clock.each_step.append(device.advance)
    wire = Wire(Pipe(device, time).open)
    offset = 0.035
    gripper = WsgGripper(wire.open, time, WsgOptions(finger_offset=offset, force_limit=limit))
    gripper.connect()
    switch = gripper_switch(device)
    return GripperBench(
        gripper,
        time,
        hand,
        wire,
        switch,
        offset=offset,
        foreign=lambda: hand.move(0.066, 0.03),
        without=("lost", "busy"),  # of the wire; of a move that has begun
    )


def robotiq(model: str, way: str, force: float | None = 60.0) -> GripperBench:
    """A Robotiq gripper on its serial line, or behind the URCap."""
    clock, time = timed()
    stroke = MODELS[model].stroke
    hand = FreeGripper(clock.now, stroke, GripperLimits(0.0, stroke, 1.0, 300.0), 2e4)
    device = RobotiqEmulator(hand, model)
    clock.each_step.append(device.advance)
    wire = Wire(Pipe(getattr(device, way), time).open, keeps=way == "urcap")
    session = RtuSession if way == "rtu" else UrcapSession
    said: dict[str, Any] = {"port": "/dev/ttyUSB0"} if way == "rtu" else {"urcap": ("robot", 63352)}
    gripper = RobotiqGripper(
        lambda: session(wire.open(), time), time, RobotiqFile(model=model, force=force, **said)
    )
    gripper.connect()
    return GripperBench(
        gripper,
        time,
        hand,
        wire,
        device,
        foreign=lambda: device.write(0, bytes([9, 0, 0, 5, 30, 0])),
        without=("silent", "noise", "stuck"),
    )


class Says(FaultSwitch):
    """What a joint reports instead of its position."""

    known_faults = ("nan", "odd", "frozen")

    def __init__(self, fingers: Any) -> None:
        super().__init__()
        self._fingers = fingers

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        now = self._fingers.q
        says = {"nan": lambda _q: math.nan, "odd": lambda q: q + 0.2, "frozen": lambda _q: now}
        self._fingers.says = says[kind]

    def clear_fault(self) -> None:
        super().clear_fault()
        self._fingers.says = lambda q: q


class Topics(FaultSwitch):
    """The topics of a ROS 2 gripper."""

    known_faults = ("mute", "dead", "deaf", "half")

    def __init__(self, fingers: Any) -> None:
        super().__init__()
        self._take, self._publish = fingers.take, fingers.publish
        fingers.take, fingers.publish = self.heard, self.told

    def heard(self, raw: bytes) -> None:
        """A state on its way to the driver."""
        if self.fault not in ("mute", "dead"):
            self._take(raw[: len(raw) // 2] if self.fault == "half" else raw)
        if self.fault == "half":
            self.clear_fault()

    def told(self, *said: Any) -> None:
        """A set-point on its way to the controller."""
        if self.fault not in ("dead", "deaf"):
            self._publish(*said)


class Ros2Hand:
    """The fingers behind ros2_control: a controller that is a spring, up to its largest force."""

    def __init__(self, setting: Any) -> None:
        self._fingers, self.obstacle = setting.fingers, 0.0
        self._most = setting.gripper.limits.force_max

    @property
    def width(self) -> float:
        return float(self._fingers.width)

    @width.setter
    def width(self, width: float) -> None:
        self._fingers.q = (width - 0.002) / 2.0

    @property
    def force(self) -> float:
        return STIFFNESS * max(self.obstacle - self.width, 0.0) / 2.0

    def press(self) -> None:
        """Give way to what is between: two equal springs, up to the largest force."""
        object_ = self.obstacle
        deepest = object_ - 2.0 * self._most / STIFFNESS
        pressed = (2.0 * self._fingers.set_point + 0.002 + object_) / 2.0
        self._fingers.fruit = max(deepest, min(pressed, object_)) if object_ else 0.0


class Ros2Bench(GripperBench):
    """Time passes where the fingers move."""

    def stand_still(self, seconds: float) -> None:
        for _ in range(max(round(seconds / 0.005), 1)):
            self.hand.press()  # type: ignore[attr-defined]
            self.fingers.advance(0.005)

    def step(self) -> None:
        self.stand_still(0.005)
        self.device.step()

    fingers: Any


def ros2() -> GripperBench:
    """The gripper behind ros2_control."""
    from tests.drivers.devices.ros2.test_ros2_gripper import Setting

    setting = Setting()
    fingers = setting.fingers
    hand = Ros2Hand(setting)

    def another() -> None:
        fingers.set_point += 0.004

    bench = Ros2Bench(
        setting.gripper, setting.clock, hand, Topics(fingers), Says(fingers), foreign=another
    )
    bench.fingers = fingers
    return bench


class InStep(GripperBench):
    """A gripper that its clock moves."""

    def step(self) -> None:
        self.clock.advance(0.002)
        self.problem()


class SimHand:
    """The simulated fingers, as their world has them; what is between them is a spring."""

    def __init__(self, world: Any, closed: float) -> None:
        self._state, self._closed, self.obstacle = world.state, closed, 0.0
        joints = [world.model.joint(f"finger_{side}") for side in ("left", "right")]
        self._across = abs(float(joints[0].axis[1]))
        self._places = [int(joint.qposadr[0]) for joint in joints]
        self._dofs = [int(joint.dofadr[0]) for joint in joints]
        world.before_step.append(self._press)

    @property
    def width(self) -> float:
        return self._closed + self._across * float(sum(self._state.qpos[self._places]))

    @width.setter
    def width(self, width: float) -> None:
        place = (width - self._closed) / (2.0 * self._across)
        self._state.qpos[self._places] = self._state.act[0] = place

    @property
    def force(self) -> float:
        return STIFFNESS * max(self.obstacle - self.width, 0.0) / 2.0

    def _press(self) -> None:
        self._state.qfrc_applied[self._dofs] = self.force * self._across


def sim() -> GripperBench:
    """The simulated gripper."""
    cell = simulated("gripper")
    gripper: Any = cell.devices["gripper"]
    hand = SimHand(cell.devices["world"], gripper.limits.width_min)
    return InStep(gripper, cell.clock, hand, gripper, without=("busy", "runaway", "sticks"))


class MockHand:
    """The mock fingers."""

    def __init__(self, gripper: MockGripper) -> None:
        self._gripper = gripper

    @property
    def width(self) -> float:
        return self._gripper.width

    @width.setter
    def width(self, width: float) -> None:
        self._gripper.width = width

    @property
    def obstacle(self) -> float:
        return self._gripper.blocked_at

    @obstacle.setter
    def obstacle(self, width: float) -> None:
        self._gripper.blocked_at = width

    @property
    def force(self) -> float:
        return self._gripper.force


def mock() -> GripperBench:
    """The mock gripper."""
    clock = MockClock()
    gripper = MockGripper(clock)
    return InStep(gripper, clock, MockHand(gripper))


def of_template(test: str) -> object:
    """Return the bench of a test of the package that `pomona new` writes."""
    sys.path.insert(0, str(TEMPLATES / "package"))
    try:
        return runpy.run_path(str(TEMPLATES / "package" / "tests" / test))["bench"]()
    finally:
        sys.path.pop(0)


def clamp() -> GripperBench:
    """The driver that `pomona new gripper clamp` writes, as its own test has it."""
    return cast("GripperBench", of_template("test_clamp.py"))


BENCHES: dict[str, Callable[[], GripperBench]] = {
    "wsg": wsg,
    "hand_e_rtu": partial(robotiq, "hand-e", "rtu"),
    "hand_e_urcap": partial(robotiq, "hand-e", "urcap"),
    "2f_85_rtu": partial(robotiq, "2f-85", "rtu"),
    "ros2": ros2,
    "sim": sim,
    "mock": mock,
    "clamp": clamp,
}
