"""The arm's driver against the emulated controller, byte for byte, on a clock that the test moves."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.devices.emulators.motoman import FreeJoints
from pomona.devices.laboratory_emulators.universal_robots import UrEmulator
from pomona.devices.universal_robots.dashboard import WrongArmError
from pomona.devices.universal_robots.driver import UrArm
from pomona.devices.universal_robots.options import UrFile
from pomona.devices.universal_robots.rtde import RegisterTakenError
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

DOF = 6
LIMITS = ArmLimits(
    -np.full(DOF, 6.0),
    np.full(DOF, 6.0),
    np.full(DOF, 3.14),
    np.full(DOF, 10.0),
    np.full(DOF, 200.0),
)
START = np.array([0.1, -1.5, 1.4, -1.3, -1.5, 0.7])
CHANGE = np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.6])


class Cell:
    """The controller on a clock that the test moves; `cut` is the network cable."""

    def __init__(self) -> None:
        self.clock = ManualClock(50.0)
        self.cut = False
        self.joints = FreeJoints(START)
        self.controller = UrEmulator(self.joints, LIMITS.velocity)
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


def arm_of(cell: Cell, **options: Any) -> UrArm:
    said = UrFile(**{"address": "ur", "model": "ur5e", "robot": Path("robot.xml"), **options})
    return UrArm(cell.open, cell.clock, LIMITS, said)


def connected(cell: Cell, **options: Any) -> UrArm:
    arm = arm_of(cell, **options)
    arm.connect()
    return arm


def serve(
    arm: UrArm, cell: Cell, seconds: float, until: Callable[[], bool] = lambda: False
) -> None:
    end = cell.clock.now() + seconds
    while cell.clock.now() < end and not until():
        before = cell.clock.now()
        arm.step()
        if cell.clock.now() == before:
            cell.let_pass(0.001)


def moving(cell: Cell, arm: UrArm) -> Motion:
    """A motion on its way."""
    motion: Motion = arm.follow(swing(arm.state().q, CHANGE))
    serve(arm, cell, 0.6)
    assert motion.state is MotionState.RUNNING
    assert np.abs(cell.joints.measured()[1]).max() > 0.5
    return motion


def assert_never_resumes(cell: Cell, arm: UrArm, seconds: float = 1.0) -> None:
    serve(arm, cell, 0.5)
    q = cell.joints.measured()[0]
    for _ in range(20):
        serve(arm, cell, seconds / 20.0)
        assert np.abs(cell.joints.measured()[0] - q).max() < 1e-5


def test_a_trajectory_is_followed_to_its_end() -> None:
    cell = Cell()
    arm = connected(cell)
    motion = arm.follow(swing(START, CHANGE))
    assert not arm.settled()
    serve(arm, cell, 0.6)
    assert motion.state is MotionState.RUNNING
    serve(arm, cell, 1.5, lambda: motion.settled)
    assert (motion.state, motion.problem, motion.progress) == (MotionState.DONE, "", 1.0)
    assert arm.settled()
    assert arm.state().q == pytest.approx(START + CHANGE, abs=2e-3)
    second = arm.follow(swing(arm.state().q, -CHANGE))
    serve(arm, cell, 2.0, lambda: second.settled)
    assert (second.state, second.problem) == (MotionState.DONE, "")
    arm.close()
    assert all(connection.closed for connection in cell.opened)


def test_the_arm_passes_its_knots_at_their_times() -> None:
    cell = Cell()
    arm = connected(cell)
    due: list[tuple[float, np.ndarray]] = []
    command = arm._supervisor.command
    arm._supervisor.command = lambda at, q: (due.append((at, q)), command(at, q))[1]  # type: ignore[method-assign]
    seen: list[tuple[float, np.ndarray]] = []
    drive = cell.joints.drive
    cell.joints.drive = lambda q, qd: (seen.append((cell.clock.now(), q)), drive(q, qd))[1]  # type: ignore[method-assign]
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, 2.0, lambda: motion.settled)
    times = np.array([at for at, _ in seen])
    joints = np.array([q for _, q in seen])
    late = []
    for at, q in due[10:-10]:
        near = np.abs(joints - q).max(axis=1).argmin()
        late.append(times[near] - at)
    assert -0.01 < min(late) <= max(late) < 0.06


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
    arm.check()


def stopped_after(
    seconds: float, late: float = 0.0, held: tuple[float, float] = (0.0, 0.0), **options: Any
) -> tuple[Cell, UrArm, Motion, np.ndarray]:
    """An arm that was stopped at a time after its start, and where it went from then on, (cycles, 6) [rad].

    The network holds all messages to the controller for `late` from the stop on, or the computer is held up after
    `held[0]` for `held[1]` [s].
    """
    cell = Cell()
    arm = connected(cell, **options)
    motion = arm.follow(swing(START, CHANGE))
    serve(arm, cell, seconds)
    way = [cell.joints.measured()[0]]
    drive, rtde, free, sent = (
        cell.joints.drive,
        cell.opened[0],
        cell.clock.now() + late,
        list[bytes](),
    )
    send, advance = rtde.send, cell.controller.advance

    def deliver(now: float) -> None:
        while sent and free <= now:
            send(sent.pop(0))
        advance(now)

    cell.joints.drive = lambda q, qd: (way.append(q), drive(q, qd))[1]  # type: ignore[method-assign]
    cell.controller.advance = deliver  # type: ignore[method-assign]
    rtde.send = sent.append  # type: ignore[method-assign]
    motion.stop()
    serve(arm, cell, held[0])
    cell.let_pass(held[1])
    serve(arm, cell, 2.0, lambda: motion.settled)
    return cell, arm, motion, np.array(way)


def test_a_stop_does_not_wait_for_knots_that_were_sent() -> None:
    ways = []
    for lead in (0.12, 0.5):
        _, _, motion, way = stopped_after(0.6, lead=lead)
        assert motion.state is MotionState.STOPPED
        speed = np.linalg.norm(np.diff(way, axis=0), axis=1)
        slower = int(np.argmax(speed < 0.97 * speed[:10].max()))
        assert 0.002 * slower < 0.1  # the servo's lag included; it was 0.18 s with a lead of 0.12 s
        ways.append(np.linalg.norm(way[-1] - way[0]))
    assert ways[1] == pytest.approx(ways[0], rel=0.05)


@pytest.mark.parametrize("seconds", np.linspace(0.0, 1.25, 26))
def test_a_stop_at_any_time_brakes_on_the_path_within_the_limits(seconds: float) -> None:
    cell, arm, motion, way = stopped_after(seconds)
    assert motion.state in (MotionState.STOPPED, MotionState.DONE)
    arm.check()
    done = (way - START) / CHANGE
    assert np.ptp(done, axis=1).max() < 1e-3
    acceleration = np.diff(way, n=2, axis=0) / 0.002**2 if len(way) > 2 else np.zeros(1)
    assert np.abs(acceleration).max() < 1.05 * LIMITS.acceleration[0]
    assert_never_resumes(cell, arm)
    second = arm.follow(swing(arm.state().q, -0.5 * CHANGE))
    serve(arm, cell, 2.0, lambda: second.settled)
    assert second.state is MotionState.DONE


def test_a_knot_that_comes_when_the_arm_is_beyond_the_one_before_stops_the_arm() -> None:
    cell, arm, motion, way = stopped_after(0.6, late=0.07)
    assert (motion.state, cell.controller.program) == (MotionState.FAILED, None)
    with pytest.raises(DeviceFault, match="got a knot too late"):
        arm.check()
    assert np.abs(np.diff(way, n=2, axis=0)).max() / 0.002**2 < 80.0  # as the stop of a script
    assert_never_resumes(cell, arm)


@pytest.mark.parametrize("late", [0.002, 0.008, 0.016])
def test_a_network_that_is_held_up_for_a_moment_does_not_disturb_a_stop(late: float) -> None:
    for seconds in (0.3, 0.45, 0.608, 0.9):
        cell, arm, motion, way = stopped_after(seconds, late=late)
        assert (motion.state, cell.controller.program) == (MotionState.STOPPED, "pomona")
        arm.check()
        assert np.abs(np.diff(way, n=2, axis=0)).max() / 0.002**2 < 1.05 * LIMITS.acceleration[0]


@pytest.mark.parametrize("after", [0.002, 0.01, 0.02, 0.04, 0.08])
def test_a_computer_that_is_held_up_for_50_ms_does_not_disturb_a_stop(after: float) -> None:
    for seconds in (0.3, 0.45, 0.608, 0.9):
        cell, arm, motion, way = stopped_after(seconds, held=(after, 0.05))
        assert (motion.state, cell.controller.program) == (MotionState.STOPPED, "pomona")
        arm.check()
        assert np.abs(np.diff(way, n=2, axis=0)).max() / 0.002**2 < 1.05 * LIMITS.acceleration[0]


@pytest.mark.parametrize("after", [0.02, 0.05, 0.1, 0.15])
def test_a_stop_just_after_a_pause_moves_no_further_than_from_there(after: float) -> None:
    cell = Cell()
    arm = connected(cell)
    motion = moving(cell, arm)
    arm.pause()
    serve(arm, cell, 1.0)
    arm.resume()
    serve(arm, cell, after)
    motion.stop()
    began = cell.joints.measured()[0]
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert motion.state is MotionState.STOPPED
    assert_never_resumes(cell, arm)
    assert np.abs(cell.joints.measured()[0] - began).max() < 0.03
    arm.check()


HARD = {
    "protective": "protective stop",
    "e_stop": "emergency stop",
    "safeguard": "safeguard stop",
    "no_script": "program was stopped",
    "paused": "paused at the pendant",
    "nan": "not finite",
    "wild": "far outside",
    "killed": "connection",
    "silent": "no package for",
    "slow": "no package for",
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
    assert np.abs(cell.joints.measured()[1]).max() < 1e-4
    serve(arm, cell, 1.0, lambda: motion.settled)
    assert motion.state is MotionState.FAILED
    with pytest.raises(MotionRefused):
        arm.follow(swing(START, CHANGE))


def test_another_program_on_the_controller_is_noticed() -> None:
    cell = Cell()
    arm = connected(cell)
    motion = moving(cell, arm)
    cell.controller.inject_fault("replaced")
    serve(arm, cell, 0.2, lambda: arm._problem is not None)
    with pytest.raises(DeviceFault, match="another program has replaced this one"):
        arm.check()
    assert motion.state is MotionState.FAILED
    arm.acknowledge()
    serve(arm, cell, 3.0)
    with pytest.raises(DeviceFault, match="another program runs on it"):
        arm.check()
    assert cell.controller.program == "other"


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("reduced", "reduced mode"),
        ("slider", "slider at 50 %"),
        ("freedrive", "release the freedrive button"),
    ],
)
def test_a_state_in_which_the_arm_would_not_follow_brakes_it_on_its_path(
    fault: str, told: str
) -> None:
    cell = Cell()
    arm = connected(cell)
    motion = moving(cell, arm)
    cell.controller.inject_fault(fault)
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert motion.state is MotionState.FAILED
    assert told in motion.problem
    done = (cell.joints.measured()[0] - START) / CHANGE
    assert np.ptp(done) < 0.02
    arm.acknowledge()
    serve(arm, cell, 0.5)
    with pytest.raises(DeviceFault, match=re.escape(told)):
        arm.check()
    cell.controller.clear_fault()
    arm.acknowledge()
    serve(arm, cell, 0.5)
    arm.check()


def test_after_a_protective_stop_nothing_moves_before_a_new_motion() -> None:
    cell = Cell()
    arm = connected(cell)
    moving(cell, arm)
    cell.controller.inject_fault("protective")
    assert_never_resumes(cell, arm)
    arm.acknowledge()
    serve(arm, cell, 0.5)
    with pytest.raises(DeviceFault, match="until 5s after"):
        arm.check()
    serve(arm, cell, 5.0)
    arm.acknowledge()
    serve(arm, cell, 1.0)
    arm.check()
    assert_never_resumes(cell, arm)
    motion = arm.follow(swing(arm.state().q, -0.5 * CHANGE))
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE


@pytest.mark.parametrize("fault", ["safeguard", "paused", "e_stop"])
def test_a_guard_that_closes_or_a_program_that_is_resumed_moves_nothing(fault: str) -> None:
    cell = Cell()
    arm = connected(cell)
    moving(cell, arm)
    cell.controller.inject_fault(fault)
    serve(arm, cell, 0.5)
    cell.controller.clear_fault()
    assert_never_resumes(cell, arm)
    arm.acknowledge()
    serve(arm, cell, 2.0)
    arm.check()
    assert_never_resumes(cell, arm)
    motion = arm.follow(swing(arm.state().q, -0.5 * CHANGE))
    serve(arm, cell, 2.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE


def test_a_paused_program_is_begun_anew_by_an_acknowledgement() -> None:
    cell = Cell()
    arm = connected(cell)
    moving(cell, arm)
    cell.controller.inject_fault("paused")
    serve(arm, cell, 0.5)
    arm.acknowledge()
    serve(arm, cell, 1.0)
    arm.check()
    assert_never_resumes(cell, arm)


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


def test_a_link_that_returns_at_once_does_not_go_on_with_the_motion() -> None:
    cell = Cell()
    arm = connected(cell)
    moving(cell, arm)
    arm._failed(DeviceLost("arm", "the connection failed"))
    arm._retry_at = cell.clock.now()
    serve(arm, cell, 0.02)
    assert arm._session is not None
    serve(arm, cell, 0.4)
    assert cell.controller.program is None
    assert np.abs(cell.joints.measured()[1]).max() < 1e-4


def test_a_process_that_is_killed_leaves_an_arm_at_rest() -> None:
    cell = Cell()
    arm = connected(cell)
    moving(cell, arm)
    cell.let_pass(0.7)
    assert cell.controller.program is None
    assert np.abs(cell.joints.measured()[1]).max() < 1e-4
    again = arm_of(cell)
    with pytest.raises(
        RegisterTakenError,
        match=r"17 fields, such as input_int_register_24 \(IN_USE\): another run",
    ):
        again.connect()
    cell.controller.rtde.disconnected(cell.opened[0].peer)
    again.connect()
    assert_never_resumes(cell, again)


# ------------------------------------------------------------------------------------------------ bad input


def refusal(cell: Cell, **options: Any) -> str:
    arm = arm_of(cell, **options)
    with pytest.raises(DeviceError) as caught:
        arm.connect()
    text = caught.value.message
    assert "\n" not in text
    assert cell.controller.program is None or cell.controller.program != "pomona"
    assert np.array_equal(cell.joints.measured()[0], START)
    assert all(connection.closed for connection in cell.opened)
    return text


def test_another_model_at_the_address_is_refused() -> None:
    cell = Cell()
    cell.controller.model = "UR10"
    with pytest.raises(WrongArmError, match="is a ur10e, not the ur5e"):
        connected(cell)
    assert "is a ur10e" in refusal(cell)


@pytest.mark.parametrize(
    ("version", "told"),
    [
        ((3, 1, 0, 0), "update PolyScope"),
        ((3, 5, 0, 0), "runs PolyScope 3.5, which"),
        ((5, 4, 3, 0), "runs PolyScope 5.4, which"),
        ((10, 7, 0, 0), "needs 3.12 or a later 3, or 5.6 or a later 5"),
    ],
)
def test_a_controller_of_another_age_is_refused(version: tuple[int, ...], told: str) -> None:
    cell = Cell()
    cell.controller.version = version  # type: ignore[assignment]
    assert told in refusal(cell)


def test_a_cb3_is_known_by_its_model_and_has_no_remote_mode() -> None:
    cell = Cell()
    cell.controller.version, cell.controller.remote = (3, 15, 8, 0), True
    assert "is a ur5, not the ur5e" in refusal(cell)
    connected(cell, model="ur5")


def test_local_control_is_refused() -> None:
    cell = Cell()
    cell.controller.remote = False
    assert "switch it to Remote at the pendant" in refusal(cell)


def test_a_second_run_is_refused_and_the_first_goes_on() -> None:
    cell = Cell()
    first = connected(cell)
    motion = moving(cell, first)
    with pytest.raises(RegisterTakenError, match="another run, another RTDE client"):
        arm_of(cell).connect()
    serve(first, cell, 6.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE


def test_a_register_that_a_field_bus_owns_is_refused_by_its_name() -> None:
    cell = Cell()
    cell.controller.bus = {"input_double_register_30"}
    assert re.search(r"input_double_register_30 \(IN_USE\): .* field bus", refusal(cell))


def test_a_program_that_runs_already_is_left_alone() -> None:
    cell = Cell()
    cell.controller.load("def picker():\n  while True:\n    sync()\n  end\nend\n")
    assert "another program runs on it" in refusal(cell)
    assert cell.controller.program == "picker"
    cell.controller.runtime = 4
    assert "another program runs on it" in refusal(cell)
    assert cell.controller.program == "picker"


@pytest.mark.parametrize(
    "fault", ["protective", "e_stop", "safeguard", "reduced", "slider", "freedrive"]
)
def test_an_arm_in_a_stop_or_another_mode_is_refused_and_not_unlocked(fault: str) -> None:
    cell = Cell()
    cell.controller.inject_fault(fault)
    cell.let_pass(6.0)
    safety = cell.controller.safety
    assert refusal(cell)
    assert cell.controller.safety == safety


def test_the_arm_is_powered_and_its_brakes_released_where_the_options_allow_it() -> None:
    cell = Cell()
    cell.controller.mode = 3
    assert "has no power" in refusal(cell, power_on=False)
    arm = connected(cell)
    arm.check()
    assert cell.controller.mode == 7


def test_a_service_that_is_no_controller_is_refused() -> None:
    cell = Cell()

    class Web:
        def connected(self, peer: Any) -> None:
            peer.send(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        def received(self, peer: Any, chunk: bytes) -> None: ...

        def disconnected(self, peer: Any) -> None: ...

    cell.controller.rtde = Web()  # type: ignore[assignment]
    assert "a web server (HTTP) answers there" in refusal(cell)


def steps_of_set_points(cell: Cell) -> list[float]:
    """Return a list that takes the greatest step from each set-point of servoj to the next [rad]."""
    steps: list[float] = []
    servo, last = cell.controller.servo, [cell.joints.measured()[0]]

    def served(q: np.ndarray, lookahead: float) -> None:
        steps.append(float(np.abs(q - last[0]).max()))
        last[0] = q
        servo(q, lookahead)

    cell.controller.servo = served  # type: ignore[method-assign]
    return steps


@pytest.mark.parametrize(
    ("cycle", "scaling", "lasts"),
    [(0.002, 0.7, 3.0), (0.002, 0.5, 1.5), (0.002, 0.2, 1.5), (0.008, 1.0, 0.0)],
)
def test_the_set_points_keep_the_path_s_speed_whatever_the_controller_does_to_its_own(
    cycle: float, scaling: float, lasts: float
) -> None:
    cell = Cell()
    cell.controller.cycle = cycle
    arm = connected(cell)
    steps = steps_of_set_points(cell)
    motion = arm.follow(swing(START, 0.25 * CHANGE, 5.0))
    serve(arm, cell, 1.0)
    cell.controller.scaling = scaling
    serve(arm, cell, lasts)
    cell.controller.scaling = 1.0
    serve(arm, cell, 20.0, lambda: motion.settled)
    fastest = 0.25 * float(np.abs(CHANGE).max()) * 1.875 / 5.0
    assert max(steps) < 1.3 * fastest * cycle
    assert np.ptp(cell.joints.measured()[0] - START - 0.25 * CHANGE) < 2e-3
    assert motion.state is MotionState.DONE


@pytest.mark.parametrize(("late", "told"), [(0.01, ""), (0.1, "answers more than 80 ms late")])
def test_a_late_connection_is_not_called_another_program(late: float, told: str) -> None:
    cell = Cell()
    opened = cell.open

    def open_late(name: str) -> Connection:
        connection = opened(name)
        connection.late = late if name == "rtde" else 0.0
        return connection

    cell.open = open_late  # type: ignore[method-assign]
    arm = connected(cell)
    serve(arm, cell, 0.5)
    assert told in arm.link() if told else arm.link() == "ok"


@pytest.mark.parametrize("scaling", [0.7, 0.5])
def test_a_controller_that_slows_down_by_itself_ends_a_long_motion(scaling: float) -> None:
    cell = Cell()
    arm = connected(cell)
    cell.controller.scaling = scaling
    motion = arm.follow(swing(START, 0.2 * CHANGE, 5.0))
    serve(arm, cell, 12.0, lambda: motion.settled)
    assert (motion.state, arm.link()) == (MotionState.DONE, "ok")


def test_a_controller_that_slows_down_by_itself_is_named_when_the_arm_does_not_follow() -> None:
    cell = Cell()
    arm = connected(cell)
    moving(cell, arm)
    cell.controller.scaling = 0.7
    stands = cell.joints.measured()[0]
    cell.controller.measured = lambda: (stands + 1e-6 * cell.clock.now(), 0.0 * stands)  # type: ignore[method-assign]
    serve(arm, cell, 1.0)
    assert "goes at 70 % of its speed" in arm.link()


@pytest.mark.parametrize("line", ["x = get_forward_kin()[0]", "movej(7)", "x = 1 / 0", "nothing()"])
def test_an_error_in_a_script_stops_the_program_and_nothing_else(line: str) -> None:
    cell = Cell()
    cell.controller.load(f"def other():\n  sync()\n  {line}\nend\n")
    assert cell.controller.program == "other"
    cell.let_pass(0.1)
    assert cell.controller.program is None
    connected(cell).check()
