from dataclasses import replace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.crates.find_crate import FindCrate
from pomona.drivers.interfaces import Box, Camera, Frame, Workspace
from pomona.executive.clock import ManualClock
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.geometry import transform
from pomona.skills.perception.detection.detection import AllDetections
from tests.skills.applications.crates.test_crate_place import ABOVE, CRATE, LENS, rendered
from tests.skills.picking_scene import WORKSPACE, PickingScene

X, Y = CRATE.half
FLOOR = Box("source", transform(None, [-0.02, -0.37, -0.116]), (X, Y, 0.004))
WALLS = tuple(
    Box("source", transform(None, [-0.02 + x, -0.37 + y, -0.06]), half)
    for x, y, half in ((0, -Y + 0.004, (X, 0.004, 0.06)), (-X + 0.004, 0, (0.004, Y, 0.06)))
)
WITH_CRATE = replace(WORKSPACE, obstacles=(*WORKSPACE.obstacles, FLOOR, *WALLS))


def look(depth: np.ndarray | None, T_base_camera: np.ndarray = ABOVE) -> AllDetections:
    frame = Frame(0.0, 0, np.zeros((480, 640, 3), np.uint8), depth, LENS, None, T_base_camera)
    return AllDetections((), frame, T_base_camera)


def find(
    depth: np.ndarray | None,
    workspace: Workspace = WITH_CRATE,
    T_base_camera: np.ndarray = ABOVE,
    **inputs: str,
) -> SkillEnd:
    seen = look(None if depth is None else depth.astype(np.float32), T_base_camera)
    return drive(
        FindCrate(),
        {"detections": seen, **inputs},
        {Workspace: workspace},
        clock=PickingScene().clock,
    )


def test_a_crate_in_its_place_passes():
    assert find(rendered((0.002, -0.002))).status is Status.SUCCESS


@pytest.mark.parametrize(
    ("shift", "turn"), [((0.012, -0.009), 0.0), ((0.04, 0.0), 0.0), ((0.0, 0.0), 0.05)]
)
def test_a_crate_elsewhere_ends_it_with_its_shift_or_as_missing(shift, turn):
    ended = find(rendered(shift, turn))
    assert ended.reason.code in (
        ("CRATE_MOVED",) if shift[0] < 0.02 else ("CRATE_MOVED", "CRATE_MISSING")
    )
    if ended.reason.code == "CRATE_MOVED":
        np.testing.assert_allclose(ended.reason.data["shift_m"], shift, atol=3e-3)
        assert ended.reason.data["turn_rad"] == pytest.approx(turn, abs=np.radians(0.5))


def test_a_crate_that_is_not_there_is_missing():
    assert find(rendered(there=False)).reason.code == "CRATE_MISSING"


def test_a_cell_without_a_crate_of_the_usual_name_passes():
    assert find(rendered(there=False), WORKSPACE).status is Status.SUCCESS


def test_a_crate_that_is_named_must_be_in_the_cell():
    ended = find(rendered(), name="sorce")
    assert ended.reason.code == "CRATE_MISSING"
    assert (
        ended.reason.message
        == "the cell file has no crate 'sorce', an obstacle with `wall`: source"
    )
    assert find(rendered(), name="source").status is Status.SUCCESS


def test_a_look_past_the_crate_and_a_picture_without_depth_judge_nothing():
    past = ABOVE.copy()
    past[0, 3] += 0.6
    ended = find(rendered(there=False), T_base_camera=past)
    assert ended.reason.code == "CRATE_UNSEEN"
    assert (
        "the crate 'source' (400 × 300 mm) is not in view: 0 % of its upper edge"
        in ended.reason.message
    )
    assert find(None).reason.code == "CRATE_UNSEEN"


def test_without_detections_it_looks_itself():
    class Looking:
        def latest(self) -> Frame:
            return look(rendered((0.012, -0.009)).astype(np.float32)).frame

    devices = {Workspace: WITH_CRATE, Camera: Looking()}
    assert drive(FindCrate(), {}, devices, clock=ManualClock(0.1)).reason.code == "CRATE_MOVED"
    assert drive(FindCrate(), {}, devices, clock=ManualClock(1.0)).reason.code == "STALE_FRAME"


class Cell:
    """Facts about a cell with obstacles of these names."""

    name = "bench"

    def __init__(self, *obstacles: Box) -> None:
        self.workspace = replace(WORKSPACE, obstacles=obstacles)

    def known(self, what: type) -> Workspace | None:
        return self.workspace if what is Workspace else None


def judged(cell: Cell | None, **known: str) -> list[tuple[str, str, bool]]:
    return [(found.message, found.hint, found.warning) for found in FindCrate.judge(known, cell)]


def test_a_name_in_a_tree_is_compared_with_the_crates_of_the_cell():
    cell = Cell(replace(FLOOR, name="bin"), FLOOR, *WALLS)
    assert judged(cell) == judged(cell, name="source") == judged(None, name="sorce") == []
    words = "the cell 'bench' has no crate '{}', an obstacle with `wall`"
    assert judged(cell, name="sorce") == [(words.format("sorce"), "did you mean 'source'?", False)]
    assert judged(cell, name="bin") == [(words.format("bin"), "write `wall` for it: bin", False)]
    assert FindCrate.offers("name", cell) == ("source",)


def test_a_crate_that_lacks_its_walls_or_a_letter_is_no_cell_without_one():
    assert judged(Cell(replace(FLOOR, name="bin"))) == []
    assert [hint for _, hint, warning in judged(Cell(FLOOR)) if not warning] == [
        "write `wall` for it: source"
    ]
    typing = Cell(*(replace(box, name="sorce") for box in (FLOOR, *WALLS)))
    assert [hint for _, hint, warning in judged(typing) if warning] == ["did you mean 'sorce'?"]


def test_interrupted_it_has_judged_nothing():
    ended = drive(
        FindCrate(),
        {"detections": look(rendered().astype(np.float32))},
        {Workspace: WITH_CRATE},
        clock=PickingScene().clock,
        computing=10,
        interrupt_after=3,
    )
    assert ended.status is Status.INVALID
