"""`pomona data pack`: pictures, boxes, splits and parts are those of the folder, smaller."""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import pytest

from pomona.executive.values.pictures import write_picture
from pomona.tools.photographs.photo_folder import read_photographs
from pomona.tools.photographs.photographs import FRUIT_IN_INPUT, joined
from pomona.tools.training import command_pack


def write_folder(folder: Path, side: int = 900, fruit: int = 90) -> Path:
    """Six pictures of a place each, with a red disc and a doubtful box; the last two are for val."""
    (folder / "images").mkdir(parents=True)
    images, boxes = ["image,group,split"], ["image,x,y,w,h,crowd"]
    for k in range(6):
        picture = np.random.default_rng(k).integers(0, 60, (side // 2, side, 3)).astype(np.uint8)
        cv2.circle(picture, (200 + 40 * k, 200), fruit // 2, (230, 30, 30), -1)
        write_picture(folder / "images" / f"p{k}.png", picture)
        images.append(f"p{k}.png,place{k},{'train' if k < 4 else 'val'}")
        boxes += [
            f"p{k}.png,{200 + 40 * k - fruit / 2},{200 - fruit / 2},{fruit},{fruit},0",
            f"p{k}.png,5,5,30,20,1",
        ]
    (folder / "images.csv").write_text("\n".join(images) + "\n")
    (folder / "fruit.csv").write_text("\n".join(boxes) + "\n")
    return folder


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    command_pack.add(parser.add_subparsers(required=True))
    options = parser.parse_args(["pack", *arguments])
    status: int = options.main(options)
    return status


def test_a_pack_is_read_as_the_folder_is_only_smaller(tmp_path: Path) -> None:
    folder, out = write_folder(tmp_path / "photos"), tmp_path / "pack"
    assert run(str(folder), "--out", str(out), "--side", "450") == 0
    before, after = read_photographs(folder), read_photographs(out / "part_1")
    assert [len(after.train), len(after.val)] == [4, 2]
    assert not list(out.glob(".*"))
    for one, other in zip((*before.train, *before.val), (*after.train, *after.val), strict=True):
        assert (other.width, other.height, other.group) == (450, 225, one.group)
        np.testing.assert_allclose(other.boxes, 0.5 * one.boxes, atol=0.01)
        assert other.crowd.tolist() == one.crowd.tolist() == [False, True]
        x, y, w, h = other.boxes[0]
        red, green, _ = other.picture()[int(y + h / 2), int(x + w / 2)].astype(int)
        assert red > green + 100
    assert after.train[0].scale == pytest.approx(2.0 * before.train[0].scale, rel=1e-3)


def test_a_small_picture_is_not_enlarged(tmp_path: Path) -> None:
    assert (
        run(
            str(write_folder(tmp_path / "photos")),
            "--out",
            str(tmp_path / "pack"),
            "--side",
            "2000",
        )
        == 0
    )
    assert read_photographs(tmp_path / "pack" / "part_1").train[0].width == 900


def test_parts_keep_to_their_size_and_each_has_both_splits(tmp_path: Path) -> None:
    photos = read_photographs(write_folder(tmp_path / "photos"))
    rows = [(photo, "train") for photo in photos.train] + [(photo, "val") for photo in photos.val]
    one = command_pack.write_pack(tmp_path / "whole", rows, 448, 50)
    parts = command_pack.write_pack(tmp_path / "pack", rows, 448, 50, most=int(0.7 * one[0][1]))
    assert len(parts) == 2
    assert all(size <= 0.7 * one[0][1] for _, size in parts)
    sets = [read_photographs(folder) for folder, _ in parts]
    assert [(len(part.train), len(part.val)) for part in sets] == [(2, 1), (2, 1)]
    assert sorted(photo.group for photo in joined(sets).train) == [f"place{k}" for k in range(4)]


def test_sets_that_are_joined_keep_their_scales(tmp_path: Path) -> None:
    sets = [
        read_photographs(write_folder(tmp_path / str(fruit), fruit=fruit)) for fruit in (60, 120)
    ]
    assert {round(photo.scale, 6) for photo in joined(sets).train} == {
        round(FRUIT_IN_INPUT / median, 6)
        for median in (45.0, 75.0)  # of a disc and a doubtful box of 30 px
    }


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--side", "8"), "--side 8 --quality 50: at least 64 px, and 1 to 100"),
        (("--quality", "0"), "--side 448 --quality 0"),
        (("--out", "{full}"), "expected a new folder"),
    ],
)
def test_impossible_options_write_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a").write_text("a")
    filled = [word.format(full=tmp_path / "full") for word in arguments]
    folder = write_folder(tmp_path / "photos")
    assert (
        run(str(folder), *([] if "--out" in filled else ["--out", str(tmp_path / "pack")]), *filled)
        == 2
    )
    assert message in capsys.readouterr().err
    assert not (tmp_path / "pack").exists()


def test_a_folder_without_labels_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(str(tmp_path), "--out", str(tmp_path / "pack")) == 2
    assert "has no labels" in capsys.readouterr().err
