"""The robot's file: kinematics of the manufacturer, frames as in the interfaces, limits of every joint."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from pomona.drivers import robot_file
from pomona.drivers.errors import CellFileError, UnusableRobotFile
from pomona.drivers.robot_file import read_limits
from pomona.executive.cell.cell_file import read_cell_file
from pomona.executive.cell.connect import load_cell
from pomona.skills.motion.robot import RobotModel
from pomona.tools.simulation.gl import load_mujoco

ROBOT = Path(__file__).resolve().parents[4] / "trees" / "robots" / "sia5f_wsg32.xml"
CELLS = ROBOT.parents[1] / "cells"


@pytest.fixture(scope="module")
def robot():
    mujoco = load_mujoco()
    model = mujoco.MjModel.from_xml_path(str(ROBOT))
    state = mujoco.MjData(model)

    def pose(q, fingers=0.0):
        state.qpos[:7] = q
        state.joint("finger_left").qpos[0] = state.joint("finger_right").qpos[0] = fingers
        mujoco.mj_forward(model, state)
        return state

    return model, pose


def urdf_chain(q):
    """tool0 by the public URDF's joint origins and axes, independently of the file."""

    def step(origin, axis=None, angle=0.0):
        T = np.eye(4)
        T[:3, 3] = origin
        if axis is not None:
            x, y, z = axis
            K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            T[:3, :3] = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
        return T

    joints = [
        ((0, 0, 0.310), (0, 0, 1)),
        ((0, 0, 0), (0, 1, 0)),
        ((0, 0, 0.270), (0, 0, 1)),
        ((0.085, 0, 0), (0, -1, 0)),
        ((0.270, 0, 0.060), (-1, 0, 0)),
        ((0, 0, 0), (0, -1, 0)),
        ((0.134, 0, 0), (-1, 0, 0)),
    ]
    T = np.eye(4)
    for (origin, axis), angle in zip(joints, q, strict=True):
        T = T @ step(origin, axis, angle)
    quarter = -np.pi / 2
    rpy = (
        step((0, 0, 0), (0, 0, 1), quarter)
        @ step((0, 0, 0), (0, 1, 0), quarter)
        @ step((0, 0, 0), (1, 0, 0), quarter)
    )
    return T @ step((0.011, 0, 0)) @ rpy


def test_the_flange_is_where_the_manufacturers_chain_puts_it(robot):
    _, pose = robot
    rng = np.random.default_rng(0)
    assert pose(np.zeros(7)).site("tool0").xpos == pytest.approx([0.5, 0.0, 0.64])
    assert pose(np.arange(1, 8) / 10).site("tool0").xpos == pytest.approx(
        [0.446461, 0.199077, 0.770157], abs=1e-6
    )
    for q in rng.uniform(-1.5, 1.5, (50, 7)):
        site = pose(q).site("tool0")
        expected = urdf_chain(q)
        assert np.abs(site.xpos - expected[:3, 3]).max() < 1e-9
        assert np.abs(site.xmat.reshape(3, 3) - expected[:3, :3]).max() < 1e-9


def test_limits_are_the_manufacturers(robot):
    model, _ = robot
    degrees = np.degrees(model.jnt_range[:7])
    assert degrees[:, 1] == pytest.approx([180, 110, 170, 115, 180, 110, 180], abs=1e-4)
    assert degrees[:, 0] == pytest.approx([-180, -110, -170, -90, -180, -110, -180], abs=1e-4)
    assert np.degrees(model.numeric("arm_velocity").data) == pytest.approx(
        [200] * 5 + [230, 350], abs=1e-4
    )
    assert (
        model.numeric("arm_acceleration").data.shape == model.numeric("arm_jerk").data.shape == (7,)
    )


def test_frames_of_pads_tcp_and_camera_are_as_the_interfaces_say(robot):
    _, pose = robot
    state = pose(np.array([0.3, -0.4, 0.2, 0.5, -0.1, 0.6, 0.7]), fingers=0.01)
    tool = state.site("tool0").xmat.reshape(3, 3)
    tcp = state.site("tcp")
    assert np.abs(tcp.xmat.reshape(3, 3) - tool).max() < 1e-12
    left, right = state.site("pad_left"), state.site("pad_right")
    assert (left.xpos + right.xpos) / 2.0 == pytest.approx(tcp.xpos)
    assert np.linalg.norm(left.xpos - right.xpos) == pytest.approx(0.035 + 0.02)
    for pad, other in ((left, right), (right, left)):
        R = pad.xmat.reshape(3, 3)
        towards = (other.xpos - pad.xpos) / np.linalg.norm(other.xpos - pad.xpos)
        assert R[:, 2] == pytest.approx(towards, abs=1e-9)  # out of the face, into the fruit
        assert R[:, 0] == pytest.approx(tool[:, 2], abs=1e-9)  # the approach axis
    camera = state.site("camera").xmat.reshape(3, 3)
    assert camera[:, 2] == pytest.approx(tool[:, 2], abs=1e-9)
    assert camera[:, 0] == pytest.approx(tool[:, 1], abs=1e-9)
    optical = state.cam("camera").xmat.reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
    assert np.abs(optical - camera).max() < 1e-9


def test_at_the_observe_pose_nothing_touches_and_the_camera_looks_at_the_table(robot):
    _, pose = robot
    state = pose([-1.36, -0.316, -0.264, -0.234, 0.065, -1.294, 0.048], fingers=0.03)
    assert state.ncon == 0
    site = state.site("camera")
    assert site.xpos == pytest.approx([-0.040, -0.250, 0.480], abs=1e-3)
    assert site.xmat.reshape(3, 3)[:, 2] == pytest.approx([0.0, -0.341, -0.940], abs=1e-3)


DAMAGE = {
    "a joint that an actuator names": ('<joint name="joint_u"', '<joint name="elbow"', "'joint_u'"),
    "a camera": ('<site name="camera"', '<site name="eye"', "has no site named 'camera'"),
    "the middle of the fingers": ('<site name="tcp"', '<site name="middle"', "needs tcp, camera"),
    "what is broken off": ("</mujoco>", "", "XML"),
    "a limit of speed": (
        'name="arm_velocity"',
        'name="speeds"',
        "has no numeric named 'arm_velocity'",
    ),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_robot_file_that_lacks_something_is_refused_at_the_cell_files_line(tmp_path, what):
    shutil.copytree(
        ROBOT.parents[1], tmp_path / "trees", ignore=shutil.ignore_patterns("__pycache__")
    )
    sound, damaged, words = DAMAGE[what]
    files = [tmp_path / "trees" / "robots" / name for name in (ROBOT.name, "wsg32_body.xml")]
    robot = next(file for file in files if sound in file.read_text())
    text = robot.read_text()
    robot.write_text(text.replace(sound, damaged))
    with pytest.raises(CellFileError, match=rf"sim\.yaml:\d+:\d+.*{ROBOT.name}.*{words}"):
        load_cell(tmp_path / "trees" / "cells" / "sim.yaml", seed=0)


def test_a_pose_with_too_few_joints_is_refused_before_the_world_is_made(tmp_path):
    shutil.copytree(
        ROBOT.parents[1], tmp_path / "trees", ignore=shutil.ignore_patterns("__pycache__")
    )
    cell = tmp_path / "trees" / "cells" / "sim.yaml"
    workspace = cell.parent / "shared" / "workspace.yaml"
    workspace.write_text(
        workspace.read_text().replace("observe: -1.36 -0.316 ", "observe: -0.316 ")
    )
    with pytest.raises(CellFileError, match="the pose 'observe' has 6 joints, the arm has 7"):
        load_cell(cell, seed=0)


def denavit_hartenberg(q):
    """T_base_flange of a UR5e by the manufacturer's table, in its base frame: half a turn from the robot file's."""
    T = np.diag([-1.0, -1.0, 1.0, 1.0])
    d, a = (0.1625, 0, 0, 0.1333, 0.0997, 0.0996), (0, -0.425, -0.3922, 0, 0, 0)
    alpha = (np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0)
    for angle, offset, length, twist in zip(q, d, a, alpha, strict=True):
        c, s, ct, st = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
        T = T @ [
            [c, -s * ct, s * st, length * c],
            [s, c * ct, -c * st, length * s],
            [0, st, ct, offset],
            [0, 0, 0, 1],
        ]
    return T


def test_a_changed_hand_is_read_anew(tmp_path):
    shutil.copytree(ROBOT.parent, tmp_path / "robots")
    robot, hand = tmp_path / "robots" / ROBOT.name, tmp_path / "robots" / "wsg32_body.xml"
    before = RobotModel.load(robot).frame("tcp")
    hand.write_text(
        hand.read_text().replace('name="tcp" pos="0 0 0.168"', 'name="tcp" pos="0 0 0.200"')
    )
    os.utime(hand, ns=(hand.stat().st_atime_ns, hand.stat().st_mtime_ns + 1))
    assert RobotModel.load(robot).frame("tcp")[2, 3] - before[2, 3] == pytest.approx(0.032)


def test_the_ur5e_stands_where_the_manufacturers_table_puts_it():
    robot = RobotModel.load(ROBOT.with_name("ur5e_wsg32.xml"))
    for q in np.random.default_rng(0).uniform(-3, 3, (50, 6)):
        assert np.abs(robot.fk(q) - denavit_hartenberg(q)).max() < 1e-9


def test_both_arms_hold_the_hand_over_the_same_places():
    sia5f, ur5e = (read_cell_file(CELLS / f"{name}.yaml").workspace for name in ("sim", "sim_ur5e"))
    assert sia5f.poses.keys() == ur5e.poses.keys()
    robots = [RobotModel.load(ROBOT.with_name(f"{name}_wsg32.xml")) for name in ("sia5f", "ur5e")]
    for pose in sia5f.poses.keys() - {"home"}:
        T_base_tcp, other = robots[0].tcp(sia5f.poses[pose]), robots[1].tcp(ur5e.poses[pose])
        assert np.abs(T_base_tcp - other).max() < 1e-3, pose


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (
            '<replicate count="100000000" offset="0 0 1"><geom size=".1"/></replicate>',
            "takes more than 4 s",
        ),
        ('<geom type="hfield" hfield="h"/>', "needs more than 512 MB of memory"),
    ],
)
@pytest.mark.slow
def test_a_robot_that_exhausts_time_or_memory_ends_in_its_trial(
    tmp_path: Path, body: str, words: str
) -> None:
    path = tmp_path / "robot.xml"
    field = '<asset><hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/></asset>'
    path.write_text(
        f"<mujoco>{field if 'hfield' in body else ''}<worldbody>{body}</worldbody></mujoco>"
    )
    with pytest.raises(UnusableRobotFile, match=rf"robot\.xml: {words}"):
        read_limits(path)


def test_a_shipped_robot_is_read_without_a_trial_and_another_with_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[str] = []
    monkeypatch.setattr(robot_file, "trial", lambda _, path: tried.append(path) or "")
    robot_file.read_spec(ROBOT)
    assert tried == []
    for file in ROBOT.parent.glob("*.xml"):
        shutil.copy(file, tmp_path)
    robot_file.read_spec(tmp_path / ROBOT.name)
    assert tried == [str(tmp_path / ROBOT.name)]


def test_limits_are_those_of_the_joints_from_base_to_tool_in_any_order_of_the_actuators(
    tmp_path: Path,
) -> None:
    for file in ROBOT.parent.glob("*.xml"):
        shutil.copy(file, tmp_path)
    lines = ROBOT.read_text("utf-8").split("\n")
    first = next(k for k, line in enumerate(lines) if "<actuator>" in line) + 1
    last = next(k for k, line in enumerate(lines) if "</actuator>" in line)
    assert last - first >= 7
    path = tmp_path / ROBOT.name
    path.write_text("\n".join([*lines[:first], *lines[first:last][::-1], *lines[last:]]), "utf-8")
    given, turned = read_limits(ROBOT), read_limits(path)
    assert np.array_equal(turned.lower, given.lower)
    assert np.array_equal(turned.upper, given.upper)


def test_an_arm_whose_weight_nothing_compensates_is_refused_with_the_remedy(tmp_path: Path) -> None:
    for file in ROBOT.parent.glob("*.xml"):
        (tmp_path / file.name).write_text(
            file.read_text("utf-8").replace(' gravcomp="1"', ""), "utf-8"
        )
    world = f"world: {{include: 'sim.yaml#world', robot: {tmp_path / ROBOT.name}}}\n"
    cell = tmp_path / "cell.yaml"
    cell.write_text("include: sim.yaml\noptions: {include: 'sim.yaml#options'}\n" + world)
    with pytest.raises(
        CellFileError, match=r"drives give way by 0\.00\d+ rad to the .*gravcomp=\"1\""
    ) as caught:
        load_cell(cell, seed=1).close()
    assert caught.value.line == 3
