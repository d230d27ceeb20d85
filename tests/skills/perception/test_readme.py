"""The README of perception follows one frame: Refine passes through the files of the table, and all names exist."""

from __future__ import annotations

from pathlib import Path

from pomona.drivers.depth_model import SIMULATED
from pomona.skills import perception
from pomona.skills.perception.refinement import DepthLook, FruitContext, refine
from tests.skills.walk import files_named, files_visited, names_defined, steps_of

FOLDER = Path(perception.__file__).parent
PAGE = (FOLDER / "README.md").read_text("utf-8")


def test_a_refined_frame_passes_through_the_files_of_the_table(scene, apple) -> None:
    seen = scene((70.0, 65.0, 72.0), 40.0)
    look = DepthLook(seen.depth, seen.intrinsics, SIMULATED, renderer="zbuffer")
    files = files_visited(
        FOLDER,
        lambda: refine(look, seen.T_camera_detected, apple, known=FruitContext(support=seen.table)),
    )
    table = set(steps_of(PAGE, "Refine: `Detection` → `MeasuredFruit`"))
    assert len(table) == 6
    outside = {"refinement/curvature.py"}  # checked where less of the depth agrees
    assert {file for file in files if file.startswith("refinement/")} - outside == table - outside


def test_every_file_and_name_exists_and_the_page_is_short() -> None:
    assert len(steps_of(PAGE, "Detect: frame → `Instance`")) == 6
    assert len(files_named(PAGE)) > 16
    assert [name for name in files_named(PAGE) if not (FOLDER / name).is_file()] == []
    assert names_defined(FOLDER, PAGE) <= {"find_in_frame", "skills"}
    assert len(PAGE.split()) <= 400
