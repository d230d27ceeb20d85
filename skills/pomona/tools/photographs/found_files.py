"""Fruit found in photographs, as files: COCO's JSON, YOLO's labels, and a sheet of pictures with their boxes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from pomona.executive import Float64, UInt8

COLOUR = (255, 176, 46)  # of boxes and numbers, RGB: `pomona.executive.palette.OVERLAY["found"]`
ON_SHEET, COLUMNS = 10, 5  # pictures on a sheet, and pictures in a row
CELL_WIDTH, CELL_HEIGHT, LINE = (
    400,
    300,
    24,
)  # of a picture on the sheet, and of the line below it [px]
PAPER, INK = (255, 255, 255), (40, 40, 40)  # colours of the sheet, RGB


class Outlined(Protocol):
    """A fruit in a picture."""

    @property
    def score(self) -> float:
        """Estimated ratio of fruit among such detections, 0..1."""

    def outline(self, width: int, height: int) -> Float64:
        """Return the box x, y, w, h (4,) [px], inside a picture of this size."""


def draw(picture: UInt8, found: Sequence[Outlined]) -> None:
    """Draw boxes and numbers of the fruit into a picture (h, w, 3), RGB."""
    height, width = picture.shape[:2]
    thick = max(1, round(width / 800))
    for k, fruit in enumerate(found):
        x, y, w, h = (round(float(value)) for value in fruit.outline(width, height))
        cv2.rectangle(picture, (x, y), (x + w, y + h), COLOUR, thick)
        cv2.putText(
            picture,
            str(k + 1),
            (x, max(y - 3, 12)),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.4 * thick,
            COLOUR,
            thick,
        )


class ContactSheet:
    """Up to ten of the pictures, evenly chosen, on one sheet.

    Args:
        count: number of all pictures.
    """

    def __init__(self, count: int) -> None:
        self._chosen = set(
            np.linspace(0, count - 1, min(count, ON_SHEET)).round().astype(int).tolist()
        )
        self._cells: list[UInt8] = []

    def add(self, number: int, drawn: UInt8, name: str) -> None:
        """Add the picture of this number, from 0, with its boxes (h, w, 3), RGB, if it is one of the chosen."""
        if number not in self._chosen:
            return
        height, width = drawn.shape[:2]
        factor = min(CELL_WIDTH / width, CELL_HEIGHT / height)
        small = max(1, round(factor * width)), max(1, round(factor * height))
        cell = np.full((CELL_HEIGHT + LINE, CELL_WIDTH, 3), PAPER, np.uint8)
        left, top = (CELL_WIDTH - small[0]) // 2, (CELL_HEIGHT - small[1]) // 2
        cell[top : top + small[1], left : left + small[0]] = cv2.resize(
            drawn, small, interpolation=cv2.INTER_AREA
        )
        text = name.encode("ascii", "replace").decode("ascii")[
            :48
        ]  # OpenCV's font has no other characters
        cv2.putText(
            cell, text, (4, CELL_HEIGHT + 17), cv2.FONT_HERSHEY_SIMPLEX, 0.45, INK, 1, cv2.LINE_AA
        )
        self._cells.append(cell)

    def picture(self) -> UInt8 | None:
        """Return the sheet (h, w, 3), RGB; None without a picture."""
        if not self._cells:
            return None
        columns = min(COLUMNS, len(self._cells))
        blank = np.full_like(self._cells[0], PAPER[0])
        cells = [*self._cells, *[blank] * (-len(self._cells) % columns)]
        rows = [np.hstack(cells[k : k + columns]) for k in range(0, len(cells), columns)]
        return np.asarray(np.vstack(rows), np.uint8)


@dataclass(slots=True)
class CocoFile:
    """All finds in the form of COCO's labels, with scores.

    Attributes:
        fruit: name of the one category.
    """

    fruit: str
    images: list[dict[str, Any]] = field(default_factory=list)
    annotations: list[dict[str, Any]] = field(default_factory=list)

    def add(self, file: Path, width: int, height: int, found: Sequence[Outlined]) -> None:
        """Append a picture of this size [px] and its fruit."""
        number = len(self.images) + 1
        self.images.append(
            {"id": number, "file_name": str(file.absolute()), "width": width, "height": height}
        )
        for fruit in found:
            box = [round(float(value), 1) for value in fruit.outline(width, height)]
            self.annotations.append(
                {
                    "id": len(self.annotations) + 1,
                    "image_id": number,
                    "category_id": 1,
                    "bbox": box,
                    "area": round(box[2] * box[3], 1),
                    "iscrowd": 0,
                    "score": round(fruit.score, 3),
                }
            )

    def text(self) -> str:
        """Return the file's content."""
        categories = [{"id": 1, "name": self.fruit}]
        return json.dumps(
            {"images": self.images, "categories": categories, "annotations": self.annotations}
        )


def yolo_lines(width: int, height: int, found: Sequence[Outlined]) -> str:
    """Return the content of YOLO's file of labels of a picture of this size [px]: class 0, middle and size in parts."""
    lines = []
    for fruit in found:
        x, y, w, h = fruit.outline(width, height)
        lines.append(
            f"0 {(x + 0.5 * w) / width:.6f} {(y + 0.5 * h) / height:.6f} {w / width:.6f} {h / height:.6f}\n"
        )
    return "".join(lines)
