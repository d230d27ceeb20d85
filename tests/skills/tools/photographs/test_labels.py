"""COCO's labels are read strictly, and every other form is refused by its name in one line."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from pomona.tools.photographs.labels import BadLabels, read_labels
from tests.skills.tools.photographs.labelled import SIDE, TRUTH, boxes_of, content


def write(path: Path, said: Any) -> Path:
    path.write_text(json.dumps(said))
    return path


def test_the_boxes_of_the_fruits_category_are_read_for_every_picture(tmp_path: Path) -> None:
    read = read_labels(write(tmp_path / "labels.json", content()), "apple")
    assert [str(picture.name) for picture in read] == list(TRUTH)
    for picture, discs in zip(read, TRUTH.values(), strict=True):
        assert (picture.width, picture.height) == (SIDE, SIDE)
        wanted = np.array(boxes_of(discs)).reshape(-1, 4)
        assert np.array(picture.boxes).reshape(-1, 4) == pytest.approx(wanted)
        assert picture.crowds == []


def test_a_box_of_several_fruit_is_kept_apart_and_one_at_the_border_is_cut(tmp_path: Path) -> None:
    said = content()
    said["annotations"] = [
        {"image_id": 3, "category_id": 7, "bbox": [10, 10, 90, 90], "iscrowd": 1},
        {"image_id": 3, "category_id": 7, "bbox": [-2.0, 200, 30, 42.5]},
    ]
    picture = read_labels(write(tmp_path / "labels.json", said), "apple")[3]
    assert [box.tolist() for box in picture.crowds] == [[10, 10, 90, 90]]
    assert [box.tolist() for box in picture.boxes] == [[0, 200, 28, 40]]


def changed(key: str, number: int, **values: Any) -> Callable[[dict[str, Any]], None]:
    def change(said: dict[str, Any]) -> None:
        entry = said[key][number]
        for name, value in values.items():
            if value is None:
                del entry[name]
            else:
                entry[name] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda said: said.pop("images"), "has no list of images, expected COCO's"),
        (lambda said: said.update(annotations={}), "has no list of annotations"),
        (changed("images", 1, id=0), "two of its images have one id"),
        (changed("categories", 0, id=7), "two of its categories have one id"),
        (changed("categories", 1, name="pear"), "has the categories leaf, pear: expected one with the name apple"),
        (changed("categories", 0, name="apple"), "has the categories apple, Apple: expected one"),
        (changed("images", 2, file_name=None), "images[2] has no 'file_name'"),
        (changed("images", 2, width="wide"), "images[2]: invalid literal"),
        (changed("annotations", 1, image_id=99), "annotations[1] has no 99, or no entry has this id"),
        (changed("annotations", 1, category_id=99), "annotations[1] has no 99"),
        (changed("annotations", 1, bbox=None), "annotations[1] has no 'bbox'"),
        (changed("annotations", 1, bbox=[1, 2, 3]), "annotations[1]: not enough values"),
        (changed("annotations", 1, bbox=[1, 2, "three", 4]), "annotations[1]: could not convert"),
        (changed("annotations", 1, bbox=[10, 10, 0, 20]), "is not inside 240 × 240 px"),
        (changed("annotations", 1, bbox=[10, 10, float("nan"), 20]), "is not inside 240 × 240 px"),
        (changed("annotations", 1, bbox=[150, 130, 200, 180]), "x, y, w, h 150, 130, 200, 180 is not inside"),
        (lambda said: said["images"].append(7), "images[4]: "),
    ],
)  # fmt: skip
def test_an_entry_that_cannot_be_used_is_named_in_one_line(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    said = content()
    change(said)
    path = write(tmp_path / "labels.json", said)
    with pytest.raises(BadLabels) as caught:
        read_labels(path, "apple")
    assert str(caught.value).startswith(f"{path}: ")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def made(folder: Path, name: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text("")
    return folder


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("labels/a.txt", "YOLO's texts, expected a JSON file of COCO: convert them: datum convert -if yolo -i FOLDER"),
        ("annotations/a.xml", "Pascal VOC's XML, expected a JSON file of COCO: convert them: datum convert -if voc"),
        ("fruit.csv", "a table, expected a JSON file of COCO: write its rows as"),
        ("masks/a.png", "masks, expected a JSON file of COCO: convert them to COCO's boxes"),
        ("labels.json", "a folder, expected a JSON file of COCO: name the JSON file in it"),
        ("a.png", "holds no labels, expected a JSON file of COCO"),
    ],
)  # fmt: skip
def test_another_form_is_refused_by_its_name_with_its_converter(
    tmp_path: Path, name: str, words: str
) -> None:
    with pytest.raises(BadLabels) as caught:
        read_labels(made(tmp_path / "set", name), "apple")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_single_file_of_another_form_and_damaged_ones_are_refused(tmp_path: Path) -> None:
    for name, words in (("a.txt", "YOLO's texts"), ("a.xml", "Pascal VOC"), ("a.csv", "a table")):
        (tmp_path / name).write_text("0 0.5 0.5 0.1 0.1\n")
        with pytest.raises(BadLabels, match=words):
            read_labels(tmp_path / name, "apple")
    with pytest.raises(BadLabels, match=r"none\.json: no such file"):
        read_labels(tmp_path / "none.json", "apple")
    for text in ("", "{", "[" * 100_000, "\x00", "[]", "7"):
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(BadLabels, match=r"a\.json: (is no JSON|has no list of categories)"):
            read_labels(tmp_path / "a.json", "apple")


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)  # fmt: skip


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(["images", "annotations", "categories"]), st.text(max_size=9), PLAIN)
def test_any_value_is_read_or_refused(tmp_path: Path, key: str, name: str, value: Any) -> None:
    said: Any = content()
    for entry in said[key]:
        entry[name] = value
    said[key].append(value)
    with contextlib.suppress(BadLabels):
        read_labels(write(tmp_path / "labels.json", said), "apple")
