"""Small folders of labelled photographs in the five layouts, drawn here: red discs on green."""

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
GROUP = {"a": "train", "b": "val"}


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


def tables(folder: Path) -> Path:
    rows = [f"{name},{name[0]},{GROUP[name[0]]}" for name in TRUTH]
    (folder / "images").mkdir(parents=True)
    (folder / "images.csv").write_text("\n".join(["image,tree,split", *rows]) + "\n")
    lines = [
        f"{name},{x},{y},{w},{h}" for name, discs in TRUTH.items() for x, y, w, h in boxes_of(discs)
    ]
    (folder / "fruit.csv").write_text("\n".join(["image,x,y,w,h", *lines]) + "\n")
    for name, discs in TRUTH.items():
        draw(folder / "images" / name, discs)
    return folder


def yolo(folder: Path) -> Path:
    for name, discs in TRUTH.items():
        split = GROUP[name[0]]
        draw(folder / split / "images" / name, discs)
        lines = [
            f"1 {(x + w / 2) / SIDE} {(y + h / 2) / SIDE} {w / SIDE} {h / SIDE}"
            for x, y, w, h in boxes_of(discs)
        ]
        text = folder / split / "labels" / f"{name[:-4]}.txt"
        text.parent.mkdir(parents=True, exist_ok=True)
        text.write_text("\n".join([*lines, "0 0.5 0.5 0.1 0.1"]) + "\n")  # a leaf in every picture
    (folder / "data.yaml").write_text("names: {0: leaf, 1: Apple}\n")
    return folder


def coco(folder: Path) -> Path:
    for split in ("train", "val"):
        names = [name for name in TRUTH if GROUP[name[0]] == split]
        images = [
            {"id": k, "file_name": name, "width": SIDE, "height": SIDE}
            for k, name in enumerate(names)
        ]
        annotations = [
            {"image_id": k, "category_id": 7, "bbox": box, "iscrowd": 0}
            for k, name in enumerate(names)
            for box in boxes_of(TRUTH[name])
        ]
        annotations.append({"image_id": 0, "category_id": 3, "bbox": [1, 1, 20, 20]})
        content = {
            "images": images,
            "annotations": annotations,
            "categories": [{"id": 3, "name": "leaf"}, {"id": 7, "name": "apple"}],
        }
        (folder / "annotations").mkdir(parents=True, exist_ok=True)
        (folder / "annotations" / f"instances_{split}.json").write_text(json.dumps(content))
    for name, discs in TRUTH.items():
        draw(folder / "images" / name, discs)
    return folder


def minneapple(folder: Path) -> Path:
    """As MinneApple's archive unpacks: masks of one value per apple, and a test folder without masks."""
    for name, discs in TRUTH.items():
        stem = f"2015_17{name[0]}_image{name[2]}"
        draw(folder / "detection" / "train" / "images" / f"{stem}.png", discs)
        mask = np.zeros((SIDE, SIDE), np.uint8)
        for value, (x, y, w, h) in enumerate(boxes_of(discs), start=1):
            mask[round(y) : round(y + h), round(x) : round(x + w)] = value
        path = folder / "detection" / "train" / "masks" / f"{stem}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(path), mask)
    draw(folder / "detection" / "test" / "images" / "dataset2_front_1.png", [])
    return folder


def kfuji(folder: Path) -> Path:
    """As KFuji's archive unpacks."""
    place = folder / "KFuji_RGB-DS_dataset" / "preprocessed data"
    for part in ("images", "square_annotations1", "sets"):
        (place / part).mkdir(parents=True)
    for split in ("train", "val", "test"):
        names = [name[:-4] for name in TRUTH if GROUP[name[0]] == split]
        (place / "sets" / f"{split}.txt").write_text("\n".join([*names, ""]))
    for name, discs in TRUTH.items():
        draw(place / "images" / f"{name[:-4]}hr.jpg", discs)
        objects = "".join(
            f"<object><name>Poma</name><bbox><xmin>{x:.0f}</xmin><ymin>{y:.0f}</ymin>"
            f"<xmax>{x + w:.0f}</xmax><ymax>{y + h:.0f}</ymax></bbox></object>"
            for x, y, w, h in boxes_of(discs)
        )
        text = f"<annotations><filename>{name}</filename>{objects}</annotations>"
        (place / "square_annotations1" / f"{name[:-4]}.xml").write_text(text)
    return folder
