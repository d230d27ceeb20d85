from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.crates import insert as insert_module
from pomona.applications.crates.feeling import PRESSED
from pomona.applications.crates.hooks import Beside
from pomona.applications.crates.insert import Insert
from pomona.applications.crates.inserts import insert_candidates
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.grasps.gripper_shape import gripper_shape
from pomona.skills.motion.planning.arm_space import arm_space
from tests.skills.applications.crates.wall_scene import apple
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL, WORKSPACE, PickingScene

STIFFNESS = 2e3
"""Of a thing that a finger meets [N/m]."""


@cache
def an_insert() -> Grasp:
    fruit = apple((0.104, 0.0), (-0.104, 0.0))
    space = arm_space(PickingScene().arm, WORKSPACE, None, ROBOT_MODEL.width_max, 4e-3)
    fingers = gripper_shape(ROBOT_MODEL)
    return insert_candidates(
        Beside.of(fruit, WORKSPACE), space, OBSERVE, fingers, ROBOT_MODEL.width_max
    ).grasps[0]


def over_the_fruit() -> PickingScene:
    insert = an_insert()
    scene = PickingScene(q=insert.q_pre_grasp[0].copy(), width=insert.width)
    scene.clock.advance(0.1)  # the fingers have sent something
    return scene


def go_down(scene: PickingScene, **settings) -> SkillEnd:
    return drive(Insert(), {"insert": an_insert()}, scene.devices, clock=scene.clock, **settings)


def is_up_again(scene: PickingScene) -> bool:
    return abs(scene.tcp[2, 3] - an_insert().T_base_pre_grasp[2, 3]) < 1e-3


class Flank:
    """A thing beside the left pad that presses it along the hand's y axis below a height; it gives by 2 N/mm."""

    def __init__(self, scene: PickingScene, below: float, aside: float) -> None:
        self._scene, self._aside = scene, aside  # way sideways that frees the hand [m]
        self._height = an_insert().T_base_grasp[2, 3] + below
        self._begin = scene.tcp[:3, 3].copy()
        self.most = 0.0
        scene.fingers.feel = self._feel

    def _feel(self, _now: float) -> np.ndarray:
        tcp = self._scene.tcp
        away = float((tcp[:3, 3] - self._begin) @ tcp[:3, 1])
        deep = min(self._height - tcp[2, 3], self._aside - away)
        wrenches = np.full((2, 6), 0.02)
        if deep > 0.0:
            wrenches[0, 2] -= STIFFNESS * deep
            self.most = max(self.most, STIFFNESS * deep)
        return wrenches


def test_free_fingers_go_down_to_the_grasp_and_give_it_as_the_hand_stands():
    scene = over_the_fruit()
    outcome = go_down(scene)
    assert outcome.status is Status.SUCCESS, outcome.reason
    np.testing.assert_allclose(scene.tcp, an_insert().T_base_grasp, atol=2e-3)
    np.testing.assert_allclose(outcome.outputs["grasp"].T_base_grasp, scene.tcp, atol=1e-9)
    assert outcome.outputs["shifted"] < 1e-3


def test_a_hand_that_is_pressed_gives_way_sideways_and_takes_the_fruit_along():
    scene = over_the_fruit()
    flank = Flank(scene, below=0.03, aside=0.003)
    outcome = go_down(scene)
    assert outcome.status is Status.SUCCESS, outcome.reason
    assert outcome.outputs["shifted"] == pytest.approx(0.003, abs=1e-3)
    assert flank.most < 2.5
    grasp, planned = outcome.outputs["grasp"], an_insert()
    moved = grasp.T_base_grasp[:2, 3] - planned.T_base_grasp[:2, 3]
    np.testing.assert_allclose(
        grasp.fruit.T_base_fruit[:2, 3] - planned.fruit.T_base_fruit[:2, 3], moved, atol=1e-9
    )


def test_what_does_not_give_way_ends_it_at_its_force_and_the_hand_rises():
    scene = over_the_fruit()
    flank = Flank(scene, below=0.03, aside=1.0)
    outcome = go_down(scene)
    assert outcome.reason.code == "FORCE_LIMIT"
    assert 0.02 < outcome.reason.data["before_grasp_m"] < 0.035
    assert flank.most < 4.0
    assert is_up_again(scene)


def test_a_heavy_fruit_is_pressed_with_what_its_floor_leaves(monkeypatch: pytest.MonkeyPatch):
    most = []
    for weight in (0.0, 10.0):
        monkeypatch.setattr(insert_module, "weight_of", lambda _insert, weight=weight: weight)
        scene = over_the_fruit()
        flank = Flank(scene, below=0.03, aside=1.0)
        assert go_down(scene).reason.code == "FORCE_LIMIT"
        most.append(flank.most)
    assert most[1] < 0.8 * most[0]


def test_a_push_from_outside_is_felt_by_the_motor_and_ends_it_too():
    scene = over_the_fruit()
    scene.gripper.motor_force = 0.0

    def push(_tick: int) -> None:
        low = scene.tcp[2, 3] < an_insert().T_base_grasp[2, 3] + 0.03
        scene.gripper.motor_force = -3.0 if low else 0.0

    outcome = go_down(scene, each_tick=push)
    assert outcome.reason.code == "FORCE_LIMIT"
    assert outcome.reason.data["force_n"] == pytest.approx(3.0)
    assert is_up_again(scene)


def test_a_hand_beside_the_fruit_is_centred_on_it_as_the_fingers_close():
    scene = over_the_fruit()
    width = an_insert().width
    begin = scene.tcp[:3, 3].copy()

    def feel(_now: float) -> np.ndarray:
        off = 0.002 - float(
            (scene.tcp[:3, 3] - begin) @ scene.tcp[:3, 1]
        )  # of the fruit, towards the left finger
        wrenches = np.full((2, 6), 0.02)
        if scene.tcp[2, 3] < an_insert().T_base_grasp[2, 3] + 0.005:
            fruit = width - 0.005
            left, right = (
                (fruit - scene.gripper.width) / 2.0 + off,
                (fruit - scene.gripper.width) / 2.0 - off,
            )
            wrenches[:, 2] -= [STIFFNESS * max(left, 0.0), STIFFNESS * max(right, 0.0)]
        return wrenches

    scene.fingers.feel = feel
    outcome = go_down(scene)
    assert outcome.status is Status.SUCCESS, outcome.reason
    shift = float((scene.tcp[:3, 3] - begin) @ scene.tcp[:3, 1])
    assert shift == pytest.approx(0.002, abs=1e-3)
    assert feel(0.0)[:, 2].max() < -0.3  # both pads are at the fruit


def test_fingers_that_are_closed_are_opened_over_the_fruit_first():
    scene = over_the_fruit()
    scene.gripper.width = 0.05
    assert go_down(scene).status is Status.SUCCESS
    assert scene.gripper.moves[0].width == pytest.approx(an_insert().width)


def test_the_force_with_which_the_motor_brakes_the_fingers_is_no_push():
    scene = over_the_fruit()
    scene.gripper.width = 0.05

    def brake(_tick: int) -> None:
        moves = scene.gripper.moves
        scene.gripper.motor_force = (
            0.0 if scene.arm.followed or not moves or not moves[0].settled else 1.5
        )
        if moves and moves[0].settled and scene.clock.now() > ended[0] + 0.1:
            scene.gripper.motor_force = 0.0
        ended[0] = scene.clock.now() if not moves or not moves[0].settled else ended[0]

    ended = [0.0]
    assert go_down(scene, each_tick=brake).status is Status.SUCCESS


@pytest.mark.parametrize("trouble", ["blocked", "pressed"])
def test_something_at_the_fingers_is_a_contact_before_the_arm_moves(trouble):
    scene = over_the_fruit()
    if trouble == "blocked":
        scene.gripper.width, scene.gripper.blocked_at = 0.103, 0.103
    else:
        scene.gripper.motor_force = -2.0 * PRESSED
    assert go_down(scene).reason.code == "CONTACT"
    assert not scene.arm.followed


def test_it_begins_over_the_fruit_only():
    scene = PickingScene()
    assert go_down(scene).reason.code == "NOT_AT_PRE_GRASP"
    assert not scene.arm.followed


def test_fingers_that_feel_nothing_any_more_stop_the_arm():
    scene = over_the_fruit()

    def lose(_tick: int) -> None:
        if scene.arm.followed:
            scene.fingers.lose(10.0)

    assert go_down(scene, each_tick=lose).reason.code == "SENSOR_STALE"
    assert scene.arm.settled()


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason(code):
    scene = over_the_fruit()
    assert go_down(scene, each_tick=scene.arm_trouble(code)).reason.code == code
    assert scene.arm.settled()


def test_a_place_out_of_reach_is_a_reason():
    scene = over_the_fruit()
    far = an_insert().T_base_grasp.copy()
    far[2, 3] -= 1.0
    outcome = drive(
        Insert(),
        {"insert": replace(an_insert(), T_base_grasp=far)},
        scene.devices,
        clock=scene.clock,
    )
    assert outcome.reason.code == "NO_STRAIGHT_LINE"


def test_interrupted_the_arm_comes_to_rest():
    scene = over_the_fruit()
    go_down(scene, interrupt_after=60)
    scene.clock.advance(1.0)
    assert scene.arm.settled()
    assert np.isfinite(scene.tcp).all()
