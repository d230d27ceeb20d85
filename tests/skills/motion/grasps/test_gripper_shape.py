import mujoco
import numpy as np
import pytest

from pomona.skills.geometry import transform
from pomona.skills.motion.grasps.gripper_shape import gripper_shape, outline
from pomona.skills.motion.grasps.sphere import pre_grasp_orientation
from pomona.skills.motion.robot.description import Geom
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL

SHAPE = gripper_shape(ROBOT_MODEL)


@pytest.mark.parametrize("theta", [0.0, 0.26, 0.52, 0.79])
def test_the_lowest_point_is_that_of_the_finger_boxes(theta):
    """Fingers are 20 mm wide and end 12 mm beyond the TCP."""
    T = transform(pre_grasp_orientation(theta, 0.7), np.array([0.0, -0.4, 0.1]))
    height, body = SHAPE.lowest(T, 0.08)
    assert height == pytest.approx(0.1 - 0.012 * np.cos(theta) - 0.010 * np.sin(theta), abs=1e-6)
    assert body.startswith("finger")


def test_the_palm_is_where_the_gripper_body_ends():
    assert SHAPE.palm_depth == pytest.approx(0.168 - 0.085)


def test_the_shortest_way_from_a_fruit_to_a_finger_leads_to_its_nearest_side():
    """The left finger's tip lies 12 mm beyond the TCP, the right pad's face at half the opening."""
    left = SHAPE.way_to(np.array([[0.0, 0.045, 0.03], [0.0, 0.0, 0.03]]), 0.08, "left")
    np.testing.assert_allclose(left, [0.0, 0.0, -0.018], atol=1e-6)
    right = SHAPE.way_to(np.array([[0.0, -0.03, 0.0], [0.0, 0.03, 0.0]]), 0.08, "right")
    np.testing.assert_allclose(right, [0.0, -0.01, 0.0], atol=1e-6)


@pytest.mark.parametrize("width", [0.035, 0.07, 0.103])
def test_fingers_slide_as_in_the_simulator(width):
    model = mujoco.MjModel.from_xml_path(str(ROBOT_MODEL.path))
    state = mujoco.MjData(model)
    for name, value in zip(ROBOT_MODEL.joint_names, OBSERVE, strict=True):
        state.joint(name).qpos[0] = value
    for name in ("finger_left", "finger_right"):
        state.joint(name).qpos[0] = (width - 0.035) / 2.0
    mujoco.mj_kinematics(model, state)
    lowest = np.inf
    for name in ("finger_left", "finger_right"):
        geom = model.geom(name)
        corners = (
            np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * geom.size
        )
        placed = state.geom(name).xpos + corners @ state.geom(name).xmat.reshape(3, 3).T
        lowest = min(lowest, placed[:, 2].min())
    assert SHAPE.lowest(ROBOT_MODEL.tcp(OBSERVE), width)[0] == pytest.approx(lowest, abs=1e-6)


def test_a_fingertip_is_level_with_what_a_displacement_brings_below_it():
    tip, finger = (
        0.010,
        0.012,
    )  # of the pads of the shipped hand, opened to 80 mm; the fingers are 2 mm longer
    points = np.array([[0.0, 0.042, -0.02], [0.0, 0.025, -0.02], [0.0, 0.0, 0.0], [0.0, 0.2, 0.0]])
    assert SHAPE.levels(points, 0.08, 0.0)[0] in (
        pytest.approx(tip + 0.02),
        pytest.approx(finger + 0.02),
    )
    np.testing.assert_array_equal(
        np.isfinite(SHAPE.levels(points, 0.08, 0.0)), [True, False, False, False]
    )
    np.testing.assert_array_equal(
        np.isfinite(SHAPE.levels(points, 0.08, 0.02)), [True, True, False, False]
    )
    np.testing.assert_array_equal(
        np.isfinite(SHAPE.levels(points, 0.08, 0.045)), [True, True, True, False]
    )


SUPPORTS = {
    "sphere": lambda d, size: size[0],
    "capsule": lambda d, size: size[0] + size[1] * abs(d[2]),
    "cylinder": lambda d, size: size[0] * np.hypot(d[0], d[1]) + size[1] * abs(d[2]),
    "box": lambda d, size: np.abs(d) @ size,
    "ellipsoid": lambda d, size: np.linalg.norm(d * size),
}
"""How far a shape reaches in a direction, a unit vector."""
SLACK = {"cylinder": 1.0 / np.cos(np.pi / 16.0), "ellipsoid": np.sqrt(3.0)}
"""By how much a polygon around a circle, and a box around an ellipsoid, reach farther."""


@pytest.mark.parametrize("kind", SUPPORTS)
def test_an_outline_holds_its_shape_and_little_more(kind):
    size = np.array([0.03, 0.05, 0.02])
    points, radius = outline(Geom("a", 0, kind, size, np.eye(4), np.empty((0, 3))))
    directions = np.random.default_rng(1).normal(size=(300, 3))
    directions = np.vstack([directions, np.eye(3), -np.eye(3)])
    for d in directions / np.linalg.norm(directions, axis=1, keepdims=True):
        reach, needed = float((points @ d).max() + radius), SUPPORTS[kind](d, size)
        assert needed - 1e-12 <= reach <= SLACK.get(kind, 1.0) * needed + 1e-12


def test_the_outline_of_a_mesh_is_its_corners():
    corners = np.random.default_rng(2).normal(size=(9, 3))
    points, radius = outline(Geom("a", 0, "mesh", np.zeros(3), np.eye(4), corners))
    assert radius == 0.0
    np.testing.assert_array_equal(points, corners)
