"""The emulated cell on virtual time: real drivers and bytes, the same each time, and all of it can be made to fail."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fault_plan import FaultPlan, PlannedFault
from pomona.drivers.errors import DeviceError, DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.interfaces import Arm, Camera, ForceSensor, Gripper, MotionState
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell
from pomona.skills.motion.planning.timing import time_polyline

pytestmark = pytest.mark.slow

CELL = Path(__file__).resolve().parents[4] / "trees" / "cells" / "emulated.yaml"
TICK = 0.02


@pytest.fixture
def open_cell() -> Iterator[Callable[[int], Cell]]:
    opened: list[Cell] = []

    def open_with(seed: int = 1) -> Cell:
        opened.append(load_cell(CELL, seed=seed, overrides={"distractors": "0"}))
        return opened[-1]

    yield open_with
    for cell in opened:
        cell.close()


def run(cell: Cell, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
    end = cell.clock.now() + seconds
    while cell.clock.now() < end and not until():
        cell.clock.advance(TICK)
        cell.check()


def swing(cell: Cell, change: float = 0.4):
    arm = cell.device(Arm)
    q = arm.state().q
    return arm.follow(
        time_polyline([q, q + change * np.array([1.0, -0.2, 0.0, -0.2, 0.3, 0.0, 0.5])], arm.limits)
    )


def test_every_device_answers_through_its_own_wire(open_cell):
    cell = open_cell()
    assert cell.clock.simulated
    assert set(cell.links().values()) == {"ok"}
    arm, gripper, fingers, camera = (
        cell.device(kind) for kind in (Arm, Gripper, ForceSensor, Camera)
    )
    assert type(arm).__name__ == "MotomanArm"
    assert arm.state().q == pytest.approx(cell.workspace.poses["observe"], abs=2e-3)
    motion, width = swing(cell), gripper.state().width
    move = gripper.move(width - 0.01, 0.1)
    run(cell, 5.0, lambda: motion.settled and move.settled)
    assert (motion.state, move.state) == (MotionState.DONE, MotionState.DONE)
    assert gripper.state().width == pytest.approx(width - 0.01, abs=1e-3)
    assert np.abs(fingers.latest().wrenches[:, :3]).max() < 0.6
    run(cell, 1.0)
    frame = camera.latest()
    assert frame.colour.shape == (480, 640, 3)
    assert frame.q == pytest.approx(arm.state().q, abs=1e-3)
    assert not cell.truth()["lifted"]


def test_a_frame_taken_while_the_arm_moves_knows_where_the_arm_was(open_cell):
    cell = open_cell()
    joints = cell._world._world.state.qpos[:7]
    history = []
    motion = swing(cell)
    while not motion.settled:
        cell.clock.advance(0.002)
        history.append((cell.clock.now(), joints.copy()))
        frame = cell.device(Camera).latest()
    times, q = np.array([t for t, _ in history]), np.array([q for _, q in history])
    assert times[0] < frame.stamp < times[-1]
    truly = np.array([np.interp(frame.stamp, times, q[:, joint]) for joint in range(7)])
    assert frame.q == pytest.approx(truly, abs=0.02)


def test_two_cells_of_one_seed_measure_the_same_to_the_last_bit_and_another_seed_does_not(
    open_cell,
):
    def trace(seed):
        cell = open_cell(seed)
        received = []
        subscription = cell.device(ForceSensor).subscribe(
            lambda sample: received.append(sample.wrenches.tobytes())
        )
        motion = swing(cell)
        cell.device(Gripper).set_speed(-0.02)
        told = []
        while not motion.settled:
            run(cell, TICK)
            told.append(
                (
                    cell.clock.now(),
                    cell.device(Arm).state().q.tobytes(),
                    cell.device(Gripper).state().width,
                )
            )
        subscription.close()
        frame = cell.device(Camera).latest()
        return told, received, frame.stamp, frame.depth.tobytes(), frame.colour.tobytes()

    first, second, other = trace(1), trace(1), trace(2)
    assert len(first[0]) > 20
    assert len(first[1]) > 200
    assert first == second
    assert first != other


def test_time_stands_still_for_all_until_the_clock_advances(open_cell):
    cell = open_cell()
    run(cell, 0.1)
    motion = swing(cell)
    cell.safe_stop("before the arm's thread had a turn")
    cell.clock.advance(0.5)
    assert (motion.state, motion.settled) == (MotionState.FAILED, True)
    assert cell.device(Arm).state().q == pytest.approx(cell.workspace.poses["observe"], abs=1e-3)


@pytest.mark.parametrize(
    ("switch", "kind", "device", "within"),
    [
        pytest.param("arm", "busy", "arm", 2.0, marks=pytest.mark.long),
        pytest.param("arm", "frozen", "arm", 0.8, marks=pytest.mark.long),
        pytest.param("arm", "stuck", "arm", 0.8, marks=pytest.mark.long),
        ("arm", "wild", "arm", 0.1),
        pytest.param("arm", "no_status", "arm", 0.8, marks=pytest.mark.long),
        ("arm", "e_stop", "arm", 0.1),
        pytest.param("arm.motion_wire", "garbage", "arm", 0.1, marks=pytest.mark.long),
        ("arm.motion_wire", "silent", "arm", 0.6),
        pytest.param("arm.state_wire", "silent", "arm", 0.5, marks=pytest.mark.long),
        pytest.param("arm.state_wire", "cut", "arm", 0.1, marks=pytest.mark.long),
        pytest.param("gripper.controller", "faulty", "gripper", 0.1, marks=pytest.mark.long),
        ("gripper.controller", "deaf", "gripper", 0.5),
        pytest.param("gripper.wire", "silent", "gripper", 0.5, marks=pytest.mark.long),
        pytest.param("fingers.left", "stuck", "fingers", 0.2, marks=pytest.mark.long),
        ("fingers.right", "restless", "fingers", 0.5),
        pytest.param("gripper.wire", "cut", "gripper", 0.1, marks=pytest.mark.long),
        pytest.param("fingers.left_wire", "silent", "fingers", 0.5, marks=pytest.mark.long),
        pytest.param("fingers.right_wire", "cut", "fingers", 0.1, marks=pytest.mark.long),
        ("camera.wire", "cut", "camera", 0.5),
    ],
)
def test_a_fault_beside_a_moving_arm_names_the_right_device_and_the_arm_comes_to_rest(
    open_cell, switch, kind, device, within
):
    cell = open_cell()
    plan = FaultPlan([PlannedFault(switch, kind, after=0.2, phase="moving")], cell.switches)
    motion = swing(cell, change=1.2)
    plan.begin("moving", cell.clock.now())
    while not plan.injected:
        run(cell, TICK)
        plan.step(cell.clock.now())
    with pytest.raises(DeviceError) as caught:
        run(cell, within)
    assert caught.value.device == device
    cell.safe_stop("the check found it")
    joints = cell._world._world.state
    cell.clock.advance(2.0)
    assert motion.settled
    assert np.abs(joints.qvel[:7]).max() < 5e-3
    stood = joints.qpos[:7].copy()
    cell.clock.advance(1.0)
    assert np.abs(joints.qpos[:7] - stood).max() < 1e-3
    cell.switches[switch].clear_fault()
    cell.clock.advance(
        3.0
    )  # mended and connected again: still nothing moves, and nothing is forgotten
    assert np.abs(joints.qpos[:7] - stood).max() < 1e-3
    with pytest.raises((DeviceLost, DeviceFault)):
        cell.check()
    with pytest.raises(MotionRefused):
        swing(cell)


def test_after_a_cut_wire_was_mended_and_acknowledged_the_arm_moves_again(open_cell):
    cell = open_cell()
    cell.switches["arm.state_wire"].inject_fault("cut")
    with pytest.raises(DeviceLost):
        run(cell, 0.2)
    cell.safe_stop("lost")
    cell.switches["arm.state_wire"].clear_fault()
    cell.clock.advance(2.0)
    cell.acknowledge()
    cell.clock.advance(1.0)
    motion = swing(cell)
    run(cell, 5.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE


def test_a_fault_of_another_kind_is_refused(open_cell):
    plan = FaultPlan([PlannedFault("camera", "wags")], open_cell().switches)
    with pytest.raises(ValueError, match=r"there are the faults freeze, lost.* not wags"):
        plan.step(1.0)
