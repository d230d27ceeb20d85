"""Settings of a model of boxes: metadata, the file beside it, and values that are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.skills.perception.detection.errors import BadWeights
from pomona.tools.box_detectors.box_settings import (
    BoxSettings,
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
    (tmp_path / "model.onnx.yaml").write_text("names: [pear, apple]\nimgsz: 320\n")
    settings = read_settings(tmp_path / "model.onnx", ULTRALYTICS)
    assert (settings.names, settings.imgsz) == ({0: "pear", 1: "apple"}, (320, 320))


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
        ("imgsz: 100000", "has imgsz '100000', expected height and width from 32 to 4096 px"),
        ("imgsz: [640]", "has imgsz .*, expected height and width"),
        ("stride: 0", "has stride '0', expected 1 to 4096 px"),
        ("task: classify", "has task 'classify', expected detect: export a model of boxes alone"),
        ("units: share", "has the key 'units', expected names, task, imgsz, stride"),
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
    ("names", "number"), [(["apple"], 0), (["pineapple", "apple"], 1), (["leaf", "Apple"], 1)]
)
def test_the_class_is_the_one_with_the_fruits_name(names: list[str], number: int) -> None:
    assert BoxSettings(dict(enumerate(names))).class_of("apple") == number


@pytest.mark.parametrize("names", [[], ["pineapple"], ["apple_leaf"], ["Apple", "apple"]])
def test_no_such_class_and_several_are_refused_with_the_cure(names: list[str]) -> None:
    with pytest.raises(ValueError, match=r"expected one named apple; write names: \{0: apple\}"):
        BoxSettings(dict(enumerate(names))).class_of("apple")
