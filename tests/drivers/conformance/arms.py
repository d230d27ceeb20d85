"""A bench of every arm that ships, and of the one that `pomona new arm` writes."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from pomona.devices.emulators.motoman import MotomanEmulator
from pomona.devices.emulators.pipes import Pipe
from pomona.devices.laboratory_emulators.universal_robots import UrEmulator
from pomona.devices.laboratory_emulators.xarm import XArmEmulator
from pomona.devices.motoman.driver import MotomanArm
from pomona.devices.motoman.options import MotomanFile
from pomona.devices.universal_robots.driver import UrArm
from pomona.devices.universal_robots.options import UrFile
from pomona.devices.xarm.driver import XArm
from pomona.devices.xarm.options import XArmFile
from pomona.drivers import ArmLimits, FaultSwitch
from pomona.drivers.conformance import ArmBench, Body, Wire
from pomona.tools.mock import MockArm, MockClock
from tests.drivers.conformance.grippers import Topics, of_template, timed
from tests.drivers.conformance.simulated import simulated

ROBOT = Path("robot.xml")
BEFORE = ("other_model", "old", "local", "owned", "by_hand")
"""Harms of a controller before a connection."""
OTHERS = ("replaced", "moved")
"""Another program: a claim of its own."""
OF_JOINTS = ("stuck", "wild", "jump")
"""A body holds joints, and lies for them."""


def limits(dof: int, reach: float = 6.0) -> ArmLimits:
    full = np.ones(dof)
    return ArmLimits(-reach * full, reach * full, 3.14 * full, 10.0 * full, 200.0 * full)


class Emulated:
    """An emulated controller on a body, and the wires to its ports."""

    def __init__(self, start: Any) -> None:
        self.clock, self.time = timed()
        self.body = Body(self.clock, np.array(start))
        self.pipes: dict[str, Pipe] = {}
        self.wires: dict[str, Wire] = {}

    def serve(self, controller: Any, *ports: str) -> None:
        """Let the controller work, report what the body says, and be found at these ports."""
        truth = controller.measured
        body = self.body

        def measured() -> Any:
            q, qd = truth()
            return body.says(q), qd

        controller.measured = measured
        self.clock.each_step += [controller.advance, body.advance]
        controller.advance(self.clock.now())
        for name in ports:
            self.pipes[name] = Pipe(getattr(controller, name), self.time)
            self.wires[name] = Wire(self.pipes[name].open)

    def open(self, name: str) -> Any:
        """Connect to a port."""
        return self.wires[name].open()

    def bench(
        self,
        arm: Any,
        controller: Any,
        quick: str,
        late: tuple[str, ...],
        paced: bool = True,
        **more: Any,
    ) -> ArmBench:
        """Return the bench of a connected arm."""

        def delay(name: str, seconds: float) -> None:
            self.pipes[name].latency = seconds

        def pace(rate: float) -> None:
            controller.clock.rate = rate

        switches: Mapping[str, FaultSwitch] = {
            "": controller,
            **{name: self.wires[name] for name in {quick, *late}},
        }
        return ArmBench(
            arm,
            self.time,
            self.body,
            switches=switches,
            pace=pace if paced else None,
            late={name: partial(delay, name) for name in late},
            **more,
        )


def motoman() -> ArmBench:
    """A Yaskawa arm."""
    at = Emulated([0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7])
    of = limits(7)
    controller = MotomanEmulator(at.body, of.velocity)
    at.serve(controller, "state", "motion")
    said = MotomanFile(address=("robot", 50240), robot=ROBOT, controller="dx200")
    arm = MotomanArm(at.open, at.time, of, said)
    arm.connect()
    return at.bench(arm, controller, "motion", ("state", "motion"), without=(*BEFORE, *OF_JOINTS))


def universal_robots() -> ArmBench:
    """A Universal Robots arm."""
    at = Emulated([0.1, -1.5, 1.4, -1.3, -1.5, 0.7])
    of = limits(6)
    controller = UrEmulator(at.body, of.velocity)
    at.serve(controller, "rtde", "script", "dashboard")
    said = UrFile(address="ur", model="ur5e", robot=ROBOT)
    arm = UrArm(at.open, at.time, of, said)
    arm.connect()
    return at.bench(
        arm,
        controller,
        "rtde",
        ("rtde",),
        foreign=lambda: controller.inject_fault("replaced"),
        without=(*BEFORE, *OTHERS, *OF_JOINTS),
    )


def xarm() -> ArmBench:
    """A UFACTORY arm."""
    at = Emulated([0.1, -0.6, -0.7, 0.3, 1.2, 0.7])
    of = limits(6)
    controller = XArmEmulator(at.body, of.velocity)
    at.serve(controller, "command", "report")
    arm = XArm(at.open, at.time, of, XArmFile(address="xarm", model="xarm6", robot=ROBOT))
    arm.connect()

    def foreign() -> None:
        controller.answer(29, struct.pack("<7f", *(at.body.q + 0.05), 0.0) + bytes(12))

    return at.bench(
        arm,
        controller,
        "command",
        ("report",),
        False,  # in servo mode the time is that of the set-points
        foreign=foreign,
        without=(*BEFORE, *OTHERS, *OF_JOINTS),
    )


class Ros2Bench(ArmBench):
    """Time passes where the controller moves, 5 ms at a time."""

    setting: Any

    def stand_still(self, seconds: float) -> None:
        for _ in range(max(round(seconds / 0.005), 1)):
            self.setting.controller.advance(0.005)
            self.body.advance()

    def step(self) -> None:
        self.stand_still(0.005)
        self.device.step()


def ros2() -> ArmBench:
    """An arm behind ros2_control."""
    from tests.drivers.devices.ros2 import test_ros2_arm as of

    setting = of.Setting()
    controller = setting.controller
    body = Body(setting.clock, of.START, lambda: controller.q)
    controller.says = body.told
    wire = Topics(controller)

    def step(host: float, of_controller: float) -> None:
        setting.host_step += host
        controller.clock_step += of_controller

    def foreign() -> None:
        there = body.q + 0.05
        point = {"positions": there, "velocities": 0.0 * there, "time_from_start": of.stamped(0.2)}
        header = {"stamp": of.stamped(0.0), "frame_id": ""}
        fields = {"header": header, "joint_names": list(of.JOINTS), "points": [point]}
        message = of.coder(of.TRAJECTORY).coded(fields)
        controller.publish(setting.arm.options.commands, of.TRAJECTORY, message, 0)

    bench = Ros2Bench(
        setting.arm,
        setting.clock,
        body,
        switches={"": wire},
        rough=6.0,
        foreign=foreign,
        step_clocks=step,
    )
    bench.setting = setting
    return bench


class InStep(ArmBench):
    """An arm that its clock moves."""

    def step(self) -> None:
        self.clock.advance(0.002)
        self.problem()


def mock() -> ArmBench:
    """The mock arm."""
    clock = MockClock()
    arm = MockArm(clock)
    body = Body(clock, arm.q, lambda: arm.q)
    arm.says = body.told
    clock.each_step.insert(0, body.advance)
    return InStep(arm, clock, body)


class SimBody(Body):
    """The simulated joints, as their world has them."""

    def __init__(self, cell: Any) -> None:
        self._arm = cell.devices["arm"]
        self._world = self._arm._world
        super().__init__(cell.clock, self._arm._measure().q)
        said = self._arm._said
        self._shifted = self.pushed

        def lied() -> Any:
            q, qd = said()
            return self.says(q), qd

        self._arm._said = lied
        self._world.after_step.insert(0, self.advance)

    def advance(self, _now: float = 0.0) -> None:
        """Hold or push the joints, and note where they are."""
        state = self._world.state
        if self.is_held:
            state.qpos[self._arm._qpos] = self.q
            state.qvel[self._arm._qvel] = 0.0
        elif self.pushed is not self._shifted:
            state.qpos[self._arm._qpos] += self.pushed - self._shifted
            state.ctrl[self._arm._actuators] += self.pushed - self._shifted
            self._shifted = self.pushed
        self.q = state.qpos[self._arm._qpos].copy()
        self.track.append((self._clock.now(), self.q))


def sim() -> ArmBench:
    """The simulated arm."""
    cell = simulated("arm")
    arm: Any = cell.devices["arm"]
    way = np.array([0.8, 0.3, -0.2, 0.3, 0.4, 0.5, -0.9])
    return InStep(
        arm, cell.clock, SimBody(cell), way=way, switches={"": arm}, without=(*OF_JOINTS, "stall")
    )


def reacher() -> ArmBench:
    """The driver that `pomona new arm reacher` writes, as its own test has it."""
    return cast("ArmBench", of_template("test_reacher.py"))


BENCHES: dict[str, Callable[[], ArmBench]] = {
    "mock": mock,
    "sim": sim,
    "motoman": motoman,
    "universal_robots": universal_robots,
    "xarm": xarm,
    "ros2": ros2,
    "reacher": reacher,
}
