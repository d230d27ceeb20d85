"""Effect of a frame on the cells: free in front, occupied on surfaces, hidden behind them, unchanged elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.drivers.interfaces import ArmState, Box, Frame, Intrinsics, Workspace
from pomona.skills.geometry import rot_x, rot_y, transform
from pomona.skills.motion.collision import Convex
from pomona.skills.motion.collision.cover import fibonacci_sphere
from pomona.skills.motion.occupancy import (
    FREE,
    HIDDEN,
    OCCUPIED,
    UNKNOWN,
    CameraPoseMismatch,
    MapEmpty,
    MapStale,
    NothingMeasured,
    OccupancyMap,
    Sensing,
    integrate,
)
from pomona.skills.motion.occupancy.integrate import check_camera_pose, mark_spheres

TABLE_Z, RADIUS = -0.12, 0.04
LENS = Intrinsics(305.0, 305.0, 159.5, 119.5, 320, 240)
CELL = Workspace(TABLE_Z, np.array([-0.3, -0.7, -0.14]), np.array([0.3, -0.1, 0.4]))
FROM_ABOVE = transform(rot_x(np.pi - 0.35), [0.0, -0.2, 0.45])
FROM_LEFT = transform(rot_y(0.55) @ rot_x(np.pi), [0.35, -0.4, 0.4])
LEFT, RIGHT = np.array([-0.10, -0.38, TABLE_Z + RADIUS]), np.array([0.10, -0.42, TABLE_Z + RADIUS])


def look(T_base_camera: np.ndarray, *centres: np.ndarray, stamp: float = 0.0) -> Frame:
    """Depth of balls on a table, by ray casting."""
    v, u = np.mgrid[: LENS.height, : LENS.width].astype(float)
    rays = np.stack(((u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, np.ones_like(u)), axis=-1)
    rays = rays @ T_base_camera[:3, :3].T
    eye = T_base_camera[:3, 3]
    with np.errstate(divide="ignore"):
        depth = np.where(rays[..., 2] < 0.0, (TABLE_Z - eye[2]) / rays[..., 2], np.inf)
    for centre in centres:
        a, b = (rays**2).sum(axis=-1), rays @ (eye - centre)
        under_root = b**2 - a * ((eye - centre) @ (eye - centre) - RADIUS**2)
        hit = (-b - np.sqrt(np.maximum(under_root, 0.0))) / a
        depth = np.where(under_root > 0.0, np.minimum(depth, hit), depth)
    depth = np.where(np.isfinite(depth) & (depth < 3.0), depth, 0.0).astype(np.float32)
    return Frame(
        stamp,
        0,
        np.zeros((LENS.height, LENS.width, 3), np.uint8),
        depth,
        LENS,
        None,
        T_base_camera,
        "made",
    )


def empty(resolution: float = 0.01) -> OccupancyMap:
    return OccupancyMap.empty(CELL.lower, CELL.upper, resolution)


def seen_surface(frame: Frame, above: float = 0.012) -> np.ndarray:
    """Points of the depth image well above the table, in the base frame."""
    assert frame.depth is not None
    v, u = np.nonzero(frame.depth)
    d = frame.depth[v, u].astype(float)
    points = np.stack(((u - LENS.cx) / LENS.fx * d, (v - LENS.cy) / LENS.fy * d, d), axis=-1)
    points = points @ frame.T_mount_camera[:3, :3].T + frame.T_mount_camera[:3, 3]
    return points[points[:, 2] > TABLE_Z + above]


@pytest.mark.parametrize("resolution", [0.01, 0.02])
def test_every_seen_surface_point_lies_in_or_beside_a_blocked_cell(resolution: float) -> None:
    frame = look(FROM_ABOVE, LEFT, RIGHT)
    fused = integrate(empty(resolution), frame, FROM_ABOVE, CELL)
    points = seen_surface(frame)
    assert len(points) > 1000
    distances = fused.field.distance(points)
    assert np.mean(distances <= 0.0) > 0.99
    assert distances.max() < resolution  # cells at the rim with too few points


def test_the_unseen_half_of_an_object_is_blocked_too() -> None:
    fused = integrate(empty(), look(FROM_ABOVE, LEFT, RIGHT), FROM_ABOVE, CELL)
    inside = LEFT + 0.8 * RADIUS * fibonacci_sphere(300)
    inside = inside[inside[:, 2] > TABLE_Z + 0.01]
    assert np.mean(fused.field.distance(inside) <= 0.0) > 0.97


def test_space_in_front_of_the_table_is_free_and_the_table_is_not_in_the_map() -> None:
    fused = integrate(empty(), look(FROM_ABOVE), FROM_ABOVE, CELL)
    assert not fused.blocked.any()
    i, j, k = fused.cell_of(np.array([0.0, -0.4, 0.0]))
    assert fused.states[i, j, k] == FREE


def test_cells_outside_the_picture_stay_unknown() -> None:
    fused = integrate(empty(), look(FROM_ABOVE, LEFT), FROM_ABOVE, CELL)
    i, j, k = fused.cell_of(np.array([0.29, -0.11, 0.39]))
    assert fused.states[i, j, k] == UNKNOWN
    assert np.isinf(fused.age(5.0)[i, j, k])


def test_pixels_without_depth_say_nothing() -> None:
    frame = look(FROM_ABOVE, LEFT)
    assert frame.depth is not None
    depth = frame.depth.copy()
    depth[:, 100:] = 0.0
    frame = replace(frame, depth=depth)
    fused = integrate(empty(), frame, FROM_ABOVE, CELL)
    i, j, k = fused.cell_of(np.array([0.1, -0.4, -0.05]))
    assert fused.states[i, j, k] == UNKNOWN


def test_the_target_and_the_space_behind_it_are_left_out() -> None:
    frame = look(FROM_ABOVE, LEFT, RIGHT)
    target = Convex.of_points("target", LEFT + RADIUS * fibonacci_sphere(500))
    fused = integrate(empty(), frame, FROM_ABOVE, CELL, target=target)
    blocked = fused.centres(OCCUPIED, HIDDEN)
    assert len(blocked) > 50
    assert np.linalg.norm(blocked - LEFT, axis=1).min() > 0.10
    assert np.linalg.norm(blocked - RIGHT, axis=1).max() < 0.12


def test_a_target_in_an_earlier_map_is_forgotten() -> None:
    frame = look(FROM_ABOVE, LEFT, RIGHT)
    before = integrate(empty(), frame, FROM_ABOVE, CELL)
    target = Convex.of_points("target", LEFT + RADIUS * fibonacci_sphere(500))
    after = integrate(before, frame, FROM_ABOVE, CELL, target=target)
    near = np.linalg.norm(after.centres(OCCUPIED) - LEFT, axis=1)
    assert near.min() > RADIUS + 0.005
    assert (
        np.linalg.norm(before.centres(OCCUPIED) - LEFT, axis=1).min() < RADIUS + 0.005
    )  # the old snapshot stays


@pytest.mark.parametrize(("margin", "stays"), [(0.006, True), (0.010, False)])
def test_a_wire_beside_the_target_stays_with_a_smaller_margin(margin: float, stays: bool) -> None:
    """Erased, it was in no grasp's way: the hand met it, and the fingers pressed an apple with 88 N."""
    plain = look(FROM_ABOVE, LEFT)
    assert plain.depth is not None
    depth = plain.depth.copy()
    wire = LEFT + np.array([[RADIUS + 0.007, y, 0.0] for y in np.arange(-0.05, 0.05, 0.001)])
    for x, y, z in (wire - FROM_ABOVE[:3, 3]) @ FROM_ABOVE[:3, :3]:
        u, v = round(LENS.fx * x / z + LENS.cx), round(LENS.fy * y / z + LENS.cy)
        depth[v - 1 : v + 2, u - 1 : u + 2] = z
    frame, target = (
        replace(plain, depth=depth),
        Convex.of_points("target", LEFT + RADIUS * fibonacci_sphere(500)),
    )
    before = integrate(empty(0.006), frame, FROM_ABOVE, CELL)
    fused = integrate(
        before, frame, FROM_ABOVE, CELL, target=target, sensing=Sensing(target_margin=margin)
    )
    cells = fused.centres(OCCUPIED)
    assert bool(np.linalg.norm(cells[:, None] - wire[45:55], axis=2).min() < 0.005) is stays
    assert target.distance(cells).min() > 0.003, "nothing is left of the target itself"


def test_measured_neighbours_are_shapes_and_the_gap_between_them_stays_open() -> None:
    gap = 0.012
    near = LEFT + np.array([2.0 * RADIUS + gap, 0.0, 0.0])
    frame = look(FROM_ABOVE, LEFT, near)
    target, other = (
        Convex.of_points("ball", c + RADIUS * fibonacci_sphere(500)) for c in (LEFT, near)
    )
    between = (LEFT + near)[None] / 2.0
    assert (
        integrate(empty(), frame, FROM_ABOVE, CELL, target=target).field.distance(between)[0]
        < gap / 4.0
    )
    fused = integrate(replace(empty(), shapes=(other,)), frame, FROM_ABOVE, CELL, target=target)
    assert fused.field.distance(between)[0] > 0.1
    assert fused.shapes == fused.field.shapes == (other,)
    assert integrate(fused, look(FROM_ABOVE), FROM_ABOVE, CELL).shapes == (other,), (
        "a later look adds to the map"
    )


def test_obstacles_of_the_cell_are_no_cells_and_what_stands_beside_them_is() -> None:
    frame = look(FROM_ABOVE, LEFT, RIGHT)
    cell = replace(CELL, obstacles=(Box("post", transform(None, LEFT), (RADIUS, RADIUS, RADIUS)),))
    fused = integrate(empty(), frame, FROM_ABOVE, cell)
    blocked = fused.centres(OCCUPIED, HIDDEN)
    assert np.linalg.norm(blocked - LEFT, axis=1).min() > 0.10
    assert np.linalg.norm(blocked - RIGHT, axis=1).min() < RADIUS
    assert fused.shapes == (), "collision checks have the cell file's obstacles"


def test_the_robot_itself_is_no_obstacle() -> None:
    frame = look(FROM_ABOVE, LEFT, RIGHT)
    robot = np.array([[*RIGHT, RADIUS]])
    fused = integrate(empty(), frame, FROM_ABOVE, CELL, robot=robot)
    assert np.linalg.norm(fused.centres(OCCUPIED, HIDDEN) - RIGHT, axis=1).min() > 0.1


def test_a_second_image_opens_cells_that_the_first_one_did_not_show() -> None:
    first = integrate(empty(), look(FROM_ABOVE, LEFT, stamp=1.0), FROM_ABOVE, CELL)
    second = integrate(first, look(FROM_LEFT, LEFT, stamp=4.0), FROM_LEFT, CELL)
    hidden_then = first.states == HIDDEN
    assert np.count_nonzero(second.states[hidden_then] == FREE) > 10
    assert second.stamps == (1.0, 4.0)
    ages = second.age(6.0)
    assert set(np.unique(ages)) == {2.0, 5.0, np.inf}
    assert np.all(ages[second.last_look == 1] == 2.0)


def test_a_removed_object_is_free_after_the_next_look() -> None:
    first = integrate(empty(), look(FROM_ABOVE, LEFT, RIGHT), FROM_ABOVE, CELL)
    second = integrate(first, look(FROM_ABOVE, RIGHT, stamp=1.0), FROM_ABOVE, CELL)
    left_over = np.linalg.norm(second.centres(OCCUPIED, HIDDEN) - LEFT, axis=1)
    assert np.count_nonzero(left_over < 0.06) == 0


@settings(max_examples=15)
@given(st.integers(0, 1000))
def test_noise_of_the_sensor_neither_blocks_free_space_nor_opens_objects(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame = look(FROM_ABOVE, LEFT, RIGHT)
    assert frame.depth is not None
    noise = rng.normal(size=frame.depth.shape).astype(np.float32) * 1e-3 * (frame.depth > 0.0)
    frame = replace(frame, depth=frame.depth + noise)
    fused = integrate(empty(), frame, FROM_ABOVE, CELL)
    blocked = fused.centres(OCCUPIED)
    away = np.minimum(
        np.linalg.norm(blocked - LEFT, axis=1), np.linalg.norm(blocked - RIGHT, axis=1)
    )
    assert np.mean(away < RADIUS + 0.012) > 0.98
    assert fused.field.distance(LEFT[None] + [0.0, 0.0, RADIUS])[0] <= 0.0


def test_a_look_without_depth_is_an_error_and_never_free() -> None:
    frame = look(FROM_ABOVE, LEFT)
    assert frame.depth is not None
    blind = Frame(0.0, 0, frame.colour, None, LENS, None, FROM_ABOVE)
    with pytest.raises(NothingMeasured):
        integrate(empty(), blind, FROM_ABOVE, CELL)
    for nothing, words in ((0.0, "0 pixels with depth"), (np.nan, None)):
        empty_depth = replace(frame, depth=np.full_like(frame.depth, nothing))
        with pytest.raises(NothingMeasured, match=words):
            integrate(empty(), empty_depth, FROM_ABOVE, CELL)


def test_a_look_elsewhere_is_an_error() -> None:
    away = transform(np.eye(3), [0.0, 0.0, 5.0])  # looks up
    frame = look(FROM_ABOVE, LEFT)
    with pytest.raises(NothingMeasured, match="0 of them inside"):
        integrate(empty(), frame, away, CELL)


def test_a_camera_pose_that_puts_the_scene_under_the_table_is_refused() -> None:
    frame = look(FROM_ABOVE, LEFT)
    lower = FROM_ABOVE.copy()
    lower[2, 3] -= 0.08
    with pytest.raises(CameraPoseMismatch, match="below the table"):
        integrate(empty(), frame, lower, CELL)


def test_an_empty_or_stale_map_gives_no_distance_field() -> None:
    with pytest.raises(MapEmpty):
        empty().usable_field(0.0, 10.0)
    fused = integrate(empty(), look(FROM_ABOVE, LEFT, stamp=3.0), FROM_ABOVE, CELL)
    assert fused.usable_field(4.0, 2.0) is fused.field
    with pytest.raises(MapStale, match=r"4.00 s old, 2.00 s"):
        fused.usable_field(7.0, 2.0)


def test_few_stray_points_do_not_block() -> None:
    frame = look(FROM_ABOVE)
    assert frame.depth is not None
    depth = frame.depth.copy()
    depth[120, 160:162] = 0.4  # two pixels in the air
    frame = replace(frame, depth=depth)
    assert not (integrate(empty(), frame, FROM_ABOVE, CELL).states == OCCUPIED).any()
    wary = integrate(empty(), frame, FROM_ABOVE, CELL, sensing=Sensing(min_points=1))
    assert (wary.states == OCCUPIED).any()


@pytest.mark.parametrize("seed", range(6))
def test_cells_whose_centre_lies_in_a_grown_sphere_are_marked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    origin, resolution, padding = rng.normal(size=3), 0.05, 0.02 * (seed % 3)
    marked = np.zeros((9, 7, 8), bool)
    size = resolution * np.array(marked.shape)
    spheres = np.column_stack(
        [origin + rng.uniform(-0.1, size + 0.1, (4, 3)), rng.uniform(0.01, 0.12, 4)]
    )
    spheres = np.vstack([spheres, [*(origin - 3.0), 0.1]])  # far outside
    mark_spheres(spheres, padding, origin, resolution, marked)
    centres = origin + (np.indices(marked.shape).reshape(3, -1).T + 0.5) * resolution
    apart = np.linalg.norm(centres[:, None] - spheres[None, :, :3], axis=2)
    expected = (apart < spheres[:, 3] + padding).any(axis=1).reshape(marked.shape)
    assert np.array_equal(marked, expected)
    before = rng.random(marked.shape) < 0.2
    again = before.copy()
    mark_spheres(spheres, padding, origin, resolution, again)
    assert np.array_equal(again, expected | before)


def plainly(
    before: OccupancyMap, frame: Frame, cell: Workspace, spheres: np.ndarray, ball: Convex
) -> tuple[np.ndarray, np.ndarray]:
    """States and last looks after a frame, from the text of `integrate`, cell by cell and pixel by pixel."""
    how, lens, size = Sensing(), frame.intrinsics, before.resolution
    T, depth, shape = frame.T_mount_camera, frame.depth, before.states.shape
    assert depth is not None
    assert cell.table_z is not None
    cells = np.indices(shape).reshape(3, -1).T
    centres = before.origin + (cells + 0.5) * size
    apart = np.linalg.norm(centres[:, None] - spheres[:, :3], axis=2)
    own = (apart < spheres[:, 3] + how.robot_padding).any(axis=1).reshape(shape)
    left_out = [(ball, 0.01)] + [(Convex.of_box(box), how.table) for box in cell.obstacles]
    count, kind = np.zeros(shape, int), np.full(depth.shape, "nothing", object)
    for v, u in np.argwhere(depth > 0.0):
        d = float(depth[v, u])
        ray = [(u - lens.cx) / lens.fx * d, (v - lens.cy) / lens.fy * d, d]
        point = T[:3, :3] @ ray + T[:3, 3]
        at = tuple(np.floor((point - before.origin) / size).astype(int))
        if point[2] < cell.table_z + how.table:
            kind[v, u] = "table"
        elif not all(0 <= a < n for a, n in zip(at, shape, strict=True)):
            kind[v, u] = "surface"
        elif own[at]:
            kind[v, u] = "robot"
        elif any(
            one.distance(point[None])[0] < margin
            and np.linalg.norm(point - one.bound[:3]) < one.bound[3] + margin
            for one, margin in left_out
        ):
            kind[v, u] = "target"
        else:
            kind[v, u] = "surface"
            count[at] += 1
    states, last = before.states.copy(), before.last_look.copy()
    look = len(before.stamps)
    for at, centre in zip(map(tuple, cells), centres, strict=True):
        x, y, z = T[:3, :3].T @ (centre - T[:3, 3])
        if centre[2] < cell.table_z or z < 1e-3:
            continue
        u, v = np.floor([lens.fx * x / z + lens.cx + 0.5, lens.fy * y / z + lens.cy + 0.5])
        if not (0 <= u < depth.shape[1] and 0 <= v < depth.shape[0]):
            continue
        d, seen = depth[int(v), int(u)], kind[int(v), int(u)]
        if seen == "nothing":
            continue
        if z < d - size * (0.25 if seen == "table" else how.clear):
            states[at], last[at] = FREE, look
        elif seen == "surface" and d < z < d + how.shadow and states[at] != FREE:
            states[at] = states[at] or HIDDEN
            last[at] = look
    states[(count >= how.min_points)] = OCCUPIED
    last[count >= how.min_points] = look
    for one, margin in left_out:
        within = (one.distance(centres) < margin).reshape(shape)
        states[within & (states >= OCCUPIED)] = UNKNOWN
    return states, last


@pytest.mark.parametrize("seed", range(4))
def test_cells_and_pixels_are_read_as_the_text_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lens = Intrinsics(26.0, 28.0, 13.2, 9.7, 28, 20)
    T = transform(rot_x(np.pi - 0.2 - 0.1 * seed) @ rot_y(0.2), [0.03, 0.0, 0.34])
    cell = Workspace(
        -0.07,
        np.array([-0.13, -0.1, -0.11]),
        np.array([0.12, 0.1, 0.12]),
        obstacles=(Box("post", transform(None, (-0.06, 0.05, -0.03)), (0.02, 0.02, 0.03)),),
    )
    v, u = np.mgrid[:20, :28]
    rays = np.stack([(u - 13.2) / 26.0, (v - 9.7) / 28.0, np.ones_like(u)], axis=-1) @ T[:3, :3].T
    depth = (-0.07 - T[2, 3]) / rays[..., 2] - rng.choice(
        [-0.01, 0.004, 0.03, 0.07, 0.2], (5, 7)
    ).repeat(4, axis=0).repeat(4, axis=1)
    depth[rng.random(depth.shape) < 0.1] = 0.0
    colour = np.zeros((20, 28, 3), np.uint8)
    frame = Frame(3.0, 0, colour, depth.astype(np.float32), lens, None, T)
    start = OccupancyMap.empty(cell.lower, cell.upper, 0.025)
    start = replace(
        start,
        states=rng.integers(0, 4, start.states.shape).astype(np.uint8),
        last_look=np.zeros_like(start.last_look),
        stamps=(1.0,),
    )
    spheres = np.array([[0.05, -0.04, 0.0, 0.02], [0.08, 0.06, -0.05, 0.01]])
    ball = Convex.of_points("ball", [0.0, 0.03, -0.03] + 0.045 * fibonacci_sphere(30))
    fused = integrate(start, frame, T, cell, robot=spheres, target=ball)
    states, last = plainly(start, frame, cell, spheres, ball)
    assert len(np.unique(states)) == 4
    np.testing.assert_array_equal(fused.states, states)
    np.testing.assert_array_equal(fused.last_look, last)
    assert fused.stamps == (1.0, 3.0)


class Slide:
    """A robot that carries the camera along x: one joint, in metres."""

    def fk(self, q: np.ndarray) -> np.ndarray:
        return transform(None, [float(q[0]), 0.0, 0.0])

    def checked(self, q: np.ndarray) -> np.ndarray:
        return np.asarray(q, dtype=float)


def resting(q: float, stamp: float = 0.0, moving: bool = False) -> ArmState:
    return ArmState(stamp, np.array([q]), np.zeros(1), moving)


def check_slide(arm: ArmState, T_base_camera: np.ndarray, q: float | None = 0.1) -> None:
    """The camera looks from the height of 0.5 m on a slide."""
    frame = replace(
        look(FROM_ABOVE), q=None if q is None else np.array([q]), T_mount_camera=transform(None, [0.0, 0.0, 0.5])
    )  # fmt: skip
    check_camera_pose(frame, T_base_camera, Slide(), arm)  # type: ignore[arg-type]


@pytest.mark.parametrize(("off", "turned", "good"), [
    (1.9e-3, 0.0, True), (2.1e-3, 0.0, False), (-2.1e-3, 0.0, False), (np.nan, 0.0, False),
    (0.0, 4.9e-3, True), (0.0, 5.1e-3, False), (1.9e-3, 4.9e-3, True),
])  # fmt: skip
@pytest.mark.parametrize("q", [0.1, None])
def test_a_camera_pose_is_that_of_the_frames_joints(
    q: float | None, off: float, turned: float, good: bool
) -> None:
    T = transform(rot_x(turned), [(q or 0.0) + off, 0.0, 0.5])
    if good:
        check_slide(resting(0.1), T, q)
        return
    with pytest.raises(CameraPoseMismatch) as error:
        check_slide(resting(0.1), T, q)
    if np.isfinite(off):
        assert error.value.distance == pytest.approx(abs(off), abs=1e-9)
        assert error.value.angle == pytest.approx(turned, abs=1e-6)
        words = f"it is {1e3 * abs(off):.1f} mm and {np.degrees(turned):.2f}° from the pose"
        assert words in str(error.value)


def test_joints_of_a_frame_are_those_of_a_resting_arm() -> None:
    T = transform(None, [0.1, 0.0, 0.5])
    for there in (0.081, 0.119):
        check_slide(resting(there), T)
    for there in (0.079, 0.121, np.nan):
        with pytest.raises(CameraPoseMismatch, match="rad from those of the resting arm"):
            check_slide(resting(there), T)
    check_slide(resting(0.2, moving=True), T)  # it moves: its joints are of another moment
    check_slide(resting(0.2, stamp=0.051), T)
    check_slide(resting(0.2, stamp=-0.051), T)
    with pytest.raises(CameraPoseMismatch):
        check_slide(resting(0.2, stamp=0.049), T)
