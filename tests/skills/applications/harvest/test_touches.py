import numpy as np
import pytest

from pomona.applications.harvest import touches
from pomona.applications.harvest.bruises import impact_force, peak_pressure
from pomona.applications.harvest.score import WallScore
from pomona.applications.harvest.stems import AT_SPUR, Stems
from pomona.applications.harvest.touches import BY_HARD, BY_LINING, BY_PAD
from pomona.tools.simulation.gl import load_mujoco

from .conftest import one_fruit

FRUIT, LEFT, RIGHT, FLOOR, SIDE, TWIG = range(6)
KINDS = np.array(
    [touches._FRUIT, touches._PAD, touches._PAD, touches._LINING, touches._LINING, touches._WOOD]
)


def sorted_contacts(*contacts):
    """Forces on the one fruit, and of the pads, from (other geom, normal force) in the engine's order."""
    forces, pads = np.zeros((1, 3)), np.zeros((1, 2))
    geoms = np.array([(FRUIT, g) for g, _ in contacts], np.int32)
    flags = [np.zeros(1, bool) for _ in range(3)]
    touches._sort(
        geoms, np.arange(len(contacts), dtype=np.int32), np.array([f for _, f in contacts]), KINDS,
        np.array([0, 0, 1, 0, 0, -1]), forces, pads, *flags, np.zeros(3),
    )  # fmt: skip
    return forces[0], pads[0]


def test_two_pads_press_with_the_larger_of_their_forces():
    forces, pads = sorted_contacts((LEFT, 1.3), (LEFT, 3.0), (RIGHT, 2.0), (RIGHT, 2.1))
    assert (forces[BY_PAD], *pads) == pytest.approx((4.3, 4.3, 4.1))


def test_floor_and_side_of_the_bin_press_at_two_places():
    forces, _ = sorted_contacts((FLOOR, 1.0), (FLOOR, 0.6), (SIDE, 1.1), (TWIG, 0.4))
    assert (forces[BY_LINING], forces[BY_HARD], forces[BY_PAD]) == pytest.approx((1.6, 0.4, 0.0))


@pytest.fixture
def fruit_in_reach(numbers):
    """A fruit that is off its stem, and all that watches it."""
    built = one_fruit(numbers)
    data = load_mujoco().MjData(built.model)
    stems = Stems(built, data)
    stems.state[0] = AT_SPUR
    stems.release(0)
    return built, data, WallScore(built, data, stems)


def test_a_fall_to_the_ground_is_an_impact_of_its_speed_and_later_contacts_add_nothing(
    fruit_in_reach,
):
    built, data, score = fruit_in_reach
    fruit = built.wall.fruits[0]
    for _ in range(900):
        load_mujoco().mj_step(built.model, data)
        score.look(-1)
    fall = float(fruit.T_base_fruit[2, 3] - data.xpos[built.fruit_bodies[0], 2])
    speed = np.sqrt(2.0 * 9.81 * fall)
    expected = impact_force(
        fruit.mass * speed, fruit.mass, fruit.radius, built.wall.numbers.modulus_hard
    )
    assert score.fruits[0].impact == pytest.approx(expected, rel=0.03)
    data.xfrc_applied[built.fruit_bodies[0], 2] = -6.0
    for _ in range(500):
        load_mujoco().mj_step(built.model, data)
        score.look(-1)
    assert score.fruits[0].impact == pytest.approx(expected, rel=0.03)
    pressed = peak_pressure(6.0 + 9.81 * fruit.mass, fruit.radius, built.wall.numbers.modulus_hard)
    assert score._steady[0, BY_HARD] == pytest.approx(6.0 + 9.81 * fruit.mass, rel=0.02)
    assert score.fruits[0].pressure >= 0.99 * pressed


@pytest.mark.parametrize(
    ("partner", "column", "share"),
    [
        (touches._FRUIT, BY_HARD, 0.5),
        (touches._WOOD, BY_HARD, 1.0),
        (touches._LINING, BY_LINING, 1.0),
    ],
)
def test_a_touch_begins_with_the_normal_speed_at_the_contacts_place(partner, column, share):
    """A fruit that moves and turns, 20 mm from the contact, against a body at rest."""
    v, w, lever = np.array([0.3, 0.1, 0.0]), np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.02, 0.0])
    centre, normal = np.array([[0.0, 0.0, 0.0], [5.0, 5.0, 5.0]]), np.array([1.0, 0.0, 0.0])
    velocities = np.array([[*w, *v], np.zeros(6)])
    speeds, touched = np.zeros((1, 3)), np.full((1, 2), -np.inf)
    kinds = np.array([touches._FRUIT, partner])

    def meet(now):
        touches._meet(
            np.array([[0, 1]], np.int32), np.zeros(1, np.int32), lever[None], np.array([[*normal, *np.zeros(6)]]),
            velocities, centre, np.array([0, 1]), np.array([0, 1]), kinds, np.array([0, 0]), now, touched, speeds,
        )  # fmt: skip
        return speeds[0, column]

    assert meet(0.0) == pytest.approx(share * (v + np.cross(w, lever)) @ normal)
    assert meet(0.015) == 0.0
    assert meet(0.045) > 0.0
