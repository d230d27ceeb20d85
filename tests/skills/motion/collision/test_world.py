"""The collision world names colliding bodies, misses nothing along a path, and keeps a margin for each body."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from benchmarks.collision_oracle import Oracle, compare, random_scene
from pomona.drivers.errors import BadTrajectory
from pomona.drivers.interfaces import ArmLimits, Box, Trajectory, Workspace
from pomona.skills.geometry import rot_x, transform
from pomona.skills.motion.collision import (
    CollisionWorld,
    Convex,
    DistanceField,
    Margins,
    RobotShape,
    UnknownObstacle,
)
from pomona.skills.motion.collision.cover import fibonacci_sphere
from pomona.skills.motion.collision.kernel import check_states
from pomona.skills.motion.collision.segment import SLACK, check_path
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.planning.timing import time_polyline
from pomona.skills.motion.robot import BadJoints, RobotModel, inverse_kinematics

ROOT = Path(__file__).resolve().parents[4]
SIA5F = ROOT / "trees" / "robots" / "sia5f_wsg32.xml"
SIX_AXIS = ROOT / "tests" / "skills" / "motion" / "robot" / "six_axis.urdf"
OBSERVE = np.array([-1.36, -0.316, -0.264, -0.234, 0.065, -1.294, 0.048])
OPEN = 0.103
TOUCHING_ALLOWED = Margins(0.0, 0.0, 0.0, 0.0, 0.0)

robot = RobotModel.load(SIA5F)
table = Workspace(-0.12, np.array([-0.6, -0.8, -0.14]), np.array([0.6, 0.2, 0.7]))


def above(height: float, x: float = -0.03, y: float = -0.40) -> np.ndarray:
    """Joints with the gripper pointing down, its centre point so high above the table."""
    T = transform(rot_x(np.pi), [x, y, -0.12 + height])
    return inverse_kinematics(robot, T, near=OBSERVE)[0]


@pytest.mark.parametrize("file", [SIA5F, SIX_AXIS], ids=["sia5f", "six_axis"])
def test_nothing_that_touches_by_mujocos_judgement_is_called_free(file: Path) -> None:
    for seed in (0, 1):
        verdicts = compare(file, 150, seed)
        assert verdicts.touching > 20
        assert verdicts.missed == 0
        assert verdicts.greatest_care < 0.025


def test_the_oracle_itself_sees_a_known_collision_and_its_absence() -> None:
    scene = random_scene(0, boxes=0, cells=0)
    oracle = Oracle(robot, scene)
    assert not oracle.touches(above(0.05), OPEN)
    assert oracle.touches(above(0.005), OPEN)
    assert oracle.distance(above(0.05), OPEN) == pytest.approx(0.05 - 0.012, abs=1e-6)


def test_the_clearance_of_the_fingers_from_the_table_is_exact() -> None:
    world = CollisionWorld.build(robot, table, margins=TOUCHING_ALLOWED)
    for height in (0.02, 0.03):
        assert world.clearance(above(height), OPEN) == pytest.approx(height - 0.012, abs=1e-9)


def test_each_body_keeps_its_own_margin() -> None:
    q = above(0.012 + 0.003)  # fingertips 3 mm above the table
    assert CollisionWorld.build(robot, table, margins=Margins(fingers=0.002)).check(q, OPEN) is None
    hit = CollisionWorld.build(robot, table, margins=Margins(fingers=0.005)).check(q, OPEN)
    assert hit is not None
    assert (hit.body, hit.other, hit.margin) == (
        "finger_left",
        "table",
        0.005,
    ) or hit.body == "finger_right"
    assert hit.depth == pytest.approx(0.002, abs=1e-9)
    assert "comes within 3.0 mm of the table" in str(hit)


def test_a_collision_names_link_obstacle_depth_and_place() -> None:
    wall = Box("wall", transform(translation=[0.0, -0.40, 0.1]), (0.3, 0.02, 0.05))
    world = CollisionWorld.build(robot, Workspace(-0.12, table.lower, table.upper, (wall,)))
    hit = world.check(above(0.05), OPEN)
    assert hit is not None
    assert hit.other == "wall"
    assert hit.depth > hit.margin
    assert abs(hit.point[1] + 0.40) < 0.2
    assert str(hit).startswith(f"{hit.body} touches the wall at (")


def test_self_collision_is_seen_and_named() -> None:
    folded = np.array([2.0, -0.3, 2.0, -1.5, -0.8, -1.6, 1.0])
    assert Oracle(robot, random_scene(0, boxes=0, cells=0, table_z=-3.0)).touches(folded, OPEN)
    hit = CollisionWorld.build(robot).check(folded, OPEN)
    assert hit is not None
    assert hit.itself
    assert (hit.body, hit.other) == ("tool0", "link_l")
    assert "touches the arm's own link_l" in str(hit)


def test_the_robots_usual_postures_are_free() -> None:
    world = CollisionWorld.build(robot, table)
    assert world.check(OBSERVE, OPEN) is None
    assert world.check(np.zeros(7), OPEN) is None


def test_an_open_gripper_is_wider_than_a_closed_one() -> None:
    q = above(0.10)
    T = robot.tcp(q)
    beside = T[:3, 3] + T[:3, 1] * 0.058
    post = Convex.of_points("post", beside + 0.003 * fibonacci_sphere(40))
    world = CollisionWorld.build(robot, table, obstacles=[post], margins=TOUCHING_ALLOWED)
    assert world.free(q, 0.05)[0]
    hit = world.check(q, OPEN)
    assert hit is not None
    assert hit.other == "post"
    assert hit.body.startswith("finger")


def test_touchable_objects_are_ignored_only_for_the_named_parts() -> None:
    q, around = (
        above(0.08),
        0.085,
    )  # the fingers reach 2.5 mm into the apple, the palm stays 38 mm away
    apple = Convex.of_points("target", robot.tcp(q)[:3, 3] + 0.045 * fibonacci_sphere(400))
    world = CollisionWorld.build(robot, table, obstacles=[apple])
    assert world.check(q, around) is not None
    assert world.allowing("target", "fingers").check(q, around) is None
    too_deep = above(0.08 - 0.040)
    assert world.allowing("target", "fingers").check(too_deep, around) is not None
    assert world.without("target").check(too_deep, around) is None
    with pytest.raises(UnknownObstacle, match="no obstacle is named 'pear'"):
        world.without("pear")


def test_held_fruit_is_part_of_the_robot() -> None:
    apple_tcp = 0.04 * fibonacci_sphere(300)
    shape = RobotShape.of(robot).holding(apple_tcp)
    world = CollisionWorld.build(shape, table, margins=TOUCHING_ALLOWED)
    assert world.free(above(0.05), 0.08)[0]
    hit = world.check(above(0.035), 0.08)
    assert hit is not None
    assert (hit.body, hit.other) == ("held fruit", "table")
    assert hit.depth == pytest.approx(0.005, abs=1e-3)
    assert CollisionWorld.build(robot, table, margins=TOUCHING_ALLOWED).free(above(0.035), 0.08)[0]


@settings(max_examples=40)
@given(st.integers(0, 100_000))
def test_a_path_called_free_holds_no_collision_at_any_fine_sample(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = random_scene(seed % 5)
    field = DistanceField.of_blocked(scene.cells, scene.origin, 0.02, 0.3)
    world = CollisionWorld.build(
        robot, scene.workspace, field, margins=Margins(0.005, 0.005, 0.002, 0.0, 0.002)
    )
    start = rng.uniform(robot.lower, robot.upper)
    end = np.clip(start + rng.normal(size=7) * 0.3, robot.lower, robot.upper)
    samples = start + np.linspace(0.0, 1.0, 400)[:, None] * (end - start)
    clearances = world.clearances(samples, 0.07)
    hit = world.check_path([start, end], 0.07)
    if hit is None:
        assert clearances.min() >= -2.0 * SLACK
    else:
        assert clearances.min() < 1e-4 - SLACK
        assert world.clearance(hit.q, 0.07) == pytest.approx(-hit.depth, abs=1e-9)
        first = np.flatnonzero(clearances < -2.0 * SLACK)
        if len(first):
            assert hit.at <= first[0] / 399.0 + 1e-9


def test_a_thin_plate_between_two_free_postures_is_not_jumped() -> None:
    start, end = above(0.15, x=-0.15), above(0.15, x=0.15)
    plate = Box("plate", transform(translation=[0.0, -0.40, 0.02]), (5e-4, 0.2, 0.1))
    world = CollisionWorld.build(robot, Workspace(-0.12, table.lower, table.upper, (plate,)))
    assert world.check(start, 0.05) is None
    assert world.check(end, 0.05) is None
    hit = world.check_path([start, end, start], 0.05)
    assert hit is not None
    assert hit.other == "plate"
    assert 0.0 < hit.at < 1.0


STILL = Trajectory(
    np.array([0.0, 1.0]), np.repeat(OBSERVE[None], 2, axis=0), np.zeros((2, 7)), np.zeros((2, 7))
)


def test_a_trajectory_between_distant_samples_must_keep_clear_of_its_possible_bow() -> None:
    world = CollisionWorld.build(robot, table)
    q = np.linspace(above(0.05), above(0.06), 5)
    limits = ArmLimits(robot.lower, robot.upper, robot.velocity, robot.acceleration, robot.jerk)
    assert world.check_trajectory(time_polyline(q, limits), OPEN) is None
    at_rest = replace(STILL, q=q[[0, 0]])
    assert world.check_trajectory(at_rest, OPEN) is None
    swinging = replace(at_rest, qdd=np.full((2, 7), 8.0))
    assert (
        world.check_trajectory(swinging, OPEN) is not None
    )  # 6 cm of bow may be hidden between samples


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        (replace(STILL, q=np.zeros((2, 6))), "two or more samples of 7 joints"),
        (replace(STILL, t=np.array([0.0, 0.0])), "time does not increase"),
        (
            replace(STILL, q=np.full((2, 7), np.nan)),
            "the position of sample 0 is not a finite number",
        ),
        (replace(STILL, q=np.full((2, 7), 2.5)), "joint 2 would be at 143.2°"),
    ],
)
def test_a_trajectory_that_must_not_be_executed_is_refused(
    wrong: Trajectory, complaint: str
) -> None:
    with pytest.raises(BadTrajectory, match=complaint):
        CollisionWorld.build(robot, table).check_trajectory(wrong, OPEN)


def test_bad_joints_are_refused_before_anything_is_judged() -> None:
    world = CollisionWorld.build(robot, table)
    for question in (world.check, world.clearance, world.clearances, world.free, world.check_path):
        with pytest.raises(BadJoints):
            question(
                np.full((1, 7), np.nan)
                if question not in (world.check, world.clearance)
                else np.full(7, np.nan),
                OPEN,
            )


def test_a_world_travels_to_another_process() -> None:
    world = CollisionWorld.build(robot, table)
    copy = pickle.loads(pickle.dumps(world))
    Q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (50, 7))
    assert np.array_equal(copy.clearances(Q, OPEN), world.clearances(Q, OPEN))


def test_neither_a_world_from_another_process_nor_a_read_only_path_compiles_a_kernel_again() -> (
    None
):
    """numba compiles a kernel for each pattern of writable arrays: 20 s in the middle of a first pick."""
    world = CollisionWorld.build(robot, table)
    Q = np.linspace(robot.lower, robot.upper, 4)
    world.clearances(Q, OPEN), world.check_path(Q, OPEN)
    compiled = [set(kernel.signatures) for kernel in (check_states, check_path)]
    Q.setflags(write=False)
    for each in (
        world,
        pickle.loads(pickle.dumps(world, protocol=4)),
        pickle.loads(pickle.dumps(world, protocol=5)),
    ):
        each.clearances(Q, OPEN), each.check_path(Q, OPEN), each.leaving(Q[0], OPEN, "fingers")
    assert [set(kernel.signatures) for kernel in (check_states, check_path)] == compiled


NESTED = """<mujoco><worldbody><body name="post"><geom size="0.1"/>
  <body name="one"><joint name="one" axis="0 0 1" range="-1 1"/><geom name="hub" size="0.09"/>
    <body name="two"><joint name="two" axis="0 1 0" range="-1 1"/><geom name="inner" size="0.08"/>
      <body name="tool0" pos="0.3 0 0"><geom name="tip" size="0.02"/></body>
    </body></body></body></worldbody></mujoco>"""


def test_pairs_that_overlap_in_every_posture_are_left_out_by_geometry(tmp_path: Path) -> None:
    file = tmp_path / "nested.xml"
    file.write_text(NESTED)
    shape = RobotShape.of(RobotModel.load(file))
    pairs = {frozenset((shape.geom_names[i], shape.geom_names[j])) for i, j in shape.arrays.pairs}
    assert pairs == {
        frozenset(("post/0", "tip")),
        frozenset(("hub", "tip")),
    }  # not post and inner


@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_convex_distances_are_lower_bounds_and_close(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre, radius = rng.uniform(-0.2, 0.2, 3), 0.045
    fruit = Convex.of_points("fruit", centre + radius * fibonacci_sphere(3000))
    points = rng.uniform(-0.4, 0.4, (200, 3))
    true = np.linalg.norm(points - centre, axis=1) - radius
    told = fruit.distance(points)
    assert np.all(told <= true + 1e-3 * radius)
    assert np.all(told >= np.where(true > 0.0, 0.96 * true, true) - 1e-3)


def ball(offset: tuple[float, float, float], radius: float, name: str) -> Convex:
    """A ball beside the TCP of `above(0.05)`."""
    centre = robot.tcp(above(0.05))[:3, 3] + np.array(offset)
    return Convex.of_points(name, centre + radius * fibonacci_sphere(162))


def leaving(*obstacles: Convex) -> CollisionWorld:
    """A world in which a held ball of 80 mm may leave what it touches in the posture `above(0.05)`."""
    held = RobotShape.of(robot).holding(0.04 * fibonacci_sphere(162))
    return CollisionWorld.build(held, table, obstacles=obstacles).leaving(
        above(0.05), 0.08, "held", "fingers"
    )


def rise(height: float) -> np.ndarray:
    """Joints along a straight way up."""
    return straight_line(
        robot,
        above(0.05),
        robot.tcp(above(0.05)) + transform(translation=[0, 0, height]) - np.eye(4),
    ).q


@pytest.mark.parametrize(
    "beside", [(0.079, 0.0, 0.0), (0.06, 0.052, -0.01), (-0.05, 0.06, -0.01), (0.0, 0.0, -0.079)]
)
def test_a_held_fruit_leaves_a_neighbour_that_it_touches(
    beside: tuple[float, float, float],
) -> None:
    neighbour = ball(beside, 0.04, "neighbour")
    assert (
        CollisionWorld.build(leaving().shape, table, obstacles=[neighbour]).check_path(
            rise(0.1), 0.08
        )
        is not None
    )
    assert leaving(neighbour).check_path(rise(0.1), 0.08) is None


@pytest.mark.parametrize("above_it", [(0.06, 0.03, 0.042), (0.06, 0.0, 0.05)])
def test_a_fruit_below_another_one_is_not_free_to_rise(
    above_it: tuple[float, float, float],
) -> None:
    hit = leaving(ball(above_it, 0.04, "upper")).check_path(rise(0.1), 0.08)
    assert hit is not None
    assert hit.other == "upper"
    assert "not pressed more" in str(hit)


def test_a_fruit_under_a_lip_is_not_free_to_rise() -> None:
    centre = robot.tcp(above(0.05))[:3, 3]
    lip = Box(
        "lip", transform(translation=[*(centre + np.array([0.05, 0.0, 0.045]))]), (0.02, 0.1, 0.005)
    )
    assert leaving(Convex.of_box(lip)).check_path(rise(0.1), 0.08) is not None


def test_only_what_is_touched_may_be_left_and_the_rest_keeps_its_margin() -> None:
    world = leaving(
        ball((0.079, 0.0, 0.0), 0.04, "touched"), ball((0.06, 0.0, 0.09), 0.02, "on the way")
    )
    hit = world.check_path(rise(0.1), 0.08)
    assert hit is not None
    assert (hit.other, hit.margin) == ("on the way", Margins().held)


def test_a_deep_overlap_is_no_contact() -> None:
    assert leaving(ball((0.050, 0.0, 0.0), 0.04, "inside")).check_path(rise(0.1), 0.08) is not None


@pytest.mark.parametrize(("deep", "free"), [(0.001, True), (0.012, False)])
def test_fingers_may_leave_cells_that_they_touch_and_not_cells_that_they_are_in(
    deep: float, free: bool
) -> None:
    q, width = above(0.05), 0.08
    robot_shape = RobotShape.of(robot)
    outside = max(
        float((spheres[:, 1] + spheres[:, 3]).max())
        for geom, group in enumerate(robot_shape.geom_groups)
        if group == "fingers" and len(spheres := robot_shape.spheres_of(geom, q, width))
    )
    blocked = np.zeros((30, 30, 60), np.bool_)
    blocked[10:20, 10:20, 8:16] = True  # cells of 5 mm beside a finger
    origin = np.array([-0.03 - 0.075, outside - deep - 0.05, -0.12])
    field = DistanceField.of_blocked(blocked, origin, 0.005, 0.3)
    world = CollisionWorld.build(robot_shape, table, field, margins=Margins().scaled(0.5))
    leaving = world.leaving(q, width, "held", "fingers")
    assert (leaving.check_path(rise(0.05), width) is None) == free
