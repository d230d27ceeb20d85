"""Surroundings of the arm in a cell file."""

import numpy as np
import pytest
import trimesh

from pomona.drivers.errors import UnusableMesh
from pomona.drivers.interfaces import PathWatchSettings
from pomona.drivers.workspace import (
    MeshSection,
    ObstacleSection,
    WatchSection,
    WorkspaceSection,
    ZoneSection,
    _overlap,
    read_parts,
)
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


def inside(points, boxes):
    """Which points lie in one of the boxes."""
    found = np.zeros(len(points), bool)
    for box in boxes:
        local = (points - box.T_base_box[:3, 3]) @ box.T_base_box[:3, :3]
        found |= (np.abs(local) <= box.half_extents).all(axis=1)
    return found


@pytest.mark.parametrize("wall", [None, 0.03])
def test_an_obstacle_is_solid_where_its_sizes_say(wall):
    size, centre, yaw = np.array([0.4, 0.2, 0.15]), np.array([0.5, -0.3, 0.1]), 0.6
    crate = ObstacleSection(name="a", centre=tuple(centre), size=tuple(size), yaw=yaw, wall=wall)
    points = np.random.default_rng(2).uniform(-0.3, 0.3, (6000, 3))
    solid = (np.abs(points) <= size / 2.0).all(axis=1)
    if wall is not None:
        hollow = (np.abs(points[:, :2]) < size[:2] / 2.0 - wall).all(axis=1)
        solid &= ~(hollow & (points[:, 2] > wall - size[2] / 2.0))
    x = points[:, 0] * np.cos(yaw) - points[:, 1] * np.sin(yaw)
    y = points[:, 0] * np.sin(yaw) + points[:, 1] * np.cos(yaw)
    placed = np.column_stack([x, y, points[:, 2]]) + centre
    assert np.array_equal(inside(placed, crate.boxes()), solid)
    assert {box.name for box in crate.boxes()} == {"a"}


@pytest.mark.parametrize(
    ("size", "wall", "key"),
    [
        ((0.3, 0.0, 0.2), None, "size"),
        ((0.3, 0.2, -0.1), None, "size"),
        ((20.0, 0.2, 0.1), None, ""),
        ((0.1, 20.1, 0.1), None, "size"),
        ((0.5, 0.25, 0.2), 0.125, "wall"),
        ((0.25, 0.5, 0.2), 0.125, "wall"),
        ((0.5, 0.5, 0.125), 0.125, "wall"),
        ((0.5, 0.5, 0.126), 0.125, ""),
        ((0.3501, 0.5, 0.3), 0.125, ""),
        ((0.3499, 0.5, 0.3), 0.125, "size warning"),
        ((0.5, 0.3499, 0.3), 0.125, "size warning"),
        ((0.5, 0.251, 0.3), 0.125, "size warning"),
        ((0.05, 0.05, 0.05), None, ""),
    ],
)
def test_sizes_of_an_obstacle_have_bounds(size, wall, key):
    section = ObstacleSection(name="a", centre=(0.0, 0.0, 0.0), size=size, wall=wall)
    found = [f"{p.key}{' warning' * p.warning}" for p in section.problems()]
    assert found == [key][: bool(key)]


@pytest.mark.parametrize("axis", range(3))
def test_a_zone_and_a_workspace_have_a_room_along_each_axis(axis):
    lower, upper = [-0.2, 0.1, 0.3], [0.4, 0.5, 0.6]
    zone = ZoneSection(name="z", lower=tuple(lower), upper=tuple(upper))
    assert list(zone.problems()) == []
    box = zone.box()
    corners = box.T_base_box[:3, 3] + np.outer((-1, 1), box.half_extents)
    np.testing.assert_allclose(corners, [lower, upper])
    np.testing.assert_array_equal(box.T_base_box[:3, :3], np.eye(3))
    for low in (upper[axis], upper[axis] + 0.1):
        lower[axis] = low
        for section in (ZoneSection, WorkspaceSection):
            named = {"name": "z"} if section is ZoneSection else {}
            bad = section(lower=tuple(lower), upper=tuple(upper), **named)
            assert [problem.key for problem in bad.problems()] == ["upper"]


def test_a_workspace_is_what_its_sections_say():
    section = WorkspaceSection(
        lower=(-1.0, -2.0, -3.0), upper=(1.0, 2.0, 3.0), poses={"home": (0.1, 0.2)},
        obstacles=(ObstacleSection(name="post", centre=(0.5, 0.0, 0.0), size=(0.2, 0.4, 0.6)),),
        zones=(ZoneSection(name="gap", lower=(0.0, 0.0, 0.0), upper=(0.2, 0.2, 0.2)),),
        watch=WatchSection(
            passing=(ZoneSection(name="belt", lower=(0.0, 0.0, 0.0), upper=(0.2, 0.4, 0.6)),),
            speed=0.9, near=0.04, padding=0.05, delay=0.06,
        ),
    )  # fmt: skip
    made = section.workspace()
    assert made.table_z is None
    np.testing.assert_array_equal(made.lower, [-1.0, -2.0, -3.0])
    np.testing.assert_array_equal(made.upper, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(made.poses["home"], [0.1, 0.2])
    assert [box.name for box in made.obstacles] == ["post"]
    assert made.obstacles[0].half_extents == pytest.approx((0.1, 0.2, 0.3))
    assert [box.name for box in made.zones] == ["zone gap"]
    watch = made.watch
    assert (watch.speed, watch.near, watch.padding, watch.delay) == (0.9, 0.04, 0.05, 0.06)
    assert watch.passing[0].half_extents == pytest.approx((0.1, 0.2, 0.3))
    plain = WorkspaceSection(lower=(0.0, 0.0, 0.0), upper=(1.0, 1.0, 1.0)).workspace()
    assert (plain.watch, plain.zones, plain.obstacles, plain.hulls) == (None, (), (), ())


def test_the_watch_of_a_cell_file_has_the_settings_of_its_type(judge):
    workspace, found = judge("  watch: {}")
    assert found == []
    assert workspace.watch == PathWatchSettings()


def boxes_at(offset, yaw=0.0):
    """Two boxes of 0.2 by 0.4 by 0.6 m, one of them moved and turned."""
    size = (0.2, 0.4, 0.6)
    (a,) = ObstacleSection(name="a", centre=(0.0, 0.0, 0.0), size=size).boxes()
    (b,) = ObstacleSection(name="b", centre=tuple(offset), size=size, yaw=yaw).boxes()
    return a, b


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [-1, 1])
def test_boxes_overlap_when_they_do_along_every_axis_by_more_than_a_millimetre(axis, side):
    for deep, overlaps in ((0.9e-3, False), (1.1e-3, True)):
        offset = np.zeros(3)
        offset[axis] = side * ((0.2, 0.4, 0.6)[axis] - deep)
        a, b = boxes_at(offset)
        assert _overlap(a, b) is overlaps
        assert _overlap(b, a) is overlaps


def test_a_turned_box_overlaps_up_to_its_corner():
    reach = 0.1 + (0.1 + 0.2) / np.sqrt(2.0)  # half of one, and the corner of the other
    for deep, overlaps in ((0.9e-3, False), (1.1e-3, True)):
        assert _overlap(*boxes_at((reach - deep, 0.0, 0.0), np.pi / 4.0)) is overlaps
    diagonal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    apart = (0.1 + 0.2) / np.sqrt(2.0) + 0.1  # along the turned box's own x
    for deep, overlaps in ((0.9e-3, False), (1.1e-3, True)):
        assert _overlap(*boxes_at((apart - deep) * diagonal, np.pi / 4.0)) is overlaps


def misplaced(table_z=None, others=(), **crate):
    """Problems of a crate in a volume of two metres."""
    given = {"centre": (0.0, 0.0, 0.0), "size": (0.4, 0.3, 0.2), "wall": 0.01} | crate
    section = WorkspaceSection(
        lower=(-1.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0), table_z=table_z,
        obstacles=(ObstacleSection(name="crate", **given), *others),
    )  # fmt: skip
    return "".join(f"{problem.key} {problem.message}" for problem in section.problems())


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [-1, 1])
def test_a_crate_reaches_to_the_border_of_the_volume_and_not_beyond(axis, side):
    for beyond, fits in ((0.9e-3, True), (1.2e-3, False)):
        centre = [0.0, 0.0, 0.0]
        centre[axis] = side * (1.0 - (0.2, 0.15, 0.1)[axis] + beyond)
        words = misplaced(centre=tuple(centre))
        under = axis == 2 and side < 0
        assert (words == "") is fits, words
        assert fits or ("under the table" if under else "leaves the volume") in words
        assert fits or words.startswith("obstacles.1 ")


def test_a_turned_crate_needs_the_room_of_its_corners():
    reach = (0.2 + 0.15) / np.sqrt(2.0)
    for beyond, fits in ((0.9e-3, True), (1.2e-3, False)):
        centre = (1.0 - reach + beyond, 0.0, 0.0)
        assert (misplaced(centre=centre, yaw=np.pi / 4.0) == "") is fits


def test_a_crate_stands_on_the_table_or_above():
    for under, fits in ((0.9e-3, True), (1.2e-3, False)):
        assert (misplaced(table_z=0.2, centre=(0.0, 0.0, 0.3 - under)) == "") is fits
    assert "is 50 mm under the table" in misplaced(table_z=0.2, centre=(0.0, 0.0, 0.25))


def test_a_solid_obstacle_may_stand_anywhere_and_only_the_first_overlap_is_named():
    assert misplaced(centre=(3.0, 0.0, 0.0), wall=None) == ""
    inner = [
        ObstacleSection(name=name, centre=(x, 0.0, 0.0), size=(0.05, 0.05, 0.05))
        for name, x in (("free", 0.0), ("left", -0.2), ("right", 0.2))
    ]
    assert misplaced(others=inner).endswith("overlaps the obstacle 'left'")


@pytest.mark.parametrize(
    ("edge", "unit", "words"),
    [(20.0, 1.0, ""), (20.1, 1.0, "unit: mm"), (2.01, 1e-3, ""), (1.9, 1e-3, "unit: m`")],
)
def test_a_mesh_has_a_possible_size(tmp_path, edge, unit, words):
    path = tmp_path / "box.stl"
    trimesh.creation.box((edge, 0.1 * edge, 0.5 * edge)).export(path)
    if words:
        with pytest.raises(UnusableMesh, match=words):
            read_parts(path, unit)
        return
    (part,) = read_parts(path, unit)
    np.testing.assert_allclose(np.ptp(part.points, axis=0), unit * edge * np.array([1, 0.1, 0.5]))
    assert len(part.points) == 8
    assert {tuple(normal) for normal in np.abs(part.normals).round(6)} == set(map(tuple, np.eye(3)))


def test_a_mesh_is_turned_and_then_moved(tmp_path):
    path = tmp_path / "box.stl"
    trimesh.creation.box((0.4, 0.2, 0.1)).export(path)
    section = MeshSection(
        name="board", file=path, unit="m", at=(1.0, 2.0, 3.0), rpy=(np.pi / 2.0, 0.0, np.pi / 2.0)
    )
    (part,) = section.parts()
    # about x: y is where z was; then about z: x is where y was
    np.testing.assert_allclose(np.ptp(part.points, axis=0), [0.1, 0.4, 0.2], atol=1e-9)
    np.testing.assert_allclose(part.points.mean(axis=0), [1.0, 2.0, 3.0], atol=1e-9)
    assert part.name == "board"
    along = part.points @ part.normals.T
    assert set(np.ptp(along, axis=0).round(6)) == {0.1, 0.2, 0.4}


def test_a_surface_is_cut_into_cubes_of_an_edge(tmp_path):
    path = tmp_path / "sheet.obj"
    path.write_text("v 0 0 0\nv 0.4 0 0\nv 0.4 0.2 0\nv 0 0.2 0\nf 1 2 3\nf 1 3 4\n")
    parts = read_parts(path, detail=0.1)
    assert len(parts) == 8
    for part in parts:
        assert np.ptp(part.points, axis=0).max() <= 0.2 + 1e-9
        sides = part.points @ part.normals.T
        assert np.ptp(sides, axis=0).max() < 1e-9  # a sheet, whose normals are its two sides
        assert np.sort(part.normals[:, 2]).tolist() == [-1.0, 1.0]
    total = sum(np.prod(np.ptp(part.points[:, :2], axis=0)) for part in parts)
    assert total == pytest.approx(0.08, rel=0.3)


def test_a_mesh_is_by_default_in_metres_where_its_numbers_say(tmp_path):
    path = tmp_path / "slope.obj"
    corners = np.array([[0.1, 0.0, 0.2], [0.7, 0.3, 0.2], [0.2, 0.4, 0.9]])
    lines = [*(f"v {x} {y} {z}" for x, y, z in corners), "f 1 2 3"]
    path.write_text("\n".join(lines) + "\n")
    (part,) = MeshSection(name="slope", file=path).parts()
    np.testing.assert_allclose(part.points, corners[np.lexsort(corners.T[::-1])])
    np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.ptp(part.points @ part.normals.T, axis=0), 0.0, atol=2e-3)
