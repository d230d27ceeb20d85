from dataclasses import replace

import numpy as np

from pomona.applications.crates.hooks import WALL_AIR, Beside, facing
from pomona.applications.crates.inserts import (
    FLOOR_AIR,
    GIVE,
    LOCK,
    crowded_side,
    finger_corners,
    insert_candidates,
    insert_places,
)
from pomona.skills.motion.collision import Convex
from pomona.skills.motion.grasp import GraspCandidates
from pomona.skills.motion.grasps.gripper_shape import gripper_shape
from pomona.skills.motion.planning.arm_space import arm_space
from tests.skills.applications.crates.wall_scene import AT_WALL, WALL, apple
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL, WORKSPACE, PickingScene

FINGERS = gripper_shape(ROBOT_MODEL)
ROW = [(0.104, 0.0), (-0.104, 0.0)]
"""A neighbour on either side along the wall, 15 mm from the apple: a finger with its pad is as thick."""


def inserts_at(beside: list[tuple[float, float]], workspace=AT_WALL) -> GraspCandidates:
    scene, fruit = PickingScene(workspace=workspace), apple(*beside)
    space = arm_space(scene.arm, workspace, None, ROBOT_MODEL.width_max, 4e-3)
    return insert_candidates(
        Beside.of(fruit, workspace), space, OBSERVE, FINGERS, ROBOT_MODEL.width_max
    )


def test_between_two_neighbours_at_a_wall_the_fingers_go_along_the_wall_and_clear_of_it():
    best = inserts_at(ROW).grasps[0]
    corners = finger_corners(FINGERS, best.T_base_grasp, best.width)
    for way in (GIVE, -GIVE):
        assert (
            facing(corners + way * best.T_base_grasp[:3, 1], Convex.of_box(WALL))[1]
            >= WALL_AIR - 1e-9
        )
    assert corners[:, 2].min() >= -0.12 + FLOOR_AIR - 1e-9
    assert 0.0 < -best.clearance < LOCK * 0.045


def test_the_least_push_comes_first_and_nothing_is_pushed_where_there_is_room():
    found = inserts_at(ROW).grasps
    pushes = [-grasp.clearance for grasp in found]
    assert pushes == sorted(pushes)
    assert inserts_at([], WORKSPACE).grasps[0].clearance == 0.0


def test_fruit_that_neighbours_enclose_has_no_place_for_fingers_that_nip_none():
    ring = [
        (0.091 * np.cos(a), 0.091 * np.sin(a)) for a in np.arange(0.0, 2.0 * np.pi, np.pi / 3.0)
    ]
    assert not inserts_at(ring, WORKSPACE).grasps
    assert all("nip them" in out.reason for out in inserts_at(ring, WORKSPACE).ruled_out)


def test_fruit_as_wide_as_the_fingers_open_is_ruled_out():
    fruit = apple()
    wide = Beside.of(replace(fruit, dimensions=np.array([0.102, 0.081, 0.102])), WORKSPACE)
    assert all("wide" in place.why for place in insert_places(wide, FINGERS, ROBOT_MODEL.width_max))


def test_the_crowded_side_is_that_of_the_neighbour():
    beside = Beside.of(apple(ROW[0]), WORKSPACE)
    grasp = inserts_at([ROW[0]], WORKSPACE).grasps[0]
    T_base_grasp = grasp.T_base_grasp.copy()
    T_base_grasp[:3, :3] = np.column_stack(([0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]))
    T_base_grasp[:2, 3] = beside.fruit.T_base_fruit[:2, 3]
    assert crowded_side(beside, FINGERS, replace(grasp, T_base_grasp=T_base_grasp)) == 1.0
    T_base_grasp[:3, :2] *= -1.0
    assert crowded_side(beside, FINGERS, replace(grasp, T_base_grasp=T_base_grasp)) == -1.0
