"""Is a fruit held, by whichever sensor the cell has; and how heavy it may be."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pomona.drivers.fruit_body import HARD_MODULUS, UNKNOWN_PRESSURE, bruising_force
from pomona.drivers.interfaces import ForceSensor, Gripper, Hand, PressSensor
from pomona.skills.perception.fruit.catalogue import mass_of
from pomona.skills.shared import held_fruit
from pomona.skills.shared.held_fruit import (
    LARGE,
    bearable_force,
    bruising,
    expected_load,
    is_between,
    is_held,
    is_pressed,
    note_held,
    show_grip,
    watch_fruit,
    watch_grip,
)
from tests.skills.picking_scene import PickingScene, apple_at


def skill_of(scene: PickingScene, **more: object) -> Any:
    kinds = {"fingers": ForceSensor, "tips": PressSensor, "hand": Hand}
    there = {Gripper: scene.gripper, **{kinds[name]: device for name, device in more.items()}}
    return SimpleNamespace(device=there.__getitem__, optional_device=there.get)


def press(scene: PickingScene, left: float, right: float) -> None:
    wrenches = np.zeros((2, 6))
    wrenches[:, 2] = -left, -right
    scene.fingers.feel = lambda _now: wrenches
    scene.clock.advance(0.01)


@pytest.mark.parametrize("kind", ["fingers", "tips"])
def test_both_fingers_hold_and_one_presses(kind: str) -> None:
    scene = PickingScene(width=0.07)
    skill = skill_of(scene, **{kind: scene.fingers})
    for left, right, held, pressed in (
        (1.0, 1.0, True, True),
        (0.0, 1.0, False, True),
        (1.0, 0.0, False, True),
        (0.24, 0.24, False, False),
    ):
        press(scene, left, right)
        assert (is_held(skill), is_between(skill), is_pressed(skill)) == (held, held, pressed)
        assert (watch_fruit(skill)() == "") is held


def test_force_fingers_come_before_fingertips_that_press() -> None:
    scene, other = PickingScene(width=0.07), PickingScene(width=0.07)
    press(scene, 1.0, 1.0)
    press(other, 0.0, 0.0)
    assert is_held(skill_of(scene, fingers=scene.fingers, tips=other.fingers))
    assert not is_held(skill_of(scene, fingers=other.fingers, tips=scene.fingers))


@pytest.mark.parametrize(("words", "held"), [("", False), (None, False), ("an apple", True)])
def test_without_a_force_sensor_the_hand_decides(words: str | None, held: bool) -> None:
    hand = SimpleNamespace(in_hand=lambda: words)
    skill = skill_of(PickingScene(width=0.07), hand=hand)
    assert (is_held(skill), is_pressed(skill)) == (held, held)


def test_without_any_sensor_width_and_motor_decide_and_a_change_of_them_is_a_loss() -> None:
    scene = PickingScene(width=0.07)
    scene.grip_plainly()
    skill = skill_of(scene)
    assert is_held(skill)
    lost = watch_fruit(skill)
    assert lost() == ""
    scene.drop_plainly()
    scene.clock.advance(0.2)
    assert "0" in lost()


def test_the_grip_that_has_the_fingers_decides_unless_it_has_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = PickingScene(width=0.07)
    press(scene, 1.0, 1.0)
    skill = skill_of(scene, fingers=scene.fingers)
    holding = SimpleNamespace(holds=True, ended=False)
    empty = SimpleNamespace(holds=False, ended=False)
    given: Any = empty
    assert not is_held(skill, given)
    assert watch_fruit(skill, given)() == "it presses on neither finger"
    given.ended = True
    assert is_held(skill, given)  # by the sensor
    monkeypatch.setattr(held_fruit, "current_hold", lambda _gripper: holding)
    press(scene, 0.0, 0.0)
    assert is_held(skill)
    assert is_held(skill, given)
    given.ended = False
    assert not is_held(skill, given)


def test_the_expected_load_is_the_weight_and_twice_its_doubt_lifted_by_a_tenth_of_gravity() -> None:
    fruit = apple_at(1, 3)
    known = mass_of(fruit.fruit, fruit.dimensions, fruit.covariance[3:, 3:])
    assert known is not None
    mass, sigma = known
    assert expected_load(fruit) == pytest.approx(1.1 * 9.81 * (mass + 2.0 * sigma))
    assert 1.1 * 9.81 * 0.15 < expected_load(fruit) < 1.1 * 9.81 * 0.45  # an apple
    unsure = replace(fruit, covariance=np.eye(6) * 25e-6)
    assert expected_load(unsure) > 1.05 * expected_load(fruit)


def account_of(turned: float) -> dict[str, tuple[str, float]]:
    """What a held apple adds to the account whose load's lever has moved on the pads by so much [m]."""
    scene = PickingScene(width=0.07)
    skill = skill_of(scene, fingers=scene.fingers)
    entries: dict[str, tuple[str, float]] = {}
    skill.account = lambda about, words, press=0.0: entries.update({about: (words, press)})
    hold: Any = SimpleNamespace(
        ended=False,
        reading=SimpleNamespace(f_n=4.0, f_t=2.0),
        peaks=np.array([9.0, 5.0, 4.0]),
        press_below=3.5,
        turned=turned,
    )
    note_held(skill, hold, apple_at(1, 3))
    return entries


def test_the_largest_press_of_the_pads_is_in_the_account_of_a_held_fruit() -> None:
    assert account_of(0.0)["the pads"][1] == pytest.approx(2.5 / bruising(apple_at(1, 3)))


def test_what_carried_the_fruit_before_the_lift_is_in_the_account_as_hard() -> None:
    hard = bruising(apple_at(1, 3), HARD_MODULUS)
    assert account_of(0.0)["its support"][1] == pytest.approx(3.5 / hard)


def test_a_fruit_that_has_turned_in_the_pads_makes_the_task_done_in_part() -> None:
    assert account_of(1e-4)["the held fruit"][0] == ""
    assert (
        "turned in the pads: the lever of its weight moved by 0.6 mm"
        in (account_of(6e-4)["the held fruit"][0])
    )


def test_two_fingers_press_twice_as_hard_as_bruises_by_one_less_a_tenth() -> None:
    fruit = apple_at(1, 3)
    assert bearable_force(fruit) == pytest.approx(
        0.9 * 2.0 * bruising_force(fruit.fruit.pressure, 0.0445)
    )
    assert bearable_force(None) == pytest.approx(
        1.8 * bruising_force(UNKNOWN_PRESSURE, 0.5 * LARGE)
    )


def hold_with(waiting: float, code: str = "") -> Any:
    numbers = {name: np.array([float(k)]) for k, name in enumerate(
        ("t", "f_n", "f_ref", "f_least", "f_t", "slip_speed", "width")
    )}  # fmt: skip
    problem = SimpleNamespace(code=code, message="it slips", data={"speed": 3.0}) if code else None
    return SimpleNamespace(
        waiting=waiting, drain=lambda: SimpleNamespace(**numbers), problem=problem,
        settings=SimpleNamespace(loop=SimpleNamespace(max_force=17.0)),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("waiting", "everything", "shown"),
    [(0.11, False, 1), (0.09, False, 0), (0.09, True, 1), (0.0, True, 0), (0.11, True, 1)],
)
def test_a_grip_is_shown_ten_times_a_second_and_at_its_end(
    waiting: float, everything: bool, shown: int
) -> None:
    views: list[Any] = []
    skill: Any = SimpleNamespace(publish=lambda topic, view: views.append((topic, view)))
    show_grip(skill, hold_with(waiting), everything)
    assert len(views) == shown
    for topic, view in views:
        assert topic == "grip"
        assert view.t == [0.0]
        assert [float(value[0]) for value in view.values.values()] == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
        assert [name.split(" [")[0] for name in view.values] == [
            "grasp force", "reference", "minimum grip force", "tangential load", "slip speed", "width",
        ]  # fmt: skip
        assert view.thresholds == {"force limit [N]": 17.0}


def test_a_problem_of_the_grip_is_the_skills_failure_if_it_declares_it() -> None:
    class Told(Exception):
        pass

    skill: Any = SimpleNamespace(
        publish=lambda _topic, _view: None,
        failures=("SLIPPED",),
        failure=lambda code, message, **data: Told(code, message, data),
    )
    watch_grip(skill, hold_with(0.2, "FORCE_LIMIT"))
    with pytest.raises(Told) as told:
        watch_grip(skill, hold_with(0.2, "SLIPPED"))
    assert told.value.args == ("SLIPPED", "it slips", {"speed": 3.0})
