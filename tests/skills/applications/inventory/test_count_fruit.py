"""Frames become tables, a page and pictures; fruit is counted once."""

from __future__ import annotations

import csv
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.inventory import count_fruit
from pomona.applications.inventory.camera_motion import CameraMotion
from pomona.applications.inventory.count_fruit import CountFruit
from pomona.applications.inventory.fruit_page import FINDS, FRUIT, PAGE, PICTURES
from pomona.applications.inventory.fruit_report import FruitReport
from pomona.applications.inventory.sighting import FrameSightings, sighting_of
from pomona.drivers.interfaces import Frame
from pomona.executive.skill_testing import drive
from pomona.skills.perception.detection.detection import AllDetections
from pomona.skills.perception.fruit.sizes import KindSizes
from tests.skills.applications.inventory.test_tabulate import found
from tests.skills.picking_scene import apple_at

LABELS = ("one", "two", "three")


def frame(label: str, placed: bool = True) -> Frame:
    colour = np.full((120, 160, 3), 90, np.uint8)
    depth = np.full((120, 160), 0.8, np.float32)
    shown = apple_at(1, 3).frame
    lens = replace(shown.intrinsics, width=160, height=120)
    return replace(shown, colour=colour, depth=depth, intrinsics=lens, label=label, placed=placed)


def looked(label: str, apples: dict[int, int], placed: bool = True, lost: tuple[int, ...] = ()):
    """Return the detections in a frame: the paper's apples by number, each at its place of the table; `lost` not
    measured.
    """
    shown = frame(label, placed)
    sightings, detections = [], []
    for number, place in apples.items():
        contour = np.array([[20.0, 20.0], [50.0, 20.0], [50.0, 50.0], [20.0, 50.0]]) + 30 * (
            number - 1
        )
        apple = replace(apple_at(number, place), frame=shown, contour=contour)
        detection = found(apple, np.tile([80.0, 60.0], (9, 1)))
        detection = replace(
            detection, T_camera_object=apple.T_base_fruit, covariance=1e-6 * np.eye(6)
        )
        detections.append(detection)
        why = "NO_DEPTH" if number in lost else ""
        sightings.append(sighting_of(detection, apple, why, len(sightings) + 1))
    inputs = {"looked": AllDetections(tuple(detections), shown, np.eye(4))}
    return inputs | ({"finds": FrameSightings(shown, tuple(sightings))} if sightings else {})


def count(*frames, skill: CountFruit | None = None, out: object = "", of: int | None = None):
    skill = skill or CountFruit()
    ends = [
        drive(skill, {**inputs, "frames": of or len(frames), "out": str(out)}) for inputs in frames
    ]
    return ends[-1]


def rows(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(file.read_text().splitlines()))


def test_frames_become_two_tables_a_page_and_a_picture_each(tmp_path: Path) -> None:
    out = tmp_path / "made" / "here"
    end = count(
        looked("one", {1: 3, 5: 1}),
        looked("two", {1: 3, 3: 2}, lost=(3,)),
        looked("three", {}),
        out=out,
    )
    assert end.status is Status.SUCCESS
    assert end.outputs == {"fruit": 3, "measured": 2, "unreadable_frames": 0}
    finds, fruit = rows(out / FINDS), rows(out / FRUIT)
    assert [(row["frame"], row["row"], row["fruit"], row["width_mm"], row["not_measured"]) for row in finds] == [
        ("one", "1", "1", "89.0", ""), ("one", "2", "2", "62.0", ""),
        ("two", "1", "1", "89.0", ""), ("two", "2", "3", "", "NO_DEPTH"),
    ]  # fmt: skip
    first = finds[0]
    assert float(first["width_90_mm"]) == pytest.approx(1.645, abs=0.06)
    assert (first["x_mm"], first["y_mm"], first["visible"], first["score"]) == (
        "-30.0",
        "-520.0",
        "0.80",
        "0.910",
    )
    assert float(first["mass_g"]) == pytest.approx(
        394 * 89 * 81 * 89 / (97.56 * 85.39 * 95.90), abs=1.0
    )
    assert "394 g" in first["mass_model"]
    assert [(row["fruit"], row["frames"], row["looks_that_measured"], row["looks_agree"]) for row in fruit] == [
        ("1", "2", "2", "yes"), ("2", "1", "1", ""), ("3", "1", "0", ""),
    ]  # fmt: skip
    pictures = sorted(path.name for path in (out / PICTURES).iterdir())
    assert pictures == ["0001_one.jpg", "0002_two.jpg", "0003_three.jpg"]
    drawn = cv2.imread(str(out / PICTURES / "0001_one.jpg"))
    assert drawn.shape == (120, 160, 3)
    assert abs(drawn.astype(int) - 90).max() > 60
    page = (out / PAGE).read_text()
    assert "3 fruit in 3 frames" in page
    assert all(f'src="pictures/{name}"' in page for name in pictures)
    assert "the depth camera saw nothing there" in page
    assert sorted(path.name for path in out.iterdir()) == sorted([FINDS, FRUIT, PAGE, PICTURES])


def test_viewers_see_the_same_and_widths_are_counted_in_classes() -> None:
    views = dict(
        count(looked("one", {1: 3, 5: 1}), looked("two", {1: 3, 3: 2}, lost=(3,))).published
    )
    assert all(len(row) == len(views["measured"].columns) for row in views["measured"].rows)
    assert views["measured"].caption == "3 of 4 finds measured"
    assert views["measured"].rows[0][:5] == ("one", "1", "1", "0.91", "89.0 ± 1.6")
    assert views["fruit"].caption == "3 fruit, each once"
    assert views["sizes"].rows == (
        ("one", "2", "2", "1", "0", "0", "0", "0", "1"),
        ("two", "2", "1", "0", "0", "0", "0", "0", "1"),
        ("all, each fruit once", "3", "2", "1", "0", "0", "0", "0", "1"),
    )
    assert [(line.label, line.style) for line in views["overlay"].lines] == [
        ("1", "refined"),
        ("2", "found"),
    ]


def test_how_far_it_has_come_is_said() -> None:
    skill = CountFruit()
    end = drive(skill, {**looked("one", {1: 3, 5: 1}), "frames": 40})
    assert end.feedback == "1 of 40 frames, one: 2 found, 2 measured; 2 fruit so far, 2 measured"


def test_an_unreadable_frame_keeps_its_line_and_later_frames_are_counted(tmp_path: Path) -> None:
    frames = (
        looked("one", {1: 3}),
        {"unreadable": "b_color.png: is no image"},
        looked("three", {1: 3}),
    )
    end = count(*frames, out=tmp_path / "o")
    assert end.outputs == {"fruit": 1, "measured": 1, "unreadable_frames": 1}
    assert "b_color.png: is no image" in (tmp_path / "o" / PAGE).read_text()
    assert len(rows(tmp_path / "o" / FINDS)) == 2


def test_a_frame_without_fruit_does_not_take_the_finds_of_the_one_before() -> None:
    first = looked("one", {1: 3})
    assert count(first, looked("two", {}) | {"finds": first["finds"]}).outputs["fruit"] == 1


def test_without_poses_frames_are_joined_by_common_fruit_or_not_at_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frames = [looked(label, {1: 3, 5: 1}, placed=False) for label in LABELS]
    monkeypatch.setattr(count_fruit, "camera_motion", lambda *_: CameraMotion(np.eye(4), 0.001, ""))
    assert count(*frames).outputs["fruit"] == 2
    monkeypatch.setattr(
        count_fruit, "camera_motion", lambda *_: CameraMotion(None, np.inf, "nothing in common")
    )
    skill = CountFruit()
    assert count(*frames, skill=skill).outputs["fruit"] == 6
    report: FruitReport = skill._report
    assert [entry.scene for entry in report.frames] == [1, 2, 3]
    assert "nothing in common" in report.frames[1].how
    monkeypatch.setattr(count_fruit, "camera_motion", None)
    skill = CountFruit()
    for inputs in frames:
        drive(skill, {**inputs, "join": False})
    assert len(skill._report.book.fruit) == 6


def test_motions_add_up_over_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    step = np.eye(4)
    step[0, 3] = 0.1
    monkeypatch.setattr(count_fruit, "camera_motion", lambda *_: CameraMotion(step, 0.003, ""))
    skill = CountFruit()
    count(*(looked(label, {1: 3}, placed=False) for label in LABELS), skill=skill)
    places = [fruit.place[0] for fruit in skill._report.book.fruit]
    assert np.diff(places) == pytest.approx([0.1, 0.1])
    assert "4.2 mm" in skill._report.frames[2].how


def test_given_poses_that_contradict_the_frames_are_doubted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    frames = [looked(label, {1: 3}) for label in ("one", "two")]
    aside, far = np.eye(4), CameraMotion(None, np.inf, "nothing in common")
    aside[0, 3] = 0.5
    words = "the given camera poses disagree with the images by 500 mm between these two frames"
    moved, still = CameraMotion(aside, 0.002, ""), CameraMotion(np.eye(4), 0.002, "")
    for motion, doubted in ((moved, True), (still, False), (far, False)):
        monkeypatch.setattr(count_fruit, "camera_motion", lambda *_, found=motion: found)
        out = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        end = count(*frames, out=out)
        assert (f"two: {words}" in end.feedback) is doubted
        assert (
            (out / PAGE).read_text().count("disagree with the images by 500 mm") == 2
        ) is doubted
        assert [words in row["doubt"] for row in rows(out / FINDS)] == [False, doubted]
    drive(skill := CountFruit(), {**frames[0], "join": False})
    monkeypatch.setattr(count_fruit, "camera_motion", None)
    drive(skill, {**frames[1], "join": False})


def test_frames_whose_depth_does_not_lie_on_colour_are_doubted_where_they_show_fruit(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(
        count_fruit,
        "misplaced_depth",
        lambda frame: "depth is turned" if frame.label != "one" else "",
    )
    out = tmp_path / "o"
    end = count(looked("one", {1: 3}), looked("two", {1: 3}), looked("three", {}), out=out)
    assert "two: depth is turned: is it registered" in end.feedback
    assert "(frames in doubt: 1 of 3)" in end.feedback
    page = (out / PAGE).read_text()
    assert "These figures are not reliable yet: two: depth is turned" in page
    assert "In doubt: depth is turned" in page
    assert ["turned" in row["doubt"] for row in rows(out / FINDS)] == [False, True]


def test_existing_files_are_not_written_over_and_an_unwritable_place_is_reported_before(
    tmp_path: Path,
) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    (tmp_path / "empty").mkdir()
    said = {name: [p.message for p in CountFruit.judge({"out": str(tmp_path / name)}, None)]
            for name in ("full", "file", "empty", "file/below", "new/deep")}  # fmt: skip
    assert "is there already" in said["full"][0]
    assert "is there already" in said["file"][0]
    assert "is not a folder" in said["file/below"][0]
    assert said["empty"] == said["new/deep"] == []
    assert list(CountFruit.judge({"out": ""}, None)) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only for root")
def test_a_read_only_folder_is_reported_before_the_work(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    (problem,) = CountFruit.judge({"out": str(tmp_path / "out")}, None)
    assert "nothing can be written into" in problem.message


def test_a_disk_that_takes_nothing_fails_and_leaves_no_half_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    skill = CountFruit()
    drive(skill, {**looked("one", {1: 3}), "frames": 2, "out": str(out)})
    before = (out / FINDS).read_text()

    def full(self: Path, content: bytes) -> int:
        with self.open("wb") as stream:
            stream.write(content[: len(content) // 2])
        raise OSError(28, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_bytes", full)
    end = drive(skill, {**looked("two", {1: 3}), "frames": 2, "out": str(out)})
    assert end.reason.code == "NOT_WRITTEN"
    assert "No space left on device" in end.reason.message
    assert (out / FINDS).read_text() == before
    assert not [path for path in out.rglob("*") if path.name.startswith(".")]


def test_messages_stay_in_proportion_to_findings() -> None:
    report, told = FruitReport(), 0
    inputs = looked("one", {1: 3, 5: 1})
    for _ in range(300):
        report.add("one", inputs["finds"].sightings, np.eye(4), 0.0, "")
        told += report.is_due(last=False)
    assert 60 < told < 90
    assert report.is_due(last=True)


@pytest.mark.parametrize(("factor", "doubted"), [(1.0, False), (1.9, True), (0.4, True)])
def test_where_all_fruit_look_too_large_or_too_small_the_sizes_are_doubted(
    factor: float, doubted: bool, tmp_path: Path
) -> None:
    inputs = looked("one", {1: 3, 2: 1, 5: 5})
    seen = inputs["finds"].sightings
    wrong = tuple(replace(each, shown=factor * each.shown) for each in seen)
    end = count(
        inputs | {"finds": FrameSightings(inputs["looked"].frame, wrong)}, out=tmp_path / "o"
    )
    assert ("do the intrinsics belong to these pictures" in end.feedback) is doubted
    assert ("These figures are not reliable yet" in (tmp_path / "o" / PAGE).read_text()) is doubted


@pytest.mark.parametrize(("lost", "doubted"), [((1, 2, 5), True), ((1, 2), False)])
def test_where_no_fruit_at_all_was_measured_the_depth_is_doubted(
    lost: tuple[int, ...], doubted: bool, tmp_path: Path
) -> None:
    end = count(looked("one", {1: 3, 2: 1, 5: 5}, lost=lost), out=tmp_path / "o")
    words = "none of 3 fruit could be measured: is the depth in millimetres"
    assert (words in end.feedback) is doubted
    page = (tmp_path / "o" / PAGE).read_text()
    assert (words in page) is doubted
    assert "These figures are not reliable" not in page


def test_where_less_than_a_tenth_was_measured_the_depth_is_doubted() -> None:
    """The orchard's frames with their depth times five had 1 measured of 56."""
    inputs = looked("one", {1: 3})
    measured = inputs["finds"].sightings[0]
    apart = [
        replace(measured, p_base=measured.p_base + 0.5 * k, dimensions=None, why="NO_DEPTH")
        for k in range(1, 11)
    ]
    for count_of, doubted in ((10, True), (9, False)):
        seen = (measured, *apart[:count_of])
        end = count(inputs | {"finds": FrameSightings(inputs["looked"].frame, seen)})
        assert ("only 1 of 11 fruit could be measured" in end.feedback) is doubted


def test_sizes_of_a_kind_constrain_less_than_its_model() -> None:
    sizes = KindSizes(0.073, 0.07, 0.957, 0.06)
    inputs = looked("one", {1: 3, 2: 1, 5: 5})
    seen = inputs["finds"].sightings
    for factor, doubted in ((0.75, False), (1.1, True)):
        alike = [
            replace(
                s, fruit=replace(s.fruit, sizes=sizes), shown=factor * np.array([0.0967, 0.001])
            )
            for s in seen
        ]
        end = count(inputs | {"finds": FrameSightings(inputs["looked"].frame, tuple(alike))})
        assert ("intrinsics" in end.feedback) is doubted
