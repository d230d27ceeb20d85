"""An arm behind ros2_control: following, stopping, and a peer with false data, without answers, or with floods."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("zenoh", reason="the extra ros2 is not installed")

from rosbags.typesys import Stores, get_typestore

from pomona.devices.ros2 import arm as module, outside
from pomona.devices.ros2.arm import TRAJECTORY, Ros2Arm, Ros2ArmFile
from pomona.devices.ros2.gripper import COMMAND
from pomona.devices.ros2.joints import JOINT_STATE, KEPT, LARGEST, stamped
from pomona.drivers.errors import CellFileError, DeviceError, DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.interfaces import Arm, ArmLimits, Gripper, MotionState, Trajectory
from pomona.drivers.motion_supervisor import Supervision
from pomona.executive.cell.connect import load_cell
from pomona.executive.clock import ManualClock
from pomona.tools.ros2.peer import Ros2Peer
from pomona.tools.ros2.types import coder

STORE = get_typestore(Stores.ROS2_JAZZY)
JOINTS = ("shoulder", "elbow", "wrist")
LIMITS = ArmLimits(
    -np.full(3, 3.0), np.full(3, 3.0), np.full(3, 2.0), np.full(3, 10.0), np.full(3, 200.0)
)
START, CHANGE = np.array([0.1, -0.2, 0.3]), np.array([0.5, -0.4, 0.3])
ORDER = ("wrist", "gripper", "shoulder", "elbow")
WALL = 1.7e9
STEP = 0.005


class Controller:
    """A joint_trajectory_controller and a joint_state_broadcaster, on a wire that the test holds.

    As the real one it joins points by cubics, replaces its trajectory by a new one, refuses one that ends in the past
    or not at rest, and holds its last position.
    """

    def __init__(self, clock: ManualClock) -> None:
        self.clock, self.q, self.qd = clock, START.copy(), np.zeros(3)
        self.take: Callable[[bytes], None] = lambda _raw: None
        self.hear: Callable[[bytes], None] = lambda _raw: None
        self.said: list[Any] = []
        self.refused: list[str] = []
        self.silent = self.stuck = self.closed = self.deaf = False
        self.says: Callable[[np.ndarray], np.ndarray] = lambda q: q
        self.late = self.clock_step = 0.0
        self.fastest = self.hardest = 0.0
        self._plan: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def subscribe(self, topic: str, kind: str, take: Callable[[bytes], None]) -> None:
        if topic == "/joint_states":
            assert kind == JOINT_STATE
            self.take = take
        else:
            assert (topic, kind) == ("/joint_trajectory_controller/joint_trajectory", TRAJECTORY)
            self.hear = take

    def publish(self, topic: str, kind: str, coded: Any, _stamp: int) -> None:
        assert (topic, kind) == ("/joint_trajectory_controller/joint_trajectory", TRAJECTORY)
        message = STORE.deserialize_cdr(
            bytes(coded), kind
        )  # another reader than the one that wrote it
        self.said.append(message)
        self.hear(bytes(coded))  # a publisher hears itself, too
        stamp = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
        begin = stamp or self.wall
        t = begin + np.array(
            [p.time_from_start.sec + p.time_from_start.nanosec / 1e9 for p in message.points]
        )
        if list(message.joint_names) != ["shoulder", "elbow", "wrist"]:
            self.refused.append("other joints")
        elif t[-1] < self.wall:
            self.refused.append("ends in the past")
        elif (np.diff(t) <= 0.0).any():
            self.refused.append("time does not increase")
        elif np.abs(message.points[-1].velocities).max() > np.finfo(np.float32).eps:
            self.refused.append("does not end at rest")
        elif not self.deaf:
            q, qd = (
                np.array([p.positions for p in message.points]),
                np.array([p.velocities for p in message.points]),
            )
            if t[0] > self.wall:  # from where it is
                t, q, qd = np.append(self.wall, t), np.vstack([self.q, q]), np.vstack([self.qd, qd])
            self._plan = t, q, qd

    def close(self) -> None:
        self.closed = True

    @property
    def wall(self) -> float:
        return WALL + self.clock.now() + self.clock_step

    def advance(self, seconds: float) -> None:
        self.clock.advance(seconds)
        self.pass_time(seconds)

    def pass_time(self, seconds: float) -> None:
        """Do what was due in a time that has passed."""
        before = self.qd
        if self._plan is not None and not self.stuck:
            self._sample(*self._plan)
        self.fastest = max(self.fastest, np.abs(self.qd).max())
        self.hardest = max(self.hardest, np.abs(self.qd - before).max() / seconds)
        if not self.silent:
            self.take(self.state())

    def _sample(self, t: np.ndarray, q: np.ndarray, qd: np.ndarray) -> None:
        if len(t) == 1 or self.wall >= t[-1]:
            self.q, self.qd = q[-1], np.zeros(3)
            return
        if self.wall < t[0]:  # its clock was stepped back: it holds its position until then
            self.qd = np.zeros(3)
            return
        k = max(int(np.searchsorted(t, self.wall, side="right")) - 1, 0)
        h = t[k + 1] - t[k]
        s = (self.wall - t[k]) / h
        step, v0, v1 = q[k + 1] - q[k], qd[k] * h, qd[k + 1] * h
        a, b = -2 * step + v0 + v1, 3 * step - 2 * v0 - v1
        self.q = q[k] + s * (v0 + s * (b + s * a))
        self.qd = (v0 + s * (2 * b + s * 3 * a)) / h

    def state(
        self,
        names: tuple[str, ...] = ("wrist", "gripper", "shoulder", "elbow"),
        velocities: Callable[[list[float]], list[float]] = list,
    ) -> bytes:
        """In an order of its own, with a joint that is not the arm's."""
        of = dict(zip(JOINTS, self.says(self.q), strict=True)) | {"gripper": 0.02}
        rates = dict(zip(JOINTS, self.qd, strict=True)) | {"gripper": 0.0}
        types = STORE.types
        taken = self.wall - self.late
        stamp = types["builtin_interfaces/msg/Time"](int(taken), round(taken % 1.0 * 1e9) % 10**9)
        message = types[JOINT_STATE](
            types["std_msgs/msg/Header"](stamp, ""),
            list(names),
            np.array([of[name] for name in names]),
            np.array(velocities([rates[name] for name in names])),
            np.zeros(0),
        )
        return bytes(STORE.serialize_cdr(message, JOINT_STATE))


class Setting:
    def __init__(self, clock: ManualClock | None = None, **options: Any) -> None:
        self.clock, self.host_step = clock or ManualClock(20.0), 0.0
        self.controller = Controller(self.clock)
        self.arm = Ros2Arm(
            self.controller, self.clock, LIMITS,
            Ros2ArmFile(robot=Path("robot.xml"), joints=JOINTS, **options),
            host_time=lambda: WALL + self.clock.now() + self.host_step,
        )  # fmt: skip
        self.controller.advance(STEP)
        self.arm.connect()

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.clock.now() + seconds
        while self.clock.now() < end and not until():
            self.controller.advance(STEP)
            self.arm.step()

    def moving(self, after: float = 0.4) -> Any:
        motion = self.arm.follow(swing(self.controller.q, CHANGE))
        self.serve(after)
        assert motion.state is MotionState.RUNNING
        assert np.abs(self.controller.qd).max() > 0.1
        return motion


@pytest.fixture
def setting(monkeypatch: pytest.MonkeyPatch) -> Setting:
    monkeypatch.setattr(module, "PATIENCE", 0.0)
    return Setting()


def swing(start: np.ndarray, change: np.ndarray, duration: float = 1.0) -> Trajectory:
    """A quintic from rest to rest."""
    s = np.linspace(0.0, 1.0, 101)[:, None]
    q = start + change * (10 * s**3 - 15 * s**4 + 6 * s**5)
    qd = change * (30 * s**2 - 60 * s**3 + 30 * s**4) / duration
    qdd = change * (60 * s - 180 * s**2 + 120 * s**3) / duration**2
    return Trajectory(s[:, 0] * duration, q, qd, qdd)


def test_a_trajectory_is_followed_to_its_end_and_every_message_is_one_that_a_controller_takes(
    setting: Setting,
) -> None:
    assert isinstance(setting.arm, Arm)
    assert setting.arm.state().q == pytest.approx(START)  # the topic's order is another
    motion = setting.arm.follow(swing(START, CHANGE))
    assert not setting.arm.settled()
    setting.serve(0.5)
    assert 0.2 < motion.progress < 0.9
    setting.serve(2.0, lambda: motion.settled)
    assert (motion.state, motion.progress) == (MotionState.DONE, 1.0)
    assert setting.controller.q == pytest.approx(START + CHANGE, abs=1e-6)
    assert setting.controller.refused == []
    assert (
        setting.controller.hardest < 1.1 * np.abs(swing(START, CHANGE).qdd).max()
    )  # replaced without a jolt
    assert len(setting.controller.said) < 60  # about every 30 ms
    setting.arm.check()


def test_a_start_that_is_a_little_beside_the_arm_is_taken_up_smoothly(setting: Setting) -> None:
    beside = np.array([1.5e-3, -1.5e-3, 0.0])
    motion = setting.arm.follow(swing(START + beside, CHANGE))
    setting.serve(2.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE
    assert setting.controller.hardest < 1.2 * np.abs(swing(START, CHANGE).qdd).max()


def test_a_motion_that_has_not_begun_yet_is_not_over(
    setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    left: list[Callable[[], None]] = []
    monkeypatch.setattr(setting.arm._owner, "post", left.append)
    motion = setting.arm.follow(swing(START, CHANGE))
    setting.serve(0.2)
    assert not motion.settled
    left[0]()
    setting.serve(2.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE


def test_stopped_it_brakes_on_its_path_within_its_limits(setting: Setting) -> None:
    motion = setting.moving()
    motion.stop()
    setting.serve(1.5, lambda: motion.settled)
    assert motion.state is MotionState.STOPPED
    assert np.abs(setting.controller.qd).max() < 1e-6
    assert setting.controller.hardest <= 1.1 * LIMITS.acceleration[0]
    done = (setting.controller.q - START) / CHANGE
    assert np.ptp(done) < 1e-6  # on the straight line in joints
    assert done[0] < 0.9


def test_paused_it_rests_and_goes_on_to_the_end(setting: Setting) -> None:
    motion = setting.moving()
    setting.arm.pause()
    setting.serve(1.5)
    assert motion.state is MotionState.PAUSED
    assert setting.arm.settled()
    rested = setting.controller.q
    setting.serve(1.0)
    assert np.array_equal(setting.controller.q, rested)
    setting.arm.resume()
    setting.serve(3.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE
    assert setting.controller.q == pytest.approx(START + CHANGE, abs=1e-6)
    assert setting.controller.refused == []


def test_an_arm_that_hears_nothing_more_comes_to_rest_on_its_path_by_itself(
    setting: Setting,
) -> None:
    setting.moving()
    for _ in range(300):  # the process that moved it is gone
        setting.controller.advance(STEP)
    assert not setting.controller.qd.any()
    done = (setting.controller.q - START) / CHANGE
    assert np.ptp(done) < 1e-6
    assert done[0] < 0.95
    assert setting.controller.hardest <= 1.1 * LIMITS.acceleration[0]


def test_a_motion_stalled_longer_than_the_lead_does_not_go_on(setting: Setting) -> None:
    motion = setting.moving()
    for _ in range(50):
        setting.controller.advance(STEP)
    assert setting.controller._plan is not None
    end = setting.controller._plan[1][-1]  # where its last message brakes to
    done = []

    def look() -> bool:
        done.append((setting.controller.q - START) / (end - START))
        return False

    setting.serve(1.0, look)
    assert np.ptp(done, axis=1).max() < 1e-6
    assert np.diff(done, axis=0).min() > -1e-4
    assert done[-1] == pytest.approx(1.0, abs=1e-6)
    assert not setting.controller.qd.any()
    assert motion.state is MotionState.FAILED
    with pytest.raises(DeviceFault, match="delayed, and the arm comes to rest"):
        setting.arm.check()


@pytest.mark.parametrize(
    ("wrong", "error", "words"),
    [
        (lambda c: setattr(c, "silent", True), DeviceLost, "no joints on /joint_states for 1"),
        (lambda c: setattr(c, "says", lambda q: q * np.nan), DeviceLost, "not finite numbers"),
        (
            lambda c: setattr(c, "says", lambda q: q + np.array([0.6, 0.0, 0.0])),
            DeviceLost,
            "joint 1 jumped by 34",
        ),
        (
            lambda c: setattr(c, "says", lambda q: q * 0.0 + 9.0),
            DeviceLost,
            "far outside its range",
        ),
        (lambda c: setattr(c, "late", 5.0), DeviceLost, "the newest message was taken 5 s ago"),
        (lambda c: setattr(c, "late", -5.0), DeviceLost, "the newest message is of the future"),
        (
            lambda c: setattr(c, "state", lambda: b"\0\1\0\0nonsense"),
            DeviceLost,
            "the newest message is no sensor_msgs",
        ),
        (
            lambda c: setattr(c, "state", lambda s=c.state: s(("wrist", "elbow"))),
            DeviceLost,
            "has no joint shoulder",
        ),
        (
            lambda c: setattr(c, "says", lambda _q, q=c.q.copy(): q),
            DeviceLost,
            "has not changed for",
        ),
    ],
    ids=["silence", "nan", "jump", "wild", "old", "future", "nonsense", "joints missing", "frozen"],
)
def test_joints_that_cannot_be_true_brake_the_arm_on_its_path_and_stay_latched(
    setting: Setting, wrong: Any, error: type[DeviceError], words: str
) -> None:
    motion = setting.moving()
    wrong(setting.controller)
    setting.serve(2.0, lambda: motion.settled)
    assert motion.state is MotionState.FAILED
    assert not setting.controller.qd.any()
    assert setting.controller.hardest <= 1.1 * LIMITS.acceleration[0]
    with pytest.raises(error, match=words):
        setting.arm.check()
    with pytest.raises(MotionRefused, match="not ready"):
        setting.arm.follow(swing(setting.controller.q, CHANGE))


def test_after_a_loss_it_goes_on_only_when_somebody_acknowledges_and_starts_anew(
    setting: Setting,
) -> None:
    motion = setting.moving()
    setting.controller.silent = True
    setting.serve(1.5, lambda: motion.settled)
    with pytest.raises(DeviceLost):
        setting.arm.state()
    setting.arm.safe_stop("lost")
    with pytest.raises(DeviceLost, match="is still lost"):
        setting.arm.acknowledge()
    setting.controller.silent = False
    said = len(setting.controller.said)
    setting.serve(0.5)
    assert len(setting.controller.said) == said  # nothing resumes
    with pytest.raises(DeviceLost):
        setting.arm.check()
    setting.arm.acknowledge()
    setting.arm.check()
    again = setting.arm.follow(swing(setting.controller.q, 0.2 * CHANGE))
    setting.serve(2.0, lambda: again.settled)
    assert again.state is MotionState.DONE


@pytest.mark.parametrize("how", ["stuck", "deaf"])
def test_an_arm_that_does_not_follow_is_a_fault_and_its_set_points_brake_at_once(
    setting: Setting, how: str
) -> None:
    if how == "stuck":
        motion = setting.moving()
        setting.controller.stuck = True
    else:
        setting.controller.deaf = True  # the controller is not active: it takes nothing
        motion = setting.arm.follow(swing(START, CHANGE))
    setting.serve(2.0, lambda: motion.settled)
    assert motion.state is MotionState.FAILED
    with pytest.raises(DeviceError, match=r"does not follow|has not changed"):
        setting.arm.check()
    last = setting.controller.said[-1]
    assert not np.array(last.points[-1].velocities).any()
    assert (last.header.stamp.sec, last.header.stamp.nanosec) == (0, 0)


def test_an_ended_motion_is_not_played_again_when_the_clock_of_both_steps_back(
    setting: Setting,
) -> None:
    motion = setting.arm.follow(swing(START, CHANGE))
    setting.serve(2.0, lambda: motion.settled)
    rested = np.array(setting.controller.q)
    setting.host_step = setting.controller.clock_step = -0.4
    for _ in range(200):
        setting.serve(STEP)
        assert np.abs(setting.controller.q - rested).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.5, -0.5, 60.0, -60.0])
def test_a_step_of_the_controller_s_clock_ends_at_rest_on_the_path(
    setting: Setting, seconds: float
) -> None:
    motion = setting.moving()
    setting.controller.clock_step = seconds
    setting.serve(2.0, lambda: motion.settled)
    assert motion.state is MotionState.FAILED
    setting.serve(0.1)
    rested = np.array(setting.controller.q)
    setting.serve(65.0)
    assert np.array_equal(setting.controller.q, rested)
    done = (rested - START) / CHANGE
    assert np.ptp(done[:2]) < 1e-6
    assert done[0] < 0.95
    with pytest.raises(DeviceLost, match="no joints on"):
        setting.arm.check()


def test_a_stop_that_comes_late_is_no_jolt(setting: Setting) -> None:
    setting.moving()
    take, late = setting.controller.publish, STEP
    waiting: list[tuple[float, tuple[Any, ...]]] = []

    def publish(*message: Any) -> None:
        waiting.append((setting.clock.now() + late, message))

    setting.controller.publish = publish
    setting.arm._halt("in doubt")
    for _ in range(200):
        setting.serve(STEP)
        while waiting and waiting[0][0] <= setting.clock.now() + 1e-9:
            take(*waiting.pop(0)[1])
    assert not setting.controller.qd.any()
    assert setting.controller.hardest <= 1.1 * LIMITS.acceleration[0]


@pytest.mark.parametrize(
    "velocities",
    [lambda _: [], lambda rates: [np.nan] * len(rates), lambda rates: [np.nan, *rates[1:]]],
)
def test_velocities_may_be_missing_or_nan(
    setting: Setting, velocities: Callable[[list[float]], list[float]]
) -> None:
    whole = setting.controller.state
    setting.controller.state = lambda: whole(velocities=velocities)
    motion = setting.moving()
    assert np.abs(setting.arm.state().qd - setting.controller.qd).max() < 0.05
    setting.serve(2.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE


def test_a_flood_costs_no_memory_and_the_newest_counts(setting: Setting) -> None:
    for _ in range(500):
        setting.controller.clock.advance(1e-4)
        setting.controller.take(setting.controller.state())
    setting.controller.take(setting.controller.state(("gripper",)))  # another broadcaster's
    assert len(setting.arm._feed._raw) <= KEPT
    setting.arm.step()
    assert setting.arm.state().stamp == pytest.approx(setting.clock.now(), abs=1e-6)
    setting.arm.check()


def test_a_message_of_a_megabyte_is_not_read_and_the_arm_is_lost_when_nothing_else_comes(
    setting: Setting,
) -> None:
    setting.controller.silent = True
    for _ in range(40):
        setting.controller.take(bytes(LARGEST + 1))
        setting.serve(STEP)
    assert not setting.arm._feed._raw
    with pytest.raises(DeviceLost, match="has 65537 bytes"):
        setting.arm.check()


def test_a_forbidden_motion_is_refused_and_nothing_is_sent(setting: Setting) -> None:
    for trajectory, words in (
        (swing(START, 10.0 * CHANGE), "limits are"),
        (swing(START + 0.1, CHANGE), "away from the arm"),
        (swing(START, CHANGE, 0.05), "its limit is"),
    ):
        with pytest.raises(MotionRefused, match=words):
            setting.arm.follow(trajectory)
    setting.arm.safe_stop("by hand")
    with pytest.raises(MotionRefused, match=r"latched in the safe state \(by hand\)"):
        setting.arm.follow(swing(START, CHANGE))
    setting.serve(0.1)
    assert setting.controller.said == []


def test_closed_it_comes_to_rest_first(setting: Setting) -> None:
    setting.moving()
    advance = setting.clock.advance

    def let_pass(seconds: float) -> None:
        setting.clock.advance = advance
        setting.serve(seconds)
        setting.clock.advance = let_pass

    setting.clock.advance = let_pass
    setting.arm.close()
    setting.clock.advance = advance
    assert not setting.controller.qd.any()
    assert setting.controller.closed


def test_the_supervisor_process_sees_whether_it_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = ManualClock(5.0)
    controller = Controller(clock)
    monkeypatch.setattr(outside, "open_peer", lambda *_a, **_k: controller)
    monkeypatch.setattr(outside, "SystemClock", lambda: clock)
    feed = partial(outside.JointFeed, host_time=lambda: controller.wall)
    monkeypatch.setattr(outside.time, "monotonic", clock.now)
    moved, newest = np.zeros(3), outside.JointFeed.newest

    def wait(feed: Any, _timeout: float) -> Any:
        controller.q = controller.q + moved
        controller.advance(0.02)
        return newest(feed, 0.0)

    monkeypatch.setattr(outside.JointFeed, "newest", wait)
    monkeypatch.setattr(outside, "JointFeed", feed)
    ask = ("127.0.0.1:7447", "/joint_states", list(JOINTS), 5e-3)
    outside.see_rest(*ask)
    moved = np.full(3, 1e-3)
    with pytest.raises(TimeoutError, match="they go on moving"):
        outside.see_rest(*ask)
    controller.silent = True
    with pytest.raises(TimeoutError, match="no message arrives"):
        outside.see_rest(*ask)
    assert controller.closed


def test_a_cell_of_ros2_moves_over_the_wire(tmp_path: Path) -> None:
    """Both devices as a cell file describes them, and their controllers behind a node of its own."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{one.getsockname()[1]}"
    robot = Path(__file__).parents[4] / "trees" / "robots" / "sia5f_wsg32.xml"
    patient = "silence: 1 s, supervision: {following_error: 0.5 rad, lag: 1 s, margin: 20 s}"
    (tmp_path / "cell.yaml").write_text(
        f"name: x\nkind: real\ndevices:\n"
        f"  arm: {{driver: ros2-arm, address: '{address}', robot: {robot}, joints: s l e u r b t, lead: 700 ms,\n"
        f"        {patient}}}\n"
        f"  gripper: {{driver: ros2-gripper, address: '{address}', joint: finger, scale: 2, opening: [10 mm, 80 mm],\n"
        "            speed_max: 200 mm/s, silence: 1 s, supervision: {margin: 20 s, lag: 1 s}}\n"
    )
    node = Ros2Peer(address, node="controllers")
    at: dict[str, float] = dict.fromkeys((*"sleurbt", "finger"), 0.0) | {"finger": 0.03}
    plan: list[Any] = []
    node.subscribe("/joint_trajectory_controller/joint_trajectory", TRAJECTORY, plan.append)
    node.subscribe(
        "/gripper_controller/commands", COMMAND, lambda raw: at.update(finger=position_of(raw))
    )
    over = threading.Event()

    def control() -> None:
        while not over.wait(0.01):
            if plan:
                message = STORE.deserialize_cdr(plan[-1], TRAJECTORY)
                begin = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
                t = [
                    begin + p.time_from_start.sec + p.time_from_start.nanosec / 1e9
                    for p in message.points
                ]
                q = np.array([p.positions for p in message.points]).T
                at.update(
                    {
                        name: float(np.interp(time.time(), t, of))
                        for name, of in zip("sleurbt", q, strict=True)
                    }
                )
            head = {"stamp": stamped(time.time())}
            fields = {"header": head, "name": list(at), "position": list(at.values())}
            node.publish(
                "/joint_states", JOINT_STATE, coder(JOINT_STATE).coded(fields), time.time_ns()
            )

    thread = threading.Thread(target=control)
    thread.start()
    try:
        cell = load_cell(tmp_path / "cell.yaml")
        try:
            arm, gripper = cell.device(Arm), cell.device(Gripper)
            assert cell.outside_stops().keys() == {"arm", "gripper"}
            change = np.full(7, 0.1)
            motions = arm.follow(swing(arm.state().q, change, 1.0)), gripper.move(0.05, 0.05)
            deadline = time.monotonic() + 30.0
            while not all(motion.settled for motion in motions) and time.monotonic() < deadline:
                cell.check()
                time.sleep(0.02)
            assert [motion.state for motion in motions] == [MotionState.DONE] * 2
            assert [at[name] for name in "sleurbt"] == pytest.approx([0.1] * 7, abs=1e-3)
            assert at["finger"] == pytest.approx(0.025, abs=1e-3)
        finally:
            cell.close()
    finally:
        over.set()
        thread.join()
        node.close()


def position_of(raw: bytes) -> float:
    """Of a position controller's command."""
    return float(STORE.deserialize_cdr(raw, COMMAND).data[0])


def test_a_cell_file_s_mistakes_are_reported_at_their_place(tmp_path: Path) -> None:
    cell = tmp_path / "cell.yaml"
    for device, line, words in (
        ("driver: ros2-arm\n    robot: nothing.xml\n    joints: a b c", 6, "nothing.xml"),
        ("driver: ros2-arm\n    joints: a b c", 5, "robot"),
        ("driver: ros2-gripper\n    joint: j\n    opening: [80 mm, 80 mm]", 7, "range"),
        ("driver: ros2-gripper\n    joint: j\n    opening: [0 mm, 80 mm]\n    scale: 0", 8, "zero"),
    ):
        cell.write_text(f"name: x\nkind: real\ndevices:\n  it:\n    {device}\n")
        with pytest.raises(CellFileError, match=words) as caught:
            load_cell(cell)
        assert caught.value.line == line


def test_supervision_is_the_cell_file_s(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.0)
    wide = Setting(supervision=Supervision(following_error=0.5, lag=1.0))
    motion = wide.moving()
    wide.controller.stuck = True
    wide.serve(0.3)
    assert motion.state is MotionState.RUNNING


def test_a_slower_arm_takes_longer_and_a_change_on_the_way_is_no_jolt(setting: Setting) -> None:
    setting.arm.go_at(0.5)
    motion = setting.arm.follow(swing(START, CHANGE))
    setting.serve(1.0)
    assert 0.3 < motion.progress < 0.6
    fastest = setting.controller.fastest
    assert fastest < 0.55 * np.abs(swing(START, CHANGE).qd).max()
    setting.arm.go_at(0.1)
    began = setting.clock.now()
    setting.serve(8.0, lambda: motion.settled)
    assert (motion.state, motion.progress) == (MotionState.DONE, 1.0)
    assert setting.clock.now() - began > 3.0
    assert setting.controller.refused == []
    assert setting.controller.hardest < 1.1 * LIMITS.acceleration.max()
    setting.arm.check()
