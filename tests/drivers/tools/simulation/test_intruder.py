"""A hand that comes into the simulated cell, and the fixed cameras that see it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from pomona.drivers.errors import CellFileError
from pomona.drivers.interfaces import Arm, Camera, Cameras
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell
from pomona.executive.files import find_cell
from pomona.skills.geometry import inverse
from pomona.skills.motion.robot import RobotModel
from pomona.tools.simulation.camera import SimCamera
from pomona.tools.simulation.intruder import BODY, Reach


@pytest.fixture
def cell() -> Iterator[Cell]:
    opened = load_cell(find_cell("sim_watched"), seed=3)
    yield opened
    opened.close()


def test_the_camera_that_is_listed_first_is_the_one_that_skills_look_with(cell: Cell) -> None:
    seen = [camera.latest() for camera in cell.device(Cameras).all]
    riding, overview, above = (None if frame is None else frame.T_mount_camera for frame in seen)
    first = cell.device(Camera).latest()
    assert first is not None
    np.testing.assert_array_equal(first.T_mount_camera, riding)
    assert not np.allclose(overview, above)


def test_a_fixed_camera_and_one_on_the_gripper_see_the_same_from_the_same_place(cell: Cell) -> None:
    riding = cell.device(Camera)
    assert isinstance(riding, SimCamera)
    frame = riding.latest()
    assert frame is not None
    assert frame.q is not None
    T = RobotModel.load(cell.device(Arm).description).fk(frame.q) @ frame.T_mount_camera
    fixed = SimCamera(cell.devices["world"], riding._intrinsics, riding._stereo, 30.0, T)
    same = fixed.latest()
    fixed.close()
    assert same is not None
    assert same.q is None
    assert np.mean(np.abs(frame.depth - same.depth) > 2e-3) < 1e-3


def test_a_look_at_depth_alone_shows_the_same_and_is_no_look_that_is_scored(cell: Cell) -> None:
    camera = cell.device(Camera)
    assert isinstance(camera, SimCamera)
    whole = camera.latest()
    looks = []
    camera._world.looked, kept = lambda: looks.append(1), camera._world.looked
    depth = camera.latest_depth()
    camera._world.looked = kept
    assert looks == []
    assert whole is not None
    assert depth is not None
    assert depth.depth.shape == (240, 320)
    middle = np.median(whole.depth[220:260, 300:340]), np.median(depth.depth[110:130, 150:170])
    assert middle[0] == pytest.approx(middle[1], abs=2e-3)


def test_the_hand_comes_when_its_switch_is_turned_goes_back_and_reports_its_least_distance(
    cell: Cell,
) -> None:
    world = cell.devices["world"]
    above = cell.device(Cameras).all[2]
    start = world.state.body(BODY).xpos.copy()
    before = above.latest_depth()
    cell.switches["intruder"].inject_fault("reach")
    cell.clock.advance(1.3)
    there = world.state.body(BODY).xpos.copy()
    np.testing.assert_allclose(there, [0.10, -0.40, 0.12], atol=2e-3)
    seen = above.latest_depth()
    x, y, z = (inverse(seen.T_mount_camera) @ np.append(there, 1.0))[:3]
    lens = seen.intrinsics
    u, v = round(lens.fx * x / z + lens.cx), round(lens.fy * y / z + lens.cy)
    assert before.depth[v, u] - seen.depth[v, u] > 0.15
    truth = cell.truth()
    assert 100.0 < truth["intruder_distance_mm"] < 500.0
    assert truth["intruder_distance_moving_mm"] == 1000.0
    cell.clock.advance(3.5)
    np.testing.assert_allclose(world.state.body(BODY).xpos, start, atol=2e-3)


def test_a_hand_that_goes_through_the_arm_touches_it_and_moves_nothing(cell: Cell) -> None:
    world, arm = cell.devices["world"], cell.device(Arm)
    q = arm.state().q.copy()
    tool = world.state.site("tcp").xpos.copy()
    world.intruder.send(Reach(tool + np.array([0.5, 0.0, 0.0]), tool, 1.0))
    for _ in range(30):
        cell.clock.advance(0.02)
        assert np.abs(arm.state().q - q).max() < 1e-3
        assert np.linalg.norm(world.state.site("tcp").xpos - tool) < 1e-3
    assert world.intruder.nearest < 0.0


@pytest.mark.parametrize(
    ("line", "changed", "words"),
    [
        ("looks_at: 0 -0.35 0.1 m", "looks_at: 0.9 -1.1 0.9 m", "where the camera itself is"),
        ("goal: 0.10 -0.40 0.12 m", "goal: 0.75 -0.75 0.35 m", "where the hand starts"),
    ],
)
def test_a_hand_without_a_way_and_a_camera_without_a_direction_are_refused(
    line: str, changed: str, words: str
) -> None:
    path = find_cell("sim_watched")
    text = path.read_text("utf-8")
    assert line in text
    with pytest.raises(CellFileError, match=words):
        load_cell(path, texts={str(path): text.replace(line, changed)})
