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
STRETCHED = (
    np.array([460.0, 160.0 * 640 / 480, 120.0, 80.0 * 640 / 480]) / 640
)  # middle and size, as shares
ULTRALYTICS = {
    "description": "Ultralytics YOLO11n model",
    "task": "detect",
    "stride": "32",
    "imgsz": "[640, 640]",
}


def rows(places: int = 8400, extra: int = 0) -> Values:
    """YOLO's places: a sure pear, an apple, and places without an object."""
    values = np.zeros((1, 7 + extra, places))
    values[0, :4] = np.array([[320.0, 320.0, 600.0, 600.0]]).T
    values[0, :5, 0] = 60, 160, 40, 40, 0.95
    values[0, :4, 1], values[0, 5, 1] = (460, 240, 120, 80), 0.75
    values[0, 7:] = 5.5
    return values


def chosen(extra: int = 0) -> Values:
    values = np.zeros((1, 300, 6 + extra))
    values[0, 0, :6] = 40, 140, 80, 180, 0.95, 0
    values[0, 1, :6] = *LETTERBOXED, 0.75, 1
    values[0, :2, 6:] = 5.5
    return values


def queries() -> Values:
    values = np.full((1, 300, 7), 0.01)
    values[0, 0] = 0.1, 0.3, 0.05, 0.05, 0.95, 0.01, 0.01
    values[0, 1] = *STRETCHED, 0.01, 0.75, 0.02
    return values


def logits(columns: int, apple: int) -> tuple[Values, Values]:
    boxes, scores = np.full((1, 300, 4), 0.5), np.full((1, 300, columns), -6.0)
    boxes[0, 1], scores[0, 1, apple] = STRETCHED, np.log(3.0)  # a sigmoid of 0.75
    boxes[0, 2], scores[0, 2, apple - 1] = (0.2, 0.2, 0.1, 0.1), 4.0
    return boxes, scores


def lists(batch: bool = False, stretched: bool = False) -> tuple[Any, Any, Any]:
    corners = np.array(LETTERBOXED)
    if stretched:
        corners = 640 * np.concatenate(
            [STRETCHED[:2] - STRETCHED[2:] / 2, STRETCHED[:2] + STRETCHED[2:] / 2]
        )
    boxes, labels, scores = (
        np.array([(5, 85, 90, 190), corners]),
        np.array([0, 1]),
        np.array([0.95, 0.75]),
    )
    return (boxes[None], labels[None], scores[None]) if batch else (boxes, labels, scores)


def named(*names: str, values: tuple[Any, ...]) -> dict[str, Any]:
    return dict(zip(names, values, strict=True))


MASKS = np.zeros((1, 32, 8, 8))
NUMBERED = dict(
    zip(("2775", "labels", "2776"), lists(), strict=True)
)  # `labels` makes the test's file hold int64
FORMS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "YOLO without NMS": ({"output0": rows()}, {"metadata": ULTRALYTICS}),
    "YOLO without NMS, any size": ({"output0": rows()}, {"metadata": ULTRALYTICS, "shape": FREE}),
    "YOLO with NMS": ({"output0": chosen()}, {"metadata": ULTRALYTICS}),
    "YOLO, masks": (
        {"output0": rows(8400, 32), "output1": MASKS},
        {"metadata": {"task": "segment"}},
    ),
    "YOLO, points": (
        {"output0": rows(8400, 51)},
        {"metadata": {"task": "pose", "kpt_shape": "[17, 3]"}},
    ),
    "YOLO, masks, with NMS": (
        {"output0": chosen(32), "output1": MASKS},
        {"metadata": {"task": "segment"}},
    ),
    "YOLO as shares": ({"output0": rows() / np.array([640] * 4 + [1] * 3)[:, None]}, {}),
    "YOLO without metadata": ({"output0": rows()}, {}),
    "RT-DETR of Ultralytics": ({"output0": queries()}, {"metadata": ULTRALYTICS}),
    "RT-DETR": (
        named("labels", "boxes", "scores", values=[lists(True, True)[k] for k in (1, 0, 2)]),  # type: ignore[arg-type]
        {"sizes": "orig_target_sizes"},
    ),
    "RT-DETR of transformers": (named("pred_boxes", "logits", values=logits(3, 1)), {}),
    "RF-DETR": (named("dets", "labels", values=logits(4, 1)), {}),
    "RF-DETR with masks": (named("dets", "labels", "masks", values=(*logits(4, 1), MASKS)), {}),
    "torchvision": (named("boxes", "labels", "scores", values=lists()), {}),
    "torchvision without names of outputs": (NUMBERED, {}),
}


def model(path: Path, form: str) -> Path:
    outputs, options = FORMS[form]
    return write(path, outputs, **{"shape": SQUARE, "names": NAMES, **options})


@pytest.mark.parametrize("form", FORMS)
def test_each_exporters_form_gives_the_apple_and_not_the_pear(tmp_path: Path, form: str) -> None:
    (found,) = BoxModel(model(tmp_path / "model.onnx", form), "apple").find(PICTURE)
    assert np.allclose(found.box, BOX, atol=0.01)
    assert found.score == pytest.approx(0.75, abs=1e-6)


@pytest.mark.parametrize("form", FORMS)
def test_each_form_is_refused_if_it_disagrees_with_the_names(tmp_path: Path, form: str) -> None:
    outputs, options = FORMS[form]
    path = write(
        tmp_path / "model.onnx", outputs, **{"shape": SQUARE, **options, "names": "['apple']"}
    )
    with pytest.raises(
        BadWeights, match=r"(rows|columns) of scores for 1 named classes|gives a box of class 1"
    ) as caught:
        BoxModel(path, "apple")
    assert "\n" not in str(caught.value)


def test_points_without_their_number_disagree_with_the_names(tmp_path: Path) -> None:
    path = write(
        tmp_path / "model.onnx",
        {"output0": rows(8400, 51)},
        SQUARE,
        NAMES,
        metadata={"task": "pose"},
    )
    with pytest.raises(BadWeights, match="gives 54 rows of scores for 3 named classes"):
        BoxModel(path, "apple")


def test_numbers_of_coco_are_those_of_rf_detr_as_published(tmp_path: Path) -> None:
    path = write(tmp_path / "model.onnx", named("dets", "labels", values=logits(91, 53)), SQUARE)
    (tmp_path / "model.onnx.yaml").write_text("names: {53: apple}\n")
    (found,) = BoxModel(path, "apple").find(PICTURE)
    assert np.allclose(found.box, BOX, atol=0.01)


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


def test_shares_of_chosen_boxes_are_read_when_the_file_beside_says_so(tmp_path: Path) -> None:
    values = chosen() / np.array([640.0] * 4 + [1.0] * 2)
    path = write(tmp_path / "model.onnx", {"output0": values}, SQUARE, NAMES)
    with pytest.raises(BadWeights, match=r"write units: share into model\.onnx\.yaml"):
        BoxModel(path, "apple")
    (tmp_path / "model.onnx.yaml").write_text("units: share\n")
    (found,) = BoxModel(path, "apple").find(PICTURE)
    assert np.allclose(found.box, BOX, atol=0.01)


@pytest.mark.parametrize("row", [2, 5])
def test_one_value_of_8_400_that_is_not_finite_is_refused_where_it_counts(
    tmp_path: Path, row: int
) -> None:
    values = rows()
    values[0, row, 1] = np.nan  # of the apple: its width, its score
    path = write(tmp_path / "model.onnx", {"output0": values}, SQUARE, NAMES)
    with pytest.raises(BadWeights, match="gives values that are not finite, in 1 of 8400 boxes"):
        BoxModel(path, "apple")


def test_a_place_without_an_object_may_have_any_box(tmp_path: Path) -> None:
    values = rows()
    values[0, :4, 7] = np.inf
    path = write(tmp_path / "model.onnx", {"output0": values}, SQUARE, NAMES)
    assert len(BoxModel(path, "apple").find(PICTURE)) == 1
