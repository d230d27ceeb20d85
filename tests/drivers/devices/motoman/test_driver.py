"""The arm's driver against the emulated controller, byte for byte, on a clock that the test moves."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.devices.emulators.motoman import FreeJoints, MotomanEmulator
from pomona.devices.motoman.codec import Communication, Message, RobotStatus, encode
from pomona.devices.motoman.driver import MotomanArm
from pomona.devices.motoman.options import MotomanFile
from pomona.drivers.errors import DeviceError, DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.interfaces import ArmLimits, Motion, MotionState, Trajectory
from pomona.drivers.motion_supervisor import Supervision
from pomona.drivers.path_arm import RECONNECT
from pomona.executive.cell.owner import Nonsense
from pomona.executive.clock import ManualClock, SystemClock

DOF = 7
LIMITS = ArmLimits(
    -np.full(DOF, 3.0),
    np.full(DOF, 3.0),
    np.full(DOF, 3.0),
    np.full(DOF, 10.0),
    np.full(DOF, 200.0),
)
START = np.array([0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7])


class Connection:
    """One TCP connection, in memory; what the controller sends comes `late` [s]."""

    late = 0.0

    def __init__(self, cell: Cell, port: Any) -> None:
        self.cell, self.port, self.closed, self.broken = cell, port, False, False
        self.arrived = bytearray()
        self.coming: list[tuple[float, bytes]] = []
        self.peer = Peer(self)
        port.connected(self.peer)

    def send(self, chunk: bytes) -> None:
        if self.cell.cut:
            raise BrokenPipeError("cut")
        self.port.received(self.peer, chunk)

    def receive(self, timeout: float) -> bytes:
        if self.broken:
            raise ConnectionResetError("the connection is broken")
        self.cell.let_pass(timeout, self.has_arrived)
        chunk = bytes(self.arrived)
        self.arrived.clear()
        return b"" if self.cell.cut else chunk

    def has_arrived(self) -> bool:
        """Return True if bytes can be received now."""
        while self.coming and self.coming[0][0] <= self.cell.clock.now():
            self.arrived += self.coming.pop(0)[1]
        return bool(self.arrived)

    def close(self) -> None:
        self.closed = True
        self.port.disconnected(self.peer)


class Peer:
    def __init__(self, connection: Connection) -> None:
        self.connection = connection

    def send(self, chunk: bytes) -> None:
        connection = self.connection
        if connection.late:
            due = connection.cell.clock.now() + connection.late
            connection.coming.append((due, chunk))
        else:
            connection.arrived += chunk

    def close(self) -> None:
        self.connection.closed = True


class Cell:
    def __init__(self, order: str = "<", **options: Any) -> None:
        self.clock = ManualClock(50.0)
        self.cut = False
        self.joints = FreeJoints(START)
        self.controller = MotomanEmulator(self.joints, LIMITS.velocity, order, **options)  # type: ignore[arg-type]
        self.opened: list[Connection] = []

    def open(self, port: Any) -> Connection:
        if self.cut:
            raise ConnectionRefusedError("nobody answers")
        connection = Connection(self, port)
        self.opened.append(connection)
        return connection

    def let_pass(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.clock.now() + seconds
        self.controller.advance(self.clock.now())
        while not until() and self.clock.now() < end:
            self.clock.advance(0.001)
            self.controller.advance(self.clock.now())


def connected(cell: Cell, controller: str = "dx200", **options: Any) -> MotomanArm:
    arm = MotomanArm(
        lambda name: cell.open(
            {"state": cell.controller.state, "motion": cell.controller.motion}[name]
        ),
        cell.clock,
        LIMITS,
        MotomanFile(
            address=("robot", 50240), robot=Path("robot.xml"), controller=controller, **options
        ),
    )
    arm.connect()
    return arm


def serve(
    arm: MotomanArm, cell: Cell, seconds: float, until: Callable[[], bool] = lambda: False
) -> None:
    end = cell.clock.now() + seconds
    while cell.clock.now() < end and not until():
        before = cell.clock.now()
        arm.step()
        if cell.clock.now() == before:
            cell.let_pass(0.001)


def swing(
    start: np.ndarray, change: np.ndarray, duration: float = 1.0, samples: int = 101
) -> Trajectory:
    """A quintic from rest to rest."""
    s = np.linspace(0.0, 1.0, samples)[:, None]
    q = start + change * (10 * s**3 - 15 * s**4 + 6 * s**5)
    qd = change * (30 * s**2 - 60 * s**3 + 30 * s**4) / duration
    qdd = change * (60 * s - 180 * s**2 + 120 * s**3) / duration**2
    return Trajectory(s[:, 0] * duration, q, qd, qdd)


CHANGE = np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.6, -0.7])


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_trajectory_is_followed_to_its_end_without_a_gap(order: str) -> None:
    cell = Cell(order)
    arm = connected(cell, controller="fs100" if order == ">" else "dx200")
    motion = arm.follow(swing(START, CHANGE))
    assert not arm.settled()
    serve(arm, cell, 0.6)
    assert motion.state is MotionState.RUNNING
    assert 0.3 < motion.progress < 1.0
    serve(arm, cell, 1.0, lambda: motion.settled)
    assert (motion.state, motion.progress) == (MotionState.DONE, 1.0)
    assert arm.settled()
    assert arm.state().q == pytest.approx(START + CHANGE, abs=1e-6)
    assert cell.controller.gaps == 0


@pytest.mark.parametrize(
    ("late", "state", "words"),
    [
        (0.02, MotionState.DONE, ""),
        (0.05, MotionState.DONE, ""),
        (
            0.1,
            MotionState.FAILED,
            "answers 101 ms late: the connection is too slow for `lead`",
        ),
    ],
)
def test_points_fit_the_time_of_an_answer_or_the_connection_is_named(
    late: float, state: MotionState, words: str
) -> None:
    cell = Cell()
    arm = connected(cell)
    cell.opened[-1].late = late
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 3.0, lambda: motion.settled)
    assert (motion.state, motion.problem, cell.controller.gaps) == (state, words, 0)


def test_a_status_from_before_the_servos_came_on_is_no_fault() -> None:
    cell = Cell()
    off = RobotStatus(
        drives_powered=0,
        e_stopped=0,
        error_code=0,
        in_error=0,
        in_motion=0,
        mode=2,
        motion_possible=0,
    )
    answer = cell.controller.motion.received

    def answered_before_the_status_was_read(peer: Any, chunk: bytes) -> None:
        answer(peer, chunk)
        cell.opened[0].arrived += encode(Message(off, Communication.TOPIC), "<")

    cell.controller.motion.received = answered_before_the_status_was_read  # type: ignore[method-assign]
    arm = connected(cell)
    serve(arm, cell, 0.2)
    arm.check()


def test_the_controller_moves_along_the_path_and_not_beside_it() -> None:
    cell = Cell()
    arm = connected(cell)
    seen = []
    drive = cell.joints.drive
    cell.joints.drive = lambda q, qd: (seen.append(q), drive(q, qd))[1]  # type: ignore[method-assign,func-returns-value]
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 2.0, lambda: motion.settled)
    share = (np.array(seen) - START) / CHANGE
    assert np.abs(share - share[:, :1]).max() < 1e-4  # all joints at the same place of the path
    assert np.all(np.diff(share[:, 0]) >= -1e-7)


def test_joints_are_sorted_between_the_robot_file_and_the_wire() -> None:
    cell = Cell()
    wire_joints = (0, 1, 3, 4, 5, 6, 2)
    arm = connected(cell, joints=tuple("SLURBTE"))
    assert arm.state().q == pytest.approx(START[list(wire_joints)])
    motion = arm.follow(swing(arm.state().q, CHANGE))
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE
    measured, _ = cell.joints.measured()
    assert measured[2] == pytest.approx(START[2] + CHANGE[6], abs=1e-6)


def test_a_full_queue_answers_busy_and_the_same_point_is_sent_again() -> None:
    cell = Cell(buffer=0.05)
    arm = connected(cell, lead=0.5)
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 0.01)
    stream = arm._stream
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE
    assert stream is not None
    assert stream.busy > 5
    assert cell.controller.gaps == 0


@pytest.mark.slow
def test_500_points_are_streamed_without_a_gap() -> None:
    cell = Cell()
    arm = connected(cell)
    motion = arm.follow(swing(START, CHANGE, duration=10.0, samples=501))
    serve(arm, cell, 0.01)
    stream = arm._stream
    serve(arm, cell, 12.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE
    assert stream is not None
    assert stream.sent == 501
    assert cell.controller.gaps == 0


@pytest.mark.parametrize(("quickness", "queued"), [(0.02, 0.05), (1.0, 0.15)])
def test_the_queue_of_a_slow_arm_is_a_third_of_that_of_a_quick_one(
    quickness: float, queued: float
) -> None:
    cell = Cell()
    arm = connected(cell, lead=0.15)
    motion = arm.follow(swing(START, quickness * CHANGE))
    serve(arm, cell, 0.5)
    stream = arm._stream
    assert stream is not None
    assert queued - 0.02 < stream.ahead < queued + 0.02
    motion.stop()
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert motion.state is MotionState.STOPPED
    assert cell.controller.gaps == 0


def test_a_stop_decelerates_on_the_path_within_the_limits_and_stays() -> None:
    cell = Cell()
    arm = connected(cell)
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 0.5)
    motion.stop()
    speeds = []
    drive = cell.joints.drive
    cell.joints.drive = lambda q, qd: (speeds.append(qd), drive(q, qd))[1]  # type: ignore[method-assign,func-returns-value]
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert (motion.state, motion.settled) == (MotionState.STOPPED, True)
    q, qd = cell.joints.measured()
    share = (q - START) / CHANGE
    assert np.abs(share - share[0]).max() < 1e-4
    assert 0.5 < share[0] < 0.95
    assert np.all(qd == 0.0)
    change = np.abs(np.diff(np.array(speeds), axis=0)) / 0.001
    assert change.max() < 2.0 * LIMITS.acceleration[0]
    assert cell.controller.gaps == 0


def test_a_paused_motion_goes_on_to_its_end() -> None:
    cell = Cell()
    arm = connected(cell)
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 0.4)
    arm.pause()
    serve(arm, cell, 2.0)
    stood, _ = cell.joints.measured()
    assert arm.settled()
    assert motion.state is MotionState.PAUSED
    serve(arm, cell, 1.0)
    assert np.array_equal(cell.joints.measured()[0], stood)
    arm.resume()
    serve(arm, cell, 3.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE
    assert cell.joints.measured()[0] == pytest.approx(START + CHANGE, abs=1e-6)
    assert cell.controller.gaps == 0


def test_a_small_distance_at_the_start_is_taken_up_smoothly() -> None:
    cell = Cell()
    arm = connected(cell)
    seen = []
    drive = cell.joints.drive
    cell.joints.drive = lambda q, qd: (seen.append(q), drive(q, qd))[1]  # type: ignore[method-assign,func-returns-value]
    motion = arm.follow(swing(START + 1.5e-3, CHANGE))
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE
    assert cell.joints.measured()[0] == pytest.approx(START + 1.5e-3 + CHANGE, abs=1e-6)
    assert (
        np.abs(np.diff(np.array(seen), axis=0)).max() < 0.0025
    )  # no jump: 2 rad/s at most, in 1 ms


def test_a_trajectory_that_starts_elsewhere_is_refused_and_nothing_is_sent() -> None:
    cell = Cell()
    arm = connected(cell)
    with pytest.raises(MotionRefused, match="away from the arm at joint"):
        arm.follow(swing(START + 0.01, CHANGE))
    serve(arm, cell, 0.2)
    assert np.array_equal(cell.joints.measured()[0], START)


def test_a_second_trajectory_while_moving_is_refused() -> None:
    cell = Cell()
    arm = connected(cell)
    arm.follow(swing(START, CHANGE))
    serve(arm, cell, 0.3)
    with pytest.raises(MotionRefused, match="still moves"):
        arm.follow(swing(arm.state().q, CHANGE))


def test_a_start_that_the_controller_does_not_accept_fails_the_motion_in_words() -> None:
    cell = Cell()
    arm = connected(cell)
    cell.joints._q = START + 1e-3  # moved by hand between the last feedback and the first point
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 0.5, lambda: motion.settled)
    assert motion.state is MotionState.FAILED
    assert "does not start where the arm stands" in motion.problem
    serve(arm, cell, 0.1)
    again = arm.follow(swing(arm.state().q, CHANGE))
    serve(arm, cell, 2.0, lambda: again.settled)
    assert again.state is MotionState.DONE


@pytest.mark.parametrize(
    ("happen", "words"),
    [
        (MotomanEmulator.press_e_stop, "emergency stop"),
        (MotomanEmulator.turn_to_teach, "teach mode|play mode"),
        (lambda controller: controller.raise_alarm(4107), "alarm"),
    ],
)
def test_a_fault_fails_the_motion_and_stays_latched(
    happen: Callable[[MotomanEmulator], None], words: str
) -> None:
    cell = Cell()
    arm = connected(cell)
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 0.5)
    happen(cell.controller)
    serve(arm, cell, 0.2)
    assert (motion.state, motion.settled) == (MotionState.FAILED, True)
    assert re.search(words, motion.problem)
    with pytest.raises(DeviceFault, match=words):
        arm.check()
    stood = cell.joints.measured()[0]
    cell.controller.e_stopped = cell.controller.teach = False
    serve(arm, cell, 1.0)
    with pytest.raises(DeviceFault):
        arm.check()  # released, but nobody acknowledged
    arm.acknowledge()
    with pytest.raises(MotionRefused, match="being made ready"):
        arm.follow(swing(arm.state().q, CHANGE))
    serve(arm, cell, 1.0)
    arm.check()
    assert np.array_equal(cell.joints.measured()[0], stood)  # nothing went on by itself
    again = arm.follow(swing(arm.state().q, -CHANGE * 0.1))
    serve(arm, cell, 2.0, lambda: again.settled)
    assert again.state is MotionState.DONE


def test_acknowledging_while_the_emergency_stop_is_pressed_brings_the_fault_back() -> None:
    cell = Cell()
    arm = connected(cell)
    cell.controller.press_e_stop()
    serve(arm, cell, 0.1)
    arm.acknowledge()
    serve(arm, cell, 0.1)
    with pytest.raises(DeviceFault, match="emergency stop"):
        arm.check()


@pytest.mark.parametrize(
    ("flag", "value", "words"),
    [
        ("e_stopped", True, "emergency stop"),
        ("teach", True, "PLAY"),
        ("remote", False, "REMOTE"),
        ("hold", True, "hold"),
    ],
)
def test_a_controller_that_is_not_ready_is_refused_at_the_connection(
    flag: str, value: bool, words: str
) -> None:
    cell = Cell()
    setattr(cell.controller, flag, value)
    with pytest.raises(DeviceFault, match=words):
        connected(cell)
    assert all(connection.closed for connection in cell.opened)


def test_a_hold_at_the_pendant_ends_the_motion_and_nothing_moves_before_an_acknowledgement() -> (
    None
):
    cell = Cell()
    arm = connected(cell)
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 0.4)
    cell.controller.inject_fault("hold")
    held = cell.joints.measured()[0].copy()
    serve(arm, cell, 0.3)
    assert motion.state is MotionState.FAILED
    rested = cell.joints.measured()[0].copy()
    assert np.abs(rested - held).max() < 0.05
    trail: list[Any] = []

    def look() -> bool:
        trail.append(cell.joints.measured()[0].copy())
        return False

    serve(arm, cell, 0.3, look)
    cell.controller.clear_fault()
    serve(arm, cell, 0.5, look)
    with pytest.raises(DeviceFault, match="hold button"):
        arm.check()
    with pytest.raises(MotionRefused, match="hold button"):
        arm.follow(swing(arm.state().q, CHANGE))
    arm.acknowledge()
    serve(arm, cell, 1.0, look)
    arm.check()
    assert np.abs(np.array(trail) - rested).max() < 1e-9
    again = arm.follow(swing(arm.state().q, 0.1 * CHANGE))
    serve(arm, cell, 3.0, lambda: again.settled)
    assert again.state is MotionState.DONE


def test_servos_are_not_switched_on_when_the_options_forbid_it() -> None:
    cell = Cell()
    with pytest.raises(DeviceFault, match="servos are off"):
        connected(cell, servo_on=False)
    assert not cell.controller.drives_on


def test_a_pulled_cable_is_seen_within_100_ms() -> None:
    cell = Cell()
    arm = connected(cell)
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 0.4)
    cell.controller.silent = True
    pulled = cell.clock.now()
    serve(arm, cell, 1.0, lambda: arm.link() != "ok")
    assert cell.clock.now() - pulled <= 0.100
    assert motion.state is MotionState.FAILED
    for call in (arm.state, arm.check, arm.acknowledge):
        with pytest.raises(DeviceLost):
            call()


@pytest.mark.parametrize(("held_up", "goes_on"), [(0.1, True), (0.4, False), (5.0, False)])
def test_an_arm_that_came_to_rest_because_this_computer_was_held_up_does_not_go_on_by_itself(
    held_up: float, goes_on: bool
) -> None:
    cell = Cell()
    arm = connected(cell)
    motion = arm.follow(swing(START, CHANGE, 2.0))
    serve(arm, cell, 0.8)
    cell.let_pass(held_up)
    rested = cell.joints.measured()[0]
    serve(arm, cell, 0.5)
    moved = float(np.abs(cell.joints.measured()[0] - rested).max())
    if goes_on:
        assert motion.state is MotionState.RUNNING
        assert moved > 0.05
        return
    assert motion.state is MotionState.FAILED
    assert moved < 1e-9
    with pytest.raises(DeviceFault, match="the computer or the connection was delayed"):
        arm.check()
    with pytest.raises(MotionRefused):
        arm.follow(swing(rested, -CHANGE, 2.0))
    arm.acknowledge()
    serve(arm, cell, 0.5)
    back = arm.follow(swing(cell.joints.measured()[0], -0.1 * CHANGE, 2.0))
    serve(arm, cell, 3.0, until=lambda: back.settled)
    assert back.state is MotionState.DONE


def test_a_motion_connection_that_breaks_while_nothing_moves_is_seen_at_once() -> None:
    cell = Cell()
    arm = connected(cell)
    serve(arm, cell, 0.1)
    motion = cell.opened[1]
    assert motion.port is cell.controller.motion
    motion.broken = True
    serve(arm, cell, 0.02)
    with pytest.raises(DeviceLost, match="broken"):
        arm.check()


def test_a_reconnection_repeats_the_handshake_and_does_not_go_on_to_the_old_target() -> None:
    cell = Cell()
    arm = connected(cell)
    arm.follow(swing(START, CHANGE))
    serve(arm, cell, 0.4)
    cell.cut = True
    serve(arm, cell, 0.3)
    assert all(connection.closed for connection in cell.opened)
    cell.let_pass(1.0)
    stood = cell.joints.measured()[0]
    cell.cut = False
    serve(arm, cell, RECONNECT + 0.5)
    assert len(cell.opened) == 4
    with pytest.raises(DeviceLost):
        arm.check()
    with pytest.raises(MotionRefused, match="not ready"):
        arm.follow(swing(stood, CHANGE))
    arm.acknowledge()
    serve(arm, cell, 1.0)
    arm.check()
    assert np.array_equal(cell.joints.measured()[0], stood)
    assert arm.state().q == pytest.approx(stood, abs=1e-6)


def test_bytes_of_the_wrong_order_are_nonsense() -> None:
    with pytest.raises(Nonsense, match="byte order"):
        connected(Cell(">"), controller="dx200")


def test_a_safe_stop_decelerates_and_is_latched() -> None:
    cell = Cell()
    arm = connected(cell)
    motion: Motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 0.4)
    arm.safe_stop("test")
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert motion.state is MotionState.STOPPED
    with pytest.raises(MotionRefused, match="latched in the safe state"):
        arm.follow(swing(arm.state().q, -0.1 * CHANGE))
    arm.acknowledge()
    arm.follow(swing(arm.state().q, -0.1 * CHANGE))


@pytest.mark.parametrize(
    ("kind", "within", "problem", "words"),
    [
        ("busy", 1.2, DeviceFault, "has not continued the motion"),
        ("stuck", 0.6, DeviceError, "does not follow|although the arm is to move"),
        ("frozen", 0.6, DeviceError, "does not follow|although the arm is to move"),
        ("nan", 0.1, Nonsense, "answered nonsense"),
        ("wild", 0.1, DeviceLost, r"at 1e\+30 rad, far outside its range"),
        ("no_status", 0.4, DeviceLost, "has not sent its status for"),
        ("nonsense", 0.1, Nonsense, "answered nonsense"),
    ],
)
def test_silent_faults_are_noticed_and_the_arm_comes_to_rest(
    kind: str, within: float, problem: type[DeviceError], words: str
) -> None:
    cell = Cell()
    arm = connected(cell)
    motion = arm.follow(swing(START, CHANGE, duration=4.0, samples=201))
    serve(arm, cell, 1.5)
    arm.check()
    cell.controller.inject_fault(kind)
    before = cell.clock.now()
    serve(arm, cell, 120.0, lambda: arm.link() != "ok")
    assert cell.clock.now() - before <= within
    with pytest.raises(problem, match=words):
        arm.check()
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert (motion.state, motion.settled) == (MotionState.FAILED, True)
    assert re.search(words, motion.problem)
    serve(arm, cell, 1.0)
    stood = cell.joints.measured()[0]
    serve(arm, cell, 2.0)
    assert np.array_equal(cell.joints.measured()[0], stood)
    with pytest.raises(MotionRefused):
        arm.follow(swing(stood, CHANGE))


@pytest.mark.parametrize("kind", ["nan", "frozen"])
def test_feedback_that_lies_lets_the_arm_brake_on_its_path_within_its_limits(kind: str) -> None:
    cell = Cell()
    arm = connected(cell)
    motion = arm.follow(swing(START, CHANGE, duration=2.0))
    serve(arm, cell, 0.8)
    cell.controller.inject_fault(kind)
    speeds = []
    drive = cell.joints.drive
    cell.joints.drive = lambda q, qd: (speeds.append(qd), drive(q, qd))[1]  # type: ignore[method-assign,func-returns-value]
    serve(arm, cell, 4.0, lambda: motion.settled)
    serve(arm, cell, 0.1)
    q, qd = cell.joints.measured()
    share = (q - START) / CHANGE
    assert np.abs(share - share[0]).max() < 1e-4
    assert np.all(qd == 0.0)
    if (
        kind == "nan"
    ):  # what is frozen may also be an arm that does not follow, which is stopped at once
        assert (
            np.abs(np.diff(np.array(speeds), axis=0)) / 0.001
        ).max() < 2.0 * LIMITS.acceleration[0]


def test_an_arm_that_still_lies_cannot_be_acknowledged_and_one_that_lied_moves_only_after_that() -> (
    None
):
    cell = Cell()
    arm = connected(cell)
    cell.controller.inject_fault("wild")
    serve(arm, cell, 0.2)
    with pytest.raises(DeviceLost, match="still lost: its feedback is implausible"):
        arm.acknowledge()
    cell.controller.clear_fault()
    serve(arm, cell, 0.2)
    with pytest.raises(DeviceLost):
        arm.check()
    with pytest.raises(MotionRefused, match="not ready"):
        arm.follow(swing(START, CHANGE))
    arm.acknowledge()
    serve(arm, cell, 1.0)
    arm.check()
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 3.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE


def test_an_emergency_stop_is_not_hidden_by_a_missing_status() -> None:
    cell = Cell()
    arm = connected(cell)
    cell.controller.inject_fault("no_status")
    cell.controller.e_stopped = True
    serve(arm, cell, 0.4)
    with pytest.raises(DeviceLost, match="has not sent its status"):
        arm.check()


def test_many_threads_at_once_never_touch_the_wire_and_never_break_the_driver() -> None:
    cell = Cell()
    cell.clock = SystemClock()  # type: ignore[assignment]
    cell.let_pass = lambda seconds, until=lambda: False: cell.controller.advance(cell.clock.now())  # type: ignore[method-assign]
    arm = connected(
        cell,
        silence=5.0,
        supervision=Supervision(status=2.0, stall=5.0, margin=30.0, following_error=0.5),
    )
    touched: set[str] = set()
    received = cell.controller.motion.received

    def receive(peer: Any, chunk: bytes) -> None:
        touched.add(threading.current_thread().name)
        received(peer, chunk)

    cell.controller.motion.received = receive  # type: ignore[method-assign]
    wrong: list[BaseException] = []
    end = cell.clock.now() + 2.0

    def ask(seed: int) -> None:
        rng = np.random.default_rng(seed)
        ways = (arm.check, arm.settled, arm.pause, arm.resume, arm.acknowledge, arm.state, arm.link)
        motions = []
        while cell.clock.now() < end:
            try:
                if rng.random() < 0.2:
                    motions.append(
                        arm.follow(swing(arm.state().q, CHANGE * rng.uniform(-0.1, 0.1)))
                    )
                elif motions and rng.random() < 0.2:
                    motions[-1].stop()
                elif rng.random() < 0.05:
                    arm.safe_stop(f"by {seed}")
                else:
                    ways[rng.integers(len(ways))]()
            except DeviceError:
                pass
            except BaseException as error:
                wrong.append(error)
                return

    threads = [threading.Thread(target=ask, args=(seed,)) for seed in range(4)]
    arm.start()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    assert touched == {"arm owner"}
    arm.safe_stop("the end")
    deadline = cell.clock.now() + 5.0
    while not arm.settled() and cell.clock.now() < deadline:
        cell.clock.advance(0.01)
    assert arm.settled()
    stood = cell.joints.measured()[0]
    cell.clock.advance(0.3)
    assert np.array_equal(
        cell.joints.measured()[0], stood
    )  # latched: nothing that was asked before goes on
    arm._owner.check()
    arm.close()


def test_a_slower_arm_takes_longer_and_a_change_on_the_way_keeps_the_path_and_the_limits() -> None:
    cell = Cell()
    arm = connected(cell)
    arm.go_at(0.5)
    seen = []
    drive = cell.joints.drive
    cell.joints.drive = lambda q, qd: (seen.append(q), drive(q, qd))[1]  # type: ignore[method-assign,func-returns-value]
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 1.0)
    assert 0.3 < motion.progress < 0.6
    arm.go_at(0.1)
    serve(
        arm, cell, 8.0, lambda: motion.settled
    )  # far beyond the time that was planned, and no fault
    arm.check()
    assert (motion.state, motion.progress) == (MotionState.DONE, 1.0)
    assert cell.clock.now() > 50.0 + 4.0
    share = (np.array(seen) - START) / CHANGE
    assert np.abs(share - share[:, :1]).max() < 1e-4
    assert cell.controller.gaps == 0
