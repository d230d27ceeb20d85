"""Small folders of labelled photographs, drawn here: red discs on green, with COCO's labels."""

import json
from pathlib import Path

import cv2
import numpy as np

Discs = list[tuple[float, float, float]]
"""Centre and radius [px]."""

SIDE = 240
TRUTH: dict[str, Discs] = {
    "a_0.jpg": [(60.0, 70.0, 25.0), (170.0, 150.0, 30.0)],
    "a_1.jpg": [(120.0, 120.0, 28.0), (5.0, 60.0, 24.0)],
    "b_0.jpg": [(80.0, 160.0, 26.0)],
    "b_1.jpg": [],
}


def draw(path: Path, discs: Discs, side: int = SIDE) -> None:
    picture = np.full((side, side, 3), (60, 140, 40), np.uint8)
    for u, v, radius in discs:
        cv2.circle(picture, (round(u), round(v)), round(radius), (40, 40, 200), -1)
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), picture)


def boxes_of(discs: Discs) -> list[tuple[float, float, float, float]]:
    """Cut at the picture's border, as people draw them."""
    edges = [np.clip([u - r, v - r, u + r, v + r], 0.0, SIDE).tolist() for u, v, r in discs]
    return [(x, y, x_end - x, y_end - y) for x, y, x_end, y_end in edges]


def content() -> dict[str, list[dict[str, object]]]:
    """The labels, with a leaf in the first picture."""
    images = [
        {"id": k, "file_name": name, "width": SIDE, "height": SIDE} for k, name in enumerate(TRUTH)
    ]
    annotations = [
        {"image_id": k, "category_id": 7, "bbox": list(box), "iscrowd": 0}
        for k, discs in enumerate(TRUTH.values())
        for box in boxes_of(discs)
    ]
    annotations.append({"image_id": 0, "category_id": 3, "bbox": [1, 1, 20, 20]})
    categories = [{"id": 3, "name": "leaf"}, {"id": 7, "name": "Apple"}]
    return {"images": images, "annotations": annotations, "categories": categories}


def coco(folder: Path) -> Path:
    """Write the pictures, and the labels beside them; return the file of labels."""
    for name, discs in TRUTH.items():
        draw(folder / "images" / name, discs)
    path = folder / "labels.json"
    path.write_text(json.dumps(content()))
    return path
