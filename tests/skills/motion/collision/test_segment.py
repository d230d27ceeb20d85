"""How far a robot's parts can move along a segment: never less than they do, and little more along a straight line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.drivers.interfaces import Box, Workspace
from pomona.skills.geometry import inverse, rot_x, transform
from pomona.skills.motion.collision import CollisionWorld, Convex, Margins, RobotShape
from pomona.skills.motion.collision.kernel import make_scratch, place
from pomona.skills.motion.collision.segment import (
    _reaches,
    bounds_of_motion,
    speed_of_ball,
    write_twists,
)
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.robot import RobotModel, inverse_kinematics

ROOT = Path(__file__).resolve().parents[4]
SIA5F = ROOT / "trees" / "robots" / "sia5f_wsg32.xml"
OBSERVE = np.array([-1.36, -0.316, -0.264, -0.234, 0.065, -1.294, 0.048])
SLIDING = """<robot name="gantry">
  <link name="base"/>
  <link name="beam"><collision><geometry><box size="0.4 0.1 0.1"/></geometry></collision></link>
  <link name="arm"><collision><geometry><box size="0.1 0.1 0.5"/></geometry></collision></link>
  <link name="tool0"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="beam"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="beam"/><child link="arm"/><origin xyz="0.3 0 0.2" rpy="0.3 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-0.5" upper="0.5" velocity="1" effort="1"/></joint>
  <joint name="nod" type="revolute"><parent link="arm"/><child link="tool0"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
</robot>"""


def bound(
    shape: RobotShape, q: np.ndarray, step: np.ndarray, share: float, inner: int, geom: int
) -> float:
    """How far a geom can move, in the frame of link `inner`, while the joints go from q by a share of a step."""
    arrays, room = shape.arrays, make_scratch(shape.arrays)
    place(arrays, q, shape.model.width_max, room)
    turns, shifts = np.zeros((len(q) + 1, 3)), np.zeros((len(q) + 1, 3))
    write_twists(arrays.sliding, room.links, step, turns, shifts)
    rate, bend = bounds_of_motion(arrays.reach, step, inner, geom)
    speed = speed_of_ball(
        turns, shifts, inner, arrays.links[geom], room.centres[geom], arrays.bounds[geom, 3]
    )
    return min(rate * share, (speed + 0.5 * bend * share) * share)


def motion(
    shape: RobotShape, q: np.ndarray, step: np.ndarray, share: float, inner: int, geom: int
) -> float:
    """How far the centres of a geom's spheres do move, in the frame of link `inner`."""
    centres = []
    for joints in (q, q + share * step):
        T_inner_base = inverse(shape.model.link_poses(joints)[inner])
        spheres = shape.spheres_of(geom, joints, shape.model.width_max)
        centres.append(spheres[:, :3] @ T_inner_base[:3, :3].T + T_inner_base[:3, 3])
    return float(np.linalg.norm(centres[1] - centres[0], axis=1).max())


@pytest.fixture(scope="module", params=["sia5f", "sliding"])
def shape(request, tmp_path_factory) -> RobotShape:
    if request.param == "sia5f":
        return RobotShape.of(RobotModel.load(SIA5F))
    file = tmp_path_factory.mktemp("robot") / "gantry.urdf"
    file.write_text(SLIDING)
    return RobotShape.of(RobotModel.load(file))


@settings(max_examples=60)
@given(seed=st.integers(0, 100_000), share=st.floats(1e-3, 1.0))
def test_nothing_moves_further_than_its_bound(shape: RobotShape, seed: int, share: float) -> None:
    rng, model = np.random.default_rng(seed), shape.model
    q = rng.uniform(model.lower, model.upper)
    # Within the limits all along: a sliding joint's stroke is part of the reach.
    step = (
        (rng.uniform(model.lower, model.upper) - q)
        * rng.uniform(0.01, 1.0)
        * rng.integers(0, 2, model.dof)
    )
    pairs = [(int(shape.arrays.links[i]), int(j)) for i, j in shape.arrays.pairs]
    for inner, geom in [(0, geom) for geom in range(len(shape.geom_names))] + pairs:
        assert (
            motion(shape, q, step, share, inner, geom)
            <= bound(shape, q, step, share, inner, geom) + 1e-12
        )


def test_along_a_straight_line_the_bound_is_close_to_the_motion() -> None:
    robot = RobotModel.load(SIA5F)
    shape, finger = RobotShape.of(robot), RobotShape.of(robot).geom_names.index("finger_left")
    line = straight_line(robot, OBSERVE, robot.tcp(OBSERVE) @ transform(None, [0.0, 0.0, 0.02])).q
    step = line[-1] - line[0]
    assert motion(shape, line[0], step, 0.1, 0, finger) == pytest.approx(2e-3, rel=0.1)
    assert bound(shape, line[0], step, 0.1, 0, finger) < 4e-3
    assert (
        float(np.abs(step) @ shape.arrays.reach[:, finger]) * 0.1 > 6e-3
    )  # what joints times reach would say


def test_a_path_names_its_first_segment_that_is_not_free() -> None:
    robot = RobotModel.load(SIA5F)
    world = CollisionWorld.build(
        robot, Workspace(-0.12, np.array([-0.6, -0.8, -0.14]), np.array([0.6, 0.2, 0.7]))
    )
    high, low = (
        inverse_kinematics(robot, transform(rot_x(np.pi), [-0.03, -0.40, z]), near=OBSERVE)[0]
        for z in (0.03, -0.115)
    )
    assert world.first_blocked([high, high + 0.01, low, high], 0.05) == 1
    assert world.first_blocked([high, high + 0.01], 0.05) is None
    assert world.first_blocked([low], 0.05) == 0


@settings(max_examples=60)
@given(st.integers(0, 100_000))
def test_a_space_proven_free_is_never_denied_where_another_check_looks_elsewhere(seed: int) -> None:
    """A plan must not fail on its own path: any part of a segment that was proven is free to the one that executes."""
    rng = np.random.default_rng(seed)
    boxes = tuple(
        Convex.of_box(
            Box(f"box {k}", transform(None, rng.uniform([-0.6, -0.7, 0.0], [0.6, 0.5, 0.6])), size)
        )
        for k, size in enumerate(rng.uniform(0.02, 0.1, (8, 3)).tolist())
    )
    robot = RobotModel.load(SIA5F)
    world = CollisionWorld.build(
        robot, obstacles=boxes, margins=Margins(0.005, 0.005, 0.002, 0.0, 0.002)
    )
    start = rng.uniform(robot.lower, robot.upper)
    end = np.clip(start + rng.normal(size=robot.dof) * 0.3, robot.lower, robot.upper)
    if world.check_path([start, end], 0.07) is not None:
        return
    shares = np.sort(rng.uniform(0.0, 1.0, 7))
    assert world.first_blocked(start + shares[:, None] * (end - start), 0.07) is None


# --------------------------------------------------------------------------------------- the bounds by themselves


def test_rates_and_bends_are_sums_over_the_joints_from_one_on() -> None:
    rng = np.random.default_rng(4)
    reach, step = rng.uniform(0.1, 1.0, (5, 3)), rng.normal(size=5)
    for first in (0, 2, 4, 5):
        for geom in range(3):
            moved = np.abs(step[first:])
            apart = reach[first:, geom]
            rate, bend = bounds_of_motion(reach, step, first, geom)
            assert rate == pytest.approx(float(moved @ apart))
            pairs = np.triu(
                np.ones((len(moved), len(moved))), 1
            )  # each joint that turns a later one
            expected = moved**2 @ apart + 2.0 * moved @ pairs @ (moved * apart)
            assert bend == pytest.approx(float(expected))


def test_twists_are_the_motion_of_points_that_links_carry() -> None:
    rng = np.random.default_rng(5)
    dof = 4
    links = np.zeros((dof + 1, 3, 4))
    for j in range(dof + 1):
        links[j, :, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        links[j, :, 3] = rng.normal(size=3)
    step, sliding = rng.normal(size=dof), np.array([False, True, False, True])
    turns, shifts = np.zeros((dof + 1, 3)), np.zeros((dof + 1, 3))
    write_twists(sliding, links, step, turns, shifts)
    p = rng.normal(size=3)
    velocity = np.zeros(3)
    for j in range(dof):
        z, origin = links[j + 1, :, 2], links[j + 1, :, 3]
        velocity = velocity + step[j] * (z if sliding[j] else np.cross(z, p - origin))
        assert np.cross(turns[j + 1], p) + shifts[j + 1] == pytest.approx(velocity)
    inner, outer, radius = 1, 4, 0.2
    bound = speed_of_ball(turns, shifts, inner, outer, p, radius)
    middle = np.cross(turns[outer] - turns[inner], p) + shifts[outer] - shifts[inner]
    turning = np.linalg.norm(turns[outer] - turns[inner])
    assert bound == pytest.approx(np.linalg.norm(middle) + radius * turning)


@pytest.mark.parametrize(
    ("clear", "rate", "speed", "bend", "reached"),
    [
        (0.1, 0.5, 10.0, 0.0, 0.2),  # by the rate
        (0.1, 5.0, 0.2, 0.0, 0.5),  # at a steady speed
        (0.1, 5.0, 0.0, 0.2, 1.0),  # from rest: bend / 2 · t² = clear
        (0.1, 5.0, 0.05, 0.1, 1.0),  # 0.05 t + 0.05 t² = 0.1
        (0.1, 0.0, 1.0, 1.0, 1e11),
    ],
)
def test_a_clearance_is_valid_until_the_motion_can_have_used_it_up(
    clear: float, rate: float, speed: float, bend: float, reached: float
) -> None:
    assert _reaches(clear, rate, speed, bend) == pytest.approx(reached)
