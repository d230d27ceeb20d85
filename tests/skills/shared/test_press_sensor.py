"""Skills of a cell with fingertips that measure pressing force alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import ForceSensor, Gripper, PressSensor
from pomona.executive.skill_testing import drive
from pomona.skills.approach import Approach
from pomona.skills.grasp import PRESSED_ALONE, UNMEASURED, Grasp
from pomona.skills.lift import Lift
from pomona.tools.mock.hand import spring_fruit
from tests.skills.picking_scene import PickingScene, a_grasp, q_at_grasp

GRASP = a_grasp()


def scene_of(**place: Any) -> tuple[PickingScene, dict[type, object]]:
    scene = PickingScene(**place)
    scene.clock.advance(0.01)
    return scene, {**scene.without_sensor, PressSensor: scene.fingers}


@pytest.mark.parametrize("force", [3.0, 6.0])
def test_a_grip_ends_at_its_force_by_the_pads_without_a_motors_force(force: float) -> None:
    scene, devices = scene_of(width=0.10)
    scene.fingers.feel = spring_fruit(scene.gripper, 0.08)
    outcome = drive(Grasp(), {"force": force}, devices, clock=scene.clock)
    assert outcome.status is Status.SUCCESS, outcome.reason
    pressed = -scene.fingers.latest().wrenches[:, 2].sum()
    assert force <= pressed < force + 1.5


def test_fingers_between_which_nothing_presses_have_gripped_nothing() -> None:
    scene, devices = scene_of(width=0.10)
    assert drive(Grasp(), {}, devices, clock=scene.clock).reason.code == "NO_CONTACT"


def test_a_touch_of_one_finger_stops_the_approach() -> None:
    scene, devices = scene_of(q=GRASP.q_pre_grasp[0].copy(), width=GRASP.width)

    def feel(now: float) -> np.ndarray:
        wrenches = np.zeros((2, 6))
        wrenches[1, 2] = -3.0 if now > 0.7 else 0.0
        return wrenches

    scene.fingers.feel = feel
    outcome = drive(Approach(), {"grasp": GRASP}, devices, clock=scene.clock)
    assert (outcome.reason.code, outcome.reason.data["finger"]) == ("CONTACT", "right")


def test_a_fruit_that_presses_on_neither_finger_any_more_is_lost() -> None:
    scene, devices = scene_of(q=q_at_grasp().copy(), width=0.085)
    scene.hold_fruit()

    def lose(tick: int) -> None:
        if tick == 20:
            scene.fingers.feel = lambda _now: np.zeros((2, 6))

    outcome = drive(Lift(), {}, devices, clock=scene.clock, each_tick=lose)
    assert outcome.reason.code == "LOST"
    assert "presses on neither finger" in outcome.reason.message


class Facts:
    """A cell file in which only some devices have a place."""

    def __init__(self, *there: type) -> None:
        self.there = there

    def known(self, _kind: type) -> None:
        return None

    def place(self, interface: type) -> Path | None:
        return Path(interface.__name__) if interface in self.there else None


def test_the_check_states_what_a_grip_without_shear_cannot_know() -> None:
    (plain,) = Grasp.judge({}, Facts(Gripper))  # type: ignore[arg-type]
    (tips,) = Grasp.judge({}, Facts(Gripper, PressSensor))  # type: ignore[arg-type]
    assert (plain.message, tips.message) == (UNMEASURED, PRESSED_ALONE)
    assert not list(Grasp.judge({}, Facts(Gripper, ForceSensor)))  # type: ignore[arg-type]
