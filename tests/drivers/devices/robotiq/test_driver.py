"""The gripper's driver against the emulated gripper, byte for byte, on a clock that the test moves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pomona.devices.laboratory_emulators.robotiq import RobotiqEmulator
from pomona.devices.robotiq.driver import RECONNECT, RobotiqGripper
from pomona.devices.robotiq.options import MODELS, RobotiqFile
from pomona.devices.robotiq.session import RtuSession, UrcapSession
from pomona.drivers import (
    DeviceFault,
    DeviceLost,
    GripperLimits,
    GripperState,
    MotionRefused,
    MotionState,
)
from pomona.executive import ManualClock
from tests.drivers.conformance.grippers import robotiq
from tests.drivers.devices.motoman.test_driver import Connection


class Fingers:
    """Fingers that obey at once, and an elastic fruit between them."""

    def __init__(self, cell: Cell, stroke: float) -> None:
        self.limits = GripperLimits(0.0, stroke, 1.0, 300.0)
        self.width, self.speed, self.fruit, self.stiffness = stroke, 0.0, 0.0, 3000.0
        self._cell, self._then = cell, cell.clock.now()

    @property
    def force(self) -> float:
        """Of one pad [N]; each moves by half."""
        return max(self.fruit - self.width, 0.0) / 2.0 * self.stiffness

    def state(self) -> GripperState:
        return GripperState(self._cell.clock.now(), self.width, self.speed, False, 2.0 * self.force)

    def set_speed(self, speed: float) -> None:
        self.speed = speed

    def move(self, width: float, speed: float) -> Any:
        raise NotImplementedError

    def advance(self, now: float) -> None:
        """Move until now."""
        self.width = min(
            max(self.width + self.speed * (now - self._then), 0.0), self.limits.width_max
        )
        self._then = now


class Cell:
    def __init__(self, model: str = "hand-e", activated: bool = True) -> None:
        self.clock = ManualClock(20.0)
        self.cut = False
        self.fingers = Fingers(self, MODELS[model].stroke)
        self.gripper = RobotiqEmulator(self.fingers, model, activated)
        self.opened: list[Connection] = []

    def open(self, port: Any) -> Connection:
        if self.cut:
            raise ConnectionRefusedError("nobody answers")
        connection = Connection(self, port)  # type: ignore[arg-type]
        self.opened.append(connection)
        return connection

    def let_pass(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.clock.now() + seconds
        while not until() and self.clock.now() < end - 1e-9:
            self.clock.advance(0.001)
            self.fingers.advance(self.clock.now())
            self.gripper.advance(self.clock.now())


WAYS = ("rtu", "urcap")


def built(cell: Cell, way: str = "rtu", **options: Any) -> RobotiqGripper:
    session = RtuSession if way == "rtu" else UrcapSession
    silence = 0.06 if way == "rtu" else 0.3
    said = RobotiqFile(**{"model": "hand-e", "silence": silence, **options})
    return RobotiqGripper(
        lambda: session(cell.open(getattr(cell.gripper, way)), cell.clock), cell.clock, said
    )


def connected(cell: Cell, way: str = "rtu", **options: Any) -> RobotiqGripper:
    gripper = built(cell, way, **options)
    gripper.connect()
    return gripper


def serve(
    gripper: RobotiqGripper, cell: Cell, seconds: float, until: Callable[[], bool] = lambda: False
) -> None:
    end = cell.clock.now() + seconds
    while cell.clock.now() < end and not until():
        before = cell.clock.now()
        try:
            gripper.step()
        except (OSError, DeviceLost) as error:
            gripper._failed(error)
        if cell.clock.now() == before:
            cell.let_pass(0.001)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("model", MODELS)
def test_a_move_ends_at_its_width(model: str, way: str) -> None:
    cell = Cell(model)
    gripper = connected(cell, way, model=model, finger_offset=0.02)
    stroke = MODELS[model].stroke
    assert gripper.state().width == pytest.approx(stroke + 0.02, abs=1e-3)
    width = 0.02 + 0.4 * stroke
    move = gripper.move(width, 0.05)
    serve(gripper, cell, 5.0, lambda: move.settled)
    assert (move.state, move.problem) == (MotionState.DONE, "")
    assert cell.fingers.width == pytest.approx(0.4 * stroke, abs=gripper.limits.step)
    gripper.check()


@pytest.mark.parametrize("stays", [True, False])
def test_a_web_server_in_the_place_of_the_urcap_is_named(stays: bool) -> None:
    cell = Cell()

    class Web:
        def connected(self, peer: Any) -> None: ...

        def received(self, peer: Any, chunk: bytes) -> None:
            peer.send(b"HTTP/1.1 400 Bad Request\r\n\r\n<html>\r\n</html>\r\n")
            if not stays:
                peer.close()

        def disconnected(self, peer: Any) -> None: ...

        def flush(self) -> None: ...

    cell.gripper.urcap = Web()  # type: ignore[assignment]
    with pytest.raises(DeviceLost, match=r"a web server \(HTTP\) answers there"):
        connected(cell, "urcap")


@pytest.mark.parametrize("way", WAYS)
def test_a_gripper_that_another_program_moves_is_refused(way: str) -> None:
    cell = Cell()
    cell.gripper.write(0, bytes([9, 0, 0, 230, 255, 0]))  # one command, on the way
    cell.let_pass(0.02)
    with pytest.raises(
        DeviceFault, match="moves without a command of this run: another program moves it"
    ):
        connected(cell, way)
    assert cell.gripper.written == bytes([9, 0, 0, 230, 255, 0])


def test_of_two_programs_on_a_urcap_each_sees_the_other_s_commands_and_the_fingers_stop() -> None:
    cell = Cell()
    first, second = connected(cell, "urcap"), connected(cell, "urcap")

    def serve_both(seconds: float) -> None:
        end = cell.clock.now() + seconds
        while cell.clock.now() < end:
            serve(first, cell, 0.004)
            serve(second, cell, 0.004)

    for one, other in ((first, second), (second, first)):
        serve_both(0.3)
        motion = one.move(cell.fingers.width - 0.020, 0.05)
        serve_both(1.0)
        assert motion.state is MotionState.FAILED
        rested = cell.fingers.width
        serve_both(0.5)
        assert cell.fingers.width == rested
        for gripper in (one, other):
            with pytest.raises(DeviceFault, match="another program commands it: only one may"):
                gripper.check()
            gripper.acknowledge()


def test_a_move_slower_than_the_gripper_s_slowest_speed_advances_in_steps() -> None:
    cell = Cell()
    gripper = connected(cell)
    start = cell.clock.now()
    move = gripper.move(0.045, 0.004)
    serve(gripper, cell, 4.0, lambda: move.settled)
    assert move.state is MotionState.DONE
    assert 1.0 < cell.clock.now() - start < 1.8  # 5 mm at 4 mm/s


def test_fingers_that_meet_a_fruit_press_with_the_least_force_and_hold() -> None:
    cell = Cell()
    gripper = connected(cell)
    cell.fingers.fruit = 0.030
    move = gripper.move(0.010, 0.05)
    serve(gripper, cell, 3.0, lambda: move.settled)
    assert move.state is MotionState.FAILED
    assert "blocked" in move.problem
    assert gripper.state().motor_force == pytest.approx(40.0)
    assert 20.0 <= cell.fingers.force < 21.0
    assert cell.gripper.peak < 21.0
    serve(gripper, cell, 2.0)
    assert 20.0 <= cell.fingers.force < 21.0
    gripper.safe_stop("test")
    serve(gripper, cell, 1.0)
    assert 20.0 <= cell.fingers.force < 21.0


@pytest.mark.parametrize(("stiffness", "goal"), [(3000.0, 2.0), (3000.0, 4.0), (1500.0, 2.0)])
def test_streamed_speeds_hold_a_force_far_below_the_least_one(
    stiffness: float, goal: float
) -> None:
    cell = Cell()
    gripper = connected(cell)
    cell.fingers.fruit, cell.fingers.stiffness = 0.030, stiffness
    peak = 0.0
    for _ in range(800):
        force = cell.fingers.force
        gripper.set_speed(float(np.clip((force - goal) * 0.004, -0.02, 0.02)))
        serve(gripper, cell, 0.01)
        peak = max(peak, cell.fingers.force)
    step = 0.5 * gripper.limits.step * stiffness  # of the force
    assert cell.fingers.force == pytest.approx(goal, abs=1.5 * step)
    assert peak < goal + 4.0 * step
    assert (
        gripper.state().motor_force is None
    )  # fingers that hold below their limit report no force
    gripper.check()


@pytest.mark.parametrize("speed", [0.005, 0.02, 0.06, 0.12])
def test_a_streamed_speed_is_followed(speed: float) -> None:
    cell = Cell()
    gripper = connected(cell)
    start, count = cell.fingers.width, round(0.03 / speed / 0.01)
    for _ in range(count):
        gripper.set_speed(-speed)
        serve(gripper, cell, 0.01)
    streamed = 0.01 * count * speed
    assert start - cell.fingers.width == pytest.approx(
        streamed, abs=2.0 * gripper.limits.step + 0.05 * speed
    )
    gripper.check()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    ("fault", "told"),
    [("silent", "does not answer for"), ("hot", "too hot"), ("inactive", "not activated")],
)
def test_a_fault_is_latched_and_nothing_resumes(fault: str, told: str, way: str) -> None:
    cell = Cell()
    gripper = connected(cell, way)
    move = gripper.move(0.010, 0.02)
    serve(gripper, cell, 0.5)
    cell.gripper.inject_fault(fault)
    began = cell.clock.now()
    serve(gripper, cell, 1.0, lambda: gripper._problem is not None)
    assert cell.clock.now() - began <= (0.08 if way == "rtu" else 0.35)
    with pytest.raises((DeviceFault, DeviceLost), match=told):
        gripper.check()
    assert move.state is MotionState.FAILED
    with pytest.raises(MotionRefused):
        gripper.move(0.04, 0.02)
    trail: list[float] = []

    def look() -> bool:
        trail.append(cell.fingers.width)
        return False

    if fault == "silent":  # a stop reaches it when it answers again
        cell.gripper.clear_fault()
        serve(gripper, cell, RECONNECT + 0.2)
    else:
        serve(gripper, cell, 0.5)
        cell.gripper.clear_fault()
    serve(gripper, cell, 2.0, look)
    if fault == "inactive":
        cell.gripper.write(0, bytes([1, 0, 0, 0, 0, 0]))  # the operator activates it
        serve(gripper, cell, 0.5, look)
    gripper.acknowledge()
    serve(gripper, cell, 0.5, look)
    assert np.ptp(trail) < 1e-4
    assert trail[0] > 0.010 + 2e-3  # on the way
    again = gripper.move(0.04, 0.05)
    serve(gripper, cell, 3.0, lambda: again.settled)
    assert (again.state, again.problem) == (MotionState.DONE, "")


@pytest.mark.parametrize("way", WAYS)
def test_a_gripper_that_was_switched_off_is_called_so_and_no_command_activates_it(
    way: str,
) -> None:
    cell = Cell()
    gripper = closing(cell, way)
    cell.gripper.inject_fault("silent")
    serve(gripper, cell, RECONNECT + 0.4)
    cell.gripper.write(0, bytes(6))
    cell.gripper.clear_fault()
    serve(gripper, cell, 2.0)
    gripper.acknowledge()
    serve(gripper, cell, 0.2)
    with pytest.raises(DeviceFault, match="is not activated, as after its power was off"):
        gripper.check()
    assert cell.gripper.written == bytes(6)
    assert gripper.settled()


def test_noise_on_the_line_is_repeated_and_only_noise_is_a_loss() -> None:
    cell = Cell()
    gripper = connected(cell)
    cell.gripper.inject_fault("noise")
    serve(gripper, cell, 0.02)
    cell.gripper.clear_fault()
    serve(gripper, cell, 0.2)
    gripper.check()
    cell.gripper.inject_fault("noise")
    serve(gripper, cell, 0.2)
    with pytest.raises(DeviceLost, match=r"check sum|does not answer"):
        gripper.check()


def test_a_cut_wire_is_opened_again_and_waits_for_an_acknowledgement() -> None:
    cell = Cell()
    gripper = connected(cell)
    gripper.move(0.010, 0.02)
    serve(gripper, cell, 0.3)
    cell.cut = True
    cell.opened[-1].broken = True

    serve(gripper, cell, 0.01)
    with pytest.raises(DeviceLost, match="wire failed"):
        gripper.check()
    cell.cut = False
    serve(gripper, cell, RECONNECT + 0.5)
    gripper.acknowledge()
    gripper.check()


def test_an_activation_that_moves_the_fingers_needs_to_be_allowed() -> None:
    cell = Cell(activated=False)
    with pytest.raises(DeviceFault, match="--cleared"):
        connected(cell)
    assert cell.gripper.written == bytearray(6)
    connected(cell, activate=True).check()
    assert cell.gripper.activation == 3


@pytest.mark.parametrize("way", WAYS)
def test_a_gripper_that_does_not_answer_is_refused(way: str) -> None:
    cell = Cell()
    cell.gripper.inject_fault("silent")
    with pytest.raises(DeviceLost, match="does not answer within 1 s"):
        connected(cell, way)
    assert all(connection.closed for connection in cell.opened)


def closing(cell: Cell, way: str, to: float = 0.005) -> RobotiqGripper:
    """A gripper whose fingers are on their way."""
    gripper = connected(cell, way)
    gripper.move(to, 0.03)
    serve(gripper, cell, 0.3)
    assert cell.fingers.speed < 0.0
    return gripper


@pytest.mark.parametrize("way", ["rtu", "urcap"])
@pytest.mark.parametrize("way_of_fingers", ["rest", "close", "open"])
@pytest.mark.parametrize("off", [0.0, 0.03])
def test_a_gripper_that_was_switched_off_and_on_says_so_with_the_remedy(
    way: str, way_of_fingers: str, off: float
) -> None:
    bench = robotiq("hand-e", way)
    bench.serve(0.5)
    if way_of_fingers != "rest":
        bench.begin(way_of_fingers)
    gripper: Any = bench.harms["hot"]
    bench.harm("dead", off)
    gripper.written[:] = bytes(6)
    gripper.activation = 0
    bench.heal()
    bench.serve(0.3)
    with pytest.raises(DeviceFault, match=r"is not activated, as after its power was off: .*yes"):
        bench.device.check()
