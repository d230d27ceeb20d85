"""Proposes labels from recorded frames: detections whose depth has a fruit's shape, and fruit that was picked."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.executive.values.pictures import write_picture
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.fruit import FruitModel
from pomona.tools.box_detectors.box_detector import NoSphere, sphere_in_box

SURE = 0.6  # least score of a detection that becomes a label, the default of Detect's `score`
DOUBTFUL = (
    0.2  # detections with at least this score and without a label are neither fruit nor background
)

SIZES = 0.4, 1.6  # least and greatest size relative to the CAD model, as Refine's defaults
VAL_EVERY = 4  # interval of the runs that are used for validation


@dataclass(frozen=True, eq=False)
class RecordedLook:
    """One frame in which a run searched."""

    run: str  # name of the run
    colour: UInt8  # (h, w, 3) uint8 RGB
    depth: Float32  # (h, w) [m], 0 without measurement
    K: Float64  # camera matrix (3, 3) [px]
    # places in the picture of fruit that was then picked, (n, 2) [px]
    picked: Float64 = field(default_factory=lambda: np.empty((0, 2)))


@dataclass(frozen=True, slots=True, eq=False)
class Proposed:
    """Boxes of one frame, x, y, w, h (n, 4) [px], and which of them are doubtful, (n,)."""

    boxes: Float64
    doubtful: NDArray[np.bool_]


def propose(detector: CompactDetector, look: RecordedLook, fruit: FruitModel) -> Proposed:
    """Propose the labels of one frame.

    A detection becomes a label where fruit was picked, or where its score is `SURE` and the depth in its box is a
    sphere of the fruit's size. Other detections from `DOUBTFUL` on are doubtful: training leaves them out.
    """
    radius = 0.5 * float(fruit.dimensions.mean())
    boxes, doubtful = [], []
    for found in detector.find(look.colour, look.K):
        if found.box is None:
            continue
        x, y, w, h = found.box.tolist()
        u, v = look.picked.T
        was_picked = bool(((x <= u) & (u <= x + w) & (y <= v) & (v <= y + h)).any())
        if found.score < DOUBTFUL and not was_picked:
            continue
        boxes.append(found.box)
        doubtful.append(
            not was_picked and (found.score < SURE or not _has_shape(look, found.box, radius))
        )
    return Proposed(np.array(boxes, np.float64).reshape(-1, 4), np.array(doubtful, np.bool_))


def _has_shape(look: RecordedLook, box: Float64, radius: float) -> bool:
    try:
        sphere_in_box(look.depth, look.K, box, (SIZES[0] * radius, SIZES[1] * radius))
    except NoSphere:
        return False
    return True


def write_proposals(
    folder: Path, looks: Sequence[RecordedLook], detector: CompactDetector, fruit: FruitModel
) -> tuple[int, int]:
    """Write frames and proposed labels as COCO files, `train.json` and `val.json`, for a person to correct.

    Returns the numbers of labels and of doubtful boxes.
    """
    searching = detector.looking(replace(detector.options, finder_threshold=DOUBTFUL))
    runs = list(dict.fromkeys(look.run for look in looks))
    content: dict[str, dict[str, list[Any]]] = {
        s: {"images": [], "annotations": []} for s in ("train", "val")
    }
    labels = doubts = 0
    (folder / "images").mkdir(parents=True)
    for number, look in enumerate(looks):
        name = f"{number:05d}.png"
        write_picture(folder / "images" / name, look.colour)
        proposed = propose(searching, look, fruit)
        part = content["val" if runs.index(look.run) % VAL_EVERY == VAL_EVERY - 1 else "train"]
        height, width = look.colour.shape[:2]
        part["images"].append(
            {"id": number, "file_name": name, "width": width, "height": height, "run": look.run}
        )
        for box, doubtful in zip(proposed.boxes.tolist(), proposed.doubtful.tolist(), strict=True):
            part["annotations"].append(
                {"image_id": number, "category_id": 1, "bbox": box, "iscrowd": int(doubtful)}
            )
        doubts += int(proposed.doubtful.sum())
        labels += int((~proposed.doubtful).sum())
    for split, part in content.items():
        text = json.dumps({**part, "categories": [{"id": 1, "name": fruit.name}]}, indent=1)
        (folder / f"{split}.json").write_text(text, encoding="utf-8")
    return labels, doubts
