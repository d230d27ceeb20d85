from types import SimpleNamespace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.crates import feeling
from pomona.applications.crates.feeling import PRESSED
from pomona.applications.crates.hook import OUTER, Hook
from pomona.applications.crates.hooks import pull_of
from pomona.applications.crates.pull import bears_at_edges, bears_below, weight_of
from pomona.drivers.fruit_body import HARD_MODULUS
from pomona.drivers.gripper_supervisor import GripperMotion
from pomona.drivers.interfaces import LoadSensor, MotionState
from pomona.executive.lease import notice_of
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.shared.held_fruit import bruising
from pomona.skills.shared.touch import Touch
from pomona.tools.mock import MockLoadSensor
from tests.skills.applications.crates.wall_scene import AT_WALL, RollingBall, a_hook
from tests.skills.picking_scene import PickingScene


def over_the_fruit() -> PickingScene:
    hook = a_hook()
    scene = PickingScene(q=hook.q_pre_grasp[0].copy(), width=hook.width, workspace=AT_WALL)
    scene.clock.advance(0.1)  # the fingers have sent something
    return scene


def draw(scene: PickingScene, **settings) -> SkillEnd:
    return drive(Hook(), {"hook": a_hook()}, scene.devices, clock=scene.clock, **settings)


def is_up_again(scene: PickingScene) -> bool:
    return abs(scene.tcp[2, 3] - a_hook().T_base_pre_grasp[2, 3]) < 1e-3


@pytest.mark.parametrize("radius", [0.0405, 0.0385])  # the measured one, and 2 mm less
@pytest.mark.slow
def test_a_finger_draws_the_fruit_from_the_wall_and_rises(radius):
    scene = over_the_fruit()
    ball = RollingBall(scene, radius)
    outcome = draw(scene)
    assert outcome.status is Status.SUCCESS
    assert outcome.outputs["finger"] == pytest.approx(0.045, abs=1e-3)
    assert ball.rolled > 0.018
    assert ball.most < bears_below(a_hook()) + 1.0
    assert is_up_again(scene)
    assert outcome.duration < 24.0
    # it stopped at touches that it looked for: nobody is near
    assert not notice_of(scene.clock).why


@pytest.mark.slow
def test_a_finger_that_loses_a_larger_fruit_does_not_press_after_it():
    scene = over_the_fruit()
    ball = RollingBall(scene, 0.0425)
    outcome = draw(scene)
    assert outcome.reason is None or outcome.reason.code == "NOTHING_MOVED"
    assert ball.most < bears_below(a_hook()) + 1.0
    assert is_up_again(scene)


@pytest.mark.slow
@pytest.mark.parametrize(("free", "code"), [(0.004, "PULL_BLOCKED"), (0.016, None)])
def test_a_fruit_that_is_stopped_ends_the_pull_and_counts_once_it_has_made_room(free, code):
    scene = over_the_fruit()
    ball = RollingBall(scene, 0.0405, blocked_at=free)
    outcome = draw(scene)
    assert (outcome.reason.code if outcome.reason else None) == code
    moved = outcome.reason.data["moved_m"] if code else outcome.outputs["finger"]
    assert (moved < 0.015) is (code is not None)
    assert ball.most < bears_below(a_hook()) + 1.0
    assert is_up_again(scene)


def test_a_fruit_that_is_not_there_is_a_reason():
    scene = over_the_fruit()
    outcome = draw(scene)
    assert outcome.reason.code == "NOTHING_MOVED"
    assert is_up_again(scene)


def test_the_press_of_the_crate_is_in_the_account_of_a_pull_that_fails_too():
    hook = a_hook()
    (press,) = [
        entry.press for topic, entry in draw(over_the_fruit()).published if topic == "account"
    ]
    weight = weight_of(hook) / bruising(hook.fruit, HARD_MODULUS)
    assert weight <= press < weight + 0.1, "the weight, and the noise of the fingers"


@pytest.mark.slow
def test_fingers_that_are_not_as_open_as_the_hook_needs_are_opened_first():
    scene = over_the_fruit()
    RollingBall(scene, 0.0405)
    scene.gripper.width = 0.05
    assert draw(scene).status is Status.SUCCESS
    assert scene.gripper.width == pytest.approx(a_hook().width)


@pytest.mark.parametrize("trouble", ["blocked", "pressed"])
def test_something_at_the_fingers_is_a_contact_before_the_arm_moves(trouble):
    scene = over_the_fruit()
    if trouble == "blocked":
        scene.gripper.width = 0.06
        scene.gripper.move = lambda *_: blocked_motion()
    else:
        scene.gripper.motor_force = -2.0 * PRESSED
    assert draw(scene).reason.code == "CONTACT"
    assert not scene.arm.followed


def blocked_motion() -> GripperMotion:
    """A move that has failed."""
    motion = GripperMotion(0.1, 0.1, 0.06, lambda _: None)
    motion.end(MotionState.FAILED, "the fingers are blocked at 60.0 mm")
    motion.settled = True
    return motion


@pytest.mark.parametrize("below", [0.02, 0.05])  # above the fruit's crown, and beside it
def test_a_push_on_the_outer_faces_stops_the_hook_and_the_hand_rises(below):
    scene = over_the_fruit()
    RollingBall(scene, 0.0405)
    begin = scene.tcp[2, 3]
    lowest = [begin]

    def push(_tick: int) -> None:
        scene.gripper.motor_force = -1.5 * OUTER if scene.tcp[2, 3] < begin - below else 0.0
        lowest[0] = min(lowest[0], scene.tcp[2, 3])

    outcome = draw(scene, each_tick=push)
    assert outcome.reason.code == "CONTACT"
    assert outcome.reason.data["force_n"] == pytest.approx(1.5 * OUTER)
    assert begin - lowest[0] < below + 5e-3
    assert is_up_again(scene)


class Below:
    """A thing under the fingers' tips that only a sensor at the wrist feels; it gives by 7 N/mm."""

    def __init__(self, scene: PickingScene, height: float) -> None:
        self.load, self._scene, self._height, self.most = (
            MockLoadSensor(scene.clock),
            scene,
            height,
            0.0,
        )
        self.load.feel = self._feel
        scene.clock.advance(0.1)

    def _feel(self, _now: float) -> np.ndarray:
        force = 7e3 * max(self._height - self._scene.tcp[2, 3], 0.0)
        self.most = max(self.most, force)
        return np.array([[0.0, 0.0, -force, 0.0, 0.0, 0.0]])


def draw_with_wrist(scene: PickingScene, load: MockLoadSensor, **settings) -> SkillEnd:
    devices = {**scene.devices, LoadSensor: load}
    return drive(Hook(), {"hook": a_hook()}, devices, clock=scene.clock, **settings)


def test_a_thing_above_the_fruit_that_the_pads_do_not_feel_is_a_contact_and_the_hand_rises():
    scene = over_the_fruit()
    below = Below(scene, scene.tcp[2, 3] - 0.015)
    outcome = draw_with_wrist(scene, below.load)
    assert outcome.reason.code == "CONTACT"
    assert outcome.reason.data["force_n"] > 0.5
    assert below.most < 8.0
    assert is_up_again(scene)


def test_a_tip_on_the_fruits_shoulder_ends_the_way_down_at_its_force():
    scene = over_the_fruit()
    below = Below(scene, a_hook().T_base_grasp[2, 3] + 0.008)
    draw_with_wrist(scene, below.load)
    assert below.most < 4.0
    assert is_up_again(scene)


def test_the_wrist_feels_the_edges_beside_the_pads():
    """Pad and edge push in different directions: the difference of the vectors counts, not that of their lengths."""
    scene = over_the_fruit()
    load = MockLoadSensor(scene.clock)
    load.feel = lambda _now: np.array([[edge, pulled, -(down + pressed), 0.0, 0.0, 0.0]])
    scene.fingers.feel = lambda _now: np.array([[-down, 0.0, -pulled, 0.0, 0.0, 0.0], np.zeros(6)])
    down = pulled = pressed = edge = 0.0
    with Touch(scene.fingers) as pads, Touch(load) as wrist:
        scene.clock.advance(0.2)
        hand = feeling.ManoeuvreHand(
            pads, feeling.OuterFaces(scene.gripper), wrist
        ).touching_nothing()
        pulled = 4.0
        scene.clock.advance(0.2)
        assert hand.downwards < 0.1
        assert hand.edges < 0.1
        down = 2.0
        scene.clock.advance(0.2)
        assert hand.downwards == pytest.approx(2.0, abs=0.1)
        assert hand.edges < 0.1
        pressed = 6.0
        scene.clock.advance(0.2)
        assert hand.downwards > 6.0
        assert hand.edges == pytest.approx(6.0, abs=0.1)
        down, pressed, edge = 0.0, 0.0, 3.0
        scene.clock.advance(0.2)
        assert hand.edges == pytest.approx(3.0, abs=0.1)
        assert hand.present < 4.5


@pytest.mark.slow
def test_hard_edges_end_a_pull_within_its_step_below_the_force_that_bruises():
    scene = over_the_fruit()
    load, most = MockLoadSensor(scene.clock), [0.0]

    def feel(_now: float) -> np.ndarray:
        come = max(float((scene.tcp[:3, 3] - begin) @ pull_of(a_hook())) - 0.006, 0.0)
        most[0] = max(most[0], 1.5e3 * come)
        return np.array([[1.5e3 * come, 0.0, 0.0, 0.0, 0.0, 0.0]])

    begin = scene.tcp[:3, 3]
    load.feel = feel
    outcome = draw_with_wrist(scene, load)
    assert outcome.reason.code == "PULL_BLOCKED"
    assert 0.5 * bears_at_edges(a_hook()) < most[0] < 1.3 * bears_at_edges(a_hook())
    assert is_up_again(scene)


def test_a_wrist_that_feels_nothing_any_more_stops_the_arm():
    scene = over_the_fruit()
    below = Below(scene, -1.0)
    lose = lambda tick: below.load.lose(10.0) if tick == 30 else None  # noqa: E731
    assert draw_with_wrist(scene, below.load, each_tick=lose).reason.code == "SENSOR_STALE"
    assert scene.arm.settled()


def test_it_begins_over_the_fruit_only():
    scene = PickingScene(workspace=AT_WALL)
    assert draw(scene).reason.code == "NOT_AT_PRE_GRASP"
    assert not scene.arm.followed


def test_fingers_that_feel_nothing_any_more_stop_the_arm():
    scene = over_the_fruit()
    RollingBall(scene, 0.0405)

    def lose(tick: int) -> None:
        if scene.arm.followed and tick % 10 == 0:
            scene.fingers.lose(10.0)

    outcome = draw(scene, each_tick=lose)
    assert outcome.reason.code == "SENSOR_STALE"
    assert scene.arm.settled()


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason(code):
    scene = over_the_fruit()
    outcome = draw(scene, each_tick=scene.arm_trouble(code))
    assert outcome.reason.code == code
    assert scene.arm.settled()


def test_a_pull_out_of_reach_is_a_reason_and_the_hand_rises(monkeypatch):
    broken = SimpleNamespace(complete=False, reason="a joint is at its limit")
    monkeypatch.setattr(feeling, "straight_line", lambda *_: broken)
    scene = over_the_fruit()
    outcome = draw(scene)
    assert outcome.reason.code == "NO_STRAIGHT_LINE"
    assert is_up_again(scene)


def test_interrupted_the_arm_comes_to_rest():
    scene = over_the_fruit()
    RollingBall(scene, 0.0405)
    draw(scene, interrupt_after=60)
    scene.clock.advance(1.0)
    assert scene.arm.settled()
    assert np.isfinite(scene.tcp).all()
