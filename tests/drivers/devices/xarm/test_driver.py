"""The arm's driver against the emulated controller, byte for byte, on a clock that the test moves."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.devices.emulators.motoman import FreeJoints
from pomona.devices.laboratory_emulators.xarm import XArmEmulator
from pomona.devices.xarm.codec import Register, encode
from pomona.devices.xarm.driver import WrongModelError, XArm
from pomona.devices.xarm.options import XArmFile
from pomona.drivers import (
    ArmLimits,
    DeviceError,
    DeviceFault,
    DeviceLost,
    Motion,
    MotionRefused,
    MotionState,
)
from pomona.drivers.path_arm import RECONNECT
from pomona.executive import ManualClock
from tests.drivers.devices.motoman.test_driver import Connection, swing

START = np.array([0.1, -0.6, -0.7, 0.3, 1.2, 0.7, 0.2])
CHANGE = np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.6, 0.4])


def limits(dof: int) -> ArmLimits:
    full = np.ones(dof)
    return ArmLimits(-6.0 * full, 6.0 * full, 3.14 * full, 10.0 * full, 200.0 * full)


class Cell:
    """The controller on a clock that the test moves; `cut` is the network cable."""

    def __init__(self, dof: int = 6) -> None:
        self.clock = ManualClock(50.0)
        self.cut = False
        self.dof = dof
        self.joints = FreeJoints(START[:dof])
        self.controller = XArmEmulator(self.joints, limits(dof).velocity, dof)
        self.controller.advance(self.clock.now())
        self.opened: list[Connection] = []

    def open(self, name: str) -> Connection:
        if self.cut:
            raise ConnectionRefusedError("nobody answers")
        connection = Connection(self, getattr(self.controller, name))  # type: ignore[arg-type]
        self.opened.append(connection)
        return connection

    def let_pass(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.clock.now() + seconds
        while not until() and self.clock.now() < end - 1e-9:
            self.clock.advance(0.001)
            self.controller.advance(self.clock.now())

    def speed(self) -> float:
        return float(np.abs(self.joints.measured()[1]).max())


def arm_of(cell: Cell, **options: Any) -> XArm:
    said = {"address": "xarm", "model": f"xarm{cell.dof}", "robot": Path("robot.xml"), **options}
    return XArm(cell.open, cell.clock, limits(cell.dof), XArmFile(**said))


def connected(cell: Cell, **options: Any) -> XArm:
    arm = arm_of(cell, **options)
    arm.connect()
    return arm


def serve(arm: XArm, cell: Cell, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
    end = cell.clock.now() + seconds
    while cell.clock.now() < end and not until():
        before = cell.clock.now()
        arm.step()
        if cell.clock.now() == before:
            cell.let_pass(0.001)


def moving(cell: Cell, arm: XArm) -> Motion:
    """A motion on its way."""
    motion: Motion = arm.follow(swing(arm.state().q, CHANGE[: cell.dof]))
    serve(arm, cell, 0.5)
    assert motion.state is MotionState.RUNNING
    assert cell.speed() > 0.5
    return motion


def assert_never_resumes(cell: Cell, arm: XArm, seconds: float = 1.0) -> None:
    serve(arm, cell, 0.5)
    q = cell.joints.measured()[0]
    for _ in range(20):
        serve(arm, cell, seconds / 20.0)
        assert np.abs(cell.joints.measured()[0] - q).max() < 1e-5


def assert_moves(cell: Cell, arm: XArm) -> None:
    motion = arm.follow(swing(arm.state().q, -0.5 * CHANGE[: cell.dof]))
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert (motion.state, motion.problem) == (MotionState.DONE, "")


@pytest.mark.parametrize("dof", [5, 6, 7])
def test_a_trajectory_is_followed_to_its_end(dof: int) -> None:
    cell = Cell(dof)
    arm = connected(cell)
    motion = arm.follow(swing(START[:dof], CHANGE[:dof]))
    assert not arm.settled()
    serve(arm, cell, 0.6)
    assert motion.state is MotionState.RUNNING
    serve(arm, cell, 1.5, lambda: motion.settled)
    assert (motion.state, motion.problem, motion.progress) == (MotionState.DONE, "", 1.0)
    assert arm.settled()
    assert arm.state().q == pytest.approx(START[:dof] + CHANGE[:dof], abs=2e-3)
    assert_moves(cell, arm)
    arm.close()
    assert cell.controller.state == 4
    assert all(connection.closed for connection in cell.opened)


def test_the_arm_passes_its_set_points_at_their_times() -> None:
    cell = Cell()
    arm = connected(cell)
    due: list[tuple[float, np.ndarray]] = []
    command = arm._supervisor.command
    arm._supervisor.command = lambda at, q: (due.append((at, q)), command(at, q))[1]  # type: ignore[method-assign]
    seen: list[tuple[float, np.ndarray]] = []
    drive = cell.joints.drive
    cell.joints.drive = lambda q, qd: (seen.append((cell.clock.now(), q)), drive(q, qd))[1]  # type: ignore[method-assign]
    motion = arm.follow(swing(START[:6], CHANGE[:6]))
    serve(arm, cell, 2.0, lambda: motion.settled)
    times, joints = np.array([at for at, _ in seen]), np.array([q for _, q in seen])
    late = [times[np.abs(joints - q).max(axis=1).argmin()] - at for at, q in due[20:-20]]
    assert len(due) > 200
    assert -0.005 < min(late) <= max(late) < 0.02


def test_a_stop_brakes_on_the_path_and_a_pause_goes_on() -> None:
    cell = Cell()
    arm = connected(cell)
    motion = moving(cell, arm)
    arm.pause()
    serve(arm, cell, 1.0)
    assert arm.settled()
    assert motion.state is MotionState.PAUSED
    q = cell.joints.measured()[0]
    arm.resume()
    serve(arm, cell, 0.25)
    assert np.abs(cell.joints.measured()[0] - q).max() > 1e-3
    motion.stop()
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert motion.state is MotionState.STOPPED
    done = (cell.joints.measured()[0] - START[:6]) / CHANGE[:6]
    assert np.ptp(done) < 0.01
    arm.check()


HARD = {
    "collision": "error 31: a collision",
    "e_stop": "emergency stop of the control box",
    "motor": "motor 3",
    "stopped": "was stopped by another program",
    "paused": "was paused by another program",
    "replaced": "mode of the queue",
    "nan": "not finite",
    "wild": "far outside",
    "killed": "connection",
    "silent": "no answer for",
    "no_report": "no report for",
}


@pytest.mark.parametrize("fault", HARD)
def test_a_fault_is_noticed_within_60_ms_and_the_arm_rests_within_600(fault: str) -> None:
    cell = Cell()
    arm = connected(cell)
    motion = moving(cell, arm)
    cell.controller.inject_fault(fault)
    if fault == "killed":
        for connection in cell.opened:
            connection.broken = True
        cell.cut = True
    began = cell.clock.now()
    serve(arm, cell, 1.0, lambda: arm._problem is not None)
    assert cell.clock.now() - began <= 0.06
    with pytest.raises(DeviceError, match=HARD[fault]):
        arm.check()
    serve(arm, cell, 0.6)
    cell.let_pass(max(began + 0.6 - cell.clock.now(), 0.0))
    assert cell.speed() < 1e-4
    serve(arm, cell, 1.0, lambda: motion.settled)
    assert motion.state is MotionState.FAILED
    with pytest.raises(MotionRefused):
        arm.follow(swing(START[:6], CHANGE[:6]))


@pytest.mark.parametrize("fault", ["stuck", "frozen"])
def test_the_target_of_joints_that_do_not_report_a_motion_is_replaced_by_a_stop(fault: str) -> None:
    cell = Cell()
    arm = connected(cell)
    moving(cell, arm)
    cell.controller.inject_fault(fault)
    began = cell.clock.now()
    serve(arm, cell, 1.0, lambda: arm._problem is not None)
    with pytest.raises(DeviceLost, match="feedback has not changed"):
        arm.check()
    assert cell.clock.now() - began <= 0.3
    serve(arm, cell, 0.3)
    assert cell.controller.state == 4


def test_joints_that_another_client_moves_are_stopped() -> None:
    cell = Cell()
    arm = connected(cell)
    serve(arm, cell, 0.5)
    began, q = cell.clock.now(), arm.state().q
    cell.controller.inject_fault("moved")
    serve(arm, cell, 0.2, lambda: arm._problem is not None)
    with pytest.raises(DeviceFault, match="moves without a command of this run"):
        arm.check()
    assert cell.controller.state == 4
    assert cell.clock.now() - began <= 0.030
    serve(arm, cell, 0.5)
    assert (
        1e-3 < np.abs(cell.joints.measured()[0] - q).max() < 0.015
    )  # of the 0.1 rad that the other one wanted
    assert cell.speed() < 1e-4


@pytest.mark.parametrize("length", [0.3, 0.004])
def test_an_arm_that_comes_to_rest_after_a_motion_is_moved_by_no_other(length: float) -> None:
    cell = Cell()
    arm = connected(cell)
    for sign in (1.0, -1.0):
        motion = arm.follow(swing(arm.state().q, sign * length * np.ones(6)))
        serve(arm, cell, 2.0, lambda motion=motion: motion.settled)
        serve(arm, cell, 0.5)
        arm.check()


@pytest.mark.parametrize(
    "fault", ["collision", "e_stop", "motor", "stopped", "paused", "replaced", "silent", "killed"]
)
def test_after_a_fault_nothing_moves_before_a_new_motion(fault: str) -> None:
    cell = Cell()
    arm = connected(cell)
    moving(cell, arm)
    cell.controller.inject_fault(fault)
    if fault == "killed":
        for connection in cell.opened:
            connection.broken = True
    serve(arm, cell, 0.5)
    cell.controller.clear_fault()
    serve(arm, cell, RECONNECT + 0.2)
    assert_never_resumes(cell, arm)
    arm.acknowledge()
    serve(arm, cell, 1.0)
    arm.check()
    assert_never_resumes(cell, arm)
    assert_moves(cell, arm)


def test_an_emergency_stop_that_is_still_pressed_is_not_acknowledged() -> None:
    cell = Cell()
    arm = connected(cell)
    moving(cell, arm)
    cell.controller.inject_fault("e_stop")
    serve(arm, cell, 0.5)
    arm.acknowledge()
    serve(arm, cell, 0.5)
    with pytest.raises(DeviceFault, match="release it"):
        arm.check()
    assert not cell.controller.enabled


@pytest.mark.parametrize("lost", [0.05, 0.5])
def test_after_a_lost_link_the_arm_rests_and_waits_for_an_acknowledgement(lost: float) -> None:
    cell = Cell()
    arm = connected(cell)
    motion = moving(cell, arm)
    cell.cut = True
    for connection in cell.opened:
        connection.broken = True
    serve(arm, cell, lost)
    assert motion.settled
    assert motion.state is MotionState.FAILED
    with pytest.raises(DeviceLost):
        arm.state()
    with pytest.raises(DeviceLost, match="still lost"):
        arm.acknowledge()
    cell.cut = False
    serve(arm, cell, RECONNECT + 0.5)
    arm.state()
    with pytest.raises(DeviceLost):
        arm.check()
    assert_never_resumes(cell, arm)
    arm.acknowledge()
    serve(arm, cell, 1.0)
    arm.check()
    assert_never_resumes(cell, arm)


@pytest.mark.parametrize("ordered", [False, True], ids=["stopped", "recovered"])
def test_a_process_that_is_killed_leaves_an_arm_at_rest(ordered: bool) -> None:
    cell = Cell()
    arm = connected(cell)
    moving(cell, arm)
    cell.let_pass(0.2)
    assert cell.speed() < 1e-4
    with pytest.raises(
        DeviceFault, match=r"holds it in servo mode.*stop the arm in UFACTORY Studio"
    ):
        arm_of(cell).connect()
    if ordered:
        again = arm_of(cell)
        again.takes_over = True
        again.connect()
    else:
        cell.controller.set_state(4)  # by its supervisor process, or in UFACTORY Studio
        again = connected(cell)
    assert_never_resumes(cell, again)
    assert_moves(cell, again)


@pytest.mark.parametrize("moves", [True, False], ids=["moving", "at rest"])
def test_a_second_run_is_refused_and_the_first_goes_on(moves: bool) -> None:
    cell = Cell()
    first = connected(cell)
    motion = moving(cell, first) if moves else None
    with pytest.raises(DeviceFault, match="another program moves it, holds it"):
        arm_of(cell).connect()
    if motion is not None:
        serve(first, cell, 3.0, lambda: motion.settled)
        assert motion.state is MotionState.DONE
    assert_moves(cell, first)


def test_a_late_set_point_makes_the_arm_slower_and_jumps_nowhere() -> None:
    cell = Cell()
    arm = connected(cell)
    motion = moving(cell, arm)
    for _ in range(10):
        cell.let_pass(0.03)
        serve(arm, cell, 0.004)
    assert motion.state is MotionState.RUNNING
    serve(arm, cell, 3.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE
    assert cell.controller.error == 0
    moving_again = moving(cell, arm)
    cell.let_pass(0.1)
    serve(arm, cell, 0.5, lambda: moving_again.settled)
    assert re.search(r"got no set-point for \d+ ms", moving_again.problem)
    assert cell.controller.state == 4


# ------------------------------------------------------------------------------------------------ bad input


def refusal(cell: Cell, **options: Any) -> str:
    arm = arm_of(cell, **options)
    with pytest.raises(DeviceError) as caught:
        arm.connect()
    text = caught.value.message
    assert "\n" not in text
    assert np.array_equal(cell.joints.measured()[0], START[: cell.dof])
    assert all(connection.closed for connection in cell.opened)
    return text


@pytest.mark.parametrize(
    ("axes", "kind", "named"), [(7, 7, "xarm7"), (6, 9, "lite6"), (6, 12, "850"), (5, 5, "xarm5")]
)
def test_another_model_at_the_address_is_refused(axes: int, kind: int, named: str) -> None:
    cell = Cell()
    cell.controller.axes, cell.controller.kind = axes, kind
    with pytest.raises(WrongModelError, match=f"is a {named}, not the xarm6"):
        connected(cell)
    assert not cell.controller.enabled


def test_an_old_firmware_is_refused() -> None:
    cell = Cell()
    cell.controller.firmware = (1, 8, 4)
    assert "firmware 1.8.4, which is too old: update it to 1.9.110" in refusal(cell)


@pytest.mark.parametrize("fault", ["collision", "e_stop", "motor"])
def test_an_arm_with_an_error_is_refused_and_not_cleared(fault: str) -> None:
    cell = Cell()
    cell.controller.inject_fault(fault)
    assert "has the error" in refusal(cell)
    assert cell.controller.error


def test_an_arm_that_another_program_moves_is_refused() -> None:
    cell = Cell()
    controller = cell.controller
    controller.enabled = True
    controller.set_mode(0)
    controller.set_state(0)
    controller._queue.append((START[:6] + 0.5, 0.1))
    cell.let_pass(0.1)
    with pytest.raises(DeviceFault, match="another program moves it"):
        connected(cell)
    cell.let_pass(0.1)
    assert controller.mode == 0
    assert cell.speed() > 0.05


def test_an_arm_that_is_guided_by_hand_is_refused_and_stays_so() -> None:
    cell = Cell()
    cell.controller.mode = 2
    cell.let_pass(0.05)
    assert "is in manual mode" in refusal(cell)
    assert (cell.controller.mode, cell.controller.enabled) == (2, False)


def test_motors_are_enabled_only_where_the_options_allow_it() -> None:
    cell = Cell()
    assert "does not become ready; enable it in UFACTORY Studio" in refusal(cell, enable=False)
    assert not cell.controller.enabled
    connected(cell)
    assert cell.controller.enabled


def test_another_service_at_the_address_is_refused() -> None:
    cell = Cell()
    peer = Connection(cell, cell.controller.command)  # type: ignore[arg-type]
    peer.send(encode(1, Register.VERSION))

    class Web:
        def connected(self, peer: Any) -> None:
            peer.send(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        def received(self, peer: Any, chunk: bytes) -> None: ...

        def disconnected(self, peer: Any) -> None: ...

    cell.controller.command = Web()  # type: ignore[assignment]
    assert "a web server (HTTP) answers there" in refusal(cell)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("register", [23, 29, 81])
def test_an_emulated_arm_takes_no_number_that_is_none(register: int, wrong: float) -> None:
    cell = Cell()
    connected(cell)
    body = struct.pack("<10f", wrong, *cell.joints.measured()[0][1:], *([0.0] * 4))
    if register == 23 and wrong == np.inf:  # the vendor's client: this joint stays
        cell.controller.answer(register, body)
        return
    with pytest.raises(IndexError):
        cell.controller.answer(register, body)


def test_an_emulated_arm_refuses_a_motion_that_it_does_not_know() -> None:
    cell = Cell()
    assert cell.controller.answer(60, b"") == bytes(40)
    with pytest.raises(IndexError):
        cell.controller.answer(21, bytes(40))
