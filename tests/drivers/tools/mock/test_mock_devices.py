"""Mock devices follow their scripts, on one clock."""

import numpy as np
import pytest

from pomona.drivers.errors import DeviceLost, MotionRefused
from pomona.drivers.interfaces import (
    Arm,
    Camera,
    ForceSensor,
    Frame,
    Gripper,
    Intrinsics,
    MotionState,
    Trajectory,
)
from pomona.tools.mock import MockArm, MockCamera, MockClock, MockGripper, spring_fruit


def sweep(joint=0, angle=0.5, duration=2.0):
    """A rest-to-rest motion of one joint."""
    t = np.linspace(0.0, duration, 101)
    x = t / duration
    q, qd, qdd = (np.zeros((101, 7)) for _ in range(3))
    q[:, joint] = angle * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    qd[:, joint] = angle * 30.0 * x**2 * (1.0 - x) ** 2 / duration
    qdd[:, joint] = angle * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / duration**2
    return Trajectory(t, q, qd, qdd)


def frame(label):
    intrinsics = Intrinsics(600.0, 600.0, 4.0, 3.0, 8, 6)
    return Frame(0.0, 0, np.zeros((6, 8, 3), np.uint8), None, intrinsics, None, np.eye(4), label)


def test_fixtures_are_the_interfaces(mock_devices, mock_cell):
    for interface in (Arm, Gripper, ForceSensor, Camera):
        assert isinstance(mock_devices[interface], interface)
        assert mock_cell.device(interface) is mock_devices[interface]


def test_an_arm_follows_and_records(mock_arm, mock_clock):
    path = sweep()
    motion = mock_arm.follow(path)
    mock_clock.advance(1.0)
    assert motion.state is MotionState.RUNNING
    assert motion.progress == pytest.approx(0.5, abs=0.01)
    assert mock_arm.q[0] == pytest.approx(0.25, abs=1e-3)
    assert mock_arm.state().moving
    mock_clock.advance(1.1)
    assert motion.state is MotionState.DONE
    assert mock_arm.q[0] == pytest.approx(0.5)
    assert mock_arm.followed == [path]


def test_an_arm_stops_pauses_and_latches_as_a_real_one(mock_arm, mock_clock, mock_cell):
    motion = mock_arm.follow(sweep())
    mock_clock.advance(0.5)
    mock_cell.pause()
    mock_clock.advance(0.5)
    assert motion.state is MotionState.PAUSED
    assert mock_cell.settled()
    mock_cell.resume()
    mock_clock.advance(0.3)
    mock_cell.safe_stop("operator")
    mock_clock.advance(0.5)
    assert motion.state is MotionState.STOPPED
    assert motion.settled
    with pytest.raises(MotionRefused, match="operator"):
        mock_arm.follow(sweep())


def test_an_arm_refuses_and_fails_on_request(mock_arm, mock_clock, mock_cell):
    mock_arm.refuse_next("servo off")
    with pytest.raises(MotionRefused, match="servo off"):
        mock_arm.follow(sweep())
    mock_arm.fail_at(0.3, "overload")
    motion = mock_arm.follow(sweep())
    mock_clock.advance(2.0)
    assert motion.state is MotionState.FAILED
    assert motion.problem == "overload"
    assert 0.3 <= motion.progress < 0.7
    mock_arm.fail_check(DeviceLost("arm", "cable"))
    with pytest.raises(DeviceLost, match="cable"):
        mock_cell.check()
    assert mock_cell.links()["arm"] == "cable"
    mock_arm.fail_check(None)
    mock_cell.check()


def test_an_arm_refuses_bad_trajectories_as_a_real_one():
    arm = MockArm(MockClock(), q=np.full(7, 0.3))
    with pytest.raises(MotionRefused, match="away from the arm"):
        arm.follow(sweep())


def test_an_arm_that_does_not_know_where_it_stands_does_not_move():
    clock = MockClock()
    arm = MockArm(clock)
    arm.q[3] = np.nan
    stood = arm.q.copy()
    with pytest.raises(MotionRefused, match="the arm's position is unknown"):
        arm.follow(sweep())
    for _ in range(50):
        clock.advance(0.02)
        np.testing.assert_array_equal(arm.q, stood)


def test_an_arm_that_lies_is_found_as_a_real_one_is(mock_arm, mock_clock, mock_cell):
    mock_clock.advance(0.1)
    mock_cell.check()
    mock_arm.says = lambda q: q * np.nan
    mock_clock.advance(0.02)
    with pytest.raises(DeviceLost, match="its joints are not finite numbers"):
        mock_cell.check()


def test_a_gripper_moves_streams_and_has_a_watchdog(mock_gripper, mock_clock):
    motion = mock_gripper.move(0.05, 0.1)
    mock_clock.advance(0.6)
    assert motion.state is MotionState.DONE
    assert mock_gripper.width == pytest.approx(0.05)
    mock_gripper.set_speed(0.02)
    mock_clock.advance(1.0)
    assert mock_gripper.width == pytest.approx(0.05 + 0.02 * 0.1, abs=1e-4)
    assert [speed for _, speed in mock_gripper.speeds] == [0.02]


def test_a_gripper_that_meets_something_fails_its_move():
    clock = MockClock()
    gripper = MockGripper(clock, blocked_at=0.07)
    motion = gripper.move(0.05, 0.1)
    clock.advance(1.0)
    assert motion.state is MotionState.FAILED
    assert "70.0 mm" in motion.problem


@pytest.mark.parametrize(("width", "speed"), [(0.01, 0.1), (0.05, 0.0), (float("nan"), 0.1)])
def test_a_gripper_refuses_impossible_commands(mock_gripper, width, speed):
    with pytest.raises(MotionRefused):
        mock_gripper.move(width, speed)
    mock_gripper.refuse_next("not referenced")
    with pytest.raises(MotionRefused, match="not referenced"):
        mock_gripper.move(0.05, 0.1)


def test_fingers_feel_a_spring_between_the_pads(mock_fingers, mock_gripper, mock_clock):
    mock_fingers.feel = spring_fruit(mock_gripper, width=0.08, stiffness=2000.0)
    samples = []
    mock_fingers.subscribe(samples.append)
    mock_gripper.move(0.078, 0.1)
    mock_clock.advance(0.5)
    assert samples[0].wrenches[:, 2] == pytest.approx([0.0, 0.0])
    assert samples[-1].wrenches[:, 2] == pytest.approx([-2.0, -2.0])
    assert [sample.sequence for sample in samples] == list(range(1, 251))


def test_fingers_lose_samples_and_count_on(mock_fingers, mock_clock):
    samples = []
    subscription = mock_fingers.subscribe(samples.append)
    mock_clock.advance(0.01)
    mock_fingers.lose(0.02)
    mock_clock.advance(0.04)
    assert [sample.sequence for sample in samples] == [*range(1, 6), *range(16, 26)]
    subscription.close()
    mock_clock.advance(0.1)
    assert len(samples) == 15


def test_a_camera_shows_its_frames_in_order():
    clock = MockClock()
    camera = MockCamera(frame("a"), frame("b"), clock=clock)
    clock.advance(1.0)
    assert [camera.latest().label for _ in range(3)] == ["a", "b", "b"]
    assert camera.latest().stamp == pytest.approx(1.0)
    camera.show(frame("c"))
    assert camera.latest().label == "c"
    assert camera.looks == 5
    assert MockCamera().latest() is None


def test_a_move_that_its_skill_stopped_is_not_awaited_any_more():
    clock = MockClock()
    gripper = MockGripper(clock, 0.1)
    motion = gripper.move(0.05, 0.02)
    clock.advance(0.5)
    motion.stop()
    for _ in range(100):
        clock.advance(0.1)
        gripper.check()
