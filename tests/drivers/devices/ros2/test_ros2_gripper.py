"""A gripper behind ros2_control: moves, streamed speeds, and a failing peer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("zenoh", reason="the extra ros2 is not installed")

from rosbags.typesys import Stores, get_typestore

from pomona.devices.ros2 import gripper as module
from pomona.devices.ros2.gripper import COMMAND, Ros2Gripper, Ros2GripperOptions
from pomona.devices.ros2.joints import JOINT_STATE
from pomona.drivers.errors import DeviceError, DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.interfaces import Gripper, GripperLimits, MotionState
from pomona.executive.clock import ManualClock
from pomona.tools.calibration.doctor import compared_with_gauge

STORE = get_typestore(Stores.ROS2_JAZZY)
LIMITS = GripperLimits(0.01, 0.08, 0.1, 20.0)
WALL = 1.7e9
STEP = 0.005
LAG = 0.03


class Fingers:
    """Two fingers behind a position controller: they follow their set-point with a lag, until something is between."""

    def __init__(self, clock: ManualClock) -> None:
        self.clock, self.q, self.set_point, self.fruit = clock, 0.03, 0.03, 0.0
        self.take: Callable[[bytes], None] = lambda _raw: None
        self.said: list[tuple[float, float]] = []
        self.silent = self.stuck = self.closed = False
        self.says: Callable[[float], float] = lambda q: q
        self.rate: Callable[[float], float] = lambda rate: rate

    def subscribe(self, _topic: str, kind: str, take: Callable[[bytes], None]) -> None:
        assert kind == JOINT_STATE
        self.take = take

    def publish(self, topic: str, kind: str, coded: Any, _stamp: int) -> None:
        assert (topic, kind) == ("/gripper_controller/commands", COMMAND)
        (position,) = STORE.deserialize_cdr(bytes(coded), kind).data
        self.said.append((self.clock.now(), float(position)))
        self.set_point = float(position)

    def close(self) -> None:
        self.closed = True

    @property
    def wall(self) -> float:
        return WALL + self.clock.now()

    @property
    def width(self) -> float:
        return 0.002 + 2.0 * self.q

    def advance(self, seconds: float) -> None:
        self.clock.advance(seconds)
        before = self.q
        if not self.stuck:
            self.q += (self.set_point - self.q) * (1.0 - np.exp(-seconds / LAG))
            self.q = max(self.q, (self.fruit - 0.002) / 2.0)
        if not self.silent:
            types, said = STORE.types, self.says(self.q)
            stamp = types["builtin_interfaces/msg/Time"](
                int(self.wall), round(self.wall % 1.0 * 1e9) % 10**9
            )
            rates = np.array([self.rate((self.q - before) / seconds)])
            head = types["std_msgs/msg/Header"](stamp, "")
            message = types[JOINT_STATE](head, ["finger"], np.array([said]), rates, np.zeros(0))
            self.take(bytes(STORE.serialize_cdr(message, JOINT_STATE)))


class Setting:
    def __init__(self) -> None:
        self.clock = ManualClock(20.0)
        self.fingers = Fingers(self.clock)
        self.gripper = Ros2Gripper(
            self.fingers, self.clock, LIMITS, Ros2GripperOptions("finger", 2.0, 0.002),
            host_time=lambda: self.fingers.wall,
        )  # fmt: skip
        self.fingers.advance(STEP)
        self.gripper.connect()
        self.serve(0.5)

    def serve(
        self,
        seconds: float,
        until: Callable[[], bool] = lambda: False,
        each: Callable[[], None] = lambda: None,
    ) -> None:
        end = self.clock.now() + seconds
        while self.clock.now() < end and not until():
            each()
            self.fingers.advance(STEP)
            self.gripper.step()


@pytest.fixture
def setting(monkeypatch: pytest.MonkeyPatch) -> Setting:
    monkeypatch.setattr(module, "PATIENCE", 0.0)
    return Setting()


def test_nothing_is_sent_before_the_first_command(setting: Setting) -> None:
    assert isinstance(setting.gripper, Gripper)
    assert setting.gripper.state().width == pytest.approx(0.062)
    assert setting.fingers.said == []
    assert setting.gripper.settled()
    setting.gripper.check()


@pytest.mark.parametrize("width", [0.03, 0.08])
def test_a_move_goes_to_its_width_at_its_speed(setting: Setting, width: float) -> None:
    began = setting.clock.now()
    motion = setting.gripper.move(width, 0.05)
    setting.serve(0.2)
    assert 0.0 < motion.progress < 1.0
    assert abs(setting.gripper.state().speed) == pytest.approx(
        0.05, rel=0.25
    )  # its set-points come every 10 ms
    setting.serve(3.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE
    assert setting.fingers.width == pytest.approx(width, abs=1e-3)
    assert setting.clock.now() - began == pytest.approx(abs(width - 0.062) / 0.05, abs=0.3)
    setting.gripper.check()


def test_fingers_that_meet_something_end_the_move_and_press_no_more_than_they_may(
    setting: Setting,
) -> None:
    setting.fingers.fruit = 0.045
    motion = setting.gripper.move(0.012, 0.05)
    setting.serve(3.0, lambda: motion.settled)
    assert motion.state is MotionState.FAILED
    assert "blocked at 45.0 mm" in motion.problem
    assert 0.045 - (0.002 + 2.0 * setting.fingers.set_point) == pytest.approx(
        0.01, abs=1e-6
    )  # `ahead`
    setting.gripper.check()  # which is no fault of the gripper


def test_a_velocity_that_is_nan_is_computed_from_widths(setting: Setting) -> None:
    setting.fingers.rate = lambda _rate: float("nan")
    setting.serve(0.1)
    motion = setting.gripper.move(0.05, 0.05)
    speeds = []
    setting.serve(4.0, lambda: motion.settled, lambda: speeds.append(setting.gripper.state().speed))
    assert motion.state is MotionState.DONE
    assert min(speeds) == pytest.approx(-0.05, abs=0.01)
    setting.gripper.check()


def test_a_streamed_speed_moves_and_ends_when_it_is_not_renewed(setting: Setting) -> None:
    setting.serve(0.3, each=lambda: setting.gripper.set_speed(-0.04))
    assert setting.gripper.state().speed == pytest.approx(
        -0.04, rel=0.25
    )  # its set-points come every 10 ms
    setting.serve(0.4)
    assert abs(setting.gripper.state().speed) < 1e-3
    assert setting.fingers.width == pytest.approx(0.062 - 0.04 * (0.3 + 0.1), abs=2e-3)
    setting.gripper.set_speed(float("nan"))
    setting.serve(0.3)
    assert abs(setting.gripper.state().speed) < 1e-3
    setting.gripper.check()


class SetBack(ManualClock):
    """A clock behind another one."""

    def __init__(self, clock: ManualClock, back: float) -> None:
        self._clock, self._back = clock, back

    def now(self) -> float:
        return self._clock.now() - self._back


@pytest.mark.parametrize("back", [0.05, 5.0])
def test_a_clock_that_steps_back_neither_reverses_the_fingers_nor_keeps_their_speed(
    setting: Setting, back: float
) -> None:
    setting.serve(0.3, each=lambda: setting.gripper.set_speed(-0.04))
    commanded = setting.fingers.set_point
    setting.gripper._clock = SetBack(setting.clock, back)
    said = len(setting.fingers.said)
    setting.serve(8.0)
    since = [position for _, position in setting.fingers.said[said:]]
    assert max([commanded, *since]) <= commanded + 1e-6
    assert min([commanded, *since]) >= commanded - 0.5 * 0.04 * (
        0.1 + 0.03
    )  # the joint moves one finger


def test_a_safe_stop_keeps_the_grip_and_lets_nothing_open(setting: Setting) -> None:
    setting.fingers.fruit = 0.05
    setting.serve(0.6, each=lambda: setting.gripper.set_speed(-0.03))
    pressed = setting.fingers.set_point
    assert pressed < setting.fingers.q
    setting.gripper.safe_stop("by hand")
    setting.serve(0.5, each=lambda: setting.gripper.set_speed(0.05))
    assert setting.fingers.set_point == pytest.approx(pressed)
    with pytest.raises(MotionRefused, match=r"latched in the safe state \(by hand\)"):
        setting.gripper.move(0.08, 0.05)
    setting.gripper.acknowledge()
    motion = setting.gripper.move(0.08, 0.05)
    setting.serve(3.0, lambda: motion.settled)
    assert motion.state is MotionState.DONE


@pytest.mark.parametrize(
    ("wrong", "error", "words"),
    [
        (lambda f: setattr(f, "silent", True), DeviceLost, "no joints on /joint_states"),
        (
            lambda f: setattr(f, "says", lambda _q: float("nan")),
            DeviceFault,
            "reports a width of nan mm",
        ),
        (lambda f: setattr(f, "says", lambda _q: 0.2), DeviceFault, "outside its stroke"),
        (lambda f: setattr(f, "stuck", True), DeviceFault, "has not ended its move"),
    ],
    ids=["silence", "nan", "wild", "stuck"],
)
def test_an_impossible_state_fails_the_move_and_stays_latched(
    setting: Setting, wrong: Any, error: type[DeviceError], words: str
) -> None:
    motion = setting.gripper.move(0.012, 0.05)
    setting.serve(0.3)
    wrong(setting.fingers)
    if words.startswith("has not"):
        module_blocked, module.BLOCKED = module.BLOCKED, 100.0
    try:
        setting.serve(4.0, lambda: setting.gripper.link() != "ok")
    finally:
        if words.startswith("has not"):
            module.BLOCKED = module_blocked
    with pytest.raises(error, match=words):
        setting.gripper.check()
    assert motion.state is MotionState.FAILED
    said = setting.fingers.set_point
    setting.serve(0.5)
    assert setting.fingers.set_point == said  # it goes no further
    with pytest.raises(MotionRefused, match="not ready"):
        setting.gripper.move(0.05, 0.05)


def test_fingers_that_move_without_a_command_are_a_fault(setting: Setting) -> None:
    fingers = setting.fingers
    setting.serve(
        0.5, each=lambda: setattr(fingers, "set_point", fingers.set_point - 1e-4)
    )  # somebody else does
    with pytest.raises(DeviceFault, match="closes without a command"):
        setting.gripper.check()


def test_forbidden_actions_are_refused(setting: Setting) -> None:
    for width, speed, words in (
        (0.2, 0.05, "lies outside 10.0 … 80.0 mm"),
        (0.05, 0.5, "lies outside 0 … 0.1 m/s"),
    ):
        with pytest.raises(MotionRefused, match=words):
            setting.gripper.move(width, speed)
    assert setting.fingers.said == []


def test_closed_it_leaves_the_fingers_where_they_are(setting: Setting) -> None:
    setting.gripper.close()
    assert setting.fingers.closed
    with pytest.raises(DeviceLost, match="is closed"):
        setting.gripper.check()


@pytest.mark.parametrize(("scale", "right"), [(2.0, True), (1.0, False), (-2.0, False)])
def test_a_gauge_between_the_pads_shows_a_gripper_whose_scale_is_wrong(
    scale: float, right: bool
) -> None:
    clock = ManualClock(20.0)
    fingers = Fingers(clock)  # open by 62 mm
    options = Ros2GripperOptions("finger", scale, 0.002)
    gripper = Ros2Gripper(
        fingers, clock, GripperLimits(-0.1, 0.1, 0.1, 20.0), options, host_time=lambda: fingers.wall
    )
    fingers.advance(0.005)
    gripper.connect()
    line = compared_with_gauge("gripper", gripper, 0.0625)
    assert line.ok is right
    assert "the gauge has 62.5 mm" in line.found
    fingers.silent = True
    clock.advance(1.0)
    gripper.step()
    assert not compared_with_gauge("gripper", gripper, 0.0625).ok
