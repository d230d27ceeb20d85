"""The cell's safe stop, pause and checks, on mock devices that fail."""

import threading

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault, MotionRefused
from pomona.drivers.interfaces import Arm, Gripper, MotionState, Trajectory, WrenchSample
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.device import Device
from pomona.executive.clock import ManualClock, SystemClock
from pomona.tools.mock import MockArm, MockClock, MockForceSensor, MockGripper


class Stubborn(Device):
    """A device whose every reaction fails."""

    def safe_stop(self, reason):
        raise RuntimeError("broken")

    def close(self):
        raise OSError("broken")


@pytest.fixture
def cell():
    clock = MockClock()
    gripper = MockGripper(clock)
    devices = {
        "stubborn": Stubborn("stubborn"),
        "arm": MockArm(clock),
        "gripper": gripper,
        "fingers": MockForceSensor(clock),
    }
    return Cell("test", "mock", clock, devices)


def stands(cell, seconds=0.2):
    """Advance the time; the arm and the fingers stand at each moment of it."""
    arm, gripper = cell.devices["arm"], cell.devices["gripper"]
    q, width = arm.q.copy(), gripper.width
    for _ in range(round(seconds / 0.01)):
        cell.clock.advance(0.01)
        np.testing.assert_array_equal(arm.q, q)
        assert gripper.width == width


def swing(q, change=0.4):
    """One second from rest to rest, each joint by the same angle."""
    t = np.linspace(0.0, 1.0, 101)
    x = np.repeat(t[:, None], len(q), axis=1)
    return Trajectory(
        t, q + change * x**3 * (10 - 15 * x + 6 * x**2), change * 30.0 * x**2 * (1 - x) ** 2,
        change * 60.0 * x * (1 - x) * (1 - 2 * x),
    )  # fmt: skip


def test_one_device_that_fails_to_stop_does_not_keep_the_others_moving(cell):
    motion = cell.devices["gripper"].move(0.05, 0.01)
    cell.safe_stop("fire")
    assert motion.settled
    assert cell.latched == "fire"


def test_safe_stop_may_come_from_any_thread(cell):
    threads = [threading.Thread(target=cell.safe_stop, args=(f"thread {i}",)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert cell.latched.startswith("thread ")


def test_a_latched_cell_does_not_resume(cell):
    gripper = cell.devices["gripper"]
    gripper.move(0.05, 0.01)
    cell.clock.advance(0.1)
    cell.pause()
    cell.safe_stop("fire")
    cell.clock.advance(0.1)
    cell.resume()  # the stop ended the pause: there is nothing to resume
    stood = gripper.width
    for _ in range(50):
        cell.clock.advance(0.02)
        assert gripper.width == stood
    assert stood > 0.06
    cell.acknowledge()
    cell.pause()
    cell._latched = "fire"
    with pytest.raises(DeviceFault, match="acknowledge it first"):
        cell.resume()


def test_a_paused_cell_notices_that_the_arm_was_moved(cell):
    cell.pause()
    cell.clock.advance(0.1)
    cell.check()
    cell.devices["arm"].q += 0.02
    with pytest.raises(DeviceFault, match="arm: was moved by 1"):
        cell.resume()
    cell.devices["arm"].q -= 0.02
    cell.resume()


def test_a_paused_cell_notices_that_the_fruit_is_gone(cell):
    fingers = cell.devices["fingers"]
    held = np.zeros((2, 6))
    held[:, 2] = -2.0
    fingers.feel = lambda _now: held
    cell.clock.advance(0.1)
    cell.pause()
    cell.check()
    held[1, 2] = 0.0
    cell.clock.advance(0.1)
    with pytest.raises(DeviceFault, match="gone"):
        cell.resume()


def test_a_paused_cell_does_not_go_on_with_joints_or_forces_that_are_no_numbers(cell):
    fingers = cell.devices["fingers"]
    held = np.zeros((2, 6))
    held[:, 2] = -2.0
    fingers.feel = lambda _now: held
    arm = cell.devices["arm"]
    motion = arm.follow(swing(arm.q))
    cell.clock.advance(0.4)
    cell.pause()
    cell.clock.advance(0.6)  # it brakes
    cell.check()
    q = arm.q.copy()
    stands(cell)
    fingers.give(WrenchSample(cell.clock.now(), 10_000, np.full((2, 6), np.nan)))
    with pytest.raises(DeviceFault, match="gone"):
        cell.resume()
    stands(cell)
    arm.q[2] = np.nan
    with pytest.raises(DeviceFault, match="was moved by nan"):
        cell.resume()
    stands(cell)
    arm.q[:] = q
    cell.resume()
    stands(cell)
    assert motion.state is MotionState.FAILED
    assert 0.01 < q[0] < 0.39


def test_closing_goes_on_when_a_device_fails(cell):
    cell.close()


def test_a_sensor_that_somebody_distrusts_ends_the_run_until_it_is_acknowledged():
    device = Device("fingers")
    cell = Cell("test", "mock", MockClock(), {"fingers": device})
    cell.check()
    device.distrust("the left finger's samples do not change")
    device.distrust("something else")
    with pytest.raises(DeviceFault, match="fingers: the left finger's samples do not change"):
        cell.check()
    cell.safe_stop("fingers: …")
    cell.acknowledge()
    cell.check()


class Escaping(Device):
    """A device that tries to end the process from its safe stop and from its closing."""

    def safe_stop(self, reason):
        raise SystemExit(0)

    def close(self):
        raise KeyboardInterrupt


class Silent(Device):
    """A device that takes a safe stop only when it is let go."""

    def __init__(self, name):
        super().__init__(name)
        self.free = threading.Event()

    def safe_stop(self, reason):
        self.free.wait()


def test_a_device_that_tries_to_leave_keeps_no_other_from_being_stopped_and_closed():
    clock = MockClock()
    gripper = MockGripper(clock)
    cell = Cell("test", "mock", clock, {"gripper": gripper, "escaping": Escaping("escaping")})
    motion = gripper.move(0.05, 0.01)
    assert cell.safe_stop("fire") == {"escaping": "did not take the safe stop: SystemExit: 0"}
    assert motion.settled
    with pytest.raises(DeviceFault, match="did not take the safe stop"):
        cell.check()
    cell.close()


def test_on_a_real_clock_a_device_that_does_not_answer_keeps_no_other_from_being_stopped(
    monkeypatch,
):
    monkeypatch.setattr("pomona.executive.cell.cell.STOPPING", 0.05)
    silent, gripper = Silent("silent"), MockGripper(MockClock())
    motion = gripper.move(0.05, 0.01)
    cell = Cell("test", "real", SystemClock(), {"silent": silent, "gripper": gripper})
    assert cell.safe_stop("fire") == {"silent": "has not taken the safe stop within 0.05 s"}
    assert motion.settled
    silent.free.set()


def test_a_stop_that_comes_after_an_acknowledgement_latches_its_device_with_the_reason(monkeypatch):
    monkeypatch.setattr("pomona.executive.cell.cell.STOPPING", 0.05)
    clock = MockClock()
    gripper, free, stopped = MockGripper(clock), threading.Event(), threading.Event()
    stop = gripper.safe_stop

    def late(reason):
        free.wait(5.0)
        stop(reason)
        stopped.set()

    gripper.safe_stop = late
    cell = Cell("test", "real", SystemClock(), {"gripper": gripper})
    assert "gripper" in cell.safe_stop("fire")
    cell.acknowledge()
    free.set()
    assert stopped.wait(5.0)
    with pytest.raises(MotionRefused, match="fire"):
        gripper.move(0.05, 0.01)


def test_without_another_thread_devices_are_stopped_one_after_the_other(monkeypatch):
    def none_left(_thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("threading.Thread.start", none_left)
    gripper = MockGripper(MockClock())
    motion = gripper.move(0.05, 0.01)
    cell = Cell(
        "test", "real", SystemClock(), {"escaping": Escaping("escaping"), "gripper": gripper}
    )
    assert cell.safe_stop("fire") == {"escaping": "did not take the safe stop: SystemExit: 0"}
    assert motion.settled


class StillLost(Device):
    """A device that cannot be acknowledged."""

    lost = True

    def acknowledge(self):
        if self.lost:
            raise DeviceFault("arm", "is still lost")


def test_a_device_that_refuses_the_acknowledgement_keeps_all_in_the_safe_state():
    clock = MockClock()
    gripper, lost = MockGripper(clock), StillLost("arm")
    cell = Cell("test", "mock", clock, {"gripper": gripper, "arm": lost})
    cell.safe_stop("fire")
    with pytest.raises(DeviceFault, match="still lost"):
        cell.acknowledge()
    assert cell.latched == "fire"
    with pytest.raises(MotionRefused):
        gripper.move(0.05, 0.01)
    lost.lost = False
    cell.acknowledge()
    assert cell.latched is None


def test_a_stop_during_an_acknowledgement_wins():
    clock, stops = MockClock(), []
    gripper = MockGripper(clock)
    cell = Cell("test", "mock", clock, {"gripper": gripper})
    acknowledge = gripper.acknowledge

    def interrupted():
        stops.append(threading.Thread(target=cell.safe_stop, args=("hand in the cell",)))
        stops[0].start()  # it waits for the devices until they are acknowledged
        acknowledge()

    gripper.acknowledge = interrupted
    cell.safe_stop("fire")
    cell.acknowledge()
    stops[0].join()
    assert cell.latched
    with pytest.raises(MotionRefused, match="latched"):
        gripper.move(0.05, 0.01)


def test_a_safe_stop_ends_a_pause_for_good(cell):
    cell.pause()
    cell.safe_stop("fire")
    cell.acknowledge()
    cell.devices["gripper"].move(0.05, 0.2)
    assert not cell.settled()
    cell.clock.advance(1.0)
    assert cell.settled()
    assert cell.devices["gripper"].width == pytest.approx(0.05)


def test_a_slower_cell_slows_the_arm_that_moves_and_the_next_path():
    clock = MockClock()
    arm = MockArm(clock)
    cell = Cell("test", "mock", clock, {"arm": arm, "gripper": MockGripper(clock)})
    t = np.linspace(0.0, 2.0, 201)
    x = (t / 2.0)[:, None]
    change = np.full(7, 0.5)
    path = Trajectory(
        t, change * x**3 * (10 - 15 * x + 6 * x**2), change * 15.0 * x**2 * (1 - x) ** 2,
        change * 15.0 * x * (1 - x) * (1 - 2 * x),
    )  # fmt: skip
    motion = arm.follow(path)
    clock.advance(1.0)
    cell.set_speed(0.25, (Gripper,))  # not the arm's
    cell.set_speed(0.5)
    clock.advance(1.3)
    assert motion.state is MotionState.RUNNING
    clock.advance(1.0)
    assert motion.state is MotionState.DONE
    back = Trajectory(path.t, path.q[::-1].copy(), -path.qd, path.qdd[::-1].copy())
    motion = arm.follow(back)
    clock.advance(3.9)
    assert motion.state is MotionState.RUNNING
    clock.advance(0.3)
    assert motion.state is MotionState.DONE


@pytest.mark.parametrize("speed", [0.0, -1.0, 1.01, float("nan")])
def test_a_cell_never_goes_faster_than_it_is_commanded(cell, speed):
    with pytest.raises(ValueError, match="above 0 and at most 1"):
        cell.set_speed(speed)


def test_an_arm_whose_driver_knows_no_speed_is_named_and_refused():
    class FixedArm(Device):
        interfaces = (Arm,)

    arm = FixedArm("arm")
    cell = Cell("test", "mock", MockClock(), {"arm": arm, "gripper": MockGripper(MockClock())})
    assert cell.full_speed_only == ("arm",)
    cell.set_speed(1.0)
    cell.set_speed(0.5, (Gripper,))
    with pytest.raises(DeviceFault, match="cannot reduce"):
        cell.set_speed(0.5)


def test_a_slower_cell_moves_no_finger():
    """A gripper has a `set_speed` of its own, which streams a rate of its opening."""
    clock = MockClock()
    gripper = MockGripper(clock)
    cell = Cell("test", "mock", clock, {"arm": MockArm(clock), "gripper": gripper})
    before = gripper.state().width
    cell.set_speed(0.5)
    cell.set_speed(1.0, (Arm, Gripper))
    clock.advance(0.2)
    assert gripper.state().width == before


def test_a_clock_that_goes_back_is_a_fault_that_is_named():
    clock = ManualClock(10.0)
    cell = Cell("test", "mock", clock, {})
    clock.advance(1.0)
    cell.check()
    clock._now -= 5.0
    with pytest.raises(DeviceFault, match=r"clock: the cell's time went back by 5 s"):
        cell.check()
    cell.check()
