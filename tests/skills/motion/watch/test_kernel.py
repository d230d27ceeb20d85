"""The loops of the watched path, a few pixels and cells at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pomona.skills.motion.collision import RobotShape
from pomona.skills.motion.watch.kernel import (
    FREE,
    STANDING,
    UNSEEN,
    WIDE,
    CameraView,
    Nearest,
    Noise,
    WatchedCells,
    _nothing_near,
    nearest_ahead,
    see,
)
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL

EDGE = 0.05
SHAPE = (4, 5, 6)
ORIGIN = np.array([-0.1, -0.12, 0.02])
LENS = np.array([40.0, 30.0, 3.3, 2.1])
TILT = np.array([[1.0, 0.0, 0.0], [0.0, -0.96, 0.28], [0.0, -0.28, -0.96]])
T_CAMERA = np.column_stack([TILT, [0.02, -0.25, 0.8]])


class Look:
    """A camera that looks down at a few cells."""

    def __init__(self, fixed: bool = False, size: tuple[int, int] = (5, 7)) -> None:
        self.camera = CameraView(LENS, T_CAMERA, fixed)
        self.depth = np.zeros(size, np.float32)
        count = int(np.prod(SHAPE))
        self.cells = WatchedCells(
            ORIGIN, EDGE, np.zeros(SHAPE, np.bool_), np.zeros(SHAPE, np.bool_),
            np.zeros(SHAPE, np.uint8), np.zeros(SHAPE, np.float32), np.zeros(count, np.int64),
        )  # fmt: skip
        self.found, self.moved = np.zeros((8, 3)), np.zeros(8, np.bool_)

    def see(self, lowest: float = 0.0, spread: float = 0.0, least: float = 1e-6) -> int:
        return int(
            see(
                self.depth,
                self.camera,
                self.cells,
                Noise(lowest, spread, least),
                self.found,
                self.moved,
            )
        )

    def point(self, row: int, column: int) -> Any:
        """Where a pixel's surface is, (3,) [m]."""
        d = float(self.depth[row, column])
        ray = np.array([(column - LENS[2]) / LENS[0], (row - LENS[3]) / LENS[1], 1.0])
        return T_CAMERA[:, :3] @ (d * ray) + T_CAMERA[:, 3]

    def put(self, row: int, column: int, depth: float) -> tuple[int, int, int]:
        """Measure a surface at a pixel; return its cell."""
        self.depth[row, column] = depth
        cell = np.floor((self.point(row, column) - ORIGIN) / EDGE).astype(int)
        return (int(cell[0]), int(cell[1]), int(cell[2]))


def centre(cell: tuple[int, int, int]) -> Any:
    return ORIGIN + (np.array(cell) + 0.5) * EDGE


@pytest.mark.parametrize(("row", "column", "depth"), [(2, 3, 0.6), (4, 1, 0.62), (3, 5, 0.7)])
def test_a_surface_is_a_new_cell_at_its_place(row: int, column: int, depth: float) -> None:
    look = Look()
    cell = look.put(row, column, depth)
    assert all(0 <= k < n for k, n in zip(cell, SHAPE, strict=True))
    assert look.see() == 1
    assert look.found[0] == pytest.approx(centre(cell))
    assert not look.moved[0]
    assert look.cells.state[cell] == STANDING
    assert (look.cells.state != UNSEEN).sum() == 1
    assert not look.cells.area.any()  # ready for the next frame


@pytest.mark.parametrize("depth", [0.0, -0.6, np.nan, np.inf, 1e3])
def test_what_is_no_depth_is_no_surface(depth: float) -> None:
    look = Look()
    look.depth[2, 3] = depth
    assert look.see() == 0
    assert (look.cells.state == STANDING).sum() == 0


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [-1, 1])
def test_surfaces_outside_of_the_volume_are_left_out(axis: int, side: int) -> None:
    look = Look()
    cell = look.put(2, 3, 0.6)
    steps = cell[axis] + 1 if side < 0 else cell[axis] - SHAPE[axis]
    shift = np.zeros(3)
    shift[axis] = steps * EDGE  # the cell just outside
    look.cells = look.cells._replace(origin=ORIGIN + shift)
    assert look.see(lowest=-9.0) == 0
    shift[axis] -= np.sign(steps) * EDGE  # the last one inside
    look.cells = look.cells._replace(origin=ORIGIN + shift)
    assert look.see(lowest=-9.0) == 1


def test_points_near_the_table_are_the_tables() -> None:
    for spread in (0.0, 0.1):
        for above, count in ((1e-4, 1), (-1e-4, 0)):
            look = Look()
            look.put(2, 3, 0.6)
            height = float(look.point(2, 3)[2])
            assert look.see(height - spread * 0.36 - above, spread) == count


def test_a_surface_counts_from_its_least_area_on() -> None:
    share = 0.36 / (40.0 * 30.0)
    for least, count in ((0.999 * share, 1), (1.001 * share, 0)):
        look = Look()
        look.put(2, 3, 0.6)
        assert look.see(least=least) == count
    look = Look()
    cell = look.put(2, 3, 0.6)
    assert look.put(2, 4, 0.6) == cell  # two pixels of one cell
    assert look.see(least=1.9 * share) == 1


@pytest.mark.parametrize("part", ["known", "own"])
def test_known_things_and_the_robot_are_not_new(part: str) -> None:
    look = Look()
    cell = look.put(2, 3, 0.6)
    getattr(look.cells, part)[cell] = True
    assert look.see() == 0
    assert look.cells.state[cell] == UNSEEN


def test_what_was_free_before_has_moved_in_unless_something_stands_beside_it() -> None:
    first = Look()
    cell = first.put(2, 3, 0.6)
    first.cells.state[cell] = FREE
    assert first.see() == 1
    assert first.moved[0]
    assert first.cells.state[cell] == FREE
    for k in range(27):
        away = np.array([k // 9, k // 3 % 3, k % 3]) - 1
        other = tuple(np.array(cell) + away)
        if not away.any() or not all(0 <= a < n for a, n in zip(other, SHAPE, strict=True)):
            continue
        look = Look()
        look.put(2, 3, 0.6)
        look.cells.state[cell], look.cells.state[other] = FREE, STANDING
        assert look.see() == 1
        assert not look.moved[0]
    for axis in range(3):
        for way in (-2, 2):
            far = list(cell)
            far[axis] += way
            if not 0 <= far[axis] < SHAPE[axis]:
                continue
            look = Look()
            look.put(2, 3, 0.6)
            look.cells.state[cell], look.cells.state[tuple(far)] = FREE, STANDING
            look.see()
            assert look.moved[0]


def test_no_more_cells_are_told_than_there_is_room_for() -> None:
    look = Look()
    cells = {look.put(2, column, 0.6) for column in (0, 3, 6)}
    assert len(cells) == 3
    look.found, look.moved = np.zeros((2, 3)), np.zeros(2, np.bool_)
    assert look.see() == 2
    assert all(look.cells.state[cell] == STANDING for cell in cells)


def free_by_projection(look: Look, lowest: float, far: float | None) -> Any:
    """Cells whose centre projects to a pixel and lies well before a surface at depth `far`; None: no measurement."""
    free = np.zeros(SHAPE, np.bool_)
    for cell in np.ndindex(SHAPE):
        p = T_CAMERA[:, :3].T @ (centre(cell) - T_CAMERA[:, 3])  # type: ignore[arg-type]
        u = np.floor(LENS[0] * p[0] / p[2] + LENS[2] + 0.5)
        v = np.floor(LENS[1] * p[1] / p[2] + LENS[3] + 0.5)
        seen = 0 <= u < look.depth.shape[1] and 0 <= v < look.depth.shape[0] and p[2] > 0.05
        first = max(int(np.floor((lowest - ORIGIN[2]) / EDGE)), 0)
        free[cell] = seen and cell[2] >= first and (far is None or far > p[2] + 1.5 * EDGE)
    return free


@pytest.mark.parametrize("far", [0.65, 0.8, 5.0])
@pytest.mark.parametrize("lowest", [0.0, 0.13])
def test_cells_well_before_the_surface_are_free(far: float, lowest: float) -> None:
    look = Look()
    look.depth[:] = far
    look.see(lowest=lowest, least=1.0)
    expected = free_by_projection(look, lowest, far)
    assert 0 < expected.sum() < expected.size
    assert np.array_equal(look.cells.state == FREE, expected)


def test_the_robots_own_cells_and_those_that_stand_are_not_free() -> None:
    look = Look()
    look.depth[:] = 5.0
    expected = np.argwhere(free_by_projection(look, 0.0, 5.0))
    own, standing = tuple(expected[0]), tuple(expected[-1])
    look.cells.own[own] = True
    look.cells.state[standing] = STANDING
    look.see(least=1.0)
    assert look.cells.state[own] == UNSEEN
    assert look.cells.state[standing] == STANDING
    assert (look.cells.state == FREE).sum() == len(expected) - 2


@pytest.mark.parametrize("fixed", [True, False])
def test_a_large_region_without_depth_is_free_for_a_fixed_camera(fixed: bool) -> None:
    look = Look(fixed)
    look.see()
    expected = free_by_projection(look, 0.0, None)
    assert np.array_equal(look.cells.state == FREE, expected & fixed)
    look = Look(fixed)
    look.depth[0, 0] = 0.3  # every pixel is near to it
    look.see(least=1.0)
    assert not (look.cells.state == FREE).any()


@pytest.mark.parametrize("away", [(WIDE, 0), (0, -WIDE), (-WIDE, WIDE), (WIDE // 2, -WIDE // 2)])
def test_a_measurement_in_the_square_around_a_pixel_is_near(away: tuple[int, int]) -> None:
    depth = np.zeros((61, 71), np.float32)
    assert _nothing_near(depth, 35, 30)
    depth[30 + away[0], 35 + away[1]] = 0.5
    assert not _nothing_near(depth, 35, 30)
    depth[:] = 0.0
    depth[30 + away[0] + np.sign(away[0]), 35 + away[1] + np.sign(away[1])] = 0.5
    assert _nothing_near(depth, 35, 30)


@pytest.mark.parametrize(("u", "v"), [(0, 0), (70, 60)])
def test_at_the_border_the_last_pixels_count(u: int, v: int) -> None:
    depth = np.zeros((61, 71), np.float32)
    assert _nothing_near(depth, u, v)
    depth[v, u] = 0.5
    assert not _nothing_near(depth, u, v)


# -------------------------------------------------------------------------------- distance to postures

ROBOT = RobotShape.of(ROBOT_MODEL)


def distances(Q: Any, points: Any, limit: float, width: float = 0.1) -> Nearest:
    nearest = Nearest(*(np.zeros(len(Q), kind) for kind in (float, np.int64, np.int64)))
    middle = points.mean(axis=0)
    bound = np.append(middle, np.linalg.norm(points - middle, axis=1).max())
    nearest_ahead(ROBOT.arrays, Q, width, points, bound, limit, nearest)
    return nearest


def by_spheres(q: Any, points: Any, width: float = 0.1) -> tuple[float, int, int]:
    """Distance of points to the moving spheres, and the geom and the point that have it."""
    found = (np.inf, -1, -1)
    for geom, link in enumerate(ROBOT.arrays.links):
        if link == 0:
            continue
        spheres = ROBOT.spheres_of(geom, q, width)
        away = np.linalg.norm(points[:, None] - spheres[:, :3], axis=2) - spheres[:, 3]
        if away.min() < found[0]:
            found = float(away.min()), geom, int(away.min(axis=1).argmin())
    return found


@pytest.mark.parametrize("width", [0.1, 0.02])
def test_the_nearest_point_and_part_are_those_of_the_covering_spheres(width: float) -> None:
    tcp = ROBOT_MODEL.tcp(OBSERVE)[:3, 3]
    points = tcp + np.array([[0.0, 0.09, 0.03], [0.3, 0.0, 0.1], [-0.2, 0.1, 0.25]])
    Q = np.array([OBSERVE, OBSERVE + 0.3])
    found = distances(Q, points, 1.0, width)
    for m, q in enumerate(Q):
        away, geom, which = by_spheres(q, points, width)
        assert found.away[m] == pytest.approx(away, abs=1e-9)
        assert (found.geom[m], found.which[m]) == (geom, which)


def test_beyond_the_limit_nothing_is_near() -> None:
    points = ROBOT_MODEL.tcp(OBSERVE)[:3, 3] + np.array([[0.0, 0.0, 0.6], [0.0, 0.1, 0.7]])
    away = by_spheres(OBSERVE, points)[0]
    for limit, near in ((away + 1e-3, True), (away - 1e-3, False)):
        found = distances(OBSERVE[None], points, limit)
        assert (found.geom[0] >= 0) is np.True_ if near else found.geom[0] == -1
        assert found.away[0] == pytest.approx(away if near else limit)
        assert (found.which[0] >= 0) == near


def test_a_point_inside_of_a_sphere_is_nearer_than_its_surface() -> None:
    spheres = ROBOT.spheres_of(len(ROBOT.geom_names) - 1, OBSERVE, 0.1)
    points = spheres[:1, :3] + [[0.0, 0.0, 1e-4]]
    assert distances(OBSERVE[None], points, 0.5).away[0] <= 1e-4 - spheres[0, 3] + 1e-9
    assert distances(OBSERVE[None], points, 0.5).away[0] == pytest.approx(
        by_spheres(OBSERVE, points)[0]
    )
