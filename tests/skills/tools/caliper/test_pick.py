"""Touches of a record as a measurement."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pomona.tools.caliper.pick import UnusableTouches, pick_from
from tests.skills.tools.caliper.synthetic import doubted, recorded


def test_the_first_touch_shows_how_far_the_fruit_lies_to_that_side():
    for shift in (3e-3, -3e-3):
        pick = pick_from(recorded(shift, yaw=0.4), "run")
        assert pick.side * pick.first == pytest.approx(shift)
        assert pick.wider == pytest.approx(0.0, abs=1e-12)


def test_axis_and_place_are_in_the_cameras_frame():
    pick = pick_from(recorded(yaw=0.0, x=0.1, y=-0.4), "run")
    np.testing.assert_allclose(pick.place, [0.1, -0.1, 0.5], atol=1e-12)
    np.testing.assert_allclose(pick.axis, [1.0, 0.0, 0.0], atol=1e-12)


def test_one_finger_alone_shows_the_place_but_not_the_width():
    value = recorded(3e-3) | {"right": None}
    pick = pick_from(value, "run")
    assert pick.first == pytest.approx(3e-3)
    assert np.isnan(pick.wider)


def test_fingers_that_closed_beside_the_widest_section_show_the_place_but_not_the_width():
    pick = pick_from(recorded(3e-3, wider=-4e-3), "run")
    assert pick.first == pytest.approx(3e-3)
    assert np.isnan(pick.wider)


def plain(width: float | None) -> dict[str, Any]:
    return recorded() | {"left": None, "right": None, "closed": {"width": width}}


@pytest.mark.parametrize(
    "width", [0.083, 0.080, 0.069, 0.055]
)  # a Hand-E squeezed apples by 4 to 11 mm
def test_a_plain_gripper_presses_and_measures_neither_place_nor_width(width: float):
    pick = pick_from(plain(width), "run")
    assert pick.side == 0
    assert np.isnan([pick.first, pick.wider]).all()


def test_a_finger_that_landed_shows_the_way_from_the_skin_to_it():
    pick = pick_from(recorded() | {"right": None, "landed": [0.0, 3e-3, 4e-3]}, "run")
    assert pick.landed
    assert pick.first == pytest.approx(5e-3)
    np.testing.assert_allclose(pick.axis, [0.0, -0.6, -0.8], atol=1e-12)  # the camera looks down
    assert np.isnan(pick.wider)


def test_a_doubted_look_is_a_table_without_a_fruit():
    pick = pick_from(doubted(np.zeros(8)), "run")
    assert pick.is_look
    np.testing.assert_allclose(pick.place, [0.0, 0.0, 0.55], atol=1e-9)


def moved(z: float) -> list[list[float]]:
    T = np.eye(4)
    T[:3, 3] = 0.0, -0.5, z
    return T.tolist()


@pytest.mark.parametrize(
    ("value", "why"),
    [
        (recorded(wider=-0.06), "touched each other"),
        (recorded(wider=-0.02), "another fruit"),
        (recorded(wider=0.02), "another fruit"),
        (plain(0.02), "touched each other"),
        (plain(0.1), "another fruit"),
        (plain(None), "the gripper reports no width"),
        (recorded(0.06), "60 mm from the measured skin"),
        (recorded() | {"left": None, "right": None}, "no finger touched"),
        (recorded() | {"skin": [0.0, 0.0]}, "no width"),
        (recorded() | {"skin": None}, "no width"),
        (recorded() | {"T_base_tcp": np.zeros((4, 4)).tolist()}, "no rigid transform"),
        (recorded() | {"T_base_camera": [[1.0, None]]}, "malformed"),
        (recorded() | {"left": {"width": None}}, "the gripper reports no width"),
        (
            recorded() | {"T_base_fruit": moved(0.2)},
            "200 mm from the fingers: they closed on another",
        ),
        (recorded() | {"left": {"width": 1e30}}, "malformed"),
        (recorded() | {"left": [1.0]}, "malformed"),
        ({}, "malformed"),
        (recorded() | {"landed": [0.0, 0.0, 0.0]}, "where it was measured"),
        (recorded() | {"landed": [0.0, 0.0, 0.08]}, "80 mm from the measured skin"),
        (recorded() | {"landed": "low"}, "malformed"),
        ({"type": "DoubtedLook"}, "malformed"),
        (doubted(np.zeros(8)) | {"table": None}, "no table"),
        (
            doubted(np.zeros(8)) | {"table": [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.5]]},
            "no table",
        ),
    ],
)
def test_touches_of_another_thing_are_refused_with_the_reason(value: dict[str, Any], why: str):
    with pytest.raises(UnusableTouches, match=why):
        pick_from(value, "run")
