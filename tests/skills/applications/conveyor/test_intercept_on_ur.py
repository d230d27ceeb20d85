"""The skill Intercept on a Universal Robots arm: its driver, its bytes and the emulated controller, on virtual time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.conveyor.intercept import Intercept
from pomona.devices.emulators.motoman import FreeJoints
from pomona.devices.emulators.pipes import Pipe
from pomona.devices.emulators.virtual_time import VirtualTime
from pomona.devices.laboratory_emulators.universal_robots import UrEmulator
from pomona.devices.universal_robots.driver import UrArm
from pomona.devices.universal_robots.options import UrFile
from pomona.drivers import Arm, DeviceFault, StreamedArm, read_limits
from pomona.executive import SkillEnd, drive
from pomona.skills.motion import RobotModel, inverse_kinematics
from pomona.tools.mock.arm import ROBOT
from pomona.tools.mock.hand import PERIOD
from tests.skills.applications.conveyor.belt_rig import MODEL, BeltRig, workspace

UR5E = ROBOT.with_name("ur5e_wsg32.xml")
NEAR = np.array([-2.2, -2.0, 1.9, -1.6, -1.4, -2.2])
"""Joints of the shipped UR5e before the table [rad]."""


class UrRig(BeltRig):
    """The rig of the belt with a UR5e; the hand begins where that of the shipped arm does."""

    def __init__(self) -> None:
        super().__init__()
        self.ur = RobotModel.load(UR5E)
        limits = read_limits(UR5E)
        q = inverse_kinematics(self.ur, MODEL.tcp(workspace().poses["watch"]), near=NEAR)[0]
        self.joints = FreeJoints(q)
        self.controller = UrEmulator(self.joints, limits.velocity)
        self.clock.each_step.append(lambda: self.controller.advance(self.clock.now()))
        self.time = VirtualTime(self.clock, PERIOD)
        pipes = {
            name: Pipe(getattr(self.controller, name), self.time)
            for name in ("rtde", "script", "dashboard")
        }
        options = UrFile(address="ur", model="ur5e", robot=UR5E)
        self.robot = UrArm(lambda name: pipes[name].open(), self.time, limits, options)
        self.robot.connect()
        self.robot.start()

    def hand(self) -> np.ndarray:
        return self.ur.tcp(self.joints.measured()[0])

    def intercept(self, skill: Intercept | None = None, **how: Any) -> SkillEnd:
        devices = {**self.devices, Arm: self.robot, StreamedArm: self.robot}
        inputs = {"target": self.target, "tracks": self.watch}
        return drive(skill or Intercept(), inputs, devices, clock=self.time, **how)


@pytest.fixture
def rig() -> Iterator[UrRig]:
    rig = UrRig()
    yield rig
    rig.robot.close()


@pytest.mark.slow
def test_a_fruit_is_gripped_on_the_belt_and_lifted(rig: UrRig) -> None:
    off: list[np.ndarray] = []
    skill = Intercept()

    def tick(_: int) -> None:
        if "closing" in skill.feedback_message:
            along, aside = rig.watch.fruit[0]
            on_belt = np.array([along + rig.conveyor.travel(rig.clock.now()), -0.36 + aside])
            off.append(rig.hand()[:2, 3] - on_belt)

    end = rig.intercept(skill, each_tick=tick)
    assert end.status is Status.SUCCESS, end.reason
    assert len(off) > 10
    assert (
        np.abs(np.array(off)).max() < 2e-3
    )  # as the fingers begin to close, while the hand still sinks
    assert np.abs(np.array(off[5:])).max() < 1e-3
    assert rig.height == pytest.approx(0.15, abs=5e-3)
    assert rig.robot.settled()


@pytest.mark.slow
def test_a_protective_stop_above_the_belt_ends_the_pick_and_the_arm_stays_where_it_stopped(
    rig: UrRig,
) -> None:
    skill = Intercept()

    def tick(_: int) -> None:
        if "reaching, 0.4 s" in skill.feedback_message and rig.controller.fault is None:
            rig.controller.inject_fault("protective")

    end = rig.intercept(skill, each_tick=tick)
    assert end.status is Status.FAILURE
    with pytest.raises(DeviceFault, match="protective stop"):
        rig.robot.check()
    before = rig.joints.measured()[0]
    rig.time.advance(1.0)
    assert np.array_equal(before, rig.joints.measured()[0])
