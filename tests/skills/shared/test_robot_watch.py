"""The robot for people: its surface is closed and stands where the model's kinematics put it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pomona.drivers.interfaces import Arm, ArmState, Gripper, GripperState
from pomona.executive.views import BodiesView, PosesView
from pomona.skills.motion.collision import RobotShape
from pomona.skills.motion.robot import RobotModel
from pomona.skills.shared.robot_watch import RobotWatch, hull, solid

ROBOT = RobotModel.load(
    Path(__file__).resolve().parents[3] / "trees" / "robots" / "sia5f_wsg32.xml"
)


class Standing:
    """An arm and a gripper that stand where a test puts them."""

    description = ROBOT.path

    def __init__(self) -> None:
        self.q, self.width = np.zeros(ROBOT.dof), 0.05

    def state(self) -> ArmState:
        return ArmState(0.0, self.q, self.q * 0.0, False)


class Holding:
    """The gripper of a `Standing` arm."""

    def __init__(self, arm: Standing) -> None:
        self._arm = arm

    def state(self) -> GripperState:
        return GripperState(0.0, self._arm.width, 0.0, False)


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Inside a closed surface whose triangles look outwards."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def test_surfaces_are_closed_look_outwards_and_have_the_shapes_volume() -> None:
    for geom in ROBOT.geoms:
        vertices, faces = solid(geom)
        r, length = geom.size[0], 2.0 * geom.size[1]
        exact = {
            "capsule": np.pi * r**2 * (length + 4.0 / 3.0 * r),
            "cylinder": np.pi * r**2 * length,
            "box": 8.0 * np.prod(geom.size),
        }[geom.kind]
        assert volume(vertices, faces) == pytest.approx(exact, rel=0.1)


def test_a_hull_of_random_points_contains_them() -> None:
    points = np.random.default_rng(1).normal(size=(60, 3))
    corners, faces = hull(points)
    a, b, c = (corners[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    assert (
        np.einsum("ij,nj->ni", normals, points) <= np.einsum("ij,ij->i", normals, a) + 1e-9
    ).all()


def test_parts_stand_where_planning_has_them() -> None:
    arm = Standing()
    watch = RobotWatch({Arm: arm, Gripper: Holding(arm)}.__getitem__)
    rng = np.random.default_rng(2)
    arm.q, arm.width = rng.uniform(-1.0, 1.0, ROBOT.dof), 0.08
    (_, bodies), (_, poses) = watch.look()
    assert isinstance(bodies, BodiesView)
    assert isinstance(poses, PosesView)
    np.testing.assert_allclose(poses.trace, ROBOT.tcp(arm.q)[:3, 3], atol=1e-5)
    shape = RobotShape.of(ROBOT)
    for body, pose in zip(bodies.bodies, poses.poses, strict=True):
        drawn = body.vertices @ Rotation.from_quat(pose[3:]).as_matrix().T + pose[:3]
        geoms = [n for n, name in enumerate(shape.geom_bodies) if name == body.label]
        if geoms:
            spheres = np.vstack([shape.spheres_of(geom, arm.q, arm.width) for geom in geoms])
            away = (
                np.linalg.norm(drawn[:, None] - spheres[None, :, :3], axis=2) - spheres[None, :, 3]
            )
            assert (
                away.min(axis=1).max() < 2e-4
            )  # every corner lies in the cover that planning uses


def test_a_standing_device_is_reported_once() -> None:
    arm = Standing()
    watch = RobotWatch({Arm: arm, Gripper: Holding(arm)}.__getitem__)
    assert len(list(watch.look())) == 2
    assert list(watch.look()) == []
    arm.width += 0.01
    ((topic, view),) = watch.look()
    assert topic == "robot"
    assert isinstance(view, PosesView)
