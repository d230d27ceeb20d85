"""The robot model agrees with its file, for any arm, and refuses invalid ones."""

import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from pomona.skills.geometry import rot_x, rot_y, rot_z, transform
from pomona.skills.motion.robot import (
    BadJoints,
    BadRobotFile,
    NotAPose,
    RobotModel,
    inverse_kinematics,
)

SIA5F = Path(__file__).resolve().parents[4] / "trees" / "robots" / "sia5f_wsg32.xml"
SIX_AXIS = Path(__file__).parent / "six_axis.urdf"


def test_sia5f_stands_where_the_manufacturers_kinematics_put_it() -> None:
    robot = RobotModel.load(SIA5F)
    assert np.allclose(robot.fk(np.zeros(7))[:3, 3], [0.5, 0.0, 0.64], atol=1e-9)
    assert np.allclose(
        robot.fk(np.arange(1, 8) / 10.0)[:3, 3], [0.446461, 0.199077, 0.770157], atol=1e-6
    )
    assert np.allclose(robot.T_tool_tcp, transform(translation=[0.0, 0.0, 0.168]), atol=1e-12)
    assert robot.joint_names == tuple(f"joint_{letter}" for letter in "sleurbt")
    assert np.allclose(
        np.degrees(robot.lower), [-180, -110, -170, -90, -180, -110, -180], atol=1e-6
    )
    assert np.allclose(np.degrees(robot.velocity), [200, 200, 200, 200, 200, 230, 350], atol=1e-5)


def by_hand(q: np.ndarray) -> np.ndarray:
    """T_base_tool0 of the SIA5, from its table of joint origins and axes, written out."""
    turned = -np.pi / 2.0
    return (
        transform(rot_z(q[0]), [0.0, 0.0, 0.310])
        @ transform(rot_y(q[1]))
        @ transform(translation=[0.0, 0.0, 0.270])
        @ transform(rot_z(q[2]))
        @ transform(translation=[0.085, 0.0, 0.0])
        @ transform(rot_y(-q[3]))
        @ transform(translation=[0.270, 0.0, 0.060])
        @ transform(rot_x(-q[4]))
        @ transform(rot_y(-q[5]))
        @ transform(translation=[0.134, 0.0, 0.0])
        @ transform(rot_x(-q[6]))
        @ transform(rot_z(turned) @ rot_y(turned) @ rot_x(turned), [0.011, 0.0, 0.0])
    )


@given(arrays(np.float64, 7, elements=st.floats(-1.5, 1.5)))
def test_forward_kinematics_equals_the_product_of_joint_transforms(q: np.ndarray) -> None:
    assert np.allclose(RobotModel.load(SIA5F).fk(q), by_hand(q), atol=1e-9)


@pytest.mark.parametrize("path", [SIA5F, SIX_AXIS], ids=["sia5f", "six_axis"])
def test_forward_kinematics_agrees_with_mujoco(path: Path) -> None:
    robot = RobotModel.load(path)
    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.fusestatic = False
    model = spec.compile()
    world = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(50):
        q = rng.uniform(robot.lower, robot.upper)
        for name, value in zip(robot.joint_names, q, strict=True):
            world.joint(name).qpos[0] = value
        mujoco.mj_kinematics(model, world)
        frame = world.site("tcp") if path == SIA5F else world.body("tcp")
        T = robot.tcp(q)
        assert np.allclose(T[:3, 3], frame.xpos, atol=1e-9)
        assert np.allclose(T[:3, :3].ravel(), frame.xmat, atol=1e-9)


@pytest.mark.parametrize("path", [SIA5F, SIX_AXIS], ids=["sia5f", "six_axis"])
def test_jacobian_is_the_derivative_of_forward_kinematics(path: Path) -> None:
    robot = RobotModel.load(path)
    rng = np.random.default_rng(1)
    for _ in range(10):
        q, h = rng.uniform(robot.lower, robot.upper), 1e-6
        T, J = robot.tcp(q), robot.jacobian(q)
        for joint in range(robot.dof):
            step = np.eye(robot.dof)[joint] * h
            difference = (robot.tcp(q + step) - robot.tcp(q - step)) / (2.0 * h)
            spin = difference[:3, :3] @ T[:3, :3].T
            numeric = [*difference[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
            assert np.allclose(J[:, joint], numeric, atol=1e-8)


def test_manipulability_vanishes_with_the_arm_stretched() -> None:
    robot = RobotModel.load(SIX_AXIS)
    bent, stretched = (
        np.array([0.3, -1.0, 1.2, -0.4, 1.1, 0.2]),
        np.array([0.3, -1.0, 0.0, -0.4, 1.1, 0.2]),
    )
    assert robot.manipulability(bent) > 1e-2
    assert robot.manipulability(stretched) < 1e-9


def test_fingers_and_gripper_are_distinguished_from_the_arm() -> None:
    robot = RobotModel.load(SIA5F)
    groups = {body.name: body.group for body in robot.bodies}
    assert groups["link_t"] == "arm"
    assert groups["tool0"] == "gripper"
    assert {name for name, group in groups.items() if group == "fingers"} == {
        "finger_left", "finger_right", "pad_left", "pad_right",
    }  # fmt: skip
    assert (robot.width_min, robot.width_max) == pytest.approx((0.035, 0.103))
    left = next(body for body in robot.bodies if body.name == "pad_left")
    assert np.linalg.norm(left.slide) == pytest.approx(0.5)  # each finger goes half the way


def test_a_file_is_read_once_until_it_changes(tmp_path: Path) -> None:
    copy = tmp_path / "arm.urdf"
    copy.write_text(SIX_AXIS.read_text())
    first = RobotModel.load(copy)
    assert RobotModel.load(copy) is first
    copy.write_text(SIX_AXIS.read_text().replace("0.39225", "0.45"))
    assert not np.allclose(RobotModel.load(copy).fk(np.ones(6)), first.fk(np.ones(6)))


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('tool0"', 'flange_plate"', "no site or body named 'tool0'"),
        ("<site name=\"tool0\"", "<broken", "cannot compile"),
        ('name="arm_velocity" data="3.49', 'name="arm_velocity" data="-3.49', "arm_velocity"),
        ('class="solid" type="capsule" fromto="0 0 -0.10 0 0 0"', 'type="hfield"', "cannot compile"),
    ],
)  # fmt: skip
def test_bad_robot_files_are_refused_in_words(
    tmp_path: Path, old: str, new: str, complaint: str
) -> None:
    folder = shutil.copytree(SIA5F.parent, tmp_path / "robots")
    for part in folder.glob("*.xml"):
        part.write_text(part.read_text().replace(old, new))
    with pytest.raises(BadRobotFile, match=complaint):
        RobotModel.load(folder / SIA5F.name)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('velocity="3.15"', 'velocity="nan"', "'pan': velocity = 'nan' is no finite number"),
        ('velocity="3.15"', 'velocity="inf"', "'pan': velocity = 'inf' is no finite number"),
        ('velocity="3.15"', 'velocity="1e999"', "'pan': velocity = '1e999' is no finite number"),
        ('velocity="3.15"', 'velocity="fast"', "'pan': velocity = 'fast' is no finite number"),
        ('velocity="3.15"', 'velocity="-3.15"', "'pan': velocity = '-3.15' is not positive"),
        ('velocity="3.15"', 'velocity="0"', "'pan': velocity = '0' is not positive"),
        (' velocity="3.15"', "", "'pan' lacks the limit 'velocity'"),
        ('lower="-3.141592654"', 'lower="nan"', "'elbow'.* finite"),
        ('upper="3.141592654"', 'upper="inf"', "'elbow'.* finite"),
        ('lower="-3.141592654"', 'lower="4"', "'elbow' needs a range; 4 … 3.14159 is none"),
        ('lower="-3.141592654" ', "", "'elbow' lacks the limit 'lower'"),
        (
            '<limit lower="-3.141592654" upper="3.141592654" velocity="3.15" effort="150"/>',
            "",
            "'elbow' lacks the limit",
        ),
    ],
)
def test_a_urdf_with_an_impossible_limit_is_refused_with_file_and_joint(
    tmp_path: Path, old: str, new: str, complaint: str
) -> None:
    file = tmp_path / "arm.urdf"
    assert old in SIX_AXIS.read_text()
    file.write_text(SIX_AXIS.read_text().replace(old, new, 1))
    with pytest.raises(BadRobotFile, match=complaint) as refused:
        RobotModel.load(file)
    assert str(refused.value).startswith(str(file))


def test_a_robot_without_joints_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "post.xml"
    file.write_text(
        "<mujoco><worldbody><body name='tool0'><geom size='0.1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(BadRobotFile, match="no joint between the base and 'tool0'"):
        RobotModel.load(file)


def test_a_missing_joint_is_noticed_by_the_limits_that_name_it(tmp_path: Path) -> None:
    text = SIA5F.read_text()
    start = text.index('<joint name="joint_e"')
    file = shutil.copytree(SIA5F.parent, tmp_path / "robots") / SIA5F.name
    file.write_text(
        text.replace(text[start : text.index("/>", start) + 2], "").replace(
            '<position name="arm_e" class="arm" joint="joint_e" kp="5000" kv="104" forcerange="-300 300"/>',
            "",
        )
    )
    with pytest.raises(BadRobotFile, match="must hold 6 positive numbers"):
        RobotModel.load(file)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadRobotFile, match="no such file"):
        RobotModel.load(tmp_path / "nowhere.xml")


@pytest.mark.parametrize(
    "q",
    [
        np.zeros(6),
        np.zeros((7, 1)),
        np.full(7, np.nan),
        [0, 0, 0, 0, 0, 0, np.inf],
        ["a"] * 7,
        None,
    ],
)
def test_bad_joints_are_refused(q: object) -> None:
    robot = RobotModel.load(SIA5F)
    with pytest.raises(BadJoints):
        robot.fk(q)  # type: ignore[arg-type]
    with pytest.raises(BadJoints):
        robot.jacobian(q)  # type: ignore[arg-type]


def test_bad_joints_are_named() -> None:
    with pytest.raises(BadJoints, match="joint_u not finite"):
        RobotModel.load(SIA5F).tcp([0, 0, 0, np.nan, 0, 0, 0])


@pytest.mark.parametrize(
    "T", [np.zeros((4, 4)), np.full((4, 4), np.nan), np.eye(3), "pose", np.diag([1, 1, -1, 1])]
)
def test_bad_poses_are_refused(T: object) -> None:
    with pytest.raises(NotAPose):
        inverse_kinematics(RobotModel.load(SIA5F), T)  # type: ignore[arg-type]
