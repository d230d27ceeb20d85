from types import SimpleNamespace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.crates import ease
from pomona.applications.crates.ease import EVEN, Ease
from pomona.executive.skill_testing import SkillEnd, drive
from tests.skills.picking_scene import PickingScene, a_grasp, q_at_grasp


class LeaningHold:
    """A grip of a fruit that leans on a wall until the hand has moved some way along its y axis; 1 N/mm."""

    def __init__(self, scene: PickingScene, lean: float) -> None:
        self._scene, self._begin, self._lean = scene, scene.tcp.copy(), lean

    @property
    def estimate(self) -> SimpleNamespace:
        tcp = self._scene.tcp
        left = self._lean - float((tcp[:3, 3] - self._begin[:3, 3]) @ self._begin[:3, 1])
        return SimpleNamespace(left=3.0 + max(1e3 * left, 0.0), right=3.0 - min(1e3 * left, 0.0))


@pytest.fixture(autouse=True)
def _no_curves(monkeypatch):
    monkeypatch.setattr(ease, "show_grip", lambda *_: None)


def eased(scene: PickingScene, lean: float, **settings) -> SkillEnd:
    inputs = {"hold": LeaningHold(scene, lean), "grasp": a_grasp(), "most": 0.006}
    return drive(Ease(), inputs, scene.devices, clock=scene.clock, **settings)


@pytest.mark.parametrize("lean", [0.003, -0.003])
def test_a_fruit_that_leans_is_shifted_until_both_pads_press_alike(lean):
    scene = PickingScene(q=q_at_grasp().copy())
    begin = scene.tcp
    outcome = eased(scene, lean)
    assert outcome.status is Status.SUCCESS
    moved = scene.tcp[:3, 3] - begin[:3, 3]
    assert moved @ begin[:3, 1] == pytest.approx(lean, abs=1e-3 * EVEN + 1e-4)
    assert outcome.outputs["shifted"] == pytest.approx(np.linalg.norm(moved), abs=1e-4)


def test_a_fruit_that_leans_on_nothing_stays():
    scene = PickingScene(q=q_at_grasp().copy())
    assert eased(scene, 0.0).outputs["shifted"] == 0.0
    assert not scene.arm.followed


def test_the_hand_goes_no_farther_than_allowed():
    scene = PickingScene(q=q_at_grasp().copy())
    assert eased(scene, 0.05).outputs["shifted"] <= 0.006


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason(code):
    scene = PickingScene(q=q_at_grasp().copy())
    assert eased(scene, 0.003, each_tick=scene.arm_trouble(code)).reason.code == code
    assert scene.arm.settled()


def test_a_way_that_the_arm_cannot_follow_is_a_reason(monkeypatch):
    def none(skill, _p_goal):
        raise skill.failure("NO_STRAIGHT_LINE", "the arm's limits are reached")

    monkeypatch.setattr(ease, "straight_to", none)
    scene = PickingScene(q=q_at_grasp().copy())
    assert eased(scene, 0.003).reason.code == "NO_STRAIGHT_LINE"


def test_interrupted_the_arm_comes_to_rest():
    scene = PickingScene(q=q_at_grasp().copy())
    eased(scene, 0.003, interrupt_after=8)
    scene.clock.advance(1.0)
    assert scene.arm.settled()
