"""URDF as other tools write it: paths of meshes, joints that follow others, and links of which nothing is known."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pomona.executive.values.installation import load_mujoco
from pomona.skills.motion.robot import BadRobotFile, RobotModel

LIMIT = '<limit lower="-2" upper="2" velocity="2" effort="9"/>'
BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'


def link(name: str, content: str = BOX) -> str:
    return f'<link name="{name}">{content}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", content: str = LIMIT) -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>{content}</joint>'


def arm(content: str = BOX, kind: str = "revolute", of_joint: str = LIMIT) -> str:
    """An arm of three joints: the content is of its second link, kind and limits are of its last joint."""
    links = [link("base"), link("upper"), link("lower", content), link("hand"), link("tool0", "")]
    joints = [
        joint("a", "base", "upper"),
        joint("b", "upper", "lower"),
        joint("c", "lower", "hand", kind, of_joint),
    ]
    fixed = joint("flange", "hand", "tool0", "fixed", "")
    return f'<robot name="arm">{"".join([*links, *joints, fixed])}</robot>'


def mesh(name: str) -> str:
    return f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package of ROS with a folder of meshes and an empty one of descriptions."""
    for part in ("meshes", "urdf"):
        (tmp_path / "ros" / "my_arm" / part).mkdir(parents=True)
    trimesh.creation.box((0.05, 0.06, 0.2)).export(
        tmp_path / "ros" / "my_arm" / "meshes" / "l3.stl"
    )
    return tmp_path / "ros" / "my_arm"


def load(path: Path, text: str) -> RobotModel:
    path.write_text(text, "utf-8")
    return RobotModel.load(path)


@pytest.mark.parametrize(
    "name", ["package://my_arm/meshes/l3.stl", "../meshes/l3.stl", "file://{package}/meshes/l3.stl"]
)
def test_a_mesh_is_found_as_ros_finds_it(package: Path, name: str) -> None:
    robot = load(package / "urdf" / "arm.urdf", arm(mesh(name.format(package=package))))
    (shape,) = (geom for geom in robot.geoms if geom.kind == "mesh")
    assert np.sort(np.ptp(shape.vertices, axis=0)) == pytest.approx([0.05, 0.06, 0.2], abs=1e-6)


@pytest.mark.parametrize(
    ("variable", "below"), [("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")]
)
def test_a_package_elsewhere_is_found_by_the_environment(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, below: str
) -> None:
    away = tmp_path / "ws" / below / "my_arm"
    away.parent.mkdir(parents=True)
    package.rename(away)
    text = arm(mesh("package://my_arm/meshes/l3.stl"))
    with pytest.raises(
        BadRobotFile,
        match=r"'package://my_arm/meshes/l3\.stl' is not found \(looked in .*ROS_PACKAGE_PATH",
    ):
        load(tmp_path / "arm.urdf", text)
    monkeypatch.setenv(variable, os.pathsep.join(["/nowhere", str(tmp_path / "ws")]))
    assert load(tmp_path / "again.urdf", text).dof == 3


def test_a_mesh_in_a_format_that_is_not_read_is_refused_with_the_remedy(package: Path) -> None:
    (package / "meshes" / "other.dae").write_text("<COLLADA/>")
    with pytest.raises(
        BadRobotFile, match=r"is a \.dae file, and \.stl, \.obj, \.msh are read: convert it"
    ):
        load(package / "urdf" / "arm.urdf", arm(mesh("package://my_arm/meshes/other.dae")))


def test_the_same_mesh_beside_it_in_a_format_that_is_read_stands_for_a_drawn_one(
    package: Path,
) -> None:
    (package / "meshes" / "l3.dae").write_text("<COLLADA/>")
    drawn = load(package / "urdf" / "drawn.urdf", arm(mesh("package://my_arm/meshes/l3.dae")))
    plain = load(package / "urdf" / "plain.urdf", arm(mesh("package://my_arm/meshes/l3.stl")))
    assert [geom.kind for geom in drawn.geoms] == [geom.kind for geom in plain.geoms]
    assert np.array_equal(drawn.geoms[-1].vertices, plain.geoms[-1].vertices)


def test_what_is_only_drawn_is_not_looked_for_but_a_link_without_collision_geometry_is_refused(
    tmp_path: Path,
) -> None:
    drawn = '<visual><geometry><mesh filename="package://none/l3.dae"/></geometry></visual>'
    assert load(tmp_path / "both.urdf", arm(BOX + drawn)).dof == 3
    assert load(tmp_path / "frame.urdf", arm("")).dof == 3
    with pytest.raises(
        BadRobotFile,
        match="the link 'lower' has visual geometry and no collision geometry: copy its",
    ):
        load(tmp_path / "drawn.urdf", arm(drawn))


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
def test_a_joint_that_follows_another_is_refused_by_its_name(tmp_path: Path, kind: str) -> None:
    mimic = LIMIT + '<mimic joint="b" multiplier="-1"/>'
    with pytest.raises(
        BadRobotFile,
        match="the joint 'c' follows 'b'; the joints of an arm must move independently",
    ):
        load(tmp_path / "arm.urdf", arm(kind=kind, of_joint=mimic))


def test_a_joint_of_an_mjcf_that_follows_another_is_refused(tmp_path: Path) -> None:
    text = """<mujoco><worldbody><body name="a"><joint name="first" range="-2 2"/><geom size="0.1"/>
      <body name="tool0" pos="0 0 1"><joint name="second" range="-2 2"/><geom size="0.1"/></body></body></worldbody>
      <equality><joint joint1="second" joint2="first"/></equality><compiler angle="radian"/></mujoco>"""
    with pytest.raises(BadRobotFile, match="the joint 'second' follows 'first'"):
        load(tmp_path / "arm.xml", text)


@pytest.mark.parametrize(
    ("kind", "limit", "complaint"),
    [
        ("planar", LIMIT, "the joint 'c_T[XY]' is part of a planar one"),
        ("prismatic", "", "'c' slides and needs a range"),
        (
            "revolute",
            LIMIT.replace("-2", "-180").replace('"2" v', '"180" v'),
            "'c' has a range up to 180 rad: is it in degrees",
        ),
        (
            "revolute",
            LIMIT.replace('velocity="2"', 'velocity="180"'),
            "'c': velocity = '180' .* is it in degrees",
        ),
        (
            "prismatic",
            LIMIT.replace('"2" v', '"50" v'),
            "'c' has a range up to 50 m: is it in millimetres",
        ),
        (
            "prismatic",
            LIMIT.replace('velocity="2"', 'velocity="180"'),
            "'180' is more than 50 m/s: is it in millimetres",
        ),
    ],
)
def test_a_joint_that_no_plan_could_use_is_refused(
    tmp_path: Path, kind: str, limit: str, complaint: str
) -> None:
    with pytest.raises(BadRobotFile, match=complaint):
        load(tmp_path / "arm.urdf", arm(kind=kind, of_joint=limit))


def softly(lower: str, upper: str) -> str:
    soft = f'soft_lower_limit="{lower}" soft_upper_limit="{upper}" k_position="100" k_velocity="40"'
    return f"{LIMIT}<safety_controller {soft}/>"


def test_a_range_ends_where_the_safety_controller_stops_the_joint(tmp_path: Path) -> None:
    robot = load(tmp_path / "arm.urdf", arm(of_joint=softly("-1.5", "9")))
    assert (robot.lower[-1], robot.upper[-1]) == (-1.5, 2.0)
    partly = load(
        tmp_path / "partly.urdf", arm(of_joint=LIMIT + '<safety_controller k_velocity="40"/>')
    )
    assert (partly.lower[-1], partly.upper[-1]) == (-2.0, 2.0)


@pytest.mark.parametrize(
    ("lower", "upper", "complaint"),
    [
        ("1", "-1", "the joint 'c' needs a range; 1 … -1 is none"),
        ("one", "1", "the joint 'c': limit 'lower': could not convert string to float: 'one'"),
        ("-1", "nan", '<safety_controller soft_upper_limit="nan"> is not finite'),
    ],
)
def test_soft_limits_that_are_none_are_refused(
    tmp_path: Path, lower: str, upper: str, complaint: str
) -> None:
    with pytest.raises(BadRobotFile, match=re.escape(complaint)):
        load(tmp_path / "arm.urdf", arm(of_joint=softly(lower, upper)))


def test_two_joints_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadRobotFile, match="has two joints with the name 'b'"):
        load(tmp_path / "arm.urdf", arm().replace('<joint name="c"', '<joint name="b"'))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "</robot>",
            '<xacro:include filename="hand.xacro"/></robot>',
            "<include> has words of xacro",
        ),
        ("</robot>", '<xacro:ur_robot name="a"/></robot>', "<ur_robot> has words of xacro"),
        ('upper="2"', 'upper="${pi}"', "<limit> has words of xacro"),
        (
            'name="arm"',
            'name="$(arg name)"',
            "<robot> has words of xacro: first `xacro FILE > arm.urdf`",
        ),
        ("0 0 0.3", "0 0 300", '<origin xyz="0 0 300"> is 10 m off or more: is it in millimetres?'),
        ("0 0 0.3", "-0.01 12.5 0", "is it in millimetres?"),
        (
            '0 0 0.3"',
            '0 0 0.3" rpy="0 90 -3.1"',
            '<origin rpy="0 90 -3.1"> is 10 rad or more: is it in degrees?',
        ),
    ],
)
def test_a_file_before_xacro_or_in_millimetres_is_refused(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    text = arm().replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    load(tmp_path / "whole.urdf", text.replace("0 0 0.3", "-0.0123 18.5e-3 9.9"))
    with pytest.raises(BadRobotFile, match=re.escape(words)):
        load(tmp_path / "arm.urdf", text.replace(old, new, 1))


def test_a_namespace_hides_no_limit(tmp_path: Path) -> None:
    text = arm().replace("<robot ", '<robot xmlns="http://www.ros.org" ')
    assert np.array_equal(
        load(tmp_path / "named.urdf", text).velocity, load(tmp_path / "arm.urdf", arm()).velocity
    )
    with pytest.raises(BadRobotFile, match="is it in millimetres"):
        load(tmp_path / "far.urdf", text.replace("0 0 0.3", "0 0 300", 1))


def test_a_link_that_no_joint_holds_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadRobotFile, match="has several roots: base, tray; every link but one"):
        load(tmp_path / "arm.urdf", arm().replace("</robot>", link("tray") + "</robot>"))


def test_a_continuous_joint_has_no_range(tmp_path: Path) -> None:
    robot = load(
        tmp_path / "arm.urdf", arm(kind="continuous", of_joint='<limit effort="9" velocity="2"/>')
    )
    assert robot.endless.tolist() == [False, False, True]
    assert (robot.lower[2], robot.upper[2]) == pytest.approx((-32 * np.pi, 32 * np.pi))


def test_jaws_that_close_to_nothing_have_an_opening(tmp_path: Path) -> None:
    """Fingers that meet at zero have no direction there; they had an opening of NaN."""
    finger = """<body name="{name}"><joint name="{name}" type="slide" axis="0 {axis} 0" range="0 0.04"/>
      <geom type="box" size="0.01 0.005 0.02" pos="0 {y} 0"/><site name="pad_{name}"/></body>"""
    fingers = finger.format(name="left", axis=1, y=0.005) + finger.format(
        name="right", axis=-1, y=-0.005
    )
    text = f"""<mujoco><compiler angle="radian"/><worldbody><body name="arm"><joint name="turn" range="-2 2"/>
      <geom size="0.05"/><site name="tool0" pos="0 0 0.1"/><body name="palm" pos="0 0 0.2">{fingers}</body></body>
      </worldbody></mujoco>"""
    robot = load(tmp_path / "arm.xml", text)
    assert (robot.width_min, robot.width_max) == pytest.approx((0.0, 0.08))
    assert sorted(
        float(np.linalg.norm(body.slide)) for body in robot.bodies if body.group == "fingers"
    ) == pytest.approx([0.5, 0.5])


@pytest.mark.parametrize("number", ["nan", "-inf", "Infinity"])
def test_a_number_that_is_not_finite_is_named(tmp_path: Path, number: str) -> None:
    inertial = f'<inertial><mass value="{number}"/></inertial>'
    with pytest.raises(
        BadRobotFile, match=f'<mass value="{number}"> is not finite: correct or remove it'
    ):
        load(tmp_path / "arm.urdf", arm(BOX + inertial))


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ('<origin xyz="0,0,0.17"/>', 'xyz="0,0,0.17"> has a comma: use 0.5 and spaces in between'),
        ('<axis xyz="0 0.0 0"/>', 'xyz="0 0.0 0"> has no direction: write 0 0 1 for z'),
    ],
)
def test_a_vector_with_commas_or_without_direction_is_named_with_the_remedy(
    tmp_path: Path, part: str, words: str
) -> None:
    with pytest.raises(BadRobotFile, match=re.escape(words)):
        load(tmp_path / "arm.urdf", arm().replace("</joint>", f"{part}</joint>", 1))


def test_a_file_that_mujoco_refuses_is_refused_in_one_line_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    tensor = '<inertia ixx="-1" iyy="-1" izz="-1" ixy="0" ixz="0" iyz="0"/>'
    with pytest.raises(BadRobotFile, match="MuJoCo cannot compile it") as error:
        load(tmp_path / "arm.urdf", arm(BOX + f'<inertial><mass value="1"/>{tensor}</inertial>'))
    assert "\n" not in str(error.value)
    load_mujoco().MjSpec.from_string(
        '<mujoco><worldbody><geom size="nan"/></worldbody></mujoco>'
    )  # it warns
    assert [path.name for path in tmp_path.iterdir()] == ["arm.urdf"]
    assert "WARNING" not in "".join(capfd.readouterr())


def test_a_urdf_that_is_no_well_formed_xml_is_refused_though_mujoco_reads_it(
    tmp_path: Path,
) -> None:
    broken = arm().replace("</robot>", "</robot>\n\0")
    with pytest.raises(BadRobotFile, match=r"cannot be read as XML: .*line 2"):
        load(tmp_path / "arm.urdf", broken)


def test_an_inertia_that_no_body_has_is_balanced(package: Path) -> None:
    moments = 'ixx="0.01" iyy="0.01" izz="0.03" ixy="0" ixz="0" iyz="0"'
    rounded = f'<inertial><mass value="2"/><inertia {moments}/></inertial>'
    assert load(package / "urdf" / "arm.urdf", arm(BOX + rounded)).dof == 3
