"""A cell file is judged before anything is connected: every mistake at once, with its place and a way out."""

import json
from pathlib import Path

import jsonschema
import pytest
import yaml
from hypothesis import given, settings, strategies as st

from pomona.drivers.errors import CellFileError
from pomona.drivers.interfaces import Arm, ArmLimits, Camera, FruitKinds, Gripper, Workspace
from pomona.executive.cell.cell_file import judge_cell_file, outline_cell, read_cell_file
from pomona.executive.cell.connect import CELL_FILES
from pomona.executive.cell.registration import installed_drivers
from pomona.executive.values.findings import Findings
from pomona.executive.values.sections import declared

CELLS = Path(__file__).resolve().parents[3] / "trees" / "cells"
SIM = (CELLS / "sim.yaml").read_text()


@pytest.fixture
def judge():
    def judged(text, overrides=None):
        path = CELLS / "judged.yaml"  # beside the files that shipped cells name; never written
        findings = Findings()
        judge_cell_file(path, findings, overrides, {str(path): text})
        return [found for found in findings.sorted() if found.code not in ("declared", "unseen")]

    return judged


@pytest.mark.parametrize("name", ["sim", "emulated"])
def test_nothing_is_wrong_with_a_shipped_cell(name):
    file = read_cell_file(CELLS / f"{name}.yaml")
    assert file.name == name
    assert {Arm, Gripper, Camera, Workspace} <= set(file.interfaces())


def test_the_shipped_laboratory_lacks_its_calibrations_alone():
    with pytest.raises(CellFileError) as error:
        read_cell_file(CELLS / "lab.yaml")
    assert [found.code for found in error.value.findings] == ["file"] * 3
    assert all("pomona calibrate" in found.hint for found in error.value.findings)


def test_the_three_cells_share_one_workspace():
    texts = [(CELLS / f"{name}.yaml").read_text() for name in ("sim", "emulated", "lab")]
    assert all("workspace: {include: shared/workspace.yaml}" in text for text in texts)
    file = read_cell_file(CELLS / "sim.yaml")
    assert list(file.files) == ["sim.yaml", "shared/workspace.yaml", "shared/pads.yaml"]
    assert file.workspace is not None
    assert "crate_6" in file.workspace.poses


def test_known_values_of_a_cell_before_it_is_connected():
    file = read_cell_file(CELLS / "sim.yaml", {"fruit": "lemon"})
    assert file.known(FruitKinds) == FruitKinds(("lemon",))
    assert file.known(ArmLimits).lower.shape == (7,)
    assert file.known(Workspace).table_z == pytest.approx(-0.12)
    assert file.known(str) is None


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("watchdog: 100 ms", "watchdog: 100", "lacks a unit: a time is given in s, ms"),
        ("table_z: -120 mm", "table_z: -120", "lacks a unit"),
        ("table_z: -120 mm", "table_z: -120 kg", "'kg' is no unit of length"),
        ("disparity_noise:", "disparity_nose:", "did you mean 'disparity_noise'?"),
        ("fx: 610.6 px", "fx: 0 px", "must be at least 1 px"),
        ("size: [640, 480] ", "size: [-640, 480] ", "between 1 and"),
        ("size: [640, 480] ", "size: [6400, 480] ", "draws at most 1280 x 960"),
        ("cx: 317.7 px", "cx: 3177 px", "outside an image of 640 pixels"),
        ("friction: auto ", "friction: -1 ", "must be between 0.01 and 5"),
        ("mass: 85 g", "mass: -85 g", "must be between 1 g and 5 kg"),
        ("driver: sim-arm", "driver: sim-amr", "did you mean 'sim-arm'?"),
        ("model: ../fruits/lemon", "model: ../fruits/melon", "does not exist"),
        ("start: observe", "start: oberve", "did you mean 'observe'?"),
        ("place: 3 ", "place: 77 ", "it cannot be '77'"),
        ("kind: simulated", "kind: [simulated]", "not a list"),
        ("rate: 30 Hz", "rate: {Hz: 30}", "not a mapping"),
        (
            "{include: shared/workspace.yaml}",
            "{include: shared/workspace.yaml, poses: {home: 0 0 0 0 0 0 0}}",
            "workspace.poses.home must be a list of numbers with a unit of angle",
        ),
        ("include: shared/workspace.yaml", "include: shared/workspcae.yaml", "cannot be read"),
        ("include: shared/workspace.yaml", "include: judged.yaml", "includes itself"),
    ],
)
def test_a_mistake_is_found_at_its_place_before_anything_is_connected(judge, old, new, says):
    assert old in SIM
    text = SIM.replace(old, new, 1)
    found = judge(text)
    assert found
    assert any(says in f.message + f.hint for f in found), [f.message for f in found]
    lines = SIM.splitlines()
    changed = next(
        i for i, (a, b) in enumerate(zip(lines, text.splitlines(), strict=True), 1) if a != b
    )
    assert changed in [f.line for f in found]
    assert all(f.line > 0 and f.column > 0 for f in found)


def test_every_mistake_is_found_in_one_pass(judge):
    text = SIM.replace("kind: simulated", "kind: simulatd").replace(
        "watchdog: 100 ms", "watchdog: 100"
    )
    text = text.replace("range: 8 N", "range: 8 kg").replace("nearest: 180 mm", "nearst: 180 mm")
    found = judge(text)
    assert [f.code for f in found] == ["value", "value", "value", "unknown-key"]
    assert len({f.line for f in found}) == 4


def test_of_a_file_that_cannot_be_included_nothing_else_is_missed(judge):
    found = judge(SIM.replace("include: shared/workspace.yaml", "include: shared/workspcae.yaml"))
    assert [f.code for f in found] == ["file"]


def test_a_mistake_in_an_included_file_is_found_there(tmp_path):
    (tmp_path / "around.yaml").write_text("lower: 0 0 0 m\nupper: 1 1 1\n")
    path = tmp_path / "cell.yaml"
    path.write_text("kind: mock\nworkspace: {include: around.yaml}\ndevices: {}\n")
    with pytest.raises(CellFileError) as error:
        read_cell_file(path)
    assert (error.value.path, error.value.line, error.value.column) == (
        tmp_path / "around.yaml",
        2,
        8,
    )


def test_keys_beside_an_include_override_it(tmp_path):
    (tmp_path / "around.yaml").write_text("table_z: 0 m\nlower: 0 0 0 m\nupper: 1 1 1 m\n")
    path = tmp_path / "cell.yaml"
    path.write_text("kind: mock\nworkspace: {include: around.yaml, upper: 2 2 2 m}\ndevices: {}\n")
    workspace = read_cell_file(path).workspace
    assert workspace is not None
    assert workspace.upper.tolist() == [2.0, 2.0, 2.0]
    assert workspace.table_z == 0.0


def test_a_block_of_another_file_is_included_by_its_keys(tmp_path):
    (tmp_path / "all.yaml").write_text(
        "workspace: {table_z: 0 m, lower: 0 0 0 m, upper: 1 1 1 m}\n"
    )
    path = tmp_path / "cell.yaml"
    path.write_text(
        "kind: mock\nworkspace: {include: all.yaml#workspace, upper: 2 2 2 m}\ndevices: {}\n"
    )
    workspace = read_cell_file(path).workspace
    assert workspace is not None
    assert (workspace.upper.tolist(), workspace.lower.tolist()) == (
        [2.0, 2.0, 2.0],
        [0.0, 0.0, 0.0],
    )


@pytest.mark.parametrize("block", ["#workspaec", "#workspace/lower", "#workspace/lower/x"])
def test_a_block_that_is_not_there_is_found_where_it_is_named(tmp_path, block):
    (tmp_path / "all.yaml").write_text("workspace: {lower: 0 0 0 m, upper: 1 1 1 m}\n")
    path = tmp_path / "cell.yaml"
    path.write_text(f"kind: mock\nworkspace: {{include: all.yaml{block}}}\ndevices: {{}}\n")
    with pytest.raises(CellFileError) as error:
        read_cell_file(path)
    found = next(found for found in error.value.findings if found.code == "include")
    assert (found.path, found.line, found.column) == (str(path), 2, 22)
    assert "has no block" in found.message


def test_a_bad_value_of_an_option_is_found_where_it_is_given(judge):
    assert judge(SIM, {"place": "77"})[0].path == "--set place=77"
    found = judge(SIM.replace("place: 3 ", "place: 77 "))
    assert SIM.splitlines()[found[0].line - 1].lstrip().startswith("place: 3")


def test_an_unknown_override_names_the_options(judge):
    assert judge(SIM, {"plaec": "5"})[0].hint == "did you mean 'place'?"
    assert (
        "no option 'x'"
        in judge("kind: mock\ndevices: {a: {driver: mock-arm, start: '{x}'}}\n")[0].message
    )


def test_options_have_their_defaults_and_the_values_of_the_file():
    options = {
        option.name: option for option in outline_cell(CELLS / "sim.yaml", Findings()).options
    }
    assert options["place"].default == "3"
    assert options["place"].help == "where it lies: 1 … 5"


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        ("0 0 9 rad", "the pose 'observe' has 3 joints, the arm has 7"),
        (
            "0 0 0 9 0 0 0 rad",
            "the pose 'observe' has joint 4 at 515.7°, its limits are -90.0° and 115.0°",
        ),
    ],
)
def test_a_pose_out_of_the_arms_reach_is_found_without_the_arm(pose, said):
    text = SIM.replace(
        "{include: shared/workspace.yaml}",
        f"{{include: shared/workspace.yaml, poses: {{observe: {pose}}}}}",
    )
    path = CELLS / "judged.yaml"
    with pytest.raises(CellFileError, match=said):
        read_cell_file(path, texts={str(path): text})


def test_a_missing_file_and_a_folder_and_noise_are_clear_errors(tmp_path):
    (tmp_path / "noise").write_bytes(b"\xff\xfe\x00\x01")
    for path in (tmp_path / "none.yaml", tmp_path, tmp_path / "noise"):
        with pytest.raises(CellFileError, match=r"cannot be read|no text file"):
            read_cell_file(path)


@pytest.mark.parametrize(
    "text", ["a: [1\n", "a: b: c\n", "\t- x\n", "a: 'open\n", "- 1\n", "", "&x *x", "42"]
)
def test_broken_yaml_is_found_with_a_place(judge, text):
    assert all(found.line > 0 for found in judge(text))
    assert judge(text)


def test_deep_yaml_has_a_place(judge):
    (found,) = judge("kind: " + "[" * 200 + "]" * 200)
    assert (found.code, found.line) == ("too-deep", 1)


def test_schema_and_reader_accept_the_same():
    schema = CELL_FILES.schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    accepts = jsonschema.Draft202012Validator(schema).validate
    for shipped in CELLS.glob("*.yaml"):
        accepts(yaml.safe_load(shipped.read_text()))
    content = yaml.safe_load(SIM)
    content["devices"]["gripper"]["watchdog"] = "100 mm"
    with pytest.raises(jsonschema.ValidationError):
        accepts(content)
    with pytest.raises(jsonschema.ValidationError, match="'kind' is a required property"):
        accepts({"name": "here"})
    assert json.dumps(schema)


def test_every_driver_declares_its_options_with_a_help_line():
    for name, point in installed_drivers().items():
        for option in declared(point.load().options):
            assert option.help, f"{name}.{option.name}"


WORDS = st.sampled_from(
    ["kind", "devices", "world", "workspace", "options", "driver", "sim-arm", "mujoco", "include", "poses", "{place}",
     "place", "lower", "3", "-1 mm", "1 2 3 m", "mock", "mock-arm", "~", "é", "[", "]", "{", "}", "'", ":", "#", "&a"]
)  # fmt: skip
TREES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=8) | WORDS,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(WORDS | st.text(max_size=6), inner, max_size=5)
    ),
    max_leaves=30,
)


@pytest.mark.slow
@settings(max_examples=300)
@given(TREES)
def test_any_yaml_is_a_cell_or_has_findings_with_places(judge, content):
    found = judge(yaml.safe_dump(content, allow_unicode=True))
    assert all(f.path and f.message and f.line >= 1 and f.column >= 1 for f in found)
    assert found or isinstance(content, dict)


@pytest.mark.slow
@settings(max_examples=300)
@given(
    st.integers(0, len(SIM) - 1),
    st.integers(0, 12),
    st.text("abz:{}[]-0.\"'#&*!|>%@\n\t, é\x00", max_size=4),
)
def test_a_damaged_cell_has_findings_with_places_or_is_a_cell(judge, at, length, inserted):
    found = judge(SIM[:at] + inserted + SIM[at + length :])
    assert all(f.line >= 1 and f.column >= 1 for f in found)


REAL = """name: bench
kind: real
devices:
  arm:
    driver: universal-robots
    address: 192.168.1.40
    model: ur5e
    robot: ../robots/ur5e_hand_e.xml
  gripper:
    driver: robotiq
    model: hand-e
    port: /dev/ttyUSB0
    finger_offset: 53 mm
"""
HAND = REAL[REAL.index("    driver: robotiq") :]
SENSOR = "  force:\n    driver: robotiq-ft300\n    mass: 1.5 kg\n    port: /dev/ttyUSB1\n"


def test_two_devices_on_one_serial_line_are_refused_by_any_of_its_names(judge, tmp_path):
    assert judge(REAL + SENSOR) == []
    (found,) = judge(REAL + SENSOR.replace("USB1", "USB0"))
    assert (found.line, found.severity) == (17, "error")
    assert (
        "devices.force.port: 'gripper' is on /dev/ttyUSB0 already; a serial line has one device"
        in found.message
    )
    name = tmp_path / "by-id"
    name.symlink_to("/dev/ttyUSB0")
    (found,) = judge(REAL + SENSOR.replace("/dev/ttyUSB1", str(name)))
    assert "'gripper' is on" in found.message


def test_what_a_driver_declares_is_told_at_its_device():
    path = CELLS / "judged.yaml"
    findings = Findings()
    judge_cell_file(path, findings, None, {str(path): REAL})
    (found,) = (each for each in findings.sorted() if each.code == "declared")
    assert (found.severity, found.code, found.excerpt.strip()) == (
        "warning",
        "declared",
        "driver: robotiq",
    )
    assert "gripper does not keep 'a move ends with its wire'" in found.message


def test_two_programs_may_listen_to_one_controller(judge):
    assert (
        judge(
            REAL + "  force: {driver: universal-robots-force, address: 192.168.1.40, mass: 1 kg}\n"
        )
        == []
    )


@pytest.mark.parametrize(
    "sensor",
    [
        SENSOR,
        SENSOR.replace("robotiq-ft300", "universal-robots-force").replace(
            "port: /dev/ttyUSB1", "address: h"
        ),
    ],
)
@pytest.mark.parametrize("mass", ["0 kg", "0 g", "-1 kg", "31 kg"])
def test_a_wrist_sensor_that_carries_nothing_is_refused(judge, sensor, mass):
    (found,) = judge(REAL + sensor.replace("1.5 kg", mass))
    assert found.line == 16
    assert "must be between 10 g and 30 kg" in found.message


@pytest.mark.parametrize("first", ["arm", "gripper"])
@pytest.mark.parametrize(
    ("old", "new", "words", "error"),
    [
        (
            "model: hand-e",
            "model: 2f-140",
            "open by 50 mm, as a hand-e's; those of a 2f-140 by 140 mm",
            True,
        ),
        ("model: hand-e", "model: 2f-85", "as a hand-e's; those of a 2f-85 by 85 mm", True),
        ("finger_offset: 53 mm", "finger_offset: 0 mm", "pads in", False),
        (
            HAND,
            "    driver: wsg\n    tcp: 10.0.0.7\n",
            "as a hand-e's; those of a WSG by 68 or 110 or 210 mm",
            True,
        ),
        (
            "ur5e_hand_e.xml",
            "ur5e_wsg32.xml",
            "open by 68 mm, as a WSG 32's; those of a hand-e by 50 mm",
            True,
        ),
    ],
)
def test_a_description_with_other_fingers_is_found_in_any_order(
    judge, first, old, new, words, error
):
    text = REAL.replace(old, new)
    if first == "gripper":
        arm, gripper = text.index("  arm:"), text.index("  gripper:")
        text = text[:arm] + text[gripper:] + text[arm:gripper]
    (found,) = judge(text)
    assert words in found.message
    assert (found.severity == "error") == error
    assert found.hint


@pytest.mark.parametrize("driver", ["ros2-arm", "ros2-gripper", "ros2-camera"])
@pytest.mark.parametrize(
    "address",
    [
        "http://10.0.0.1:9090",
        "ws://",
        "ws:/10.0.0.1",
        "ws://:9090",
        "10.0.0.1:",
        "10.0.0.1",
        "::1:7447",
        "ws://h:99999",
        "a b:7447",
        "h:0",
        "ws://[1::2::3]:9090",
        "[:::::]:7447",
    ],
)
def test_a_way_to_ros_is_judged_before_it_is_tried(judge, driver, address):
    found = judge(
        f"name: x\nkind: real\ndevices:\n  it:\n    driver: {driver}\n    address: '{address}'\n"
    )
    (wrong,) = [one for one in found if "address" in one.message]
    assert wrong.line == 6
    words = (
        "is not HOST:PORT of rmw_zenoh's router, or ws://HOST:9090 of rosbridge",
        "is not an address: write HOST",
    )
    assert words["::" in address and "[" in address] in wrong.message


@pytest.mark.parametrize(
    "address",
    [
        "127.0.0.1:7447",
        "[::1]:7447",
        "robot-1.local:7447",
        "ws://h",
        "wss://h:9090/ros",
        "ws://[::1]:9090",
    ],
)
def test_a_right_way_to_ros_passes(judge, address):
    found = judge(
        f"name: x\nkind: real\ndevices:\n  it:\n    driver: ros2-gripper\n    address: '{address}'\n"
    )
    assert not [one for one in found if "address" in one.message]


def test_an_address_is_no_recording(judge):
    (found,) = judge((CELLS / "frames.yaml").read_text(), {"folder": "http://10.0.0.5/stream"})
    assert "is an address: recorded frames lie on this machine" in found.message
