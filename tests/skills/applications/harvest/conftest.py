"""Small walls, and one fruit on one branch."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pomona.applications.harvest.connect import wall_shapes
from pomona.applications.harvest.model import WallModel, build_wall_model
from pomona.applications.harvest.numbers import WallNumbers, read_numbers
from pomona.applications.harvest.strength import Strength
from pomona.applications.harvest.wall import HangingFruit, Lateral, Spur, Wall

TREES = Path(__file__).resolve().parents[4] / "trees"
NUMBERS = TREES / "walls" / "apple_wall.yaml"
APPLE = TREES / "fruits" / "apple"
STRONG = Strength(pull=1e6, twist=1e6, bend=1e6, stiffness=0.08, tear=1e6)


@pytest.fixture(scope="session")
def numbers() -> WallNumbers:
    return read_numbers(NUMBERS)[0]


def branch(
    numbers: WallNumbers,
    length: float = 0.4,
    diameter: float = 0.010,
    fruits: tuple[HangingFruit, ...] = (),
) -> Wall:
    """A level branch along x, evenly thick, with a spur that is straight down from its end where fruit hang."""
    lateral = Lateral(
        np.array([0.0, -0.7, 0.5]), np.array([1.0, 0.0, 0.0]), length, (diameter, diameter)
    )
    down = np.array([0.0, 0.0, -1.0])
    spur = Spur(
        0, 0.95 * length, lateral.start + np.array([0.95 * length, 0.0, 0.0]), down, 0.05, 0.006
    )
    spurs = (spur,) if fruits else ()
    return Wall(numbers, 0, (0.0, -0.7, 0.03), (), (lateral,), spurs, fruits, ())


def hanging(strength: Strength = STRONG, length: float = 0.4, mass: float = 0.17) -> HangingFruit:
    """A fruit plumb below that branch's spur."""
    anchor = np.array([0.95 * length, -0.7, 0.45])
    stem, size = 0.025, np.array([0.076, 0.068, 0.076])
    T = np.eye(4)
    T[:3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    T[:3, 3] = anchor - [0.0, 0.0, stem + 0.44 * size[1]]
    return HangingFruit(0, anchor, T, size, mass, stem, strength, 1)


def build(wall: Wall) -> WallModel:
    return build_wall_model(wall, wall_shapes(wall, APPLE, "red"))


def one_fruit(numbers: WallNumbers, strength: Strength = STRONG, **changes: float) -> WallModel:
    """A fruit on a branch that hardly bends."""
    stiff = replace(
        numbers, wood_modulus=2e10, hinge_armature=0.05, **changes
    )  # the armature keeps it stable
    return build(branch(stiff, fruits=(hanging(strength),)))
