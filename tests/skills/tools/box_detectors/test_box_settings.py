"""Settings of a model of boxes: metadata, the file beside it, and values that are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.skills.perception.detection.errors import BadWeights
from pomona.tools.box_detectors.box_settings import (
    BoxSettings,
    ClassUnknown,
    class_of,
    read_settings,
)

ULTRALYTICS = {
    "description": "Ultralytics YOLO11n model trained on apples.yaml",
    "stride": "32",
    "task": "detect",
    "batch": "1",
    "imgsz": "[480, 640]",
    "names": "{0: 'apple', 1: 'pear'}",
    "args": "{'batch': 1, 'nms': False}",
}


def test_ultralytics_metadata_is_read(tmp_path: Path) -> None:
    settings = read_settings(tmp_path / "model.onnx", ULTRALYTICS)
    assert settings == BoxSettings({0: "apple", 1: "pear"}, "detect", imgsz=(480, 640), stride=32)


def test_the_file_beside_the_model_overrides_the_metadata(tmp_path: Path) -> None:
    (tmp_path / "model.onnx.yaml").write_text(
        "names: [pear, apple]\nimgsz: 320\nmean: [0.5, 0.5, 0.5]\n"
    )
    settings = read_settings(tmp_path / "model.onnx", ULTRALYTICS)
    assert (settings.names, settings.imgsz) == ({0: "pear", 1: "apple"}, (320, 320))
    assert settings.mean == (0.5, 0.5, 0.5)


def test_without_both_the_form_of_the_outputs_decides(tmp_path: Path) -> None:
    assert read_settings(tmp_path / "model.onnx", {}) == BoxSettings({})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nmaes: [apple]", "has the key 'nmaes', expected names, task"),
        ("[apple]", r"has the key .*, expected names, task"),
        ("names: apple", "has names 'apple', expected a list or {0: 'apple'}"),
        ("names: {apple: 0}", "has names .*, expected a list or"),
        ("names: 7", "has names '7', expected a list"),
        ("fit: crop", "has fit 'crop', expected letterbox or stretch"),
        ("units: mm", "has units 'mm', expected pixels or share"),
        ("order: gbr", "has order 'gbr', expected rgb or bgr"),
        ("range: 255", "has range '255', expected 0..1 or 0..255"),
        ("std: [0, 1, 1]", "has std .*, expected three numbers above 0"),
        ("mean: [1, 2]", "has mean .*, expected three numbers"),
        ("mean: [.nan, 0, 0]", "has mean .*, expected three numbers"),
        ("imgsz: 100000", "has imgsz '100000', expected height and width from 32 to 4096 px"),
        ("imgsz: [640]", "has imgsz .*, expected height and width"),
        ("stride: 0", "has stride '0', expected 1 to 4096 px"),
        ("task: classify", "has task 'classify', expected detect or segment or pose"),
        ("names: [", "cannot be read: "),
    ],
)
def test_a_wrong_value_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "model.onnx.yaml").write_text(f"{text}\n")
    with pytest.raises(BadWeights, match=rf"model\.onnx\.yaml: {words}") as caught:
        read_settings(tmp_path / "model.onnx", {})
    assert "\n" not in str(caught.value)


def test_damaged_metadata_is_refused_with_its_key(tmp_path: Path) -> None:
    with pytest.raises(BadWeights, match="has metadata names 'apple, pear', expected a list"):
        read_settings(tmp_path / "model.onnx", {"names": "apple, pear"})


@pytest.mark.parametrize(
    ("names", "number"),
    [
        (["apple"], 0),
        (["pineapple", "apple"], 1),
        (["rotten apple", "apple"], 1),
        (["leaf", "Apple"], 1),
        (["leaf", "red_apple"], 1),
        (["leaf", "GreenApple2"], 1),
        (["leaf", "apples"], 1),
        (["apples", "apple-detection-v3"], 0),
        (["apples", "apple"], 1),
        (["Apple", "apple"], 1),
        (["Apfel", "apple (fruit)"], 1),
        (["apple tree", "apple leaves", "Apple Braeburn"], 2),
    ],
)
def test_the_class_is_the_one_of_the_fruits_name_else_the_one_that_has_it_as_a_word(
    names: list[str], number: int
) -> None:
    assert class_of(dict(enumerate(names)), "apple") == number


@pytest.mark.parametrize(
    "names",
    [
        *(["pineapple"], ["pineapple", "pear"], ["grapple"], ["appletree"], ["custardapple"], []),
        *(["apple_leaf"], ["AppleLeaves", "not apple"], ["apple-flower"]),
    ],
)
def test_a_part_of_a_word_is_no_fruit(names: list[str]) -> None:
    with pytest.raises(ClassUnknown, match="none of them is apple"):
        class_of(dict(enumerate(names)), "apple")


def test_several_that_could_be_the_fruit_are_refused() -> None:
    for names in (["red apple", "green apple"], ["Apple", "APPLE"], ["Apples", "APPLES"]):
        with pytest.raises(ClassUnknown, match="2 of them could be apple"):
            class_of(dict(enumerate(names)), "apple")


@pytest.mark.parametrize(
    ("fruit", "name"),
    [("cherry tomato", "Cherry-Tomatoes"), ("peach", "peaches"), ("berry", "berries")],
)
def test_fruit_of_two_words_and_plurals_are_words(fruit: str, name: str) -> None:
    assert class_of({0: "other", 1: name, 2: "tomato sauce"}, fruit) == 1
