"""Detectors of boxes as ONNX files: both layouts, sizes of the input, classes, and files of another form."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import TensorProto, helper

from pomona.skills.perception.detection.box_model import BoxModel, ClassUnknown, class_of
from pomona.skills.perception.detection.errors import BadWeights
from tests.skills.perception.detection.onnx_boxes import FLOAT, red_square_model, save, write


@pytest.mark.parametrize("shape", [[1, 3, 320, 320], [1, 3, 240, 320], [1, 3, 192, 640], [1, 3, "h", "w"]])
def test_a_box_is_in_pixels_of_the_picture_whatever_the_size_of_the_input(
    tmp_path: Path, shape: list[int | str]
) -> None:
    model = BoxModel(red_square_model(tmp_path / "red.onnx", shape), "apple")
    picture = np.full((480, 640, 3), 40, np.uint8)
    picture[120:200, 400:520] = (250, 20, 20)
    (found,) = model.find(picture)
    assert np.allclose(found.box, (400, 120, 120, 80), atol=6.0)
    assert found.score == pytest.approx(230 / 255, abs=0.02)


def test_a_picture_without_the_object_has_no_boxes(tmp_path: Path) -> None:
    model = BoxModel(red_square_model(tmp_path / "red.onnx", [1, 3, "h", "w"]), "apple")
    assert model.find(np.zeros((480, 640, 3), np.uint8)) == []


def test_torchvisions_outputs_are_read_with_the_labels_of_the_fruit_alone(tmp_path: Path) -> None:
    outputs = {
        "boxes": [[10, 20, 40, 60], [100, 100, 150, 140], [11, 20, 40, 60], [5, 5, 9, 9]],
        "labels": [53, 1, 53, 53],
        "scores": [0.7, 0.9, 0.8, 0.01],
    }
    path = write(tmp_path / "rcnn.onnx", outputs, [3, "h", "w"], "{0: 'person', 53: 'apple'}")
    (found,) = BoxModel(path, "apple").find(np.zeros((480, 640, 3), np.uint8))
    assert found.score == pytest.approx(0.8)  # of two boxes of one fruit, the surer one
    assert np.allclose(found.box, (22, 40, 58, 80))  # the input is half as wide as the picture


def test_yolos_scores_are_those_of_the_fruits_class(tmp_path: Path) -> None:
    places = np.zeros((1, 7, 8))
    places[0, :4, 0], places[0, 5, 0] = (160, 120, 40, 40), 0.75
    places[0, :4, 1], places[0, 4, 1] = (60, 60, 40, 40), 0.9
    path = write(tmp_path / "yolo.onnx", {"output0": places}, names="['pear', 'apple', 'leaf']")
    (found,) = BoxModel(path, "apple").find(np.zeros((480, 640, 3), np.uint8))
    assert (found.score, *found.box) == pytest.approx((0.75, 280, 200, 80, 80))


PARTS = np.zeros((1, 5, 9))
PARTS[0, :, 0] = 0.5, 0.5, 0.1, 0.1, 0.9
ONE = {"boxes": [[10, 20, 40, 60]], "scores": [0.5]}


@pytest.mark.parametrize(
    ("outputs", "options", "message"),
    [
        ({"logits": [[1.0, 2.0]]}, {}, r"has the outputs logits \(1, 2\), expected boxes \(n, 4\) and scores"),
        ({"a": [[[1.0]]], "b": [1.0]}, {}, r"has the outputs a \(1, 1, 1\), b \(1\)"),
        ({"output0": np.zeros((1, 100, 6))}, {}, r"has the outputs output0 \(1, 100, 6\)"),
        ({"boxes": [[1, 2, 3]], "scores": [0.5]}, {}, r"boxes \(1, 3\), scores \(1\)"),
        ({"output0": np.full((1, 5, 3), 7.0)}, {}, "gives scores from 7 to 7, expected 0 to 1"),
        ({"output0": np.zeros((1, 6, 9))}, {}, "has several classes without names"),
        ({**ONE, "labels": [1]}, {}, "has several classes without names"),
        ({"output0": np.zeros((1, 6, 9))}, {"names": "['pear', 'plum']"}, "classes pear, plum: none of them is apple"),
        (
            {"output0": np.zeros((1, 6, 9))},
            {"names": "{0: 'pear', 7: 'apple'}"},
            "names apple as class 7, and gives scores of 2",
        ),
        (
            {"output0": np.zeros((1, 7, 9))},
            {"names": "['apple', 'pear']"},
            "gives 3 rows of scores for 2 named classes",
        ),
        ({"output0": np.zeros((1, 6, 9))}, {"names": "['apple', 'pear', 'leaf']"}, "gives 2 rows of scores for 3"),
        ({"output0": np.zeros((1, 5, 9))}, {"names": "['pineapple']"}, "classes pineapple: none of them is apple"),
        ({"output0": np.zeros((1, 5, 9))}, {"names": "['apple', 'pear']"}, "gives 1 rows of scores for 2"),
        ({"output0": np.zeros((1, 300, 6))}, {"names": "['apple', 'pear']"}, "already chosen, export it without nms"),
        ({"output0": PARTS}, {"names": "['apple']"}, "boxes in parts of the picture"),
        ({"output0": np.zeros((1, 6, 9))}, {"names": "apple, pear"}, "has metadata names 'apple, pear'"),
        (ONE, {"shape": [1, 240, 320, 3]}, r"has the input \(1, 240, 320, 3\) of tensor\(float\), expected one input"),
        (ONE, {"shape": [4, 3, 240, 320]}, r"has the input \(4, 3, 240, 320\)"),
        (ONE, {"shape": [240, 320]}, r"has the input \(240, 320\)"),
        (ONE, {"kind": TensorProto.UINT8}, r"of tensor\(uint8\), expected one input"),
    ],
)
def test_models_of_another_form_are_refused_in_one_line(
    tmp_path: Path, outputs: dict[str, Any], options: dict[str, Any], message: str
) -> None:
    path = write(tmp_path / "model.onnx", outputs, **options)
    with pytest.raises(BadWeights, match=message) as caught:
        BoxModel(path, "apple")
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_files_that_are_no_models_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadWeights, match=r"none\.onnx: no such file"):
        BoxModel(tmp_path / "none.onnx", "apple")
    (tmp_path / "text.onnx").write_text("not ONNX")
    with pytest.raises(BadWeights, match=r"text\.onnx: cannot be read as ONNX"):
        BoxModel(tmp_path / "text.onnx", "apple")
    inputs = [helper.make_tensor_value_info(name, FLOAT, [1, 3, 64, 64]) for name in ("a", "b")]
    nodes = [helper.make_node("Add", ["a", "b"], ["boxes"])]
    two = save(tmp_path / "two.onnx", nodes, inputs, [helper.make_tensor_value_info("boxes", FLOAT, [1, 3, 64, 64])])
    with pytest.raises(BadWeights, match="has 2 inputs, expected one input"):
        BoxModel(two, "apple")


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
    ],
)
def test_the_class_is_the_one_of_the_fruits_name_else_the_one_that_has_it_as_a_word(
    names: list[str], number: int
) -> None:
    assert class_of(dict(enumerate(names)), "apple") == number


@pytest.mark.parametrize(
    "names", [["pineapple"], ["pineapple", "pear"], ["grapple"], ["appletree"], ["custardapple"], []]
)
def test_a_part_of_a_word_is_no_fruit(names: list[str]) -> None:
    with pytest.raises(ClassUnknown, match="none of them is apple"):
        class_of(dict(enumerate(names)), "apple")


def test_several_that_could_be_the_fruit_are_refused() -> None:
    for names in (["red apple", "green apple"], ["Apple", "APPLE"], ["Apples", "APPLES"]):
        with pytest.raises(ClassUnknown, match="2 of them could be apple"):
            class_of(dict(enumerate(names)), "apple")


@pytest.mark.parametrize(
    ("fruit", "name"), [("cherry tomato", "Cherry-Tomatoes"), ("peach", "peaches"), ("berry", "berries")]
)
def test_fruit_of_two_words_and_plurals_are_words(fruit: str, name: str) -> None:
    assert class_of({0: "other", 1: name, 2: "tomato sauce"}, fruit) == 1
