"""UpdateMap fuses the right frame, checks the camera's pose, and gives the reason of a failure."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import (
    Arm,
    ArmState,
    Camera,
    Frame,
    Gripper,
    GripperState,
    Intrinsics,
    Workspace,
)
from pomona.executive.clock import ManualClock
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.executive.views import SceneView
from pomona.skills.geometry import rot_y, transform
from pomona.skills.motion.collision import fruit_points
from pomona.skills.motion.occupancy import OCCUPIED, OccupancyMap
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.update_map import UpdateMap

SIA5F = Path(__file__).resolve().parents[2] / "trees" / "robots" / "sia5f_wsg32.xml"
OBSERVE = np.array([-1.36, -0.316, -0.264, -0.234, 0.065, -1.294, 0.048])
WORKSPACE = Workspace(-0.12, np.array([-0.6, -0.8, -0.14]), np.array([0.6, 0.2, 0.7]))
LENS = Intrinsics(152.65, 152.65, 79.5, 59.5, 160, 120)
robot = RobotModel.load(SIA5F)
T_TOOL_CAMERA = robot.frame("camera")
UPRIGHT = np.array(
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
)  # the fruit's y points down


@dataclass
class StillArm:
    q: np.ndarray
    stamp: float = 0.0
    description: Path = SIA5F

    def state(self) -> ArmState:
        return ArmState(self.stamp, self.q, np.zeros(7), moving=False)


class OpenGripper:
    def state(self) -> GripperState:
        return GripperState(0.0, 0.103, 0.0, moving=False)


@dataclass
class OneFrame:
    frame: Frame | None

    def latest(self) -> Frame | None:
        return self.frame


def table_with_apple(stamp: float = 0.0) -> tuple[Frame, MeasuredFruit]:
    """A look at the table from the observe pose, with an apple as a ball of depth, and its measurement."""
    T_base_camera = robot.fk(OBSERVE) @ T_TOOL_CAMERA
    apple = load_fruit("apple")
    T_base_fruit = transform(UPRIGHT, [-0.03, -0.52, -0.12 + apple.dimensions[1] / 2.0])
    v, u = np.mgrid[: LENS.height, : LENS.width].astype(float)
    rays = np.stack(((u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, np.ones_like(u)), axis=-1)
    rays = rays @ T_base_camera[:3, :3].T
    eye, radius = T_base_camera[:3, 3], 0.044
    depth = (-0.12 - eye[2]) / rays[..., 2]
    for centre in (T_base_fruit[:3, 3], np.array([0.08, -0.34, -0.12 + radius])):
        a, b = (rays**2).sum(axis=-1), rays @ (eye - centre)
        root = b**2 - a * ((eye - centre) @ (eye - centre) - radius**2)
        depth = np.where(root > 0.0, (-b - np.sqrt(np.maximum(root, 0.0))) / a, depth)
    frame = Frame(
        stamp,
        0,
        np.zeros((120, 160, 3), np.uint8),
        depth.astype(np.float32),
        LENS,
        OBSERVE,
        T_TOOL_CAMERA,
    )
    measured = MeasuredFruit(
        apple, T_base_fruit, T_base_camera, apple.dimensions, 1.0, 0.0, np.eye(6) * 1e-6, 1.0, 1e-3, np.empty((0, 2)),
        frame, "test",
    )  # fmt: skip
    return frame, measured


def run(
    frame: Frame | None, arm: StillArm | None = None, now: float = 0.1, **inputs: Any
) -> SkillEnd:
    devices = {
        Camera: OneFrame(frame), Arm: arm or StillArm(OBSERVE), Gripper: OpenGripper(), Workspace: WORKSPACE,
    }  # fmt: skip
    return drive(UpdateMap(), inputs, devices, clock=ManualClock(now))


def test_the_measured_fruits_look_is_fused_without_the_fruit() -> None:
    _, measured = table_with_apple()
    outcome = run(None, measured=measured, resolution=0.02)
    assert outcome.status is Status.SUCCESS, outcome.reason
    fused: OccupancyMap = outcome.outputs["map"]
    assert fused.stamps == (0.0,)
    blocked = fused.origin + (np.argwhere(fused.blocked) + 0.5) * fused.resolution
    assert len(blocked) > 10
    to_fruit = np.linalg.norm(blocked[:, None] - fruit_points(measured)[None, ::50], axis=2).min(
        axis=1
    )
    assert to_fruit.min() > 0.03
    assert (
        np.linalg.norm(blocked - [0.08, -0.34, -0.08], axis=1).min() < 0.05
    )  # the neighbour is there
    topic, view = outcome.published[0]
    assert topic == "map"
    assert isinstance(view, SceneView)
    assert "occupied" in view.caption


def test_without_inputs_the_cameras_newest_frame_is_fused_into_the_previous_map() -> None:
    frame, _ = table_with_apple(stamp=2.0)
    first = run(frame, now=2.0, resolution=0.02).outputs["map"]
    second = run(replace(frame, stamp=3.0), StillArm(OBSERVE, 3.0), now=3.0, previous=first)
    assert second.outputs["map"].stamps == (2.0, 3.0)
    assert second.outputs["map"].resolution == 0.02


@pytest.mark.parametrize(
    ("change", "arm", "now", "code"),
    [
        (None, None, 0.1, "NO_FRAME"),
        ({"depth": None}, None, 0.1, "NO_DEPTH"),
        ({"depth": np.zeros((120, 160), np.float32)}, None, 0.1, "NO_DEPTH"),
        ({}, None, 60.0, "STALE_FRAME"),
        ({"q": OBSERVE + 0.05}, None, 0.0, "POSE_MISMATCH"),
        ({"q": np.zeros(6)}, None, 0.0, "POSE_MISMATCH"),
        ({"q": [*OBSERVE, 0, 0.15, 0, 0, 0, 0, 0]}, StillArm([*OBSERVE, 0, 0.15, 0, 0, 0, 0, 0]), 0.0, "POSE_MISMATCH"),
    ],
)  # fmt: skip
def test_a_look_that_cannot_be_used_fails_with_a_reason(
    change: dict[str, object] | None, arm: StillArm | None, now: float, code: str
) -> None:
    frame, _ = table_with_apple()
    outcome = run(None if change is None else replace(frame, **change), arm, now, resolution=0.02)
    assert outcome.status is Status.FAILURE
    assert outcome.reason is not None
    assert outcome.reason.code == code
    assert "map" not in outcome.outputs


def test_a_measurement_whose_camera_was_elsewhere_is_refused() -> None:
    _, measured = table_with_apple()
    elsewhere = measured.T_base_camera @ transform(translation=[0.01, 0.0, 0.0])
    outcome = run(None, measured=replace(measured, T_base_camera=elsewhere))
    assert outcome.reason is not None
    assert outcome.reason.code == "POSE_MISMATCH"
    assert "10.0 mm" in outcome.reason.message


def test_depth_that_is_mirrored_makes_no_map() -> None:
    frame, _ = table_with_apple()
    assert frame.depth is not None
    turned = frame.T_mount_camera @ transform(rot_y(np.radians(6.0)))
    above = (robot.fk(OBSERVE) @ turned)[2]
    v, u = np.indices(frame.depth.shape)
    rays = np.stack([(u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, np.ones(u.shape)], axis=-1)
    table = ((above[3] + 0.12) / -(rays @ above[:3])).astype(np.float32)
    sound = run(replace(frame, depth=table, T_mount_camera=turned), resolution=0.02)
    assert sound.status is Status.SUCCESS
    outcome = run(
        replace(frame, depth=table[:, ::-1].copy(), T_mount_camera=turned), resolution=0.02
    )
    assert outcome.reason is not None
    assert outcome.reason.code == "DEPTH_MISMATCH"
    assert "map" not in outcome.outputs


def test_interrupted_it_gives_up_and_the_previous_map_stays_as_it_was() -> None:
    frame, _ = table_with_apple()
    previous = run(frame, resolution=0.02).outputs["map"]
    before = previous.states.copy()
    devices = {
        Camera: OneFrame(frame),
        Arm: StillArm(OBSERVE),
        Gripper: OpenGripper(),
        Workspace: WORKSPACE,
    }
    inputs = {"previous": previous}
    outcome = drive(
        UpdateMap(), inputs, devices, clock=ManualClock(0.1), computing=10, interrupt_after=5
    )
    assert outcome.status is Status.INVALID
    assert outcome.cancelled == 1
    assert outcome.outputs == {}
    assert outcome.published == ()
    assert np.array_equal(previous.states, before)


def test_fruit_beside_the_target_and_the_cells_obstacles_are_not_mapped_as_cells():
    frame, apple = table_with_apple()
    other = transform(UPRIGHT, [0.08, -0.34, -0.12 + apple.dimensions[1] / 2.0])
    both = replace(apple, beside=(replace(apple, T_base_fruit=other),))
    alone, crowd = (run(frame, measured=m).outputs["map"] for m in (apple, both))
    near = [0.08, -0.34, -0.08]
    assert np.linalg.norm(alone.centres(OCCUPIED) - near, axis=1).min() < 0.05
    assert crowd.blocked.sum() < 0.1 * alone.blocked.sum()
    assert [shape.name for shape in crowd.shapes] == ["neighbour"]
