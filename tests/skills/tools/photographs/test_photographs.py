"""Folders of pictures without fruit."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from pomona.skills.perception.detection.errors import BadPhotographs
from pomona.tools.photographs.photo_folder import read_empty, read_photographs
from tests.skills.tools.photographs.photo_folders import (
    SIDE,
    TRUTH,
    boxes_of,
    draw,
    kfuji,
    minneapple,
    tables,
)


def test_a_folder_without_fruit_is_read_and_one_without_pictures_refused(tmp_path: Path) -> None:
    folder = tables(tmp_path / "set") / "images"
    read = read_empty(folder)
    assert len(read) == 4
    assert not any(len(photo.boxes) for photo in read)
    (folder / "broken.jpg").write_bytes(b"no picture")
    with pytest.raises(BadPhotographs, match=r"broken\.jpg: cannot be read as a picture"):
        read_empty(folder)
    (tmp_path / "bare").mkdir()
    with pytest.raises(BadPhotographs, match="bare: holds no pictures"):
        read_empty(tmp_path / "bare")
    with pytest.raises(BadPhotographs, match="nowhere: no such folder"):
        read_empty(tmp_path / "nowhere")
    with pytest.raises(BadPhotographs, match=r"broken\.jpg: a file, expected the folder"):
        read_empty(folder / "broken.jpg")


def test_masks_of_minneapple_become_boxes_and_a_sequence_stays_together(tmp_path: Path) -> None:
    folder = minneapple(tmp_path)
    for k in range(2, 10):  # a third sequence, of which the last eighth is only a part
        for part in ("images", "masks"):
            path = folder / "detection" / "train" / part / f"2016_1_image{k}.png"
            assert cv2.imwrite(str(path), np.full((SIDE, SIDE), 3, np.uint8))
    photographs = read_photographs(folder / "detection" / "train")
    assert {photo.group for photo in photographs.val} == {"2016_1"}
    assert len(photographs.val) == 8
    truth = [np.array(boxes_of(discs)).reshape(-1, 4) for discs in TRUTH.values()]
    assert [len(photo.boxes) for photo in photographs.train] == [len(boxes) for boxes in truth]
    for photo, boxes in zip(photographs.train, truth, strict=True):
        assert np.allclose(photo.boxes, np.round(boxes), atol=1.0)


def test_kfujis_boxes_and_sets_are_read_from_the_folder_above(tmp_path: Path) -> None:
    photographs = read_photographs(kfuji(tmp_path))
    assert [photo.name for photo in photographs.train] == ["a_0hr.jpg", "a_1hr.jpg"]
    assert [photo.name for photo in photographs.val] == ["b_0hr.jpg", "b_1hr.jpg"]
    for photo, discs in zip((*photographs.train, *photographs.val), TRUTH.values(), strict=True):
        assert np.allclose(photo.boxes, np.array(boxes_of(discs)).reshape(-1, 4), atol=0.6)


MASKS, PLACE = "detection/train/masks", "KFuji_RGB-DS_dataset/preprocessed data"
MISTAKES = [
    (
        minneapple,
        lambda f: (f / MASKS / "2015_17a_image0.png").unlink(),
        r"image0\.png: has no mask in masks/, like 0",
    ),
    (
        minneapple,
        lambda f: (f / "detection/train/images/2015_17a_image0.png").unlink(),
        r"has no picture in images/",
    ),
    (
        minneapple,
        lambda f: (f / MASKS / "2015_17a_image0.png").write_bytes(b"no"),
        r"cannot be read as a picture",
    ),
    (
        minneapple,
        lambda f: draw(f / MASKS / "2015_17a_image0.png", []),
        r"has 3 channels, expected one",
    ),
    (
        minneapple,
        lambda f: cv2.imwrite(str(f / MASKS / "2015_17a_image0.png"), np.ones((99, 99), np.uint8)),
        r"is 240 × 240, .*image0\.png says 99 × 99",
    ),
    (
        kfuji,
        lambda f: (f / PLACE / "sets/val.txt").unlink(),
        r"val\.txt: cannot be read, expected a name per line",
    ),
    (
        kfuji,
        lambda f: (f / PLACE / "images/a_0hr.jpg").unlink(),
        r"a_0hr\.jpg: is labelled in .*a_0\.xml, but there is no",
    ),
    (
        kfuji,
        lambda f: (f / PLACE / "square_annotations1/a_0.xml").unlink(),
        r"a_0\.xml: is no annotation of KFuji",
    ),
    (
        kfuji,
        lambda f: (f / PLACE / "square_annotations1/a_0.xml").write_text("<a><b>"),
        r"is no annotation of KFuji",
    ),
    (
        kfuji,
        lambda f: (f / PLACE / "square_annotations1/a_0.xml").write_text("<!DOCTYPE a><a/>"),
        r"it declares a document type",
    ),
    (
        kfuji,
        lambda f: (f / PLACE / "square_annotations1/a_0.xml").write_text(
            "<a><bbox><xmin>1</xmin></bbox></a>"
        ),
        r"is no annotation of KFuji's: could not convert string to float",
    ),
    (
        kfuji,
        lambda f: (f / PLACE / "square_annotations1/a_0.xml").write_text(
            "<a><bbox><xmin>9</xmin><ymin>9</ymin><xmax>9</xmax><ymax>20</ymax></bbox></a>"
        ),
        r"a_0\.xml: object 1: a box without width or height",
    ),
]


@pytest.mark.parametrize(
    ("layout", "mistake", "says"), MISTAKES, ids=[says for _, _, says in MISTAKES]
)
def test_a_mistake_is_named_in_one_line(
    layout: Callable[[Path], Path], mistake: Callable[[Path], object], says: str, tmp_path: Path
) -> None:
    folder = layout(tmp_path)
    mistake(folder)
    with pytest.raises(BadPhotographs, match=says) as raised:
        read_photographs(folder)
    assert "\n" not in str(raised.value)
