"""`pomona detect`: pictures in, a table and pictures with boxes out."""

from __future__ import annotations

import argparse
import contextlib
import csv
import os
import shutil
import signal
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from pomona.executive.running.signals import raising
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.detection import DetectorOptions
from pomona.skills.perception.detection.instances import FoundFruit
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.fruit.catalogue import SHIPPED_WEIGHTS
from pomona.tools.photographs import command_detect_pictures as detect_pictures
from pomona.tools.photographs.command_detect_pictures import add, find_fruit
from pomona.tools.photographs.labels import read_labels
from pomona.tools.training.options import SceneOptions
from pomona.tools.training.scene import render_scene
from tests.skills.tools.box_detectors.onnx_boxes import red_square_model
from tests.skills.tools.photographs.labelled import TRUTH, boxes_of, coco


def run(*arguments: object) -> int:
    parser = argparse.ArgumentParser()
    add(parser.add_subparsers(required=True))
    options = parser.parse_args(["detect", *map(str, arguments)])
    code: int = options.main(options)
    return code


def found(x: float, score: float) -> FoundFruit:
    box = np.array([x, 20.0, 30.0, 32.0])
    return FoundFruit(
        np.zeros(3), np.array([0.0, -1.0, 0.0]), box[:2] + 15.0, 30.0, np.ones(3), score, 0.9, box
    )


@pytest.fixture
def pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with two pictures, in each of which two fruit are found, one of them doubtful."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name in ("a.png", "b.jpg"):
        cv2.imwrite(str(folder / name), np.full((120, 160, 3), 90, np.uint8))
    monkeypatch.setattr(CompactDetector, "load", classmethod(lambda cls, *_: None))
    monkeypatch.setattr(
        detect_pictures, "find_fruit", lambda *_: [found(10.0, 0.93), found(80.0, 0.31)]
    )
    return folder


@pytest.mark.parametrize("name", ["c.tif", "c.webp", "c.png"])
def test_a_file_of_several_pictures_is_named_and_the_others_are_searched(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    pages = [Image.new("RGB", (160, 120), (10 * k, 90, 90)) for k in range(3)]
    pages[0].save(pictures / name, save_all=True, append_images=pages[1:])
    assert run(pictures, "--out", tmp_path / "out") == 2
    words = f"{pictures / name}: holds 3 pictures: store each that is wanted in a file of its own"
    shown = capsys.readouterr()
    assert shown.err == f"pomona detect: {words}\n"
    assert "fruit in 2 pictures" in shown.out


def test_a_folder_of_pictures_becomes_a_table_and_pictures_with_boxes(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (pictures / "notes.txt").write_text("no picture")
    out = tmp_path / "out"
    assert run(pictures, "--out", out) == 0
    rows = list(csv.DictReader((out / "found.csv").read_text().splitlines()))
    assert [(Path(row["picture"]).name, row["fruit"], row["score"]) for row in rows] == [
        ("a.png", "1", "0.930"), ("b.jpg", "1", "0.930"),
    ]  # fmt: skip
    assert [float(rows[0][key]) for key in ("left_px", "top_px", "width_px", "height_px")] == [
        10.0,
        20.0,
        30.0,
        32.0,
    ]
    drawn = cv2.imread(str(out / "0001_a.jpg"))
    assert abs(drawn.astype(int) - 90).max() > 60
    assert "2 fruit in 2 pictures" in capsys.readouterr().out


def test_depth_images_and_hidden_files_of_a_mac_are_no_pictures(
    pictures: Path, tmp_path: Path
) -> None:
    cv2.imwrite(str(pictures / "a_depth_mm.png"), np.full((120, 160), 900, np.uint16))
    (pictures / "._a.png").write_bytes(b"Mac OS X")
    assert run(pictures, "--out", tmp_path / "out") == 0
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert written == ["0001_a.jpg", "0002_b.jpg", "found.csv", "found.json"]


def test_ctrl_c_that_a_library_swallowed_ends_it_after_that_picture_and_keeps_its_rows(
    pictures: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """As a compiled loop does that calls back while it is loaded: without this a thousand pictures went on."""

    def find(*_: object) -> list[FoundFruit]:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return [found(10.0, 0.93)]

    monkeypatch.setattr(detect_pictures, "find_fruit", find)
    with pytest.raises(KeyboardInterrupt), raising():
        run(pictures, "--out", tmp_path / "out")
    said = capsys.readouterr()
    assert "found.csv holds the results so far" in said.err
    assert "b.jpg" not in said.out
    rows = list(csv.DictReader((tmp_path / "out" / "found.csv").read_text().splitlines()))
    assert [Path(row["picture"]).name for row in rows] == ["a.png"]


def test_other_weights_are_a_file_or_the_name_of_shipped_ones(
    pictures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[Path] = []
    monkeypatch.setattr(
        CompactDetector, "load", classmethod(lambda cls, path, *_: loaded.append(path))
    )
    own = tmp_path / "own.weights"
    own.touch()
    for number, name in enumerate((own, "apple.weights")):
        assert run(pictures, "--weights", name, "--out", tmp_path / str(number)) == 0
    assert loaded == [own, SHIPPED_WEIGHTS / "apple.weights"]


def test_weights_for_photographs_are_taken_where_the_fruit_has_them(
    pictures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[str] = []
    monkeypatch.setattr(
        CompactDetector, "load", classmethod(lambda cls, path, *_: loaded.append(path.name))
    )
    for fruit in ("apple", "lemon"):
        assert run(pictures, "--fruit", fruit, "--out", tmp_path / fruit) == 0
    assert loaded == ["apple_photographs.weights", "lemon.weights"]
    assert (load_fruit("apple").weights or Path()).name == "apple.weights"  # a run keeps these


def test_a_detector_of_boxes_takes_the_place_of_weights(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = np.full((480, 640, 3), 40, np.uint8)
    picture[120:200, 400:520] = (20, 20, 250)
    cv2.imwrite(str(tmp_path / "red.png"), picture)
    model = red_square_model(tmp_path / "model.onnx", [1, 3, 240, 320])
    assert run(tmp_path / "red.png", "--boxes", model, "--out", tmp_path / "out") == 0
    (row,) = csv.DictReader((tmp_path / "out" / "found.csv").read_text().splitlines())
    box = [float(row[key]) for key in ("left_px", "top_px", "width_px", "height_px")]
    assert np.allclose(box, (400, 120, 120, 80), atol=4.0)
    assert row["visible"] == ""
    assert (
        run(
            tmp_path / "red.png",
            "--boxes",
            model,
            "--weights",
            "apple.weights",
            "--out",
            tmp_path / "two",
        )
        == 2
    )
    assert "--boxes and --weights: name one of them" in capsys.readouterr().err
    assert not (tmp_path / "two").exists()


def test_the_shipped_weights_for_photographs_find_an_apple_and_none_where_there_is_none() -> None:
    detector = CompactDetector.load(
        SHIPPED_WEIGHTS / "apple_photographs.weights", DetectorOptions(working_width=320)
    )
    table = render_scene(load_fruit("apple"), SceneOptions(kinds=(1, 0, 0, 0)), 31_000_000).colour
    assert any(fruit.score >= 0.5 for fruit in find_fruit(detector, table))
    assert not any(fruit.score >= 0.5 for fruit in find_fruit(detector, np.full_like(table, 90)))


def test_doubtful_fruit_is_taken_when_it_is_asked_for(pictures: Path, tmp_path: Path) -> None:
    assert run(pictures / "a.png", "--out", tmp_path / "out", "--score", "0.2") == 0
    assert len(list(csv.DictReader((tmp_path / "out" / "found.csv").read_text().splitlines()))) == 2


def test_a_file_that_is_no_picture_is_named_and_the_others_are_done(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (pictures / "broken.png").write_bytes(b"not a picture")
    (pictures / "empty.png").touch()
    cut = cv2.imencode(
        ".jpg", np.random.default_rng(0).integers(0, 256, (60, 80, 3)).astype(np.uint8)
    )[1].tobytes()
    (pictures / "cut.jpg").write_bytes(cut[: len(cut) // 2])
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", 100_000, 100_000, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(bytes(1000))),
    )
    huge = b"".join(
        struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in parts
    )
    (pictures / "huge.png").write_bytes(b"\x89PNG\r\n\x1a\n" + huge)
    assert run(pictures, "--out", tmp_path / "out") == 2
    said = capsys.readouterr()
    assert "broken.png: cannot be read as a picture" in said.err
    assert "cut.jpg: cannot be read as a picture" in said.err
    assert "empty.png: cannot be read as a picture" in said.err
    assert "huge.png: cannot be read as a picture" in said.err
    assert "2 fruit in 2 pictures" in said.out


def test_a_thumbnail_and_a_format_that_is_not_read_are_named_and_the_others_are_done(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite(str(pictures / "m.png"), np.zeros((18, 24, 3), np.uint8))
    (pictures / "n.HEIC").write_bytes(b"\x00\x00\x00\x18ftypheic" + bytes(64))
    model = red_square_model(tmp_path / "model.onnx", [1, 3, 240, 320])
    assert run(pictures, "--boxes", model, "--out", tmp_path / "out") == 2
    said = capsys.readouterr()
    assert "m.png: a picture must be (h, w, 3) uint8 RGB, at least 32 px on each side" in said.err
    assert "n.HEIC: cannot be read as a picture: it is HEIC: convert it to JPEG or PNG" in said.err
    assert "0 fruit in 2 pictures" in said.out


@pytest.mark.skipif(os.name != "posix", reason="names of other systems are no bytes")
@pytest.mark.parametrize(
    ("name", "shown"), [(b"\xc4pfel", r"\xc4pfel"), (b"two\nlines", r"two\nlines")]
)
def test_a_picture_whose_name_is_not_utf8_or_has_a_new_line_is_searched(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: bytes, shown: str
) -> None:
    (pictures / "a.png").rename(pictures / os.fsdecode(name + b".png"))
    assert run(pictures, "--out", tmp_path / "out") == 0
    assert f"{shown}.png: 1 found" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "out" / "found.csv").read_text("utf-8").splitlines()))
    assert [row["picture"].rpartition("/")[2] for row in rows] == ["b.jpg", f"{shown}.png"]
    assert b"0002_%s.jpg" % name in os.listdir(os.fsencode(tmp_path / "out"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--width", "20"), "--width must lie in"),
        (("--fruit", "plum"), "plum"),
        (
            ("--weights", "none.weights"),
            "none.weights: is neither a file nor the name of shipped weights",
        ),
        (("missing.jpg",), "missing.jpg: there is no such file"),
        (("--out", "."), "is there already"),
    ],
)
def test_an_impossible_export_is_refused_before_anything_is_written(
    pictures: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...],
    said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(pictures)
    (pictures / "found.csv").write_text("mine")
    assert run(".", *arguments) == 2
    assert said in capsys.readouterr().err
    assert (pictures / "found.csv").read_text() == "mine"
    assert not (pictures / "detected").exists()


def test_folders_in_a_folder_are_named_and_not_searched(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (pictures / "more").mkdir()
    shutil.copy(pictures / "a.png", pictures / "more" / "c.png")
    assert run(pictures, "--out", tmp_path / "out") == 0
    assert f"not searched: {pictures / 'more'}" in capsys.readouterr().err


def test_files_that_may_be_pictures_and_are_not_searched_are_named(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.gif", "b.dng", "c.exr", "d.JP2", "notes.txt", "labels.json", ".hidden.gif"):
        (pictures / name).write_bytes(b"")
    assert run(pictures, "--out", tmp_path / "out") == 0
    (line,) = (line for line in capsys.readouterr().err.splitlines() if "not searched" in line)
    assert line.endswith(".avif: a.gif, b.dng, c.exr and 1 more")


def test_an_empty_folder_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path, "--out", tmp_path / "out") == 2
    assert "holds no pictures" in capsys.readouterr().err


def test_the_detector_is_asked_with_a_camera_as_wide_as_the_picture() -> None:
    class Asked:
        def find(self, colour: object, K: np.ndarray) -> list[FoundFruit]:
            assert np.asarray(colour).flags["C_CONTIGUOUS"]
            assert (K[0, 0], K[0, 2], K[1, 2]) == (160.0, 80.0, 60.0)
            return []

    assert find_fruit(Asked(), np.zeros((120, 160, 3), np.uint8)[:, :, ::-1]) == []  # type: ignore[arg-type]


def test_several_widths_are_searched_unless_one_is_given(
    pictures: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked: list[tuple[int | None, int]] = []
    take = classmethod(
        lambda cls, _path, options: asked.append((options.working_width, options.looks))
    )
    monkeypatch.setattr(CompactDetector, "load", take)
    assert run(pictures, "--out", tmp_path / "several") == 0
    assert "160 × 120 px: searched at 64, 96, 128, 160 px" in capsys.readouterr().out
    assert run(pictures, "--width", "640", "--out", tmp_path / "one") == 0
    said = capsys.readouterr().out
    assert "searched at 640 px (longer side, one width); finds fruit of 6 to 32 px" in said
    assert asked == [(None, 1), (640, 2)]


def test_a_picture_that_is_too_small_gets_one_line_and_the_others_are_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, side in (("large", 400), ("tiny", 20), ("wide", 64)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((side, 2 * side, 3), 90, np.uint8))
    assert run(tmp_path, "--out", tmp_path / "out") == 2
    said = capsys.readouterr()
    (line,) = said.err.splitlines()
    assert "tiny.png: a picture must be (h, w, 3) uint8 RGB, at least 32 px on each side" in line
    assert "0 fruit in 2 pictures" in said.out
    assert "20 px" not in said.out, "its widths are not announced"


def test_sizes_at_the_edge_of_the_range_are_reported(
    pictures: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    small = FoundFruit(
        np.zeros(3),
        np.array([0.0, -1.0, 0.0]),
        np.zeros(2),
        20.0,
        np.ones(3),
        0.9,
        0.9,
        np.array([5.0, 5, 26, 25]),
    )
    monkeypatch.setattr(detect_pictures, "find_fruit", lambda *_: [small])
    assert run(pictures, "--out", tmp_path / "small") == 0
    said = capsys.readouterr().out
    assert "longer sides of the boxes: 26 to 26 px" in said
    assert "100% of the fruit are as small as the search can find" in said
    assert "--width 320" in said
    assert run(pictures, "--width", "720", "--out", tmp_path / "large") == 0
    assert "100% of the fruit are as large as the search can find" in capsys.readouterr().out


@pytest.fixture
def labelled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Four labelled pictures of discs; the detector finds all but the last disc of each, and a wrong one."""
    labels = coco(tmp_path / "set")
    order = iter(sorted(TRUTH))

    def find(*_: object) -> list[FoundFruit]:
        right = boxes_of(TRUTH[next(order)])[:-1]
        boxes = [np.array(box) for box in [*right, (200.0, 10.0, 30.0, 30.0)]]
        plain = (np.zeros(3), np.array([0.0, -1.0, 0.0]), np.zeros(2), 30.0, np.ones(3))
        return [FoundFruit(*plain, 0.9 - 0.1 * k, 1.0, box) for k, box in enumerate(boxes)]

    monkeypatch.setattr(CompactDetector, "load", classmethod(lambda cls, *_: None))
    monkeypatch.setattr(detect_pictures, "find_fruit", find)
    return labels


def test_own_labels_give_recall_precision_and_average_precision_by_size(
    labelled: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(labelled.parent / "images", "--eval", labelled, "--out", tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "4 pictures with labels, 5 boxes" in said
    assert "| recall at score ≥ 0.5 | 0.400 |" in said  # 2 of 5
    assert "| precision at score ≥ 0.5 | 0.333 |" in said  # 2 of 6
    assert "| AP50 | 0." in said
    assert "No score gives precision 0.9 on these labels." in said
    assert (tmp_path / "out" / "figures.md").read_text("utf-8").rstrip() in said


def test_a_picture_without_labels_is_named_and_left_out_of_the_figures(
    labelled: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(detect_pictures, "find_fruit", lambda *_: [])
    cv2.imwrite(str(labelled.parent / "images" / "other.png"), np.full((60, 80, 3), 90, np.uint8))
    cv2.imwrite(str(tmp_path / "a_0.jpg"), np.full((60, 80, 3), 90, np.uint8))
    assert (
        run(
            labelled.parent / "images",
            tmp_path / "a_0.jpg",
            "--eval",
            labelled,
            "--out",
            tmp_path / "out",
        )
        == 0
    )
    said = capsys.readouterr()
    assert "other.png has 0 entries in the labels, and is left out" in said.err
    assert "a_0.jpg is 80 × 60, but its labels are of 240 × 240 px" in said.err
    assert "4 pictures with labels" in said.out


def test_labels_of_another_form_or_class_are_refused_in_one_line(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    labels = coco(tmp_path / "set")
    (tmp_path / "set" / "images" / "a_0.txt").write_text("0 0.5 0.5 0.1 0.1\n")
    labels.write_text(labels.read_text().replace("Apple", "plum"))
    for given, words in (
        (labels, "has the categories leaf, plum: expected one with the name apple"),
        (tmp_path / "set", "the labels are YOLO's texts, expected a JSON file of COCO: convert"),
    ):
        assert run(pictures, "--eval", given, "--out", tmp_path / "out") == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert words in line
        assert not (tmp_path / "out").exists()


def test_boxes_are_written_as_coco_and_read_back(pictures: Path, tmp_path: Path) -> None:
    assert run(pictures, "--out", tmp_path / "out") == 0
    read = read_labels(tmp_path / "out" / "found.json", "apple")
    assert [(one.name, one.boxes[0].tolist()) for one in read] == [
        (pictures / name, [10.0, 20.0, 30.0, 32.0]) for name in ("a.png", "b.jpg")
    ]


def test_own_labels_give_the_score_for_a_precision(
    labelled: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    order = iter(sorted(TRUTH))

    def find(*_: object) -> list[FoundFruit]:
        boxes = [*boxes_of(TRUTH[next(order)]), (200.0, 10.0, 30.0, 30.0)]
        plain = (np.zeros(3), np.array([0.0, -1.0, 0.0]), np.zeros(2), 30.0, np.ones(3))
        return [
            FoundFruit(*plain, 0.4 if x == 200.0 else 0.8, 1.0, np.array((x, *box)))
            for x, *box in boxes
        ]

    monkeypatch.setattr(detect_pictures, "find_fruit", find)
    assert run(labelled.parent / "images", "--eval", labelled, "--out", tmp_path / "out") == 0
    assert (
        "On these labels, --score 0.80 gives precision 1.00 and recall 1.00."
        in capsys.readouterr().out
    )


def test_one_picture_has_no_interval(
    labelled: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Drawn again it always gives the same figures: an interval of no width would pass as a certain one."""
    picture = labelled.parent / "images" / "a_0.jpg"
    assert run(picture, "--eval", labelled, "--out", tmp_path / "out") == 0
    assert "| recall at score ≥ 0.5 | 0.500 | nan–nan |" in capsys.readouterr().out


def test_many_sizes_of_pictures_are_announced_in_a_few_lines(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(12):
        cv2.imwrite(
            str(pictures / f"c{number:02d}.png"), np.full((60 + number, 80, 3), 90, np.uint8)
        )
    assert run(pictures, "--out", tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert said.count("searched at") == 5
    assert said.count("pictures of further sizes: searched in the same way") == 1


def test_sizes_are_reported_for_a_detector_of_boxes_without_a_range(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = np.full((480, 640, 3), 40, np.uint8)
    picture[120:200, 400:520] = (20, 20, 250)
    cv2.imwrite(str(tmp_path / "red.png"), picture)
    model = red_square_model(tmp_path / "model.onnx", [1, 3, 480, 640])
    assert run(tmp_path / "red.png", "--boxes", model, "--out", tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "longer sides of the boxes: 120 to 120 px" in said
    assert "searched at" not in said


def test_the_kind_whose_scores_are_given_is_named(
    pictures: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked: list[DetectorOptions] = []
    monkeypatch.setattr(
        CompactDetector, "load", classmethod(lambda cls, _, options: asked.append(options))
    )
    assert run(pictures, "--fruit", "tomato", "--out", tmp_path / "tomato") == 0
    assert (
        "scores are those of tomato, not of apple, orange, lemon, pear, peach\n"
        in capsys.readouterr().out
    )
    assert run(pictures, "--out", tmp_path / "apple") == 0
    assert "; from 0.5 on, 0.90 of the finds were apple" in capsys.readouterr().out
    assert [options.kind for options in asked] == ["tomato", "apple"]


def test_a_fruit_that_is_not_in_the_catalogue_is_refused(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("none", "plum"):
        assert run(pictures, "--fruit", name, "--out", tmp_path / "out") == 2
        assert f"no fruit named '{name}'" in capsys.readouterr().err
