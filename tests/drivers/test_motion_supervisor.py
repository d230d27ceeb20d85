"""The supervisor finds feedback that cannot be true and motions that do not go as they must, and nothing else."""

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault, DeviceLost
from pomona.drivers.interfaces import ArmLimits, MotionState, Trajectory
from pomona.drivers.motion_supervisor import BESIDE, SLOWEST, MotionSupervisor, Supervision
from pomona.drivers.path_motion import PathMotion

DOF = 3
LIMITS = ArmLimits(
    -np.full(DOF, 3.0),
    np.full(DOF, 3.0),
    np.full(DOF, 3.0),
    np.full(DOF, 10.0),
    np.full(DOF, 200.0),
)
CHANGE = np.array([0.8, -0.4, 0.2])
STEP = 0.004
AT_REST = np.zeros(DOF)


def swing(duration=1.0):
    s = np.linspace(0.0, 1.0, 101)[:, None]
    q = CHANGE * (10 * s**3 - 15 * s**4 + 6 * s**5)
    qd = CHANGE * (30 * s**2 - 60 * s**3 + 30 * s**4) / duration
    qdd = CHANGE * (60 * s - 180 * s**2 + 120 * s**3) / duration**2
    return Trajectory(s[:, 0] * duration, q, qd, qdd)


class Rig:
    """An arm that follows `delay` seconds late, under a supervisor; `measured` may lie."""

    def __init__(self, delay=0.05, **supervision):
        self.supervisor = MotionSupervisor("arm", LIMITS, Supervision(**supervision))
        self.motion = PathMotion(swing(), LIMITS, STEP)
        self.now, self.delay = 10.0, delay
        self.went = [(0.0, AT_REST, AT_REST)]
        self.steps = 0
        self.halted = False

    def measured(self):
        return next((q, qd) for due, q, qd in reversed(self.went) if due <= self.now - self.delay)

    def run(self, seconds, feedback=None):
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            if not (self.motion.set_point_rests or self.halted):
                q, qd = self.motion.step()
                self.steps += 1
                self.went.append((self.now, q, qd))
                self.supervisor.command(self.now, q)
            if self.supervisor.due(self.now):
                q, qd = (feedback or self.measured)()
                self.supervisor.on_feedback(self.now, q, qd)
                self.supervisor.look(self.now, self.motion, self.steps)
                if self.motion.set_point_rests:
                    beside = float(np.abs(q - self.went[-1][1]).max())
                    self.motion.look(bool(np.abs(qd).max() < 5e-3), beside, self.now)


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.15])
def test_a_motion_that_is_followed_late_but_well_raises_nothing(delay):
    rig = Rig(delay)
    rig.run(2.0)
    assert rig.motion.settled
    rig.run(100.0)  # at rest, the same feedback for ever


def test_pauses_of_any_length_and_a_stop_raise_nothing():
    rig = Rig()
    for pause in (5.0, 0.1, 15.0):
        rig.run(0.3)
        rig.motion.pause()
        rig.run(min(pause, 0.5))
        came = len(rig.went)
        rig.run(max(pause - 0.5, 0.0))
        assert pause < 0.5 or rig.motion.state is MotionState.PAUSED
        assert len(rig.went) == came  # its set-point stands during the whole pause
        rig.motion.resume()
    rig.run(0.1)
    rig.motion.stop()
    rig.run(0.5)
    came = len(rig.went)
    rig.run(9.5)
    assert len(rig.went) == came
    assert rig.motion.state is MotionState.STOPPED
    done = np.array([q for _now, q, _qd in rig.went]) / CHANGE
    assert np.ptp(done, axis=1).max() < 1e-9  # on its path
    assert (np.diff(done[:, 0]) > -1e-12).all()  # and never back
    assert 0.3 < done[-1, 0] < 0.999


@pytest.mark.parametrize(
    ("q", "qd", "says"),
    [
        ((np.nan, 0, 0), AT_REST, "not finite"),
        ((0, 0, 0), (0, -np.inf, 0), "not finite"),
        ((0, 1e30, 0), AT_REST, "joint 2 at 1e[+]30 rad, far outside its range"),
        ((0, 0, -3.2), AT_REST, "joint 3 at -3.2 rad"),
        ((0, 0, 0), (0, 0, 6.0), "joint 3 at 2 times its largest speed"),
        ((0.5, 0, 0), AT_REST, r"joint 1 jumped by 28\.6°"),
    ],
)
def test_feedback_that_cannot_be_true_is_a_lost_device(q, qd, says):
    supervisor = MotionSupervisor("arm", LIMITS, Supervision())
    supervisor.on_feedback(1.0, AT_REST, AT_REST)
    with pytest.raises(DeviceLost, match=says):
        supervisor.on_feedback(1.025, np.array(q, float), np.array(qd, float))


def test_feedback_older_than_the_newest_one_is_a_lost_device():
    supervisor = MotionSupervisor("arm", LIMITS, Supervision())
    supervisor.on_feedback(1.0, AT_REST, AT_REST)
    with pytest.raises(DeviceLost, match="time goes back"):
        supervisor.on_feedback(0.9, AT_REST, AT_REST)


def test_an_arm_at_full_speed_whose_pushes_come_in_bunches_is_believed():
    supervisor = MotionSupervisor("arm", LIMITS, Supervision())
    for push in range(40):
        arrived = (push // 3) * 0.075 + 0.0001 * push  # three at once
        supervisor.on_feedback(
            arrived, np.full(DOF, 0.025 * 3.0 * push - 2.9)[:DOF].clip(-3, 3), np.full(DOF, 3.0)
        )


def test_feedback_that_repeats_itself_while_the_arm_is_moved_is_a_lost_device():
    rig = Rig()
    rig.run(0.4)
    frozen = rig.measured()
    before = rig.now
    with pytest.raises(DeviceLost, match=r"has not changed for .* although the arm is to move"):
        rig.run(2.0, lambda: frozen)
    assert rig.now - before < 0.3


def test_an_arm_that_never_moves_off_is_noticed_too():
    rig = Rig()
    before = rig.now
    with pytest.raises(DeviceLost, match="although the arm is to move"):
        rig.run(2.0, lambda: (AT_REST, AT_REST))
    assert rig.now - before < 0.6


def test_an_arm_that_does_not_follow_is_a_fault():
    rig = Rig()
    rng = np.random.default_rng(0)
    rig.run(0.4)
    stuck, _ = rig.measured()
    with pytest.raises(DeviceFault, match=r"does not follow: joint 1 is \d\.\d° from"):
        rig.run(2.0, lambda: (stuck + rng.normal(size=DOF) * 1e-5, AT_REST))


@pytest.mark.parametrize(
    ("off", "noticed"), [(0.005, False), (0.03, True)]
)  # held by a branch, and stuck
def test_an_arm_that_stands_beside_a_set_point_that_stands_is_a_fault(off, noticed):
    supervisor, motion = (
        MotionSupervisor("arm", LIMITS, Supervision()),
        PathMotion(swing(9.0), LIMITS, STEP),
    )
    said = []
    try:
        for step in range(500):
            now = step * 0.01
            supervisor.command(now, np.array([min(0.1 * now, off), 0.0, 0.0]))
            supervisor.on_feedback(now, 1e-6 * np.array([step % 2, 0.0, 0.0]), AT_REST)
            supervisor.look(now, motion, step)
    except DeviceFault as fault:
        said.append((now, str(fault)))
    assert bool(said) is noticed
    if noticed:
        assert 0.3 < said[0][0] < 1.3
        assert "joint 1 stands 1.7° from its set-point" in said[0][1]


def test_a_controller_that_takes_no_more_of_the_motion_is_a_fault_within_the_stall_time():
    rig = Rig(stall=0.5)
    rig.run(0.4)
    rig.halted, before = True, rig.now
    with pytest.raises(DeviceFault, match="has not continued the motion"):
        rig.run(120.0)
    assert rig.now - before == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(
    "act",
    [
        lambda motion: motion.stop(),
        lambda motion: motion.pause(),
        lambda motion: (motion.pause(), motion.resume()),
        lambda motion: motion.set_speed(0.9 * motion.speed),
    ],
)
def test_no_command_hides_a_controller_that_takes_no_more_of_the_motion(act):
    rig = Rig(stall=0.5)
    rig.run(0.4)
    rig.halted, before = True, rig.now
    rig.run(0.3)
    act(rig.motion)
    with pytest.raises(DeviceFault, match="has not continued the motion"):
        rig.run(0.3)
    assert rig.now - before == pytest.approx(0.5, abs=0.03)


def test_a_controller_that_took_no_more_has_the_stall_time_again_for_its_stop():
    rig = Rig(stall=0.5)
    rig.run(0.4)
    rig.halted = True
    with pytest.raises(DeviceFault):
        rig.run(2.0)
    rig.motion.stop()
    rig.run(0.4)
    with pytest.raises(DeviceFault, match="has not continued the motion"):
        rig.run(0.2)


def test_a_motion_that_does_not_end_is_a_fault():
    rig = Rig(margin=1.0, following_error=0.3)
    shaking = iter(range(10**6))
    with pytest.raises(
        DeviceFault, match="the motion did not end 1 s after its longest expected time"
    ):
        rig.run(120.0, lambda: (rig.measured()[0] + 1e-2 * (next(shaking) % 2), np.full(DOF, 0.5)))
    assert rig.now - 10.0 == pytest.approx(1.0 / SLOWEST + 1.0, abs=0.03)


def test_a_stop_that_does_not_come_to_rest_is_a_fault():
    rig = Rig(margin=1.0)
    rig.run(0.4)
    rig.motion.stop()
    before = rig.now
    with pytest.raises(DeviceFault, match="did not come to rest 1 s after"):
        rig.run(120.0, lambda: (rig.measured()[0], np.full(DOF, 0.5)))
    assert rig.now - before == pytest.approx(1.0, abs=0.03)


def test_a_status_that_no_longer_comes_is_a_lost_device():
    supervisor = MotionSupervisor("arm", LIMITS, Supervision(status=0.25))
    supervisor.check_status(5.0)  # from now on it is waited for
    supervisor.check_status(5.2)
    supervisor.on_status(5.24)
    supervisor.check_status(5.45)
    with pytest.raises(DeviceLost, match="not sent its status for 310 ms"):
        supervisor.check_status(5.55)
    supervisor.forget()
    supervisor.check_status(9.0)


def test_a_controller_that_does_not_go_on_after_a_pause_is_a_fault_within_the_stall_time():
    rig = Rig(stall=0.3)
    rig.run(0.3)
    rig.motion.pause()
    rig.run(1.0)
    rig.halted = True
    rig.motion.resume()
    with pytest.raises(DeviceFault, match="has not continued the motion"):
        rig.run(0.4)


@pytest.mark.parametrize(("way", "seen"), [(0.95, False), (1.05, True)])
@pytest.mark.parametrize("joint", range(DOF))
def test_joints_that_leave_their_path_at_once_are_moved_by_another(way, seen, joint):
    rig = Rig()
    rig.run(0.4)
    across = np.cross(CHANGE, np.eye(DOF)[joint])  # of the path of this swing, which is straight
    off = across / np.abs(across).max() * BESIDE * Supervision().following_error * way

    def pushed():
        q, qd = rig.measured()
        return q + off, qd

    if not seen:
        rig.run(0.15, pushed)
        return
    with pytest.raises(DeviceFault, match="leaves its path: another program commands the arm"):
        rig.run(0.02, pushed)


def test_joints_that_come_late_or_leave_their_path_slowly_do_not_count_as_moved_by_another():
    rig = Rig(delay=0.18)
    rig.run(0.3)
    began = rig.now

    def drifts():
        q, qd = rig.measured()
        return q + 0.03 * (rig.now - began) * np.array([1.0, 2.0, 0.0]) / 2.0, qd

    rig.run(0.4, drifts)


def test_a_joint_that_stands_while_the_others_move_does_not_follow():
    rig = Rig()
    rig.run(0.4)
    stood = rig.measured()[0][0]

    def held():
        q, qd = rig.measured()
        return np.array([stood, *q[1:]]), qd

    with pytest.raises(DeviceFault, match="does not follow"):
        rig.run(0.6, held)


@pytest.mark.long
def test_an_hour_of_work_and_rest_has_no_false_alarm():
    """Joints with the noise of a 17-bit encoder, that sag by a milliradian after each motion and drift with heat."""
    rng = np.random.default_rng(1)
    supervisor = MotionSupervisor("arm", LIMITS, Supervision())
    now, at, moved = 0.0, AT_REST, 0

    def felt(q, qd, sag=0.0):
        heat = 5e-4 * np.sin(now / 600.0)
        said = q + rng.normal(0.0, 5e-5, DOF) + heat + 1e-3 * sag
        supervisor.on_feedback(now, said, qd + rng.normal(0.0, 5e-4, DOF))
        return said

    while now < 3600.0:
        path = swing() if moved % 2 == 0 else swing(1.7)
        way = 1.0 if moved % 2 == 0 else -1.0
        motion = PathMotion(
            Trajectory(path.t, at + way * path.q, way * path.qd, way * path.qdd), LIMITS, 0.01
        )
        supervisor.end()
        sent, late = 0, [(at, AT_REST)] * 5
        while not motion.settled:
            now += 0.01
            q, qd = motion.step()
            sent += 1
            late.append((q, qd))
            supervisor.command(now, q)
            said = felt(*late[-5], sag=np.abs(late[-5][1]).max() / 1.5)
            supervisor.look(now, motion, sent)
            if sent % 7 == 0 and motion.progress < 0.5 and moved % 5 == 4:
                motion.set_speed(0.3 + 0.1 * (sent % 4))
            if motion.set_point_rests and np.array_equal(late[-5][0], q):
                motion.look(True, float(np.abs(said - q).max()), now)
        assert motion.state is MotionState.DONE
        at, began = late[-1][0], now
        moved += 1
        supervisor.end()
        while now < began + 1.5:
            now += 0.01
            supervisor.look_at_rest(felt(at, AT_REST, sag=min(now - began, 1.0)))
    assert moved > 1000
