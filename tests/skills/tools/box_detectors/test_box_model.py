"""Detectors of boxes as ONNX files: pictures as their inputs, and files of another form; `test_box_forms`: outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from pomona.skills.perception.detection.errors import BadWeights
from pomona.tools.box_detectors.box_model import BoxModel
from tests.skills.tools.box_detectors.onnx_boxes import (
    FLOAT,
    colour_model,
    red_square_model,
    save,
    write,
)


@pytest.mark.parametrize(
    "shape", [[1, 3, 320, 320], [1, 3, 240, 320], [1, 3, 192, 640], [1, 3, "h", "w"]]
)
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


SHARES = np.zeros((1, 300, 6))
SHARES[0, 0] = 0.4, 0.4, 0.6, 0.6, 0.9, 0
BY_MIDDLE = np.zeros((1, 300, 6))
BY_MIDDLE[0, 0] = 200, 200, 60, 60, 0.9, 0
ONE = {"boxes": [[10, 20, 40, 60]], "scores": [0.5]}
PLACES = {"output0": np.zeros((1, 6, 9))}
PLACE = {"output0": np.zeros((1, 5, 9))}


@pytest.mark.parametrize(
    ("outputs", "options", "message"),
    [
        ({"logits": [[1.0, 2.0]]}, {}, r"has the outputs logits \(1, 2\), expected one output"),
        ({"a": [[[1.0]]], "b": [1.0]}, {}, r"has the outputs a \(1, 1, 1\), b \(1\)"),
        ({"output0": np.zeros((1, 100, 6))}, {}, "has the classes without names: expected one named apple"),
        ({"output0": np.zeros((2, 5, 100))}, {}, r"has the outputs output0 \(2, 5, 100\)"),
        ({"boxes": [[1, 2, 3]], "scores": [0.5]}, {}, r"boxes \(1, 3\), scores \(1\)"),
        ({"output0": np.full((1, 5, 3), 7.0)}, {}, "gives scores from 7 to 7, expected 0 to 1"),
        ({"output0": np.full((1, 5, 3), -3.0)}, {}, "gives scores from -3 to -3, expected 0 to 1"),
        (PLACES, {}, r"output0 \(1, 6, 9\), for 1 classes, expected"),
        ({**ONE, "labels": [1]}, {}, "has the classes without names"),
        (PLACES, {"names": "['pear', 'plum']"}, r"has the classes pear, plum: expected one named apple; write names: \{0"),
        (PLACES, {"names": "{0: 'pear', 7: 'apple'}"}, "names 2 classes, expected the numbers 0 to 1"),
        (PLACE, {"names": "['pineapple']"}, "classes pineapple: expected one named apple"),
        ({"output0": BY_MIDDLE}, {"names": "['apple']"}, "gives a box whose right end lies left of its left one"),
        ({"output0": np.full((1, 5, 9), np.nan)}, {"names": "['apple']"}, "values that are not finite, in 9 of its boxes"),
        ({"output0": SHARES}, {"names": "['apple']"}, "boxes in shares of the input, expected pixels"),
        (PLACE, {"metadata": {"task": "segment"}}, "has metadata task 'segment', expected detect: export"),
        (PLACES, {"names": "apple, pear"}, "has metadata names 'apple, pear'"),
        (ONE, {"shape": ["b", "h", "w", 3]}, r"has the input \(b, h, w, 3\)"),
        (ONE, {"shape": [1, 240, 320, 3]}, r"has the input \(1, 240, 320, 3\) of tensor\(float\), expected one input"),
        (ONE, {"shape": [4, 3, 240, 320]}, r"has the input \(4, 3, 240, 320\)"),
        (ONE, {"shape": [240, 320]}, r"has the input \(240, 320\)"),
        (ONE, {"kind": TensorProto.UINT8}, r"of tensor\(uint8\), expected one input"),
    ],
)  # fmt: skip
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
    for text, message in (
        ("", r"a\.onnx: cannot be read as ONNX: the file is empty$"),
        (
            "version https://git-lfs.github.com/spec/v1\noid sha256:aa\nsize 9\n",
            "a pointer of Git LFS, .*: run `git lfs",
        ),
    ):
        (tmp_path / "a.onnx").write_text(text)
        with pytest.raises(BadWeights, match=message):
            BoxModel(tmp_path / "a.onnx", "apple")
    newer = onnx.load(write(tmp_path / "newer.onnx", ONE))
    newer.ir_version = 99
    onnx.save(newer, tmp_path / "newer.onnx")
    with pytest.raises(BadWeights, match=r"cannot be read as ONNX: \w+: [^:]*IR version: 99"):
        BoxModel(tmp_path / "newer.onnx", "apple")
    (tmp_path / "text.onnx").write_text("not ONNX")
    with pytest.raises(BadWeights, match=r"text\.onnx: cannot be read as ONNX"):
        BoxModel(tmp_path / "text.onnx", "apple")
    inputs = [helper.make_tensor_value_info(name, FLOAT, [1, 3, 64, 64]) for name in ("a", "b")]
    nodes = [helper.make_node("Add", ["a", "b"], ["boxes"])]
    two = save(
        tmp_path / "two.onnx",
        nodes,
        inputs,
        [helper.make_tensor_value_info("boxes", FLOAT, [1, 3, 64, 64])],
    )
    with pytest.raises(BadWeights, match="has 2 inputs, expected one input"):
        BoxModel(two, "apple")


def test_an_input_of_free_size_has_the_size_that_the_file_names(tmp_path: Path) -> None:
    boxes = {"boxes": [[0, 80, 640, 560]], "scores": [0.9]}
    path = write(
        tmp_path / "free.onnx",
        boxes,
        [1, 3, "h", "w"],
        metadata={"imgsz": "[640, 640]", "stride": "32"},
    )
    (found,) = BoxModel(path, "apple", working_width=320).find(np.zeros((240, 320, 3), np.uint8))
    assert np.allclose(found.box, (0, 0, 320, 240))


def test_colours_are_red_green_and_blue_from_0_to_1(tmp_path: Path) -> None:
    path = colour_model(tmp_path / "red.onnx")
    (found,) = BoxModel(path, "apple").find(np.full((240, 320, 3), (102, 0, 51), np.uint8))
    assert found.score == pytest.approx(0.4, abs=1e-4)
