"""The simulated arm follows within limits, stops and pauses on its path, and refuses invalid commands."""

import numpy as np
import pytest

from pomona.drivers.errors import DeviceError, DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.interfaces import Arm, MotionState, Trajectory
from pomona.drivers.trajectory import START_TOLERANCE

HERE = np.array([-1.36, -0.316, -0.264, -0.234, 0.065, -1.294, 0.048])
THERE = HERE + np.array([0.8, 0.3, -0.2, 0.3, 0.4, 0.5, -0.9])


@pytest.fixture
def cell(open_cell):
    return open_cell(seed=1)


@pytest.fixture
def arm(cell):
    return cell.device(Arm)


def advance(cell, duration, each=lambda: None):
    for _ in range(round(duration / 0.01)):
        cell.clock.advance(0.01)
        each()


def run_out(cell, motion, limit=10.0):
    start = cell.clock.now()
    while not motion.settled:
        cell.clock.advance(0.01)
        assert cell.clock.now() - start < limit


def distance_to_path(q, path):
    return np.linalg.norm(path - q, axis=1).min()


def test_it_arrives_and_lags_little(cell, arm, plan_rest_to_rest):
    path = plan_rest_to_rest([HERE, THERE], arm.limits, share=0.9)
    motion = arm.follow(path)
    assert motion.state is MotionState.RUNNING
    worst = 0.0
    while cell.clock.now() < path.duration:
        cell.clock.advance(0.01)
        wanted = np.array([np.interp(cell.clock.now(), path.t, path.q[:, j]) for j in range(7)])
        worst = max(worst, np.abs(arm.state().q - wanted).max())
    run_out(cell, motion, 0.5)
    assert motion.state is MotionState.DONE
    assert motion.progress == 1.0
    assert worst < 0.02
    assert np.abs(arm.state().q - THERE).max() < 3e-3
    assert not arm.state().moving


@pytest.mark.parametrize("when", [0.1, 0.35, 0.6])
def test_stop_decelerates_on_the_path_within_the_limits(cell, arm, plan_rest_to_rest, when):
    path = plan_rest_to_rest([HERE, THERE], arm.limits, share=1.0)
    motion = arm.follow(path)
    advance(cell, when)
    motion.stop()
    asked = [arm._set_point.copy()]
    while not motion.settled:
        cell.clock.advance(0.002)
        asked.append(arm._set_point.copy())
        assert distance_to_path(asked[-1], path.q) < 0.01
    assert motion.state is MotionState.STOPPED
    assert 0.0 < motion.progress < 1.0
    acceleration = np.diff(asked, n=2, axis=0) / 0.002**2
    assert np.all(np.abs(acceleration).max(axis=0) < 1.15 * arm.limits.acceleration)
    stood = arm.state().q
    advance(cell, 0.3)
    assert np.abs(arm.state().q - stood).max() < 2e-3


@pytest.mark.parametrize("stiffness", [1e3, 5e3, 2e4])
def test_an_arm_that_is_stopped_against_something_presses_on_it_no_longer_and_can_go_back(
    cell, arm, plan_rest_to_rest, stiffness
):
    world = cell.devices["world"]
    joint, dof = (
        world.model.jnt_qposadr[world.arm_joints][0],
        world.model.jnt_dofadr[world.arm_joints][0],
    )
    path = plan_rest_to_rest([HERE, THERE], arm.limits, share=0.06)
    way = np.sign(path.q[-1, 0] - path.q[0, 0])
    wall, pressed = path.q[len(path.q) // 2, 0], []

    def push_back():
        pressed.append(stiffness * max(way * (world.state.qpos[joint] - wall), 0.0))
        world.state.qfrc_applied[dof] = -way * pressed[-1]

    world.before_step.append(push_back)
    motion = arm.follow(path)
    while not pressed or pressed[-1] < 100.0:
        advance(cell, 0.02)
    motion.stop()
    run_out(cell, motion, 2.0)
    assert motion.state is MotionState.STOPPED, motion.problem
    advance(cell, 0.3)
    assert max(pressed) > 60.0
    assert pressed[-1] < 0.5 * max(pressed)
    set_point = world.state.ctrl[world.arm_actuators]
    assert np.abs(arm.state().q - set_point).max() < 0.75 * START_TOLERANCE, (
        "the next motion may be refused"
    )
    again = arm.follow(plan_rest_to_rest([arm.state().q, HERE], arm.limits, share=0.3))
    run_out(cell, again)
    assert again.state is MotionState.DONE


def test_an_arm_that_a_branch_holds_beside_its_set_point_begins_the_next_path_without_a_jump(
    cell, arm, plan_rest_to_rest
):
    world, joint = cell.devices["world"], 5
    dof = world.model.jnt_dofadr[world.arm_joints][joint]
    stood = world.state.ctrl[world.arm_actuators].copy()
    world.state.qfrc_applied[dof] = 12.0  # N·m: 25 N at the hand
    advance(cell, 0.5)
    held = arm.state().q
    assert START_TOLERANCE < abs(held[joint] - stood[joint]) < 3.0 * START_TOLERANCE
    with pytest.raises(DeviceFault, match="joint 6 moves without a command of this run"):
        arm.check()
    arm.acknowledge()
    motion = arm.follow(plan_rest_to_rest([held, THERE], arm.limits, share=0.8))
    commanded = [stood]
    while not motion.settled:
        cell.clock.advance(0.002)
        commanded.append(arm._set_point.copy())
        if motion.progress > 0.5:
            world.state.qfrc_applied[dof] = 0.0
    assert motion.state is MotionState.DONE
    steps = np.diff(commanded, axis=0) / 0.002
    assert (np.abs(steps).max(axis=0) < arm.limits.velocity).all()
    assert (np.abs(np.diff(steps, axis=0)).max(axis=0) / 0.002 < arm.limits.acceleration).all()
    assert np.abs(arm.state().q - THERE).max() < 3e-3


def test_a_loaded_arm_whose_feedback_has_jumped_stands_still(cell, arm, plan_rest_to_rest):
    world = cell.devices["world"]
    dofs = world.model.jnt_dofadr[world.arm_joints]
    world.state.qfrc_applied[dofs] = 1.0  # N·m, of a fruit in the hand
    advance(cell, 0.3)
    motion = arm.follow(plan_rest_to_rest([arm.state().q, THERE], arm.limits, share=0.9))
    advance(cell, 0.3)
    arm.inject_fault("jump")
    advance(cell, 1.0)
    assert motion.settled
    assert np.abs(world.state.qvel[dofs]).max() < 2e-3


def test_pause_holds_and_resume_finishes_the_path(cell, arm, plan_rest_to_rest):
    path = plan_rest_to_rest([HERE, THERE], arm.limits)
    motion = arm.follow(path)
    advance(cell, 0.4)
    cell.pause()
    advance(cell, 1.0)
    assert motion.state is MotionState.PAUSED
    assert not motion.settled
    assert cell.settled()
    stood = arm.state().q
    advance(cell, 0.5)
    assert np.abs(arm.state().q - stood).max() < 1e-4
    cell.resume()
    run_out(cell, motion)
    assert motion.state is MotionState.DONE
    assert np.abs(arm.state().q - THERE).max() < 3e-3


def test_safe_stop_latches_until_acknowledged(cell, arm, plan_rest_to_rest):
    motion = arm.follow(plan_rest_to_rest([HERE, THERE], arm.limits))
    advance(cell, 0.3)
    cell.safe_stop("operator")
    cell.safe_stop("later")
    assert cell.latched == "operator"
    run_out(cell, motion, 1.0)
    assert motion.state is MotionState.STOPPED
    assert cell.settled()
    back = plan_rest_to_rest([arm._set_point, HERE], arm.limits)
    with pytest.raises(MotionRefused, match="operator"):
        arm.follow(back)
    cell.acknowledge()
    assert cell.latched is None
    stood = arm.state().q
    advance(cell, 0.2)
    assert np.abs(arm.state().q - stood).max() < 1e-3  # nothing resumes by itself
    run_out(cell, arm.follow(back))


def test_resume_is_refused_when_the_arm_was_moved(cell, arm, plan_rest_to_rest):
    arm.follow(plan_rest_to_rest([HERE, THERE], arm.limits))
    advance(cell, 0.3)
    cell.pause()
    advance(cell, 0.8, cell.check)
    cell.devices["world"].state.qpos[1] += 0.05
    with pytest.raises(DeviceFault, match=r"moved by .*°"):
        cell.resume()


def test_a_second_trajectory_is_refused_while_the_first_runs(cell, arm, plan_rest_to_rest):
    path = plan_rest_to_rest([HERE, THERE], arm.limits)
    arm.follow(path)
    advance(cell, 0.1)
    with pytest.raises(MotionRefused, match="still moves"):
        arm.follow(path)


def spoil(path, **changes):
    return Trajectory(
        **{name: changes.get(name, getattr(path, name)) for name in ("t", "q", "qd", "qdd")}
    )


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (lambda p: {"q": p.q + 0.01}, "starts .* away from the arm"),
        (lambda p: {"qd": p.qd * 9.0}, "velocity of joint"),
        (lambda p: {"qdd": p.qdd * 9.0}, "acceleration of joint"),
        (lambda p: {"t": p.t[::-1].copy()}, "increase from 0"),
        (lambda p: {"q": p.q[:, :6]}, "samples of 7 joints"),
        (lambda p: {"q": np.where(p.t[:, None] > p.t[-1] / 2, np.nan, p.q)}, "not a finite number"),
        (lambda p: {"t": p.t / 20.0}, "jerk of joint"),
        (lambda p: {"qd": p.qd + 0.01}, "at rest"),
        (lambda p: {"q": p.q + np.linspace(0, 3.0, len(p.t))[:, None]}, "its limits are|jumps"),
        (lambda p: {"qd": p.qd * 0.0}, "do not belong"),
        (lambda p: {"q": np.where(p.t[:, None] > p.t[-1] / 2, p.q + 0.2, p.q)}, "joint 1 jumps"),
    ],
)
def test_a_bad_trajectory_is_refused_and_nothing_moves(cell, arm, plan_rest_to_rest, changes, says):
    path = plan_rest_to_rest([HERE, THERE], arm.limits, share=0.9)
    coarse = Trajectory(path.t[::19], path.q[::19], path.qd[::19], path.qdd[::19])
    before = arm.state().q
    with pytest.raises(MotionRefused, match=says):
        arm.follow(spoil(coarse, **changes(coarse)))
    for _ in range(10):
        advance(cell, 0.01)
        assert np.abs(arm.state().q - before).max() < 1e-4


def test_an_alarm_stops_the_arm_and_is_reported(cell, arm, plan_rest_to_rest):
    motion = arm.follow(plan_rest_to_rest([HERE, THERE], arm.limits))
    advance(cell, 0.3)
    arm.inject_fault("alarm")
    with pytest.raises(DeviceFault, match="alarm"):
        cell.check()
    assert cell.links()["arm"] == "the controller reports an alarm"
    run_out(cell, motion, 1.0)
    assert motion.state is MotionState.FAILED
    assert "alarm" in motion.problem
    arm.inject_fault("lost")
    with pytest.raises(DeviceLost):
        cell.check()
    with pytest.raises(ValueError, match="faults alarm, lost"):
        arm.inject_fault("explode")


@pytest.mark.parametrize(
    ("kind", "within", "problem", "words"),
    [
        ("nan", 0.05, DeviceLost, "not finite"),
        ("wild", 0.05, DeviceLost, r"at 1e\+30 rad, far outside its range"),
        ("jump", 0.05, DeviceLost, r"joint 1 jumped by 3\d\.\d°"),
        ("frozen", 0.5, DeviceError, "although the arm is to move|does not follow"),
        ("stuck", 0.5, DeviceError, "although the arm is to move|does not follow"),
        ("stall", 0.6, DeviceFault, "has not continued the motion"),
    ],
)
def test_an_arm_that_lies_or_does_not_go_on_is_noticed_and_comes_to_rest(
    cell, arm, plan_rest_to_rest, kind, within, problem, words
):
    motion = arm.follow(plan_rest_to_rest([HERE, THERE], arm.limits, share=0.3))
    advance(cell, 0.8)
    cell.check()
    arm.inject_fault(kind)
    with pytest.raises(problem, match=words):
        advance(cell, within, cell.check)
    cell.safe_stop("the check found it")
    run_out(cell, motion, 3.0)
    assert motion.state is MotionState.FAILED
    stood = cell.devices["world"].state.qpos[:7].copy()
    advance(cell, 1.0)
    assert np.abs(cell.devices["world"].state.qpos[:7] - stood).max() < 1e-3
    assert np.isfinite(arm.state().q).all()
    if kind in ("nan", "wild", "jump", "frozen"):
        with pytest.raises(DeviceLost, match="still lost"):
            cell.acknowledge()
    arm.clear_fault()
    cell.acknowledge()
    cell.check()
    again = arm.follow(plan_rest_to_rest([arm.state().q, HERE], arm.limits, share=0.3))
    run_out(cell, again)
    assert again.state is MotionState.DONE


def test_slowed_down_on_the_way_it_keeps_the_path_and_the_limits_and_arrives(
    cell, arm, plan_rest_to_rest
):
    path = plan_rest_to_rest([HERE, THERE], arm.limits, share=1.0)
    motion = arm.follow(path)
    advance(cell, 0.35)
    cell.set_speed(0.2)
    asked = [arm._set_point.copy()]
    while not motion.settled:
        cell.clock.advance(0.002)
        asked.append(arm._set_point.copy())
        assert distance_to_path(asked[-1], path.q) < 0.01
        assert cell.clock.now() < 20.0
    cell.check()
    assert motion.state is MotionState.DONE
    assert cell.clock.now() > path.duration + 1.0
    acceleration = np.diff(asked, n=2, axis=0) / 0.002**2
    assert np.all(np.abs(acceleration).max(axis=0) < 1.15 * arm.limits.acceleration)
