"""`pomona measure`: recorded frames in, tables and a page out, by the tree."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from pomona.applications.inventory import command_measure as measure
from pomona.executive.cli import main
from pomona.skills.geometry import transform
from pomona.skills.perception.detection.instances import Instance, cuboid_in_picture
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.shared import looking

INTRINSICS = "{fx: 300 px, fy: 300 px, cx: 80 px, cy: 60 px, width: 160, height: 120}"
K = np.array([[300.0, 0.0, 80.0], [0.0, 300.0, 60.0], [0.0, 0.0, 1.0]])


def instance(x: float) -> Instance:
    T = transform(None, (x, 0.0, 0.97))  # the ball looks as small as the larger model farther away
    points = cuboid_in_picture(T, load_fruit("apple").dimensions, K)
    return Instance(points, 0.93, 0.9, T, 1e-5 * np.eye(6))


@pytest.fixture
def frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three frames from one place, in each of which the detector finds a ball and something without depth."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(looking, "find_in_frame", lambda *_: [instance(0.0), instance(0.2)])
    monkeypatch.setattr(looking.LookingSkill, "prepare", lambda _self: None)
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


def rows(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(file.read_text().splitlines()))


@pytest.mark.slow
def test_a_folder_of_frames_becomes_tables_and_a_page_with_a_line_for_each(
    frames: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["measure", str(frames), "--out", "out"]) == 0
    said = capsys.readouterr().out
    assert "1 of 3 frames, a: 2 found, 1 measured; 2 fruit so far, 1 measured" in said
    assert "3 of 3 frames, c: 2 found, 1 measured; 2 fruit so far, 1 measured" in said
    first, second = rows(Path("out/fruit.csv"))
    assert (first["frames"], first["looks_that_measured"], second["not_measured"]) == (
        "3",
        "3",
        "NO_DEPTH",
    )
    assert float(first["width_mm"]) == pytest.approx(90.0, abs=6.0)
    assert len(rows(Path("out/finds.csv"))) == 6
    assert len(list(Path("out/pictures").iterdir())) == 3
    assert not Path("runs").exists()
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
    assert {row["frame"] for row in rows(Path("measured/finds.csv"))} == {"a", "c"}
    assert "b_depth_mm.png: cannot be read as a picture" in Path("measured/index.html").read_text()


@pytest.mark.slow
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
        (lambda folder: None, ("--score", "3"), "--score 3: score is at most 1"),
        (lambda folder: None, ("--every", "0"), "--every 0: it is 0, but must be"),
        (lambda folder: None, ("--method", "guess"), "method must be one of shape, uniform"),
        (
            lambda folder: None,
            ("--out", "my frames: 7"),
            "my frames: 7 is there already: name another folder",
        ),
    ],
)
def test_an_unmeasurable_input_is_refused_in_a_line_and_nothing_is_written(
    frames: Path, capsys: pytest.CaptureFixture[str], spoil, arguments: tuple[str, ...], words: str
) -> None:
    spoil(frames)
    assert main(["measure", str(frames), *arguments]) == 2
    said = capsys.readouterr()
    assert words in said.err
    assert "Traceback" not in said.err + said.out
    assert not {"--set", "measure_fruit.yaml", "error[device]", "CountFruit"} & set(
        re.split(r"[\s:/]+", said.err)
    )
    assert not Path("measured").exists()


@pytest.mark.parametrize(
    ("there", "words"), [(True, "out holds the results so far"), (False, "nothing was measured")]
)
def test_after_ctrl_c_the_partial_result_is_printed(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    there: bool,
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    result = SimpleNamespace(outcome="stopped", interrupted=True, reason=None)

    def run(*_: object) -> SimpleNamespace:
        if there:
            Path("out").mkdir()
            Path("out/index.html").touch()
        return SimpleNamespace(result=result)

    monkeypatch.setattr(measure, "run_tree", run)
    assert main(["measure", str(tmp_path), "--out", "out"]) == 130
    assert words in capsys.readouterr().err


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
