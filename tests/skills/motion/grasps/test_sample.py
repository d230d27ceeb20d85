import re
from dataclasses import replace

import numpy as np
import pytest

from pomona.drivers.interfaces import Box
from pomona.executive.values.rotations import is_rigid
from pomona.skills.geometry import rot_y, rot_z, transform
from pomona.skills.motion.collision import CollisionWorld, Convex, fruit_points
from pomona.skills.motion.grasps.follow_through import LINE_BLOCKED, LINE_BROKEN, START_BLOCKED
from pomona.skills.motion.grasps.gripper_shape import fruit_section, gripper_shape
from pomona.skills.motion.grasps.sample import (
    GraspRules,
    _why_not,
    sample_pre_grasps,
    support_below,
)
from pomona.skills.motion.grasps.sphere import Sphere
from pomona.skills.motion.planning.arm_space import TARGET, ArmSpace
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.fruit import load_fruit
from tests.skills.picking_scene import (
    APPLES,
    OBSERVE,
    PLACES,
    ROBOT_MODEL,
    TABLE_Z,
    WORKSPACE,
    apple_at,
)

SHAPE = gripper_shape(ROBOT_MODEL)
RAW = GraspRules(check=False)


def space_around(target, *others) -> ArmSpace:
    obstacles = (
        Convex.of_fruit(target, TARGET),
        *(Convex.of_fruit(other, "fruit") for other in others),
    )
    world = CollisionWorld.build(ROBOT_MODEL, WORKSPACE, None, obstacles).allowing(
        TARGET, "fingers"
    )
    return ArmSpace(world, ROBOT_MODEL.width_max)


def sample(target, *others, space=None, **rules):
    return sample_pre_grasps(
        target,
        ROBOT_MODEL,
        space or space_around(target, *others),
        OBSERVE,
        TABLE_Z,
        rules=GraspRules(**rules),
    )


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("number", APPLES)
def test_every_cell_of_the_paper_has_many_candidates_with_all_other_fruit_on_the_table(
    number, place
):
    other_places = [p for p in PLACES if p != place]
    others = [
        apple_at(n, p)
        for n, p in zip([n for n in APPLES if n != number], other_places, strict=True)
    ]
    grasps, ruled_out = sample(apple_at(number, place), *others)
    assert len(grasps) >= 20
    assert len(grasps) + len(ruled_out) == 48


def test_candidates_keep_their_promises():
    target = apple_at(3, 4)
    space = space_around(target)
    grasps, _ = sample(target, space=space)
    for grasp in grasps:
        assert is_rigid(grasp.T_base_grasp, 1e-6)
        np.testing.assert_allclose(
            grasp.T_base_pre_grasp[:3, 3],
            grasp.T_base_grasp[:3, 3] - 0.12 * grasp.T_base_grasp[:3, 2],
            atol=1e-12,
        )
        assert APPLES[3][0] * 1e-3 + 4e-3 < grasp.width <= ROBOT_MODEL.width_max
        assert SHAPE.lowest(grasp.T_base_grasp, grasp.width)[0] > TABLE_Z + 3e-3
        for q in grasp.q_pre_grasp:
            np.testing.assert_allclose(ROBOT_MODEL.tcp(q), grasp.T_base_pre_grasp, atol=1e-6)
            assert ((ROBOT_MODEL.lower <= q) & (q <= ROBOT_MODEL.upper)).all()
            assert space.at_width(grasp.width).free(q)


def test_pads_meet_the_fruit_at_its_widest_section():
    target = apple_at(1, 3)
    grasps, _ = sample(target)
    scaled = target.fruit.vertices * (target.dimensions / target.fruit.dimensions)
    points = scaled @ target.T_base_fruit[:3, :3].T + target.T_base_fruit[:3, 3]
    for grasp in grasps[:10]:
        in_tcp = (points - grasp.T_base_grasp[:3, 3]) @ grasp.T_base_grasp[:3, :3]
        outermost = in_tcp[[in_tcp[:, 1].argmin(), in_tcp[:, 1].argmax()]]
        assert (
            np.abs(outermost[:, [0, 2]]).max() < 0.008
        )  # within the pad, which reaches 10 mm around its centre
        assert outermost[:, 1].sum() == pytest.approx(0.0, abs=1e-9)


def test_fingertips_that_a_linkage_draws_back_meet_the_fruit_at_its_widest_section(tmp_path):
    for path in ROBOT_MODEL.path.parent.glob("*.xml"):
        (tmp_path / path.name).write_text(
            re.sub(r'axis="0 (-?1) 0"', r'axis="0 \1 -0.6"', path.read_text())
        )
    tilted = RobotModel.load(tmp_path / ROBOT_MODEL.path.name)
    shape, target = gripper_shape(tilted), apple_at(4, 3)
    space = space_around(target)
    plain, drawn = (
        {
            grasp.index: grasp.T_base_grasp
            for grasp in sample_pre_grasps(target, robot, space, OBSERVE, rules=RAW)[0]
        }
        for robot in (ROBOT_MODEL, tilted)
    )
    back = -shape.forward(APPLES[4][0] * 1e-3)
    assert back > 5e-3
    assert SHAPE.forward(0.05) == 0.0
    both = plain.keys() & drawn.keys()  # all but the few that are out of reach
    assert len(both) > 20
    for index in both:
        further = drawn[index][:3, 3] - plain[index][:3, 3]
        np.testing.assert_allclose(
            further, back * plain[index][:3, 2], atol=2e-3
        )  # the width there is another one
    lower, upper = (
        shape.lowest(np.diag([1.0, -1.0, -1.0, 1.0]), width)[0] for width in (shape.closed, 0.08)
    )
    assert upper - lower == pytest.approx(-shape.forward(0.08), abs=1e-9)


def test_near_the_table_the_small_apple_is_taken_a_little_higher():
    low = replace(apple_at(5, 2), T_base_fruit=apple_at(5, 2).T_base_fruit.copy())
    low.T_base_fruit[2, 3] -= 0.008  # measured 8 mm too low
    grasps, _ = sample(low)
    assert grasps
    assert all(SHAPE.lowest(g.T_base_grasp, g.width)[0] > TABLE_Z + 3e-3 for g in grasps)
    assert any(
        np.linalg.norm(g.T_base_grasp[:3, 3] - low.T_base_fruit[:3, 3]) > 1e-3 for g in grasps
    )


def test_a_fruit_measured_far_too_low_is_ruled_out_by_the_table_in_words():
    low = replace(apple_at(5, 2), T_base_fruit=apple_at(5, 2).T_base_fruit.copy())
    low.T_base_fruit[2, 3] -= 0.018
    _, ruled_out = sample(low)
    table = [out for out in ruled_out if out.code == "TABLE"]
    assert table
    assert "finger would be" in table[0].reason
    assert "the table" in table[0].reason


def test_doubt_about_the_height_costs_tilted_grasps_first():
    sure, _ = sample(apple_at(5, 2, sigma=0.5e-3))
    unsure, ruled_out = sample(apple_at(5, 2, sigma=5e-3), sigmas=2.0)
    assert len(unsure) < len(sure)
    assert {out.code for out in ruled_out} & {"TABLE", "TOO_WIDE"}


def test_a_fruit_too_wide_for_the_fingers_is_reported():
    wide = replace(apple_at(1, 3), dimensions=np.array([0.105, 0.09, 0.105]))
    grasps, ruled_out = sample(wide)
    assert grasps == ()
    assert {out.code for out in ruled_out} == {"TOO_WIDE"}
    assert "103 mm" in ruled_out[0].reason


def test_a_neighbour_on_one_side_rules_out_grasps_that_would_touch_it():
    target = apple_at(4, 3)
    neighbour = replace(apple_at(4, 3), T_base_fruit=target.T_base_fruit.copy())
    neighbour.T_base_fruit[0, 3] += 0.078  # 5 mm of air along x
    alone, _ = sample(target)
    beside, ruled_out = sample(target, neighbour)
    assert 0 < len(beside) < len(alone)
    blocked = [out for out in ruled_out if out.code == "IN_COLLISION"]
    assert any("finger" in out.reason and "fruit" in out.reason for out in blocked)
    for grasp in beside:  # a finger between the two would have to open along x
        assert abs(grasp.T_base_grasp[0, 1]) < 0.95


def test_a_finger_is_never_placed_beyond_a_wall_that_it_would_close_on():
    target = apple_at(5, 3)
    centre, half = target.T_base_fruit[:3, 3], APPLES[5][0] / 2e3
    wall = Box(
        "crate",
        transform(translation=centre + np.array([half + 0.003, 0.0, 0.0])),
        (0.002, 0.15, 0.03),
    )
    space = space_around(target)
    space = replace(space, world=space.world.with_obstacles(Convex.of_box(wall)))
    alongside = Sphere(theta=(0.0, 0.0), tilts=1, turns=12)
    grasps, ruled_out = sample_pre_grasps(
        target, ROBOT_MODEL, space, OBSERVE, TABLE_Z, alongside, GraspRules(side=(0.018, 2e-3))
    )
    assert grasps
    assert all(abs(grasp.T_base_grasp[0, 1]) < 0.8 for grasp in grasps)
    assert any("close" in out.reason and "crate" in out.reason for out in ruled_out)


def test_less_air_needs_less_room_beside_the_fruit():
    target = apple_at(4, 3)
    neighbours = []
    for side in (-1.0, 1.0):  # slots of 23 mm for fingers of 10 mm, which spheres cover
        beside = replace(target, T_base_fruit=target.T_base_fruit.copy())
        beside.T_base_fruit[0, 3] += side * (APPLES[4][0] * 1e-3 + 0.023)
        neighbours.append(beside)
    widths = {}
    for air in (6e-3, 3e-3):
        grasps, _ = sample(target, *neighbours, side=(air, 2e-3), sigmas=0.0)
        widths[air] = [
            g.width for g in grasps if abs(g.T_base_grasp[0, 1]) > 0.95 and g.theta == 0.0
        ]
    assert not widths[6e-3]
    assert widths[3e-3]
    assert max(widths[3e-3]) < APPLES[4][0] * 1e-3 + 7e-3


def test_a_fruit_stands_on_the_highest_floor_below_it():
    T_floor = transform(rot_z(0.3), [0.0, -0.4, TABLE_Z + 0.004])
    crate = Box("crate", T_floor, (0.2, 0.15, 0.004))
    tilted = Box("lid", transform(rot_y(0.5), [0.0, -0.4, TABLE_Z + 0.02]), (0.2, 0.15, 0.004))
    cell = replace(WORKSPACE, obstacles=(crate, tilted))
    assert support_below(cell, np.array([0.05, -0.42, -0.07])) == pytest.approx(TABLE_Z + 0.008)
    assert support_below(cell, np.array([0.4, -0.42, -0.07])) == TABLE_Z
    assert support_below(cell, np.array([0.05, -0.42, TABLE_Z])) == TABLE_Z, "not one above it"
    assert support_below(replace(cell, table_z=None), np.array([0.4, -0.42, -0.07])) is None


def test_without_the_check_candidates_come_in_the_order_of_sampling():
    grasps, ruled_out = sample(apple_at(5, 3), check=False)
    indices = [grasp.index for grasp in grasps]
    assert indices == sorted(indices)
    assert {out.code for out in ruled_out} == {"UNREACHABLE"}


def test_best_first_prefers_room_and_a_steep_approach():
    grasps, _ = sample(apple_at(1, 3))
    first, last = grasps[0], grasps[-1]
    assert first.theta <= last.theta
    assert first.clearance >= last.clearance


def lying_lemon(yaw: float):
    """58 x 82 mm, its long axis level and turned by `yaw` about the vertical."""
    upright = apple_at(1, 3)
    T_base_fruit = transform(
        rot_z(yaw) @ np.eye(3), [*PLACES[3], TABLE_Z + 0.029]
    )  # its axis, the object's y, is level
    return replace(
        upright,
        fruit=load_fruit("lemon"),
        T_base_fruit=T_base_fruit,
        dimensions=np.array([0.058, 0.082, 0.058]),
    )


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.1, 2.0])
def test_a_long_fruit_is_taken_across(yaw):
    grasps, _ = sample(lying_lemon(yaw))
    long_axis = lying_lemon(yaw).T_base_fruit[:3, 1]
    assert abs(grasps[0].T_base_grasp[:3, 1] @ long_axis) < np.sin(
        np.radians(16.0)
    )  # the sphere's steps are 30°
    assert grasps[0].oblique < np.radians(14.0)


def test_how_obliquely_pads_meet_an_ellipsoid():
    lemon = lying_lemon(0.0)
    for turned, expected in ((0.0, 0.0), (30.0, 19.1), (90.0, 0.0)):
        sliding = np.array([np.cos(np.radians(turned)), np.sin(np.radians(turned)), 0.0])
        down = np.array([0.0, 0.0, -1.0])
        R_base_tcp = np.stack([np.cross(sliding, down), sliding, down], axis=1)
        assert np.degrees(
            fruit_section(lemon, fruit_points(lemon), R_base_tcp).oblique
        ) == pytest.approx(expected, abs=0.1)


def test_the_sphere_is_a_choice():
    grasps, ruled_out = sample_pre_grasps(
        apple_at(1, 3), ROBOT_MODEL, space_around(apple_at(1, 3)), OBSERVE, TABLE_Z,
        Sphere(radius=0.08, theta=(0.2, 0.2), alpha=(0.0, np.pi), tilts=1, turns=5),
    )  # fmt: skip
    assert len(grasps) + len(ruled_out) == 5
    for grasp in grasps:
        assert np.linalg.norm(
            grasp.T_base_pre_grasp[:3, 3] - grasp.T_base_grasp[:3, 3]
        ) == pytest.approx(0.08)


class Told:
    """A space that tells which posture it was asked for."""

    def explain(self, q):
        return f"posture {q[0]:g} is blocked", {}


@pytest.mark.parametrize(("verdicts", "code", "words"), [
    ([START_BLOCKED, LINE_BROKEN], "UNREACHABLE", "cannot go straight from the pre-grasp to the grasp"),
    ([START_BLOCKED, START_BLOCKED], "IN_COLLISION", "at the pre-grasp posture 0 is blocked"),
    ([START_BLOCKED, LINE_BLOCKED, LINE_BROKEN], "IN_COLLISION", "on the approach posture 1 is blocked"),
])  # fmt: skip
def test_the_reason_is_that_of_the_solution_that_came_furthest(verdicts, code, words) -> None:
    rejected = _why_not(Told(), np.array(verdicts), np.arange(3.0)[:, None])
    assert rejected.code == code
    assert words in str(rejected)
