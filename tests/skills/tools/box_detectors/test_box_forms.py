"""Forms of detectors' outputs, each in a small file as its exporter writes it: the same apple is found in all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.skills.perception.detection.errors import BadWeights
from pomona.tools.box_detectors.box_model import BoxModel
from tests.skills.tools.box_detectors.onnx_boxes import write

Values = np.ndarray[Any, np.dtype[np.float64]]

NAMES = "{0: 'pear', 1: 'apple', 2: 'leaf'}"
SQUARE, FREE = [1, 3, 640, 640], [1, 3, "h", "w"]
PICTURE = np.zeros((480, 640, 3), np.uint8)  # lies at 80 px from above in a square input
BOX = (400.0, 120.0, 120.0, 80.0)  # of the apple, x, y, w, h [px of the picture]
LETTERBOXED = (400.0, 200.0, 520.0, 280.0)  # its corners in a square input
ULTRALYTICS = {
    "description": "Ultralytics YOLO11n model",
    "task": "detect",
    "stride": "32",
    "imgsz": "[640, 640]",
}


def rows(places: int = 8400) -> Values:
    """YOLO's places: a sure pear, an apple, and places without an object."""
    values = np.zeros((1, 7, places))
    values[0, :4] = np.array([[320.0, 320.0, 600.0, 600.0]]).T
    values[0, :5, 0] = 60, 160, 40, 40, 0.95
    values[0, :4, 1], values[0, 5, 1] = (460, 240, 120, 80), 0.75
    return values


def chosen() -> Values:
    values = np.zeros((1, 300, 6))
    values[0, 0] = 40, 140, 80, 180, 0.95, 0
    values[0, 1] = *LETTERBOXED, 0.75, 1
    return values


LISTS = {
    "boxes": np.array([(5.0, 85.0, 90.0, 190.0), LETTERBOXED]),
    "labels": np.array([0, 1]),
    "scores": np.array([0.95, 0.75]),
}
FORMS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "YOLO without NMS": ({"output0": rows()}, {"metadata": ULTRALYTICS}),
    "YOLO without NMS, any size": ({"output0": rows()}, {"metadata": ULTRALYTICS, "shape": FREE}),
    "YOLO with NMS": ({"output0": chosen()}, {"metadata": ULTRALYTICS}),
    "YOLO without metadata": ({"output0": rows()}, {}),
    "torchvision": (LISTS, {}),
    "torchvision, one picture without a batch": (LISTS, {"shape": [3, 640, 640]}),
}


@pytest.mark.parametrize("form", FORMS)
def test_each_exporters_form_gives_the_apple_and_not_the_pear(tmp_path: Path, form: str) -> None:
    outputs, options = FORMS[form]
    path = write(tmp_path / "model.onnx", outputs, **{"shape": SQUARE, "names": NAMES, **options})
    (found,) = BoxModel(path, "apple").find(PICTURE)
    assert np.allclose(found.box, BOX, atol=0.01)
    assert found.score == pytest.approx(0.75, abs=1e-6)


@pytest.mark.parametrize("form", FORMS)
def test_the_file_beside_the_model_names_its_classes(tmp_path: Path, form: str) -> None:
    outputs, options = FORMS[form]
    path = write(tmp_path / "model.onnx", outputs, **{"shape": SQUARE, **options})
    (tmp_path / "model.onnx.yaml").write_text("names: [birne, apple, blatt]\n")
    (found,) = BoxModel(path, "apple").find(PICTURE)
    assert np.allclose(found.box, BOX, atol=0.01)


OTHERS: dict[str, dict[str, Any]] = {
    "RT-DETR of Ultralytics": {"output0": np.full((1, 300, 7), 0.01)},
    "YOLO with masks": {"output0": np.zeros((1, 39, 8400)), "output1": np.zeros((1, 32, 8, 8))},
    "RT-DETR of transformers": {"pred_boxes": np.zeros((1, 9, 4)), "logits": np.zeros((1, 9, 3))},
    "RF-DETR": {"dets": np.zeros((1, 300, 4)), "labels": np.zeros((1, 300, 4))},
    "a classifier": {"logits": np.zeros((1, 1000))},
}


@pytest.mark.parametrize("form", OTHERS)
def test_every_other_form_is_refused_by_the_names_of_its_outputs(tmp_path: Path, form: str) -> None:
    path = write(tmp_path / "model.onnx", OTHERS[form], SQUARE, NAMES)
    with pytest.raises(BadWeights) as caught:
        BoxModel(path, "apple")
    assert all(f"{name} (" in str(caught.value) for name in OTHERS[form])
    assert "expected one output (1, 4 + classes, n) or (1, n, 6), as Ultralytics" in str(
        caught.value
    )
    assert "\n" not in str(caught.value)


def test_another_number_of_classes_than_the_names_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "model.onnx", {"output0": rows()}, SQUARE, "['apple']")
    with pytest.raises(BadWeights, match=r"output0 \(1, 7, 8400\), for 1 classes, expected"):
        BoxModel(path, "apple")


def test_of_two_boxes_of_one_fruit_the_surer_one_is_kept(tmp_path: Path) -> None:
    outputs = {
        "boxes": [[10, 20, 40, 60], [100, 100, 150, 140], [11, 20, 40, 60], [5, 5, 9, 9]],
        "labels": [53, 1, 53, 53],
        "scores": [0.7, 0.9, 0.8, 0.01],
    }
    path = write(tmp_path / "rcnn.onnx", outputs, [3, "h", "w"], "{0: 'person', 53: 'apple'}")
    (found,) = BoxModel(path, "apple").find(np.zeros((512, 640, 3), np.uint8))
    assert found.score == pytest.approx(0.8)
    assert np.allclose(found.box, (22, 40, 58, 80))  # the input is half as wide as the picture


@pytest.mark.parametrize("row", [2, 5])
def test_one_value_of_8_400_that_is_not_finite_is_refused_where_it_counts(
    tmp_path: Path, row: int
) -> None:
    values = rows()
    values[0, row, 1] = np.nan  # of the apple: its width, its score
    path = write(tmp_path / "model.onnx", {"output0": values}, SQUARE, NAMES)
    with pytest.raises(BadWeights, match="gives values that are not finite, in 1 of its boxes"):
        BoxModel(path, "apple")


def test_a_place_without_an_object_may_have_any_box(tmp_path: Path) -> None:
    values = rows()
    values[0, :4, 7] = np.inf
    path = write(tmp_path / "model.onnx", {"output0": values}, SQUARE, NAMES)
    assert len(BoxModel(path, "apple").find(PICTURE)) == 1
