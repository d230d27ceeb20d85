"""Fruit is brought together by physics: it touches, it rests, and in a crate it is inside."""

from pathlib import Path

import numpy as np
import pytest

from pomona.drivers.errors import CellFileError
from pomona.drivers.interfaces import Box
from pomona.executive.cell.cell_file import read_cell_file
from pomona.executive.cell.connect import load_cell
from pomona.skills.geometry import rot_z, transform
from pomona.tools.simulation.layout import crate_of

CELLS = Path(__file__).resolve().parents[4] / "trees" / "cells"


def crate(yaw: float = 0.4) -> tuple[Box, ...]:
    """A crate of 400 × 300 × 120 mm with walls of 8 mm: floor, then walls."""
    T = transform(rot_z(yaw), [0.1, -0.4, 0.0])
    parts = [((0.0, 0.0, -0.056), (0.2, 0.15, 0.004))]
    parts += [((side * 0.196, 0.0, 0.0), (0.004, 0.15, 0.06)) for side in (-1, 1)]
    parts += [((0.0, side * 0.146, 0.0), (0.2, 0.004, 0.06)) for side in (-1, 1)]
    return tuple(Box("source", T @ transform(None, offset), half) for offset, half in parts)


def test_the_inside_of_a_crate_is_its_size_less_the_walls():
    found = crate_of((Box("pedestal", np.eye(4), (0.1, 0.1, 0.1)), *crate()))
    assert found is not None
    np.testing.assert_allclose(found.inside, [0.192, 0.142])
    np.testing.assert_allclose(
        found.T_base_floor, transform(rot_z(0.4), [0.1, -0.4, -0.052]), atol=1e-12
    )


def test_a_solid_box_is_no_crate():
    assert crate_of((Box("source", np.eye(4), (0.1, 0.1, 0.1)),)) is None


def positions(
    kind: str, number: int, seed: int, layers: int = 1
) -> tuple[np.ndarray, np.ndarray, dict]:
    """Place and width of each fruit at the start [m], and the world's score."""
    cell = load_cell(
        CELLS / f"sim_{kind}.yaml",
        seed=seed,
        overrides={"others": str(number - 1), "layers": str(layers)},
    )
    try:
        cell.clock.advance(0.02)
        truth = cell.devices["world"].truth()
        places = np.array([np.array(fruit["T_base_fruit"])[:3, 3] for fruit in truth["fruits"]])
        widths = np.array([fruit["dimensions_m"][0] for fruit in truth["fruits"]])
        moving = np.abs(cell.devices["world"].state.qvel).max()
        assert moving < 0.05, "it rests"
        return places, widths, truth
    finally:
        cell.close()


def gaps(places: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Distance of each fruit from the next one, as circles [m]."""
    apart = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=2)
    apart -= (widths[:, None] + widths[None]) / 2.0
    np.fill_diagonal(apart, np.inf)
    return apart.min(axis=1)


def test_a_heap_is_fruit_that_touches_on_the_table():
    places, widths, truth = positions("heap", 5, 3)
    assert (gaps(places, widths) < 6e-3).all()
    assert places[:, 2].max() < -0.12 + 0.055
    assert truth["put_away"] == 0


def test_of_two_layers_some_fruit_lies_on_others():
    places, *_ = positions("heap", 9, 3, layers=2)
    assert (places[:, 2] > -0.12 + 0.075).sum() >= 1
    assert places[:, 2].min() < -0.12 + 0.05


@pytest.mark.slow
def test_in_a_crate_half_of_the_fruit_is_at_the_walls_and_none_counts_as_put_away():
    places, widths, truth = positions("crate", 8, 3)
    to_wall = (
        np.array([0.192, 0.142]) - np.abs(places[:, :2] - [-0.02, -0.37]) - widths[:, None] / 2.0
    )
    assert to_wall.min() > -4e-3
    assert (to_wall.min(axis=1) < 4e-3).sum() >= 3
    assert [fruit["inside"] for fruit in truth["fruits"]] == ["source"] * 8
    assert truth["put_away"] == 0
    again, *_ = positions("crate", 8, 3)
    np.testing.assert_array_equal(places, again)


def test_without_a_crate_in_the_workspace_no_fruit_can_be_in_it():
    with pytest.raises(CellFileError, match="no crate 'source'"):
        load_cell(CELLS / "sim_heap.yaml", overrides={"fruits_at": "crate"})


@pytest.mark.parametrize(("layers", "holds"), [("1", 12), ("2", 18)])
def test_more_fruit_than_the_crate_holds_is_refused(layers: str, holds: int):
    read_cell_file(CELLS / "sim_crate.yaml", {"others": str(holds - 1), "layers": layers})
    with pytest.raises(
        CellFileError, match=f"the crate holds {holds} fruit in all, not {holds + 1}"
    ):
        read_cell_file(CELLS / "sim_crate.yaml", {"others": str(holds), "layers": layers})
