"""`pomona new cell --arm … --hand …`: files that pass the check, and a twin that picks."""

from __future__ import annotations

import json
from importlib.metadata import entry_points
from pathlib import Path

import mujoco
import numpy as np
import pytest

from pomona.executive.cli import main
from pomona.executive.values.installation import installed_trees
from pomona.tools.kit import cell_folder
from pomona.tools.kit.cell_folder import inlined

ROBOTS = installed_trees() / "robots"
SHIPPED = [
    ("sia5f", "wsg32"),
    ("ur5e", "2f85"),
    ("ur5e", "hand-e"),
    ("ur5e", "wsg32"),
    ("xarm6", "hand-e"),
]
FORCE = ("--set", "force=40 N")


def new(folder: Path, *words: str, name: str = "bench") -> int:
    return main(["new", "cell", name, "--into", str(folder), *words])


def test_the_combinations_are_those_of_the_shipped_robots():
    arms = {path.stem for path in ROBOTS.glob("*_*.xml")} - {
        "hand_e",
        "hand_e_body",
        "wsg32_body",
        "2f85_body",
    }
    assert arms == {f"{arm}_{hand}".replace("-", "_") for arm, hand in SHIPPED}


@pytest.mark.parametrize(("arm", "hand"), SHIPPED)
def test_every_file_passes_the_check_but_for_the_calibration_that_is_due(
    arm, hand, tmp_path, capsys
):
    assert new(tmp_path, "--arm", arm, "--hand", hand, "--camera", "d435i") == 0
    cell, simulated, twin = (
        str(tmp_path / "bench" / f"{name}.yaml") for name in ("cell", "simulated", "emulated")
    )
    assert main(["check", simulated, twin]) == 0
    assert main(["check", "pick_apple_plain", "--cell", twin, *FORCE]) == 0
    capsys.readouterr()
    assert main(["check", cell]) == 2
    found = capsys.readouterr().out
    assert "devices.camera.hand_eye" in found
    assert "1 error." in found
    (tmp_path / "bench" / "hand_eye.json").write_text(
        json.dumps({"T_mount_camera": np.eye(4).tolist()})
    )
    assert main(["check", "pick_apple_plain", "--cell", cell, *FORCE]) == 0


def test_another_spelling_of_a_device_is_the_same_device(tmp_path):
    for n, (arm, hand, camera) in enumerate(
        (("UR5e", "2F-85", "D435i"), ("ur-5e", "2f_85", "d-435i"))
    ):
        assert new(tmp_path / str(n), "--arm", arm, "--hand", hand, "--camera", camera) == 0
    assert new(tmp_path / "by name", "--arm", "ur5e", "--hand", "2f85", "--camera", "d435i") == 0
    for file in (tmp_path / "by name" / "bench").iterdir():
        assert {path.read_bytes() for path in tmp_path.glob(f"*/bench/{file.name}")} == {
            file.read_bytes()
        }
    assert new(tmp_path, "--arm", "xarm-6", "--hand", "HandE") == 0


def test_the_twin_has_what_is_written_into_the_real_cell(tmp_path, capsys):
    assert new(tmp_path, "--arm", "ur5e", "--hand", "hand-e") == 0
    real, twin = tmp_path / "bench" / "cell.yaml", str(tmp_path / "bench" / "emulated.yaml")
    real.write_text(
        real.read_text("utf-8").replace("finger_offset: 53 mm", "finger_offset: 900 mm"),
        encoding="utf-8",
    )
    assert main(["check", twin]) == 2
    assert "finger_offset" in capsys.readouterr().out


def test_an_arm_with_a_force_sensor_of_its_own_brings_it_into_each_file(tmp_path):
    assert new(tmp_path, "--arm", "ur5e", "--hand", "hand-e") == 0
    for name, driver in (
        ("cell", "universal-robots-force"),
        ("emulated", "cell.yaml#"),
        ("simulated", "sim-load"),
    ):
        text = (tmp_path / "bench" / f"{name}.yaml").read_text("utf-8")
        assert driver in text.partition("\n  load:\n")[2].splitlines()[0]
    assert "`least`, measured on your arm" in (tmp_path / "bench" / "README.md").read_text("utf-8")


@pytest.mark.parametrize(
    ("file", "option", "address", "device"),
    [
        ("cell.yaml", "{arm}", "192.168.1.40", "arm' is reached at 192.168.1.40:30004"),
        ("cell.yaml", "{gripper}", "/dev/ttyUSB0", "gripper' is reached at /dev/ttyUSB0"),
        ("emulated.yaml", "{camera}", "127.0.0.1:41999", "camera' is reached at 127.0.0.1:41999"),
    ],
)
def test_a_twin_whose_device_has_the_real_address_is_refused(
    file, option, address, device, tmp_path, capsys
):
    assert new(tmp_path, "--arm", "ur5e", "--hand", "hand-e") == 0
    text = (tmp_path / "bench" / file).read_text()
    word = "port" if "/dev" in address else "address"
    (tmp_path / "bench" / file).write_text(
        text.replace(f'{word}: "{option}"', f"{word}: {address}")
    )
    assert main(["check", str(tmp_path / "bench" / "emulated.yaml")]) == 2
    assert f"the device '{device}, where this world emulates none" in capsys.readouterr().out


def test_a_twin_names_the_place_of_a_wrong_value_of_its_simulated_cell(tmp_path, capsys):
    assert new(tmp_path, "--arm", "ur5e", "--hand", "hand-e") == 0
    path = tmp_path / "bench" / "simulated.yaml"
    path.write_text(path.read_text().replace("150 mm/s", "-150 mm/s").replace("50 N", "0 N"))
    assert main(["check", str(tmp_path / "bench" / "emulated.yaml")]) == 2
    said, lines = capsys.readouterr().out, path.read_text().splitlines()
    for option, value in (("speed_max", "-150 mm/s"), ("force_max", "0 N")):
        row, column = next(
            (n, line.index(value))
            for n, line in enumerate(lines, 1)
            if f"{option}: {value}" in line
        )
        assert f"{path}:{row}:{column + 1}: devices.gripper.{option}: it is {value}" in said


def test_a_cell_of_no_named_camera_has_one_and_a_line_says_so(tmp_path, capsys):
    assert new(tmp_path, "--arm", "ur5e", "--hand", "hand-e") == 0
    first, *_ = capsys.readouterr().err.splitlines()
    assert first == "camera: d435i, as none was named; without one: --camera none"
    twin = str(tmp_path / "bench" / "emulated.yaml")
    assert main(["check", "pick_apple_plain", "--cell", twin, *FORCE]) == 0


@pytest.mark.slow
def test_a_cell_without_a_camera_passes_the_check(tmp_path, capsys):
    assert new(tmp_path, "--arm", "xarm6", "--hand", "hand-e", "--camera", "none") == 0
    files = sorted(map(str, (tmp_path / "bench").glob("*.yaml")))
    assert len(files) == 3
    assert main(["check", *files]) == 0
    assert f"next: pomona check {tmp_path}/bench/emulated.yaml" in capsys.readouterr().err
    assert main(["doctor", "--cell", str(tmp_path / "bench" / "emulated.yaml")]) in (0, 1)
    assert "KeyError" not in "".join(capsys.readouterr())


def test_the_next_three_commands_and_the_calibrations_that_are_due_are_named(tmp_path, capsys):
    assert new(tmp_path, "--arm", "ur5e", "--hand", "hand-e", "--camera", "d435i") == 0
    twin = tmp_path / "bench" / "emulated.yaml"
    assert [line.strip() for line in capsys.readouterr().err.splitlines()] == [
        f'next: pomona check pick_apple_plain --cell {twin} --set force="40 N"',
        f'pomona run pick_apple_plain --cell {twin} --set force="40 N"',
        f"pomona doctor --cell {tmp_path}/bench/cell.yaml",
    ]
    page = (tmp_path / "bench" / "README.md").read_text("utf-8")
    for due in (
        "pomona calibrate hand-eye LOOKS",
        "poses.json",
        "intrinsics.yaml",
        "finger_offset",
        "`workspace`",
        "pomona doctor --cell cell.yaml",
    ):
        assert due in page


@pytest.mark.parametrize(("arm", "hand"), SHIPPED)
def test_the_composed_robot_is_the_shipped_one_in_one_file(arm, hand, tmp_path):
    shipped = ROBOTS / f"{arm}_{hand}.xml".replace("-", "_")
    alone = tmp_path / "robot.xml"
    alone.write_text(inlined(shipped.read_text("utf-8"), shipped.parent), encoding="utf-8")
    ours, theirs = (mujoco.MjModel.from_xml_path(str(path)) for path in (alone, shipped))
    assert (ours.nbody, ours.ngeom, ours.nu) == (theirs.nbody, theirs.ngeom, theirs.nu)
    for name in (
        "body_pos",
        "body_mass",
        "geom_size",
        "geom_pos",
        "jnt_range",
        "site_pos",
        "actuator_gainprm",
    ):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("--arm", "ur5", "--hand", "hand-e"),
            "--arm: no 'ur5' is known here (did you mean 'ur5e'?; any other arm: `pomona new arm ITS.urdf`",
        ),
        (
            ("--arm", "ur5e", "--hand", "ur5e"),
            "--hand: no 'ur5e' is known here (known: 2f85, hand-e, wsg32)",
        ),
        (("--arm", "ur5e", "--hand", "hand-e", "--camera", ""), "--camera: no '' is known here"),
        (
            ("--arm", "ur5e", "--hand", "hand-e", "--camera", "d455"),
            "--camera: no 'd455' is known here (did",
        ),
        (
            ("--arm", "xarm6", "--hand", "wsg32"),
            "no robot description of xarm6 with wsg32 is shipped: possible are --arm",
        ),
        (
            ("--arm", "ur5e"),
            "a cell of devices needs --arm and --hand: possible are --arm sia5f --hand wsg32;",
        ),
        (("--arm", ""), "a cell of devices needs --arm and --hand"),
        (("--camera", "d435i"), "a cell of devices needs --arm and --hand"),
    ],
)
def test_what_cannot_be_written_is_refused_in_one_line(words, said, tmp_path, capsys):
    assert new(tmp_path, *words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert "Nothing was written." in line
    assert not list(tmp_path.iterdir())


def test_an_arm_that_is_not_shipped_gets_the_way_to_its_own_description(
    tmp_path, capsys, monkeypatch
):
    for word, near in (
        ("ur10e", "did you mean 'ur5e'?"),
        ("UR10e", "ur5e"),
        ("fr3", "known: sia5f, ur5e, xarm6"),
    ):
        assert new(tmp_path, "--arm", word, "--hand", "hand-e") == 2
        said = capsys.readouterr().err
        assert near in said
        assert "any other arm: `pomona new arm ITS.urdf`" in said
    monkeypatch.setattr(
        cell_folder,
        "entry_points",
        lambda **of: [] if of.get("name") == "arm" else entry_points(**of),
    )
    assert (
        new(tmp_path, "--arm", "xarm6", "--hand", "wsg32") == 2
    )  # the executive alone makes no arm
    assert "new arm" not in capsys.readouterr().err


def test_a_folder_that_exists_and_a_wrong_name_are_refused(tmp_path, capsys):
    (tmp_path / "bench").mkdir()
    devices = ("--arm", "ur5e", "--hand", "hand-e")
    assert new(tmp_path, *devices) == 2
    assert new(tmp_path, *devices, name="../bench") == 2
    assert main(["new", "fruit", "plum", "--into", str(tmp_path), *devices]) == 2
    taken, name, kind = capsys.readouterr().err.splitlines()
    assert "bench is there already. Nothing was written." in taken
    assert "'../bench' is not a valid name" in name
    assert "--arm, --hand and --camera belong to `pomona new cell`, not to fruit" in kind
    assert [path.name for path in tmp_path.rglob("*")] == ["bench"]


@pytest.mark.slow
def test_the_twin_picks_an_apple(tmp_path, capsys):
    assert new(tmp_path, "--arm", "ur5e", "--hand", "hand-e", "--camera", "d435i") == 0
    twin = str(tmp_path / "bench" / "emulated.yaml")
    done = main(["run", "pick_apple_plain", "--cell", twin, *FORCE, "--seed", "3", "--no-record"])
    said = capsys.readouterr()
    assert done == 0
    assert "lifted: yes" in said.out + said.err
