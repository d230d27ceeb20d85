from dataclasses import replace

import numpy as np
import pytest

from pomona.applications.crates.freedom import PLENTY, freedom, obstacles_of
from pomona.drivers.interfaces import Box
from pomona.skills.geometry import transform
from pomona.skills.motion.grasps.gripper_shape import gripper_shape
from pomona.skills.perception.measured_fruit import MeasuredFruit
from tests.skills.picking_scene import APPLES, ROBOT_MODEL, TABLE_Z, WORKSPACE, apple_at

FINGERS = gripper_shape(ROBOT_MODEL)
WIDE = APPLES[1][0] * 1e-3  # width of apple 1 [m]


def apple(x: float, y: float, number: int = 1) -> MeasuredFruit:
    """An apple at a place about (-0.03, -0.52) on the table [m]."""
    made = apple_at(number, 3)
    T_base_fruit = made.T_base_fruit.copy()
    T_base_fruit[:2, 3] += [x, y]
    return replace(made, T_base_fruit=T_base_fruit)


def room(*places: tuple[float, float], walls: tuple[Box, ...] = (), air: float = 3e-3) -> float:
    """Freedom of an apple among others at places relative to it, in diameters."""
    middle = replace(apple(0.0, 0.0), beside=tuple(apple(WIDE * x, WIDE * y) for x, y in places))
    cell = replace(WORKSPACE, obstacles=walls)
    return freedom(middle, obstacles_of(middle, cell), FINGERS, ROBOT_MODEL.width_max, air)[0]


def wall(x: float, y: float, along_x: bool) -> Box:
    """A wall of 120 mm on the table whose inner face passes through a place relative to the apple [m]."""
    half = (0.2, 0.004, 0.06) if along_x else (0.004, 0.2, 0.06)
    return Box("crate", transform(None, [-0.03 + x, -0.52 + y, TABLE_Z + 0.06]), half)


def test_an_apple_alone_has_plenty_of_room() -> None:
    assert room() == PLENTY
    assert room((2.0, 0.0)) == PLENTY


def test_a_fruit_that_the_fingers_cannot_take_has_no_room() -> None:
    wide = replace(apple(0.0, 0.0), dimensions=np.array([0.1, 0.085, 0.1]))
    wide = replace(wide, beside=(apple(0.0, 0.1),))
    assert (
        freedom(wide, obstacles_of(wide, WORKSPACE), FINGERS, ROBOT_MODEL.width_max, 3e-3)[0] < 0.0
    )


def test_one_neighbour_leaves_room_and_six_around_leave_none() -> None:
    hexagon = [(np.cos(a), np.sin(a)) for a in np.arange(6) * np.pi / 3.0]
    assert room(hexagon[0]) > 0.01
    assert room(*hexagon) < room(*hexagon[:3]) < room(hexagon[0])
    assert room(*hexagon) < 0.002


def test_beside_a_wall_there_is_room_along_it_and_in_a_corner_there_is_none() -> None:
    left, front = (
        wall(-WIDE / 2.0 - 0.005, 0.0, along_x=False),
        wall(0.0, -WIDE / 2.0 - 0.005, along_x=True),
    )
    assert room(walls=(left,)) > 0.01
    assert room(walls=(left, front)) < 0.0


def test_a_floor_below_the_fruit_is_in_nothings_way() -> None:
    floor = Box("crate", transform(None, [-0.03, -0.52, TABLE_Z + 0.004]), (0.2, 0.2, 0.004))
    assert room(walls=(floor,)) == PLENTY


def test_wider_open_fingers_have_less_room() -> None:
    pair = [
        (1.25, 0.0),
        (-1.25, 0.0),
        (0.0, 1.25),
        (0.0, -1.25),
        (0.9, 0.9),
        (-0.9, -0.9),
        (0.9, -0.9),
        (-0.9, 0.9),
    ]
    assert room(*pair, air=6e-3) < room(*pair, air=2e-3)


@pytest.mark.parametrize("gap", [0.012, 0.016])
def test_the_room_between_two_neighbours_is_the_gap_less_air_and_finger(gap: float) -> None:
    big = 1.0 + gap / WIDE
    row = [(big, 0.0), (-big, 0.0)]
    others = [(0.0, 1.0), (0.0, -1.0), (0.87, 0.8), (-0.87, 0.8), (0.87, -0.8), (-0.87, -0.8)]
    assert room(*row, *others) < gap
