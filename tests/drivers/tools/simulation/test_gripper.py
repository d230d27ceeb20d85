"""The simulated gripper: widths, speeds, its watchdog, and a grip that a safe stop does not open."""

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.interfaces import Gripper, MotionState


@pytest.fixture
def cell(open_cell):
    return open_cell(seed=1)


@pytest.fixture
def gripper(cell):
    return cell.device(Gripper)


def run_out(cell, motion, limit=5.0):
    start = cell.clock.now()
    while not motion.settled:
        cell.clock.advance(0.01)
        assert cell.clock.now() - start < limit


def test_limits_are_those_of_the_geometry(gripper):
    assert gripper.limits.width_min == pytest.approx(0.035)
    assert gripper.limits.width_max == pytest.approx(0.103)


@pytest.mark.parametrize("width", [0.035, 0.06, 0.103])
def test_a_move_ends_at_its_width(cell, gripper, width):
    motion = gripper.move(width, 0.2)
    run_out(cell, motion, 1.0)
    assert motion.state is MotionState.DONE
    assert motion.progress == 1.0
    cell.clock.advance(0.1)
    assert gripper.state().width == pytest.approx(width, abs=2e-4)
    assert not gripper.state().moving


def test_the_opening_is_the_distance_between_the_pads(cell, gripper):
    run_out(cell, gripper.move(0.07, 0.1))
    state = cell.devices["world"].state
    distance = np.linalg.norm(state.site("pad_left").xpos - state.site("pad_right").xpos)
    assert gripper.state().width == pytest.approx(distance, abs=2e-4)


def test_a_streamed_speed_is_followed_and_the_watchdog_ends_it(cell, gripper):
    run_out(cell, gripper.move(0.09, 0.2))
    start = gripper.state().width
    for _ in range(10):
        gripper.set_speed(-0.02)
        cell.clock.advance(0.02)
    assert start - gripper.state().width == pytest.approx(0.004, abs=3e-4)
    cell.clock.advance(0.15)
    stopped = gripper.state().width
    assert start - stopped == pytest.approx(0.004 + 0.0020, abs=5e-4)  # 100 ms more, then zero
    cell.clock.advance(0.3)
    assert gripper.state().width == pytest.approx(stopped, abs=1e-4)


def test_a_clock_that_steps_back_does_not_keep_a_streamed_speed(cell, gripper):
    run_out(cell, gripper.move(0.06, 0.2))
    start = gripper.state().width
    gripper.set_speed(0.02)
    cell.clock.advance(0.02)
    cell.clock.steps -= 2500  # 5 s
    cell.clock.advance(1.0)
    assert gripper.state().width - start == pytest.approx(0.0020, abs=3e-4)  # 100 ms of it


@pytest.mark.parametrize("speed", [float("nan"), float("inf"), -float("inf")])
def test_a_speed_that_is_no_number_stands_still(cell, gripper, speed):
    before = gripper.state().width
    gripper.set_speed(speed)
    cell.clock.advance(0.05)
    assert gripper.state().width == pytest.approx(before, abs=1e-4)


@pytest.mark.parametrize(
    ("width", "speed"), [(0.02, 0.1), (0.2, 0.1), (0.05, 0.0), (0.05, 9.0), (float("nan"), 0.1)]
)
def test_a_move_outside_the_limits_is_refused(gripper, width, speed):
    with pytest.raises(MotionRefused):
        gripper.move(width, speed)


def test_a_jam_fails_a_move(cell, gripper):
    gripper.inject_fault("jam")
    motion = gripper.move(0.05, 0.1)
    run_out(cell, motion, 0.5)
    assert motion.state is MotionState.FAILED
    assert "blocked" in motion.problem


def test_fingers_held_just_before_their_width_fail_a_move_instead_of_the_run(cell, gripper):
    run_out(cell, gripper.move(0.05, 0.1))
    state = cell.devices["world"].state
    for finger in ("finger_left", "finger_right"):
        state.joint(finger).qfrc_applied[0] = -4.0  # a millimetre of the drive
    motion = gripper.move(0.08, 0.1)
    start = cell.clock.now()
    while not motion.settled:
        cell.clock.advance(0.01)
        cell.check()
        assert cell.clock.now() - start < 2.0
    assert 0.0785 < gripper.state().width < 0.0799
    assert motion.state is MotionState.FAILED
    assert "blocked at" in motion.problem


def test_fingers_that_something_swaying_holds_open_fail_a_move_instead_of_the_run(cell, gripper):
    """The fingers neither arrive nor rest: without an end of its own such a move ended the run."""
    run_out(cell, gripper.move(0.078, 0.1))
    state = cell.devices["world"].state
    motion = gripper.move(0.0769, 0.1)
    start = cell.clock.now()
    while not motion.settled:
        sway = np.sin(2.0 * np.pi * 10.0 * cell.clock.now())
        for finger in ("finger_left", "finger_right"):
            state.joint(finger).qfrc_applied[0] = 4.0 + 1.5 * sway
        cell.clock.advance(0.002)
        cell.check()
        assert cell.clock.now() - start < 2.0
    assert motion.state is MotionState.FAILED
    assert "blocked at" in motion.problem


def test_a_move_pauses_and_goes_on(cell, gripper):
    motion = gripper.move(0.04, 0.05)
    cell.clock.advance(0.2)
    cell.pause()
    cell.clock.advance(0.1)
    assert cell.settled()
    width = gripper.state().width
    cell.clock.advance(0.3)
    assert gripper.state().width == pytest.approx(width, abs=1e-4)
    assert motion.state is MotionState.PAUSED
    cell.resume()
    run_out(cell, motion)
    assert motion.state is MotionState.DONE


@pytest.mark.parametrize("opening", [0.0, 0.1])
def test_latched_it_refuses_moves_and_does_not_open(cell, gripper, opening):
    run_out(cell, gripper.move(0.06, 0.2))
    cell.clock.advance(0.3)
    gripper.set_speed(opening)
    cell.safe_stop("test")
    with pytest.raises(MotionRefused, match="latched"):
        gripper.move(0.10, 0.1)
    width = gripper.state().width
    for _ in range(50):
        gripper.set_speed(0.1)
        cell.clock.advance(0.02)
    assert gripper.state().width - width < 2e-5  # 20 um: the compliance of the simulated drive
    for _ in range(10):
        gripper.set_speed(-0.02)
        cell.clock.advance(0.02)
    assert width - gripper.state().width > 3e-3  # a grip may close: it is kept
    cell.acknowledge()
    run_out(cell, gripper.move(0.10, 0.2))


def test_lost_it_answers_nothing(cell, gripper):
    gripper.inject_fault("lost")
    for call in (cell.check, lambda: gripper.set_speed(0.01)):
        with pytest.raises(DeviceLost):
            call()
    with pytest.raises(MotionRefused):
        gripper.move(0.05, 0.1)


def look_after(cell, seconds):
    """Let time pass as a run does: the cell is checked every tick."""
    for _ in range(round(seconds / 0.02)):
        cell.clock.advance(0.02)
        cell.check()


def test_moves_streams_and_pauses_are_never_taken_for_faults(cell, gripper):
    for width in (0.05, 0.10, 0.04):
        gripper.move(width, 0.15)
        look_after(cell, 1.0)
    motion = gripper.move(0.09, 0.02)
    look_after(cell, 0.5)
    cell.pause()
    look_after(cell, 5.0)
    cell.resume()
    look_after(cell, 3.0)
    assert motion.state is MotionState.DONE
    for speed in (0.02, -0.03, 0.01, -0.002):
        for _ in range(50):
            gripper.set_speed(speed)
            look_after(cell, 0.02)
    cell.clock.advance(3.0)  # nobody looked meanwhile
    cell.check()


def test_a_move_that_never_ends_is_reported(cell, gripper):
    gripper.inject_fault("busy")
    motion = gripper.move(0.05, 0.1)
    with pytest.raises(
        DeviceFault, match=r"has not ended its move to 50\.0 mm within the expected time"
    ):
        look_after(cell, 2.0)
    assert motion.state is MotionState.FAILED


def test_fingers_that_run_away_are_reported_and_are_not_settled_before_they_rest(cell, gripper):
    run_out(cell, gripper.move(0.06, 0.2))
    look_after(cell, 0.5)
    gripper.inject_fault("runaway")
    with pytest.raises(DeviceFault, match="opens without a command"):
        look_after(cell, 0.2)
    cell.safe_stop("test")
    while not cell.settled():
        before = gripper.state().width
        cell.clock.advance(0.02)
    after = gripper.state().width
    cell.clock.advance(0.1)
    assert after - before < 1e-3
    assert gripper.state().width == pytest.approx(after, abs=5e-4)


@pytest.mark.parametrize(
    ("kind", "error", "words"),
    [
        ("frozen", DeviceLost, "has not sent its width for 60 ms"),
        ("not_a_number", DeviceFault, "a width of nan mm"),
    ],
)
def test_an_impossible_state_is_reported_within_100_ms(cell, gripper, kind, error, words):
    look_after(cell, 0.5)
    gripper.inject_fault(kind)
    with pytest.raises(error, match=words):
        look_after(cell, 0.1)


def test_after_a_loss_nothing_moves_until_it_is_acknowledged(cell, gripper):
    gripper.inject_fault("lost")
    cell.clock.advance(0.1)
    gripper.clear_fault()
    before = gripper.state().width
    with pytest.raises(DeviceLost, match="acknowledge the loss before it moves"):
        gripper.set_speed(-0.05)
    with pytest.raises(MotionRefused, match="acknowledge the loss before it moves"):
        gripper.move(0.05, 0.1)
    for _ in range(10):
        cell.clock.advance(0.01)
        assert gripper.state().width == pytest.approx(before, abs=1e-6)
    cell.acknowledge()
    gripper.set_speed(-0.05)
    cell.clock.advance(0.1)
    assert gripper.state().width < before


def push(cell, force):
    for finger in ("finger_left", "finger_right"):
        cell.devices["world"].state.joint(finger).qfrc_applied[0] = force


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_spindle_holds_a_push_that_is_stronger_than_the_motor(cell, gripper, side):
    run_out(cell, gripper.move(0.07, 0.2))
    push(cell, 150.0 * side)
    cell.clock.advance(0.5)
    most = 4.0 * gripper.limits.force_max / 20000.0  # both fingers, at the stiffness of the drive
    assert abs(gripper.state().width - 0.07) < most + 1e-3
    push(cell, 0.0)
    cell.clock.advance(0.5)
    assert gripper.state().width == pytest.approx(0.07, abs=2e-4)
    assert (
        cell.devices["world"].model.jnt_range[cell.devices["world"].model.joint("finger_left").id][
            0
        ]
        > 0.0
    )


@pytest.mark.parametrize("blocked", [0, 1])
def test_fingers_that_run_away_stop_where_something_holds_one_of_them(cell, gripper, blocked):
    """The spindle moves both: no finger is dragged through a wall by more than the motor's force."""
    run_out(cell, gripper.move(0.07, 0.2))
    finger = cell.devices["world"].state.joint(("finger_left", "finger_right")[blocked])
    gripper.inject_fault("runaway")
    for _ in range(200):
        finger.qfrc_applied[0] = -2.5e4 * max(float(finger.qpos[0]) - 0.0175, 0.0)  # a wall
        cell.clock.advance(0.002)
    assert -finger.qfrc_applied[0] < 1.2 * 2.0 * gripper.limits.force_max


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_blocked_fingers_do_not_snap_when_they_come_free(cell, gripper, side):
    run_out(cell, gripper.move(0.07, 0.2))
    push(cell, -150.0 * side)
    for _ in range(50):
        gripper.set_speed(0.1 * side)
        cell.clock.advance(0.02)
    push(cell, 0.0)
    fastest = 0.0
    for _ in range(100):
        gripper.set_speed(0.0)
        cell.clock.advance(0.002)
        fastest = max(fastest, abs(gripper.state().speed))
    assert fastest < 0.8  # a report of five times 0.2 m/s counts as impossible
    assert (
        abs(gripper.state().width - 0.07) < 8e-3
    )  # the commands of that second are not made up for
