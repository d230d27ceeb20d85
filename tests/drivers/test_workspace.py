"""Surroundings of the arm in a cell file."""

import numpy as np
import pytest
import trimesh

from pomona.executive.cell.cell_file import judge_cell_file
from pomona.executive.values.findings import Findings

CELL = "kind: mock\nworkspace:\n  lower: -1 -1 -1 m\n  upper: 1 1 1 m\n{}\ndevices: {{}}\n"


@pytest.fixture
def judge(tmp_path):
    """Return the workspace of a cell file with these lines, and its findings."""

    def judged(lines):
        path = tmp_path / "cell.yaml"
        path.write_text(CELL.format(lines))
        findings = Findings()
        file = judge_cell_file(path, findings)
        return (None if file is None else file.workspace), findings.sorted()

    return judged


def test_a_zone_is_a_box_of_its_own_name_and_no_obstacle(judge):
    workspace, found = judge(
        "  zones:\n    - {name: window, lower: 0.5 -1 0 m, upper: 0.7 1 0.8 m}"
    )
    assert found == []
    (zone,) = workspace.zones
    assert zone.name == "zone window"
    assert zone.half_extents == pytest.approx((0.1, 1.0, 0.4))
    np.testing.assert_allclose(zone.T_base_box[:3, 3], [0.6, 0.0, 0.4])
    assert workspace.obstacles == ()


@pytest.mark.parametrize(
    ("zones", "says", "line", "column"),
    [
        ("[{name: a, lower: 0 0 0 m, upper: 0 1 1 m}]", "must lie above the zone's lower", 5, 44),
        ("[{name: a, lower: 0 0 0 m, upper: 1 1 m}]", "zones.1.upper must be a list", 5, 44),
        ("[{name: a, lower: 0 0 nan m, upper: 1 1 1 m}]", "lower", 5, 28),
        ("[{lower: 0 0 0 m, upper: 1 1 1 m}]", "name", 5, 11),
        ("[{name: a, lower: 0 0 0 m, upper: 1 1 1 m, box: 3}]", "no setting 'box'", 5, 53),
        (
            "[{name: a, lower: 0 0 0 m, upper: 1 1 1 m}, {name: a, lower: 0 0 0 m, upper: 1 1 1 m}]",
            "two zones have one name", 5, 10,
        ),
    ],
)  # fmt: skip
def test_a_zone_that_is_none_is_found_at_its_place(judge, zones, says, line, column):
    _workspace, found = judge(f"  zones: {zones}")
    assert [f for f in found if says in f.message], [f.message for f in found]
    assert {(f.line, f.column) for f in found} == {(line, column)}, found


def test_a_mesh_stands_where_it_is_put(judge, tmp_path):
    trimesh.creation.box((400.0, 200.0, 20.0)).export(tmp_path / "board.stl")
    workspace, found = judge(
        "  meshes:\n    - {name: board, file: board.stl, unit: mm, at: 1 0 0.5 m, rpy: 0 0 90 deg}"
    )
    assert found == []
    (hull,) = workspace.hulls
    assert hull.name == "board"
    np.testing.assert_allclose(hull.points.min(axis=0), [0.9, -0.2, 0.49], atol=1e-9)
    np.testing.assert_allclose(hull.points.max(axis=0), [1.1, 0.2, 0.51], atol=1e-9)


@pytest.mark.parametrize(
    ("mesh", "says", "column"),
    [
        ("{name: a, file: none.stl}", "none.stl does not exist", 28),
        (
            "{name: a, file: board.stl}",
            "400 x 200 x 20 m large: if it is in millimetres, write `unit: mm`",
            28,
        ),
        ("{name: a, file: empty.stl, unit: mm}", "empty.stl", 28),
        ("{name: a, file: board.stl, unit: inch}", "unit", 45),
        ("{name: a, file: board.stl, unit: mm, detail: 1 mm}", "detail", 57),
        ("{name: a, file: board.stl, unit: mm, detail: 5 mm}", "coarser `detail`", 28),
    ],
)
def test_a_mesh_that_cannot_be_used_is_found_at_its_place(judge, tmp_path, mesh, says, column):
    trimesh.creation.box((400.0, 200.0, 20.0)).export(tmp_path / "board.stl")
    (tmp_path / "empty.stl").write_bytes(b"")
    _workspace, found = judge(f"  meshes: [{mesh}]")
    assert [f for f in found if says in f.message + f.hint], [f.message for f in found]
    assert {(f.line, f.column) for f in found} == {(5, column)}, found


CRATE = "{name: source, centre: 0 0 0.1 m, size: 0.4 0.3 0.2 m, wall: 8 mm}"


@pytest.mark.parametrize(
    ("crates", "says", "line"),
    [
        (
            ["{name: a, centre: 0 -3 0.1 m, size: 0.4 0.3 0.2 m, wall: 8 mm}"],
            "'a' leaves the volume",
            7,
        ),
        (
            ["{name: a, centre: 0 0.9 0.1 m, size: 0.4 0.3 0.2 m, wall: 8 mm}"],
            "'a' leaves the volume",
            7,
        ),
        (
            ["{name: a, centre: 0 0 0.95 m, size: 0.4 0.3 0.2 m, wall: 8 mm}"],
            "'a' leaves the volume",
            7,
        ),
        (
            ["{name: a, centre: 0 0 -0.1 m, size: 0.4 0.3 0.2 m, wall: 8 mm}"],
            "'a' is 200 mm under the table",
            7,
        ),
        (
            [CRATE, "{name: source, centre: 0.5 0 0.1 m, size: 0.1 0.1 0.1 m}"],
            "has the name of another obstacle",
            7,
        ),
        (
            ["{name: box, centre: 0.25 0 0.1 m, size: 0.2 0.2 0.2 m}", CRATE],
            "overlaps the obstacle 'box'",
            8,
        ),
        (
            ["{name: a, centre: 0 0 0.1 m, size: 400 300 120 m, wall: 8 mm}"],
            "if it is in millimetres, write mm",
            7,
        ),
    ],
)
def test_a_crate_from_which_no_fruit_can_be_taken_is_found_at_its_place(judge, crates, says, line):
    _workspace, found = judge(
        "  table_z: 0 m\n  obstacles:\n" + "\n".join(f"    - {crate}" for crate in crates)
    )
    assert [(f.line, f.severity) for f in found if says in f.message] == [(line, "error")], found


@pytest.mark.parametrize(
    "beside",
    [
        "{name: box, centre: 0.25 0 0.1 m, size: 0.1 0.2 0.2 m}",  # it touches the wall
        "{name: foam, centre: 0 0 0.02 m, size: 0.3 0.2 0.02 m}",  # it lies inside
        "{name: turned, centre: 0.29 0.24 0.1 m, size: 0.2 0.2 0.2 m, yaw: 45 deg}",  # its bounds overlap, it does not
    ],
)
def test_an_obstacle_beside_or_inside_a_crate_is_none_of_its_walls(judge, beside):
    _workspace, found = judge(f"  table_z: 0 m\n  obstacles:\n    - {CRATE}\n    - {beside}")
    assert found == []


def test_a_crate_narrower_than_a_hand_is_warned_of(judge):
    _workspace, found = judge(
        "  obstacles:\n    - {name: a, centre: 0 0 0.1 m, size: 50 50 120 mm, wall: 8 mm}"
    )
    assert [(f.severity, f.line) for f in found] == [("warning", 6)]
    assert "its inside is 34 mm wide: no hand goes in beside a fruit" in found[0].message


def test_two_poses_of_one_series_that_are_the_same_are_warned_of(judge):
    _workspace, found = judge(
        "  poses:\n    crate: 0 0 rad\n    crate_2: 0 0.1 rad\n    crate_3: 0 0.1001 rad\n    home: 0 0 rad"
    )
    assert [(f.severity, f.line) for f in found] == [("warning", 8)]
    assert "the pose 'crate_3' is the same as 'crate_2'" in found[0].message
