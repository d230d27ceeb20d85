"""Options of a campaign change their part of the simulated cell, and nothing else."""

import numpy as np
import pytest

from pomona.drivers.errors import CellFileError
from pomona.tools.simulation.fruit_shape import make_fruit
from pomona.tools.simulation.score import HeldForce


def target(open_cell, seed=5, **options):
    return open_cell(seed=seed, **options)._world.scene.fruits[0]


def test_a_varied_value_leaves_the_other_draws_unchanged(open_cell):
    plain, varied = (
        target(open_cell),
        target(open_cell, spread="0.05", weight="1.2..1.2", shape_noise="0", tilt="0 deg"),
    )
    assert not np.array_equal(plain.dimensions, varied.dimensions)
    assert np.all(np.abs(varied.dimensions / plain.dimensions - 1.0) <= 0.05)
    assert varied.dimensions[0] == varied.dimensions[2]
    assert varied.mass == pytest.approx(1.2 * 0.2)
    assert varied.tilt == 0.0
    for unchanged in ("name", "place", "yaw", "skin"):
        assert getattr(varied, unchanged) == getattr(plain, unchanged)
    assert np.array_equal(varied.xy, plain.xy)


def test_other_fruit_on_the_table_is_of_the_targets_kind(open_cell):
    apples = open_cell(seed=5, others="4")._world.scene.fruits
    assert all(fruit.name.startswith("apple") for fruit in apples)
    lemons = open_cell(seed=5, fruit="lemon", others="2")._world.scene.fruits
    assert [fruit.name for fruit in lemons] == ["lemon"] * 3
    assert {fruit.skin for fruit in lemons} == {"lemon"}
    assert all(fruit.tilt >= np.pi / 2 for fruit in lemons)  # a lemon lies


def test_friction_and_noise_are_set_from_outside(open_cell):
    cell = open_cell(seed=5, friction="0.4..0.5", depth_noise="0.3 px", force_noise="0.2 N")
    assert 0.4 <= cell._world.scene.pads.friction <= 0.5
    assert cell.devices["camera"]._stereo.disparity_noise == 0.3
    with pytest.raises(CellFileError, match="friction"):
        open_cell(seed=5, friction="slippery")


def test_pads_and_centre_of_mass_are_as_drawn_and_leave_the_other_draws(open_cell):
    plain = open_cell(seed=5)._world
    drawn = open_cell(seed=5, torsion="2 mm..2.5 mm", spring="3", centre="6 mm..8 mm")._world
    friction, torsion = drawn.model.geom("pad_left").friction[:2]
    assert friction == plain.model.geom("pad_left").friction[0]
    assert 2e-3 <= torsion <= 2.5e-3
    stiffness = plain.model.joint("pad_right").stiffness[0]
    assert drawn.model.joint("pad_right").stiffness[0] == pytest.approx(3.0 * stiffness)
    before, after = (world.model.body("fruit_0") for world in (plain, drawn))
    assert after.mass[0] == pytest.approx(before.mass[0])
    moved = float(np.linalg.norm(after.ipos - 0.5 * before.ipos))
    assert 6e-3 <= moved <= 8e-3
    assert np.array_equal(drawn.scene.shapes[0].vertices, plain.scene.shapes[0].vertices)


def test_a_fruit_without_lumps_is_the_models_form(open_cell):
    fruit = target(open_cell)
    first, second = (
        make_fruit(
            fruit.model, fruit.dimensions, "red", np.random.default_rng(seed), shape_noise=0.0
        ).vertices
        for seed in (1, 2)
    )
    assert np.array_equal(first, second)


def test_the_force_of_a_hold_is_its_median_beside_the_least_and_its_end_apart():
    held = HeldForce()
    for i in range(100):
        held.note(0.01 * i, 4.0 if i < 85 else 2.4, 2.0)
    figures = held.report()
    assert figures["hold_force_n"] == 4.0
    assert figures["hold_ratio"] == 2.0
    assert figures["least_ratio"] == pytest.approx(1.2)
    assert figures["end_force_n"] == pytest.approx(2.4)
    assert figures["end_ratio"] == pytest.approx(1.2)
    assert HeldForce().report()["hold_ratio"] is None
