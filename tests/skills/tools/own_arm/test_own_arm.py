"""`pomona new arm FILE.urdf`: its cell passes the check, the hand stands where the shipped one does, and it picks."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from pomona.executive.cell.cell_file import read_cell_file
from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.values.installation import installed_trees
from pomona.skills.motion.collision import CollisionWorld, RobotShape
from pomona.skills.motion.robot import RobotModel
from pomona.tools.own_arm.arm_urdf import read_arm
from pomona.tools.own_arm.flange import choose_flange
from pomona.tools.own_arm.poses import ROOM, VIEW, reach, view

JOINTS = (  # of an arm as large as a UR5e: place in the link before it, axis, radius and end of its tube [m]
    ("pan", "0 0 0.16", "0 0 1", 0.06, (0.0, 0.0, -0.03)),
    ("lift", "0 0.13 0", "0 1 0", 0.05, (0.425, 0.0, 0.0)),
    ("elbow", "0.425 -0.12 0", "0 1 0", 0.045, (0.39, 0.0, 0.0)),
    ("bend", "0.39 0 0", "0 1 0", 0.04, (0.0, 0.11, 0.0)),
    ("turn", "0 0.12 0", "0 0 -1", 0.04, (0.0, 0.0, -0.09)),
    ("roll", "0 0 -0.1", "0 1 0", 0.035, (0.0, 0.08, 0.0)),
)
FLANGE = '<origin xyz="0 0.1 0" rpy="-1.5707963 0 0"/>'  # z along the last joint


def link(name: str, radius: float, end: tuple[float, float, float], mass: str = "2") -> str:
    pitch, length = np.arctan2(np.hypot(*end[:2]), end[2]), np.linalg.norm(end)
    middle = " ".join(f"{x / 2:g}" for x in end)
    turn = f"0 {pitch:g} {np.arctan2(end[1], end[0]):g}"
    weight = f'<inertial><mass value="{mass}"/><inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial>'
    shape = f'<geometry><cylinder radius="{radius}" length="{length:g}"/></geometry>'
    return (
        f'<link name="{name}">{weight if mass else ""}'
        f'<collision><origin xyz="{middle}" rpy="{turn}"/>{shape}</collision></link>'
    )


def joint(name: str, kind: str, parent: str, child: str, inside: str) -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def urdf(*, mass: str = "2", flange: str = "tool0", kind: str = "revolute", more: str = "") -> str:
    parts, parent = ['<robot name="bench"><link name="base_link"/>'], "base_link"
    for name, at, axis, radius, end in JOINTS:
        parts.append(link(f"{name}_link", radius, end, mass))
        limit = '<limit lower="-6.28" upper="6.28" velocity="3" effort="150"/>'
        inside = f'<origin xyz="{at}"/><axis xyz="{axis}"/>{limit}'
        parts.append(joint(name, kind, parent, f"{name}_link", inside))
        parent = f"{name}_link"
    parts.append(f'<link name="{flange}"/>{joint("end", "fixed", parent, flange, FLANGE)}')
    return "".join([*parts, more, "</robot>"])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("arms")
    (folder / "My-Arm.urdf").write_text(urdf())
    with contextlib.redirect_stderr(io.StringIO()) as said:
        assert main(["new", "arm", str(folder / "My-Arm.urdf"), "--into", str(folder)]) == 0
    return folder / "my_arm" / "cell.yaml", said.getvalue()


@pytest.fixture(scope="module")
def cell(made: tuple[Path, str]) -> Path:
    return made[0]


def test_it_prints_what_it_is_doing_before_it_takes_time(made):
    first, second, *following = made[1].splitlines()
    assert first.startswith("reading ")
    assert first.endswith("My-Arm.urdf")
    assert second.startswith("6 joints up to 'tool0'; trying where the hand wsg32 reaches")
    assert following[0].startswith("next: pomona check")


@pytest.mark.slow
def test_the_written_cell_passes_the_check_of_a_pick(cell, capsys):
    assert main(["check", "pick_apple", "--cell", str(cell)]) == 0
    assert "nothing is wrong" in capsys.readouterr().out


def test_the_hand_stands_where_that_of_the_shipped_arm_does(cell):
    written, sim = read_cell_file(cell), read_cell_file(installed_trees() / "cells" / "sim.yaml")
    arm, shipped = (RobotModel.load(of.section.world.values.robot) for of in (written, sim))
    assert set(written.workspace.poses) == set(sim.workspace.poses)
    for name, q in written.workspace.poses.items():
        T, wanted = arm.fk(q), shipped.fk(sim.workspace.poses[name])
        assert np.allclose(T[:3, 3], wanted[:3, 3], atol=1e-3), name
        assert name == "home" or np.allclose(T, wanted, atol=1e-3), (
            name
        )  # a rest pose may be turned


def test_the_poses_are_free_and_within_the_limits(cell):
    written = read_cell_file(cell)
    arm = RobotModel.load(written.section.world.values.robot)
    q = np.array(list(written.workspace.poses.values()))
    assert np.all((arm.lower <= q) & (q <= arm.upper))
    assert CollisionWorld.build(arm, written.workspace).free(q, arm.width_max).all()


def test_no_pose_is_at_a_limit_so_rounding_keeps_it_inside(cell):
    written = read_cell_file(cell)
    arm = RobotModel.load(written.section.world.values.robot)
    observe = written.workspace.poses["observe"]
    lower = arm.lower.copy()
    lower[1] = observe[1]  # the known posture touches this limit: another one is found
    tight = dataclasses.replace(arm, lower=lower)
    found = reach(tight, written.workspace, {"observe": [arm.fk(observe)]}).postures["observe"]
    assert np.all((lower + ROOM <= found) & (found <= arm.upper - ROOM))


def hits_itself(path: Path, q: np.ndarray, angle: float) -> bool:
    """Whether a ray of the camera within an angle of its axis [rad] meets a link before the hand."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[: len(q)] = q
    mujoco.mj_forward(model, data)
    eye, found = data.site("camera"), np.zeros(1, np.int32)
    links = {"base", *(f"{name}_link" for name, *_ in JOINTS[:-1])}
    for tilt in np.linspace(0.0, angle, 6):
        for turn in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
            ray = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
            ray = eye.xmat.reshape(3, 3) @ ray
            far = mujoco.mj_ray(
                model, data, eye.xpos, ray, None, 1, model.site("camera").bodyid[0], found
            )
            if far >= 0.0 and model.body(model.geom_bodyid[found[0]]).name in links:
                return True
    return False


def test_where_the_camera_observes_the_arm_stands_out_of_its_view(cell):
    written = read_cell_file(cell)
    path = written.section.world.values.robot
    arm = RobotModel.load(path)
    shape, world = RobotShape.of(arm), CollisionWorld.build(arm, written.workspace)
    drawn = np.random.default_rng(5).uniform(-np.pi, np.pi, (3000, arm.dof))
    free = drawn[world.free(drawn, arm.width_max)]
    hidden = [q for q in free if view(arm, shape, q) < 0.0][:6]
    assert len(hidden) == 6
    better = 0
    for q in hidden:
        pose = [arm.fk(q)]
        found = reach(arm, written.workspace, {"observe": pose}).postures["observe"]
        assert view(arm, shape, found) >= view(arm, shape, q) - 1e-6
        if view(arm, shape, found) >= VIEW:
            better += 1
            assert not hits_itself(path, found, VIEW)
    assert better > 0
    assert not hits_itself(path, written.workspace.poses["observe"], VIEW)


def test_a_joint_of_two_turns_stays_near_the_middle_of_its_range(cell):
    poses = read_cell_file(cell).workspace.poses
    assert np.abs(poses["observe"]).max() <= np.pi + 1e-3


def test_the_simulated_arm_has_the_masses_and_the_geometry_of_the_file(cell):
    model = mujoco.MjModel.from_xml_path(str(cell.parent / "robot.xml"))
    links = [f"{name}_link" for name, *_ in JOINTS]
    assert [float(model.body(name).mass[0]) for name in links] == pytest.approx([2.0] * 6)
    elbow = next(row for row in JOINTS if row[0] == "elbow")
    assert model.geom("shape_3_0").size[:2] == pytest.approx([elbow[3], 0.5 * elbow[4][0]])
    assert model.numeric("arm_velocity").data == pytest.approx([3.0] * 6)


def test_every_part_is_weightless_in_the_drives_so_the_arm_stays_at_home(cell):
    model = mujoco.MjModel.from_xml_path(str(cell.parent / "robot.xml"))
    data = mujoco.MjData(model)
    home = read_cell_file(cell).workspace.poses["home"]
    data.qpos[:6], data.ctrl[:6] = home, home
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert data.qpos[:6] == pytest.approx(home, abs=1e-3)


@pytest.mark.slow
def test_another_shipped_hand_is_bolted_on(tmp_path):
    (tmp_path / "arm.urdf").write_text(urdf())
    assert (
        main(
            ["new", "arm", str(tmp_path / "arm.urdf"), "--into", str(tmp_path), "--hand", "hand-e"]
        )
        == 0
    )
    assert main(["check", "pick_apple", "--cell", str(tmp_path / "arm" / "cell.yaml")]) == 0
    assert "force_max: 50 N" in (tmp_path / "arm" / "cell.yaml").read_text()


def test_a_second_time_nothing_is_overwritten(cell, capsys):
    before = cell.read_bytes()
    assert (
        main(["new", "arm", str(cell.parents[1] / "My-Arm.urdf"), "--into", str(cell.parents[1])])
        == 2
    )
    said = capsys.readouterr().err
    assert "there already. Nothing was written" in said
    assert "reading" not in said
    assert cell.read_bytes() == before


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<mujoco/>", "it has no element <robot>"),
        ("<robot", "cannot be read as XML: unclosed token: line 1, column 0"),
        (
            urdf().replace('velocity="3"', 'velocity="${v}"', 1),
            "<limit> has words of xacro: first `xacro FILE > arm.urdf`",
        ),
        (urdf().replace('upper="6.28"', 'upper="-9"', 1), "'pan' needs a range"),
        (
            urdf().replace("<collision>", "<visual>", 1).replace("</collision>", "</visual>", 1),
            "no collision geometry",
        ),
        (
            re.sub('mass value="[^"]*"', 'mass value="-2"', urdf(), count=1),
            "a link has the mass -2 kg: correct",
        ),
        (
            re.sub('mass value="[^"]*"', 'mass value="1e20"', urdf(), count=1),
            "a link has the mass 1e20 kg: correct",
        ),
        (urdf(kind="fixed"), "--flange LINK names its end"),
        (urdf().replace('name="pan" type="revolute"', 'name="pan" type="fixed"'), "5 joints lead"),
        (
            urdf().replace(
                'velocity="3" effort="150"/>', 'velocity="3" effort="150"/><mimic joint="pan"/>', 2
            ),
            "joints",
        ),
        (
            re.sub(
                '(name="elbow".*?)</joint>', r'\1<mimic joint="pan"/></joint>', urdf(), flags=re.S
            ),
            "among them: 'elbow' follows 'pan'",
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_with_the_reason_and_nothing_is_written(
    text, words, tmp_path, capsys
):
    (tmp_path / "arm.urdf").write_text(text)
    assert main(["new", "arm", str(tmp_path / "arm.urdf"), "--into", str(tmp_path)]) == 2
    assert words in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["arm.urdf"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["arm", "no.urdf"], "there is no such file"),
        (["arm", "arm.urdf", "--flange", "wrist"], "has no link 'wrist'"),
        (["arm", "arm.urdf", "--hand", "tentacle"], "no 'tentacle' is known"),
        (["arm", "arm.urdf", "--arm", "ur5e"], "belong to `pomona new cell`"),
        (["skill", "arm.urdf"], "not a valid name"),
        (["arm", "Reacher", "--flange", "tool0"], "belongs to `pomona new arm FILE.urdf`"),
    ],
)
def test_wrong_options_are_refused(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(urdf())
    assert main(["new", *words]) == 2
    assert said in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["arm.urdf"]


FINGERS = "".join(
    f'<link name="{side}"/>'
    + joint(
        side, "prismatic", "palm", side, '<limit lower="0" upper="0.04" velocity="1" effort="9"/>'
    )
    for side in ("left", "right")
)
PALM = '<link name="palm"/>' + joint("palm", "fixed", "{flange}", "palm", "") + FINGERS


@pytest.mark.parametrize(
    ("flange", "chosen"),
    [("tool0", "tool0"), ("panda_link8", "panda_link8"), ("plate", "roll_link")],
)
def test_the_hand_of_the_file_is_left_off_at_its_flange(flange, chosen, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(flange=flange, more=PALM.format(flange=flange)))
    assert choose_flange(ElementTree.parse(path).getroot(), None) == chosen
    arm = read_arm(path)
    assert arm.dof == 6
    assert any("left, right" in sentence for sentence in arm.assumed)


def test_a_flange_whose_x_axis_leads_on_is_turned(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(flange="ee_link").replace("-1.5707963 0 0", "0 0 1.5707963"))
    arm = read_arm(path)
    assert arm.T_link_hand[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert any("the x axis of 'ee_link'" in sentence for sentence in arm.assumed)


def test_soft_limits_are_taken_and_the_page_names_their_joints(tmp_path):
    path = tmp_path / "arm.urdf"
    soft = '<safety_controller soft_lower_limit="-3" soft_upper_limit="2.5" k_position="100" k_velocity="40"/>'
    plain, hard = urdf(), '<limit lower="-6.28" upper="6.28" velocity="3" effort="150"/>'
    path.write_text(plain.replace(hard, hard + soft, 1))
    arm = read_arm(path)
    assert arm.description.lower[:2] == pytest.approx([-3.0, -6.28])
    assert arm.description.upper[:2] == pytest.approx([2.5, 6.28])
    assert any(sentence.endswith("k_velocity are not used: pan.") for sentence in arm.assumed)


def test_links_without_a_mass_get_one_and_the_page_names_them(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(mass=""))
    arm = read_arm(path)
    assert all(0.1 <= body.mass < 20.0 for body in arm.masses)
    assert sum("No mass is stated of" in sentence for sentence in arm.assumed) == 6


@pytest.mark.slow
def test_a_joint_without_limits_turns_once_to_each_side(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(kind="continuous"))
    assert read_arm(path).description.endless.all()
    assert main(["new", "arm", str(path), "--into", str(tmp_path)]) == 0
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm" / "robot.xml"))
    assert model.joint("roll").range == pytest.approx([-2 * np.pi, 2 * np.pi])


@pytest.mark.slow
def test_an_arm_that_is_too_short_is_refused(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf().replace("0.425 -0.12 0", "0.1 -0.12 0").replace("0.39 0 0", "0.1 0 0"))
    with pytest.raises(UsageError, match="reaches neither the pose home nor observe"):
        main_raising(path, tmp_path)


def main_raising(path: Path, into: Path) -> None:
    from argparse import Namespace

    from pomona.tools.own_arm.command import begin_arm

    begin_arm(path, into, Namespace(arm=None, hand=None, camera=None, flange=None))


@pytest.mark.slow
def test_an_apple_is_picked(cell, tmp_path):
    record = tmp_path / "record"
    words = ["run", "pick_apple", "--cell", str(cell), "--seed", "3", "--record", str(record)]
    assert main(words) == 0
    summary = json.loads(next(record.rglob("summary.json")).read_text())
    assert summary["truth"]["lifted"] is True
