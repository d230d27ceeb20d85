"""Rows of the table of measured fruit, and doubts about all of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.applications.inventory.fruit_table import doubt_of_all, row_of, write_tables
from pomona.applications.inventory.measured_frame import FruitInFrame
from tests.skills.applications.inventory.drawn_fruit import MODEL_WIDTH, found


def usual(count: int) -> list[FruitInFrame]:
    return [found(k + 1, shown=0.8 * MODEL_WIDTH) for k in range(count)]


def test_a_row_has_sizes_and_place_with_intervals_in_millimetres() -> None:
    row = row_of(found(3, (0.075, 0.07)), "depth is mirrored")
    assert (row["frame"], row["row"], row["doubt"]) == ("a", 3, "depth is mirrored")
    assert (row["width_mm"], row["height_mm"], row["z_mm"]) == (75.0, 70.0, 1000.0)
    assert row["width_90_mm"] == row["x_90_mm"] == pytest.approx(1.645 * 2.0, abs=0.05)
    assert (row["left_px"], row["bottom_px"]) == (10.0, 50.0)


def test_a_fruit_that_was_not_measured_has_its_reason_and_no_sizes() -> None:
    row = row_of(found(size=None), "")
    assert row["not_measured"] == "NO_DEPTH"
    assert row["width_mm"] is row["x_mm"] is row["mass_g"] is None
    assert list(row) == list(row_of(found(), ""))


def test_a_folder_without_fruit_has_an_empty_table(tmp_path: Path) -> None:
    write_tables([], tmp_path)
    assert (tmp_path / "fruit.csv").read_text().startswith("frame,row,")
    assert (tmp_path / "fruit.json").read_text() == "[]"


@pytest.mark.parametrize(("size", "words"), [(0.3, "0.30 times"), (1.6, "1.60 times")])
def test_fruit_that_all_look_too_small_or_too_large_are_doubted(size: float, words: str) -> None:
    fruit = [found(k + 1, shown=size * MODEL_WIDTH) for k in range(5)]
    assert words in doubt_of_all(fruit)
    assert "intrinsics" in doubt_of_all(fruit)


def test_usual_fruit_and_two_alone_are_not_doubted() -> None:
    assert doubt_of_all(usual(5)) == ""
    assert doubt_of_all([found(k, shown=3.0 * MODEL_WIDTH) for k in (1, 2)]) == ""
    assert doubt_of_all([]) == ""


def test_fruit_that_hardly_any_depth_shows_are_doubted() -> None:
    hidden = [found(k + 2, None) for k in range(10)]
    assert "1 of 11 fruit could be measured" in doubt_of_all([*usual(1), *hidden])
    assert doubt_of_all([*usual(2), *hidden]) == ""
