"""Emulated twins of cells with a Hand-E: real drivers and bytes on virtual time, and faults."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pomona.drivers import Arm, Camera, Cell, DeviceError, Gripper, MotionState, load_cell
from pomona.skills.motion.planning.timing import time_polyline

pytestmark = pytest.mark.slow

CELLS = Path(__file__).resolve().parents[4] / "trees" / "cells"
ARMS = {"ur5e": "UrArm", "xarm6": "XArm"}


@pytest.fixture(params=ARMS)
def cell(request: pytest.FixtureRequest) -> Iterator[Cell]:
    opened = load_cell(
        CELLS / f"emulated_{request.param}_hand_e.yaml", seed=1, overrides={"distractors": "0"}
    )
    yield opened
    opened.close()


def run(cell: Cell, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
    end = cell.clock.now() + seconds
    while cell.clock.now() < end and not until():
        cell.clock.advance(0.002)


def test_every_device_answers_through_its_own_wire(cell: Cell) -> None:
    assert set(cell.links().values()) == {"ok"}
    arm, gripper = cell.device(Arm), cell.device(Gripper)
    assert type(arm).__name__ == ARMS[cell.name.split("_")[1]]
    assert type(gripper).__name__ == "RobotiqGripper"
    q, width = arm.state().q, gripper.state().width
    truly = cell.devices["world"]._cell.device(Gripper).state().width  # type: ignore[attr-defined]
    assert width == pytest.approx(truly, abs=2e-4)
    motion = arm.follow(
        time_polyline([q, q + 0.2 * np.array([1.0, -0.2, 0.1, -0.2, 0.3, 0.5])], arm.limits)
    )
    move = gripper.move(0.075, 0.05)
    run(cell, 5.0, lambda: motion.settled and move.settled)
    assert (motion.state, move.state) == (MotionState.DONE, MotionState.DONE)
    assert gripper.state().width == pytest.approx(0.075, abs=1e-3)
    frame = cell.device(Camera).latest()
    assert frame is not None
    cell.check()


@pytest.mark.parametrize(
    ("cell", "switch", "fault", "device", "within"),
    [
        ("ur5e", "arm", "protective", "arm", 0.06),
        ("ur5e", "arm.rtde_wire", "cut", "arm", 0.06),
        ("ur5e", "arm.rtde_wire", "silent", "arm", 0.06),
        ("ur5e", "arm.rtde_wire", "garbage", "arm", 0.06),
        ("ur5e", "gripper.controller", "hot", "gripper", 0.06),
        ("ur5e", "gripper.wire", "silent", "gripper", 0.1),
        ("xarm6", "arm", "collision", "arm", 0.06),
        ("xarm6", "arm", "e_stop", "arm", 0.06),
        ("xarm6", "arm", "replaced", "arm", 0.06),
        ("xarm6", "arm.command_wire", "cut", "arm", 0.06),
        ("xarm6", "arm.command_wire", "silent", "arm", 0.06),
        ("xarm6", "arm.command_wire", "garbage", "arm", 0.06),
        ("xarm6", "arm.report_wire", "cut", "arm", 0.06),
        ("xarm6", "arm.report_wire", "silent", "arm", 0.06),
    ],
    indirect=["cell"],
)
def test_a_fault_stops_the_arm(
    cell: Cell, switch: str, fault: str, device: str, within: float
) -> None:
    arm = cell.device(Arm)
    q = arm.state().q
    motion = arm.follow(
        time_polyline([q, q + 0.6 * np.array([1.0, -0.1, 0.1, -0.2, 0.3, 0.5])], arm.limits)
    )
    run(cell, 0.5)
    assert motion.state is MotionState.RUNNING
    cell.switches[switch].inject_fault(fault)
    began = cell.clock.now()
    found: list[DeviceError] = []

    def noticed() -> bool:
        try:
            cell.check()
        except DeviceError as error:
            found.append(error)
        return bool(found)

    run(cell, 1.0, noticed)
    assert found[0].device == device
    assert cell.clock.now() - began <= within
    cell.safe_stop("fault")
    run(cell, 0.6)
    joints = cell.devices["world"]._world.state.qvel  # type: ignore[attr-defined]
    assert np.abs(joints[:6]).max() < 0.02
