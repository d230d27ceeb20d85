"""The skill Policy on arms that people have: their drivers, bytes and emulated controllers, on virtual time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.policy.policy import Policy
from pomona.applications.policy.policy_network import PolicyNetwork, write_policy
from pomona.devices.emulators.motoman import FreeJoints
from pomona.devices.emulators.pipes import Pipe
from pomona.devices.emulators.virtual_time import VirtualTime
from pomona.devices.laboratory_emulators.universal_robots import UrEmulator
from pomona.devices.laboratory_emulators.xarm import XArmEmulator
from pomona.devices.universal_robots.driver import UrArm
from pomona.devices.universal_robots.options import UrFile
from pomona.devices.xarm.driver import XArm
from pomona.devices.xarm.options import XArmFile
from pomona.drivers import Arm, ArmLimits, DeviceFault, StreamedArm
from pomona.drivers.path_arm import PathArm
from pomona.executive import SkillEnd, drive
from pomona.tools.mock import MockClock
from pomona.tools.mock.hand import PERIOD

FULL = np.ones(6)
LIMITS = ArmLimits(-6.0 * FULL, 6.0 * FULL, 3.14 * FULL, 10.0 * FULL, 200.0 * FULL)
START = np.array([-1.3, -1.6, 1.2, -0.2, 0.1, -1.2])
END = START + np.array([0.4, -0.2, 0.1, 0.3, -0.2, 0.5])


class Cell:
    """An emulated controller with its driver; the policy goes a third of the way to `END` at each decision."""

    def __init__(self, seller: str, folder: Path) -> None:
        self.clock = MockClock()
        self.joints = FreeJoints(START)
        self.said: list[np.ndarray] = []
        self.controller: UrEmulator | XArmEmulator
        if seller == "ur5e":
            self.controller, ports = (
                UrEmulator(self.joints, LIMITS.velocity),
                ("rtde", "script", "dashboard"),
            )
        else:
            self.controller, ports = (
                XArmEmulator(self.joints, LIMITS.velocity, 6),
                ("command", "report"),
            )
        self.clock.each_step.append(self._advance)
        self.time = VirtualTime(self.clock, PERIOD)
        pipes = {name: Pipe(getattr(self.controller, name), self.time) for name in ports}
        self.arm: PathArm
        if seller == "ur5e":
            options = UrFile(address="ur", model=seller, robot=Path("robot.xml"))
            self.arm = UrArm(lambda name: pipes[name].open(), self.time, LIMITS, options)
        else:
            other = XArmFile(address="xarm", model=seller, robot=Path("robot.xml"))
            self.arm = XArm(lambda name: pipes[name].open(), self.time, LIMITS, other)
        self.file = folder / "policy.npz"
        W = np.zeros((9, 6))
        W[:6] = -np.eye(6) / 3.0
        scales = (np.zeros(9), np.ones(9), np.zeros(6), np.ones(6))
        names = tuple(f"joint_{k + 1}" for k in range(6))
        write_policy(self.file, PolicyNetwork(names, 10.0, *scales, layers=((W, END / 3.0),)))

    def _advance(self) -> None:
        self.controller.advance(self.clock.now())
        self.said.append(self.joints.measured()[0].copy())

    def drive(self, each_tick: Callable[[int], None] | None = None, **how: Any) -> SkillEnd:
        inputs = {"weights": str(self.file), "x": 0.1, "y": -0.4, "z": 0.1}
        devices = {Arm: self.arm, StreamedArm: self.arm}
        return drive(Policy(), inputs, devices, clock=self.time, each_tick=each_tick, **how)

    def speeds(self) -> np.ndarray:
        """Largest speed of each joint since the driver began [rad/s], over 40 ms: controllers interpolate in steps."""
        q = np.array(self.said)
        span = round(0.04 / PERIOD)
        return np.asarray(np.abs(q[span:] - q[:-span]).max(axis=0) / 0.04)


@pytest.fixture(params=["ur5e", "xarm6"])
def cell(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Cell]:
    cell = Cell(request.param, tmp_path)
    cell.arm.connect()
    cell.arm.start()
    yield cell
    cell.arm.close()


def test_it_goes_where_the_policy_wants_within_the_limits(cell: Cell) -> None:
    end = cell.drive()
    assert end.status is Status.SUCCESS, end.reason
    np.testing.assert_allclose(cell.joints.measured()[0], END, atol=np.radians(1.6))
    assert (cell.speeds() <= 1.01 * LIMITS.velocity).all()
    assert cell.speeds().max() > 0.1
    assert cell.arm.settled()


def test_an_interrupted_policy_leaves_the_arm_at_rest(cell: Cell) -> None:
    cell.drive(interrupt_after=40)
    for _ in range(200):
        cell.time.advance(0.01)
    on_the_way = cell.joints.measured()[0]
    assert np.abs(on_the_way - START).max() > 0.02
    assert np.abs(on_the_way - END).max() > 0.02
    assert cell.arm.settled()
    cell.time.advance(1.0)
    np.testing.assert_array_equal(cell.joints.measured()[0], on_the_way)


def test_a_fault_of_the_controller_ends_it_and_nothing_resumes(cell: Cell) -> None:
    fault = "protective" if isinstance(cell.controller, UrEmulator) else "collision"

    def tick(_: int) -> None:
        if np.abs(cell.joints.measured()[0] - START).max() > 0.05 and cell.controller.fault is None:
            cell.controller.inject_fault(fault)

    end = cell.drive(tick)
    assert cell.controller.fault == fault
    assert end.status is Status.FAILURE
    with pytest.raises(DeviceFault):
        cell.arm.check()
    before = cell.joints.measured()[0]
    cell.time.advance(1.0)
    np.testing.assert_array_equal(cell.joints.measured()[0], before)
