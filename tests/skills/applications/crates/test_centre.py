import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.crates import feeling
from pomona.applications.crates.centre import FREED, Centre
from pomona.executive.skill_testing import SkillEnd, drive
from tests.skills.picking_scene import PickingScene, a_grasp, q_at_grasp

STIFFNESS = 2e3
"""Of pad and fruit [N/m]."""
FRUIT = 0.089


class LeaningFruit:
    """A fruit off the hand's middle, towards the left finger, which does not come along when a pad presses it."""

    def __init__(self, scene: PickingScene, off: float) -> None:
        self._scene, self._off, self._begin = scene, off, scene.tcp[:3, 3].copy()
        scene.fingers.feel = self.feel
        self.most = 0.0

    def feel(self, _now: float = 0.0) -> np.ndarray:
        off = self._off - float((self._scene.tcp[:3, 3] - self._begin) @ self._scene.tcp[:3, 1])
        half = (FRUIT - self._scene.gripper.width) / 2.0
        presses = STIFFNESS * np.clip([half + off, half - off], 0.0, None)
        wrenches = np.full((2, 6), 0.02)
        wrenches[:, 2] -= presses
        self.most = max(self.most, float(presses.max()))
        return wrenches


def at_the_grasp() -> PickingScene:
    scene = PickingScene(q=q_at_grasp().copy(), width=FRUIT + 0.008)
    scene.clock.advance(0.1)  # the fingers have sent something
    return scene


def centre(scene: PickingScene, **settings) -> SkillEnd:
    grasp = replace(a_grasp(), width=FRUIT + 0.008)
    return drive(Centre(), {"grasp": grasp}, scene.devices, clock=scene.clock, **settings)


@pytest.mark.parametrize("off", [0.002, -0.003, 0.0])
def test_the_hand_goes_to_a_fruit_beside_its_middle_until_both_pads_touch_it_and_opens_a_little(
    off,
):
    scene = at_the_grasp()
    begin, fruit = scene.tcp[:3, 3].copy(), LeaningFruit(scene, off)
    outcome = centre(scene)
    assert outcome.status is Status.SUCCESS, outcome.reason
    shift = float((scene.tcp[:3, 3] - begin) @ scene.tcp[:3, 1])
    assert shift == pytest.approx(off, abs=8e-4)
    assert outcome.outputs["shifted"] == pytest.approx(abs(shift), abs=1e-4)
    np.testing.assert_allclose(outcome.outputs["centred"].T_base_grasp, scene.tcp, atol=1e-9)
    assert (
        np.abs(fruit.feel()[:, 2]).max() < 0.3
    )  # the pads are free, as a grip needs them at its beginning
    assert scene.gripper.width - FRUIT < FREED
    assert fruit.most < 3.0


def test_the_page_shows_the_ways_of_the_hand_with_their_forces():
    scene = at_the_grasp()
    LeaningFruit(scene, 0.002)
    table = dict(centre(scene).published)["manoeuvre"]
    assert table.columns == ("manoeuvre", "way", "felt", "on outer faces", "ended by")
    assert {row[0] for row in table.rows} == {"Centre"}
    assert all(re.fullmatch(r"\d+ mm across", row[1]) for row in table.rows)
    assert 0.3 < max(float(row[2].removesuffix(" N")) for row in table.rows) < 3.0
    assert {row[4] for row in table.rows} <= {"a touch", "its end"}


def test_a_fruit_farther_aside_than_the_hand_may_go_is_still_touched_by_one_finger():
    scene = at_the_grasp()
    LeaningFruit(scene, 0.010)
    outcome = centre(scene)
    assert outcome.reason.code == "ONE_FINGER"
    assert 0.004 < outcome.reason.data["shifted_m"] <= 0.0061


def test_fingers_that_the_fruit_blocks_before_both_pads_feel_it_let_the_hand_go_on():
    scene = at_the_grasp()
    LeaningFruit(scene, 0.0021)
    scene.gripper.blocked_at = FRUIT + 0.0015
    outcome = centre(scene)
    assert outcome.reason is None or outcome.reason.data["shifted_m"] > 1e-3


def test_nothing_between_the_fingers_is_a_reason():
    scene = at_the_grasp()
    outcome = centre(scene)
    assert outcome.reason.code == "ONE_FINGER"
    assert outcome.reason.data["shifted_m"] < 1e-4


def test_fingers_that_feel_nothing_any_more_are_a_reason():
    scene = at_the_grasp()
    LeaningFruit(scene, 0.002)
    outcome = centre(scene, each_tick=lambda tick: scene.fingers.lose(10.0) if tick == 20 else None)
    assert outcome.reason.code == "SENSOR_STALE"
    assert scene.arm.settled()


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason(code):
    scene = at_the_grasp()
    LeaningFruit(scene, 0.003)
    assert centre(scene, each_tick=scene.arm_trouble(code)).reason.code == code
    assert scene.arm.settled()


def test_a_way_that_the_arm_cannot_follow_is_a_reason(monkeypatch):
    broken = SimpleNamespace(complete=False, reason="a joint is at its limit")
    monkeypatch.setattr(feeling, "straight_line", lambda *_: broken)
    scene = at_the_grasp()
    LeaningFruit(scene, 0.003)
    outcome = centre(scene)
    assert outcome.reason.code == "NO_STRAIGHT_LINE"
    assert "a joint is at its limit" in outcome.reason.message
    assert scene.arm.settled()


def test_interrupted_the_arm_comes_to_rest():
    scene = at_the_grasp()
    LeaningFruit(scene, 0.004)
    centre(scene, interrupt_after=40)
    scene.clock.advance(1.0)
    assert scene.arm.settled()
