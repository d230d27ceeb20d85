"""`pomona measure`: recorded frames in, a table and a picture a frame out, beside calipers."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pomona.applications.inventory import command_measure, measured_frame
from pomona.executive.cli import main
from pomona.skills.geometry import transform
from pomona.skills.perception.detection.instances import Instance, cuboid_in_picture
from pomona.skills.perception.fruit import load_fruit

INTRINSICS = "{fx: 300 px, fy: 300 px, cx: 80 px, cy: 60 px, width: 160, height: 120}"
K = np.array([[300.0, 0.0, 80.0], [0.0, 300.0, 60.0], [0.0, 0.0, 1.0]])
CALIPERS = "frame,name,x,y,w,h,width_mm,height_mm\n"
BALL = "65,45,30,30,91,83"
"""The ball's box, and what a caliper says about it."""


def instance(x: float) -> Instance:
    T = transform(None, (x, 0.0, 0.97))  # the ball looks as small as the larger model farther away
    points = cuboid_in_picture(T, load_fruit("apple").dimensions, K)
    return Instance(points, 0.93, 0.9, T, 1e-5 * np.eye(6))


@pytest.fixture
def frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three frames from one place, in each of which the detector finds a ball and something without depth."""
    monkeypatch.chdir(tmp_path)
    found = [instance(0.0), instance(0.2)]
    monkeypatch.setattr(measured_frame, "find_in_frame", lambda *_: found)
    folder = tmp_path / "my frames: 7"
    folder.mkdir()
    v, u = np.mgrid[:120, :160]
    rays = np.stack([(u - 80) / 300, (v - 60) / 300, np.ones(u.shape)], -1)
    centre, radius = np.array([0.0, 0.0, 0.9]), 0.045
    b = rays @ centre / (rays**2).sum(-1)
    rest = b**2 - (centre @ centre - radius**2) / (rays**2).sum(-1)
    depth = np.where(rest > 0, 1e3 * (b - np.sqrt(np.maximum(rest, 0.0))), 0.0).astype(np.uint16)
    for label in "abc":
        cv2.imwrite(str(folder / f"{label}_color.png"), np.full((120, 160, 3), 90, np.uint8))
        cv2.imwrite(str(folder / f"{label}_depth_mm.png"), depth)
    (folder / "intrinsics.yaml").write_text(INTRINSICS)
    poses = [{"label": label, "T_base_camera": np.eye(4).tolist()} for label in "abc"]
    (folder / "frames.json").write_text(json.dumps(poses))
    return folder


def rows(file: str) -> list[dict[str, str]]:
    return list(csv.DictReader(Path(file).read_text().splitlines()))


@pytest.mark.slow
def test_a_folder_of_frames_becomes_a_table_with_intervals_and_a_line_for_each(
    frames: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["measure", str(frames), "--out", "out"]) == 0
    said = capsys.readouterr().out
    assert "1 of 3 frames, a: 2 found, 1 measured" in said
    assert "3 of 3 frames, c: 2 found, 1 measured" in said
    table = rows("out/fruit.csv")
    assert [(row["frame"], row["row"], row["not_measured"]) for row in table[:3]] == [
        ("a", "1", ""),
        ("a", "2", "NO_DEPTH"),
        ("b", "1", ""),
    ]
    ball, hidden = table[:2]
    assert float(ball["width_mm"]) == pytest.approx(90.0, abs=6.0)
    assert float(ball["z_mm"]) == pytest.approx(900.0, abs=10.0)
    for length in ("width", "height", "depth", "x", "y", "z"):
        assert float(ball[f"{length}_90_mm"]) > 0.0
        assert hidden[f"{length}_mm"] == hidden[f"{length}_90_mm"] == ""
    same = json.loads(Path("out/fruit.json").read_text())
    assert [row["width_mm"] for row in same[:2]] == [float(ball["width_mm"]), None]
    assert sorted(path.name for path in Path("out").glob("*.jpg")) == [
        "0001_a.jpg",
        "0002_b.jpg",
        "0003_c.jpg",
    ]
    assert main(["measure", str(frames), "--out", "out"]) == 2
    assert "out is there already" in capsys.readouterr().err


@pytest.mark.slow
def test_a_frame_that_is_damaged_is_named_and_the_others_are_measured(
    frames: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (frames / "b_depth_mm.png").write_bytes(b"damaged")
    assert main(["measure", str(frames)]) == 2
    said = capsys.readouterr().out
    assert "b_depth_mm.png: cannot be read as a picture" in said
    assert "3 of 3 frames, c: 2 found" in said
    assert {row["frame"] for row in rows("measured/fruit.csv")} == {"a", "c"}


@pytest.mark.slow
def test_calipers_give_figures_and_too_few_of_them_no_sizes_of_the_kind(
    frames: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("calipers.csv").write_text(CALIPERS + f"a,7,{BALL}\nb,7,{BALL}\n")
    given = ["--calipers", "calipers.csv", "--learn", "sizes.yaml"]
    assert main(["measure", str(frames), *given]) == 2
    said = capsys.readouterr()
    assert "2 measured fruit beside calipers; width: bias " in said.out
    assert "calipers.csv: 1 measured fruit do not give the spread of sizes" in said.err
    assert not Path("sizes.yaml").exists()
    assert len(rows("measured/fruit.csv")) == 6, "the table is written all the same"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("a,7,65,45,30,30,9.1,8.3", "width_mm is 0.1 times what the camera saw (median)"),
        ("a,7,0,0,30,30,91,83", "no measured fruit has its box in the table"),
        ("other,7,65,45,30,30,91,83", "no measured fruit has its box in the table"),
    ],
)
def test_calipers_of_other_units_boxes_or_frames_are_named(
    frames: Path, capsys: pytest.CaptureFixture[str], row: str, words: str
) -> None:
    Path("calipers.csv").write_text(f"{CALIPERS}{row}\n")
    assert main(["measure", str(frames), "--calipers", "calipers.csv"]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("spoil", "arguments", "words"),
    [
        (
            lambda folder: (folder / "intrinsics.yaml").write_text(
                INTRINSICS.replace("300", ".nan", 1)
            ),
            (),
            "fx",
        ),
        (
            lambda folder: (folder / "intrinsics.yaml").unlink(),
            (),
            "the intrinsics are for 1920 x 1080",
        ),
        (
            lambda folder: [path.unlink() for path in folder.glob("*_color.png")],
            (),
            "holds no frame",
        ),
        (lambda folder: (folder / "a_depth_mm.png").unlink(), (), "a_depth_mm.png is missing"),
        (
            lambda folder: (folder / "a_color.png").write_bytes(b"damaged"),
            (),
            "a_color.png: cannot be read as a picture",
        ),
        (lambda folder: None, ("--kind", "plum"), "no fruit named 'plum'"),
        (lambda folder: None, ("--every", "0"), "--every: it is 0, but must be"),
        (lambda folder: None, ("--out", "my frames: 7"), "my frames: 7 is there already"),
        (lambda folder: None, ("--out", "/proc/nothing/here"), "/proc/nothing"),
        (lambda folder: None, ("--learn", "sizes.yaml"), "--learn needs --calipers"),
        (lambda folder: None, ("--calipers", "none.csv"), "none.csv: cannot be read"),
        (
            lambda folder: Path("c.csv").write_text("frame,name\n"),
            ("--calipers", "c.csv"),
            "c.csv: has no column x, y, w, h, width_mm, height_mm",
        ),
        (
            lambda folder: Path("c.csv").write_text(f"{CALIPERS}a,7,65,45,0,30,91,83\n"),
            ("--calipers", "c.csv"),
            "c.csv:2: w is '0': a number above 0 is needed",
        ),
    ],
)
def test_unusable_input_is_refused_in_a_line_and_nothing_is_written(
    frames: Path, capsys: pytest.CaptureFixture[str], spoil, arguments: tuple[str, ...], words: str
) -> None:
    spoil(frames)
    assert main(["measure", str(frames), *arguments]) == 2
    said = capsys.readouterr()
    assert words in said.err
    assert "Traceback" not in said.err + said.out
    assert "--set" not in said.err
    assert not Path("measured").exists()


@pytest.mark.parametrize(
    "arguments", [("--score", "3"), ("--width", "3"), ("--method", "guess"), ("--width", "wide")]
)
def test_a_value_that_is_none_is_refused_with_those_that_are(
    frames: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["measure", str(frames), *arguments])
    assert ended.value.code == 2
    assert f"argument {arguments[0]}: " in capsys.readouterr().err


def test_after_ctrl_c_the_frames_so_far_are_in_the_table(
    frames: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    measured, asked = command_measure.measure_frame, []

    def interrupted(*given: object) -> object:
        asked.append(given)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return measured(*given)

    monkeypatch.setattr(command_measure, "measure_frame", interrupted)
    assert main(["measure", str(frames)]) == 130
    assert "measured holds the results so far" in capsys.readouterr().err
    assert [row["frame"] for row in rows("measured/fruit.csv")] == ["a", "a"]


def test_a_missing_path_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["measure", str(tmp_path / "nothing")]) == 2
    assert "there is no such folder or file" in capsys.readouterr().err


def test_topics_of_a_folder_that_is_no_bag_are_refused(
    frames: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["measure", str(frames), "--color-topic", "/left/image_raw"]) == 2
    assert capsys.readouterr().err.endswith(
        f"--colour-topic: {frames} is no bag, so it has no topics\n"
    )


def test_a_topic_that_a_bag_lacks_is_refused_with_those_that_it_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="the extra ros2 is not installed")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "sensor_msgs/msg/Image"
    stamp = store.types["builtin_interfaces/msg/Time"](0, 1)
    header = store.types["std_msgs/msg/Header"](stamp, "camera")
    image = store.types[kind](header, 1, 1, "rgb8", 0, 3, np.zeros(3, np.uint8))
    monkeypatch.chdir(tmp_path)
    with rosbag2.Writer(
        tmp_path / "bag", version=9, storage_plugin=rosbag2.StoragePlugin.MCAP
    ) as writer:
        for name in ("/left/image_raw", "/right/image_raw"):
            there = writer.add_connection(name, kind, typestore=store)
            writer.write(there, 1, store.serialize_cdr(image, kind))
    assert main(["measure", "bag"]) == 2
    said = capsys.readouterr().err
    assert (
        f"it has /left/image_raw ({kind}), /right/image_raw ({kind}); name it with --colour-topic"
        in said
    )
    assert main(["measure", "bag", "--colour-topic", "/left/image_raw"]) == 2
    assert "name it with --depth-topic" in capsys.readouterr().err
