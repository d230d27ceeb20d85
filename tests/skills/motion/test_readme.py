"""The README of motion follows one plan: the planner's steps are those of the table, and all names exist."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pomona.skills import motion
from pomona.skills.motion.planning.plan import PlanRequest, plan
from tests.skills.motion.planning.disc_world import LIMITS, DiscWorld, wall_with_gap
from tests.skills.walk import files_named, files_visited, names_defined, steps_of

FOLDER = Path(motion.__file__).parent
PAGE = (FOLDER / "README.md").read_text("utf-8")
START, GOALS = np.array([-1.5, -1.0]), np.array([[1.5, -1.0], [1.5, 0.0]])


def test_a_plan_passes_through_the_files_of_the_table() -> None:
    request = PlanRequest(wall_with_gap(0.4), START, GOALS, LIMITS, improve="")
    files = files_visited(FOLDER, lambda: plan(request))
    # the discs of the test are a space without compiled trees, and let OMPL connect it
    assert files - {"planning/ompl_planners.py"} == set(
        steps_of(PAGE, "Plan: `PlanRequest` → `PlanResult`")
    )


def test_a_straight_motion_is_tried_before_the_planner_that_is_named() -> None:
    ways = [plan(PlanRequest(space, START, GOALS, LIMITS, improve="")) for space in (
        DiscWorld(np.array([[0.0, 1.5, 0.2]])), wall_with_gap(0.4))]  # fmt: skip
    assert [way.found_by for way in ways] == ["straight", "RRTConnect"]
    assert all(f"`{way.found_by}`" in PAGE for way in ways)


def test_every_file_and_name_exists_and_the_page_is_short() -> None:
    assert len(files_named(PAGE)) > 15
    assert [name for name in files_named(PAGE) if not (FOLDER / name).is_file()] == []
    assert names_defined(FOLDER, PAGE) == set()
    assert len(PAGE.split()) <= 400
