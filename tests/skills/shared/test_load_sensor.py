"""Skills of a cell with a load sensor at the wrist and no force fingers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import LoadSensor
from pomona.executive.skill_testing import drive
from pomona.skills.approach import Approach
from pomona.skills.lift import Lift
from pomona.skills.motion.lines import straight_line
from pomona.skills.release import Release
from pomona.skills.retreat import Retreat
from pomona.skills.shared.touch import FINE
from pomona.tools.mock import MockLoadSensor
from tests.skills.picking_scene import ROBOT_MODEL, PickingScene, a_grasp, q_at_grasp
from tests.skills.test_release import over_ground

GRASP = a_grasp()
WEIGHT = 1.8  # of the fruit [N]
OFFSET = np.array([3.0, -7.0, 12.0])  # of a sensor that was never zeroed [N]


class Hand:
    """A hand on a load sensor: `weighs` gives the force that hangs on it now [N]."""

    def __init__(self, scene: PickingScene, weighs: Callable[[], float] = lambda: 0.0) -> None:
        self.scene, self.weighs = scene, weighs
        self.sensor = MockLoadSensor(scene.clock)
        self.sensor.feel = self.feel
        scene.clock.advance(0.01)
        self.devices: dict[type, object] = {**scene.without_sensor, LoadSensor: self.sensor}

    def feel(self, _now: float) -> np.ndarray:
        wrench = np.zeros((1, 6))
        wrench[0, :3] = OFFSET + ROBOT_MODEL.tcp(self.scene.arm.q)[:3, :3].T @ [
            0.0,
            0.0,
            -self.weighs(),
        ]
        return wrench

    def run(
        self,
        skill: Any,
        inputs: dict[str, Any],
        each_tick: Callable[[int], None] = lambda tick: None,
    ) -> Any:
        return drive(skill, inputs, self.devices, clock=self.scene.clock, each_tick=each_tick)


def gripping(q: np.ndarray, width: float = 0.085) -> PickingScene:
    scene = PickingScene(q=q.copy(), width=width)
    scene.grip_plainly()
    return scene


def test_a_touch_of_the_hand_stops_the_approach() -> None:
    scene = PickingScene(q=GRASP.q_pre_grasp[0].copy(), width=GRASP.width)
    hand = Hand(scene, lambda: 0.0 if scene.clock.now() < 0.7 else -4.0)
    outcome = hand.run(Approach(), {"grasp": GRASP})
    assert outcome.reason.code == "CONTACT"
    assert "the hand touched something" in outcome.reason.message
    assert scene.arm.settled()
    assert np.linalg.norm(scene.tcp[:3, 3] - GRASP.T_base_grasp[:3, 3]) > 0.02


def test_beside_force_fingers_that_feel_nothing_a_touch_of_the_hand_stops_the_approach() -> None:
    scene = PickingScene(q=GRASP.q_pre_grasp[0].copy(), width=GRASP.width)
    hand = Hand(scene, lambda: 0.0 if scene.clock.now() < 0.7 else -6.0)
    hand.devices = {**scene.devices, LoadSensor: hand.sensor}
    outcome = hand.run(Approach(), {"grasp": GRASP})
    assert outcome.reason.code == "CONTACT"
    assert "the hand touched something" in outcome.reason.message
    assert scene.arm.settled()


def test_the_inertia_of_the_hand_is_no_touch() -> None:
    scene = PickingScene(q=GRASP.q_pre_grasp[0].copy(), width=GRASP.width)
    hand = Hand(scene, lambda: 1.0 * MockLoadSensor.mass if 0.1 < scene.clock.now() < 0.3 else 0.0)
    assert hand.run(Approach(), {"grasp": GRASP}).status is Status.SUCCESS


def lifted(scene: PickingScene) -> float:
    return float(scene.tcp[2, 3] - GRASP.T_base_grasp[2, 3])


def test_a_fruit_whose_weight_hangs_on_the_hand_is_lifted() -> None:
    scene = gripping(q_at_grasp())
    hand = Hand(scene, lambda: WEIGHT if lifted(scene) > 1e-3 else 0.0)
    assert hand.run(Lift(), {"hold_time": 0.3}).status is Status.SUCCESS


def test_fingers_that_hold_something_without_weight_have_lifted_nothing() -> None:
    scene = gripping(q_at_grasp())  # the motor presses: a jammed finger, a leaf
    outcome = Hand(scene).run(Lift(), {})
    assert outcome.reason.code == "LOST"
    assert "no weight hangs on the hand" in outcome.reason.message
    assert scene.arm.settled()


def test_a_weight_that_goes_at_the_top_is_a_lost_fruit_though_the_motor_still_presses() -> None:
    scene = gripping(q_at_grasp())
    hand = Hand(scene, lambda: WEIGHT if lifted(scene) > 1e-3 and scene.clock.now() < 2.0 else 0.0)
    outcome = hand.run(Lift(), {"hold_time": 2.0})
    assert outcome.reason.code == "LOST"
    assert outcome.duration < 2.5


def test_a_sensor_that_is_too_coarse_for_a_fruit_decides_nothing() -> None:
    scene = gripping(q_at_grasp())
    hand = Hand(scene)
    hand.sensor.least = 4.0
    assert hand.run(Lift(), {}).status is Status.SUCCESS


def on_ground(scene: PickingScene, ground: float) -> Callable[[], float]:
    """The weight of a fruit that stands on a spring of 4 N/mm once the TCP is below a height, while it is held."""

    def weighs() -> float:
        if scene.gripper.width > 0.09:
            return 0.0
        return WEIGHT - 4e3 * max(ground - float(scene.tcp[2, 3]), 0.0)

    return weighs


@pytest.mark.parametrize("least", [0.3, 0.9])
def test_an_unknown_support_is_felt_and_the_fruit_put_down_there(least: float) -> None:
    scene = gripping(GRASP.q_pre_grasp[0])
    before = float(scene.tcp[2, 3])
    hand = Hand(scene, on_ground(scene, before - 0.06))
    hand.sensor.least = least
    heights: list[float] = []

    def watch(_tick: int) -> None:
        if len(scene.gripper.moves) > 1 and not heights:
            heights.append(float(scene.tcp[2, 3]))
            scene.drop_plainly()

    outcome = hand.run(Release(), {}, watch)
    assert outcome.status is Status.SUCCESS, outcome.reason
    assert before - 0.068 < heights[0] < before - 0.06
    assert scene.tcp[2, 3] == pytest.approx(before, abs=1e-3)


def test_over_nothing_the_fruit_stays_held() -> None:
    scene = gripping(GRASP.q_pre_grasp[0])
    outcome = Hand(scene, lambda: WEIGHT).run(Release(), {"depth": 0.04})
    assert outcome.reason.code == "NO_CONTACT"
    assert len(scene.gripper.moves) == 1


def test_a_drift_of_the_sensor_is_no_support() -> None:
    scene = gripping(GRASP.q_pre_grasp[0])
    outcome = Hand(scene, lambda: WEIGHT - 1.0 * scene.clock.now()).run(Release(), {"depth": 0.04})
    assert outcome.reason.code == "NO_CONTACT"
    assert len(scene.gripper.moves) == 1


def test_a_coarse_sensor_leaves_putting_down_to_the_known_table() -> None:
    scene = gripping(GRASP.q_pre_grasp[0])
    hand = Hand(scene, lambda: WEIGHT)
    hand.sensor.least = 1.1 * FINE
    outcome = hand.run(Release(), {"depth": 0.03, "grasp": GRASP})
    assert outcome.reason.code == "NO_CONTACT"
    assert "no force sensor" in outcome.reason.message
    assert scene.arm.followed == []


def test_a_lifted_fruit_is_lowered_until_the_hand_feels_its_support() -> None:
    T = GRASP.T_base_grasp.copy()
    T[2, 3] += 0.06
    scene = gripping(straight_line(ROBOT_MODEL, q_at_grasp(), T).q[-1])
    support = float(GRASP.T_base_grasp[2, 3]) + 0.008
    hand = Hand(scene, on_ground(scene, support))
    heights: list[float] = []

    def watch(_tick: int) -> None:
        if len(scene.gripper.moves) > 1 and not heights:
            heights.append(float(scene.tcp[2, 3]))
            scene.drop_plainly()

    assert hand.run(Retreat(), {"grasp": GRASP}, watch).status is Status.SUCCESS
    assert support - 2e-3 < heights[0] < support


def beside_fingers(presses: Callable[[PickingScene], float]) -> Hand:
    """A fruit of 1.5 N that force fingers hold over nothing, while something presses up on the hand by this force."""
    scene = over_ground(None)
    hand = Hand(scene, lambda: 1.5 - presses(scene))
    hand.devices = {**scene.devices, LoadSensor: hand.sensor}
    return hand


def test_a_finger_that_meets_something_beside_the_held_fruit_ends_the_way_down() -> None:
    start = float(over_ground(None).tcp[2, 3])
    pressed = [0.0]

    def presses(scene: PickingScene) -> float:
        pressed.append(1e4 * max(start - 0.03 - float(scene.tcp[2, 3]), 0.0))  # 10 N/mm
        return pressed[-1]

    hand = beside_fingers(presses)
    outcome = hand.run(Release(), {"speed": 0.05})
    assert outcome.reason.code == "LOWERING_BLOCKED"
    assert "a finger met something" in outcome.reason.message
    assert hand.scene.gripper.moves == []  # the fruit is still held
    assert 1.0 < max(pressed) < 30.0  # 26 N; 32 N if the arm were stopped in the next tick


def test_without_a_load_sensor_the_same_press_is_not_felt() -> None:
    hand = beside_fingers(lambda scene: 30.0)
    del hand.devices[LoadSensor]
    assert hand.run(Release(), {"depth": 0.05}).reason.code == "NO_CONTACT"


def test_the_inertia_of_the_hand_ends_no_way_down() -> None:
    hand = beside_fingers(
        lambda scene: 0.9 * MockLoadSensor.mass if 0.1 < scene.clock.now() < 0.3 else 0.0
    )
    assert hand.run(Release(), {"depth": 0.05}).reason.code == "NO_CONTACT"


def test_an_arm_that_brakes_harder_than_its_set_points_ends_no_way_down() -> None:
    """In the crates of the simulation each way down met 2.1 N in its first 0.1 s, by inertia alone."""
    hand = beside_fingers(
        lambda scene: 1.4 * MockLoadSensor.mass if 0.1 < scene.clock.now() < 0.3 else 0.0
    )
    assert hand.run(Release(), {"depth": 0.05}).reason.code == "NO_CONTACT"


def test_a_fruit_that_the_hand_feels_on_its_support_too_is_put_down() -> None:
    start = float(over_ground(None).tcp[2, 3])
    scene = over_ground(start - 0.06)
    hand = Hand(scene, lambda: 1.5 - 4e3 * max(start - 0.06 - float(scene.tcp[2, 3]), 0.0))
    hand.devices = {**scene.devices, LoadSensor: hand.sensor}
    outcome = hand.run(Release(), {})
    assert outcome.status is Status.SUCCESS, outcome.reason
