"""Results of `pomona detect`: a table, COCO's labels, pictures with boxes, sizes, and figures against labels."""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, TextIO

import cv2
import numpy as np

from pomona.executive import Float64, UInt8, write_picture
from pomona.tools.photographs.label_figures import LabelFigures
from pomona.tools.photographs.labels import read_labels
from pomona.tools.photographs.sizes_found import SizesFound

TABLE = "found.csv"
FIGURES = "figures.md"
COCO = "found.json"
COLUMNS = ("picture", "fruit", "score", "left_px", "top_px", "width_px", "height_px", "visible")
COLOUR = (255, 176, 46)  # of boxes and numbers, RGB: `pomona.executive.palette.OVERLAY["found"]`


class Outlined(Protocol):
    """A fruit in a picture."""

    @property
    def score(self) -> float:
        """Estimated ratio of fruit among such detections, 0..1."""

    @property
    def visibility(self) -> float:
        """Estimated part that is visible, 0..1; NaN without an estimate."""

    def outline(self, width: int, height: int) -> Float64:
        """Return the box x, y, w, h (4,) [px], inside a picture of this size."""


class PictureResults:
    """All that is written and printed of the pictures.

    Args:
        options: of the command.

    Raises BadLabels: the labels cannot be used; nothing has been written.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._score = options.score
        self._out = options.out
        self._sizes = SizesFound(options.width, options.boxes is None)
        fruit = Path(options.fruit).name
        self._coco: dict[str, list[Any]] = {
            "categories": [{"id": 1, "name": fruit}],
            "images": [],
            "annotations": [],
        }
        self._figures = None
        if options.eval is not None:
            self._figures = LabelFigures(read_labels(options.eval, fruit), options.score)

    def add(
        self, number: int, file: Path, picture: UInt8, found: Sequence[Outlined], stream: TextIO
    ) -> int:
        """Take in the finds of a picture, write its rows and its file with boxes; return how many are sure.

        Args:
            number: of the picture, from 1.
            stream: of the table.
        """
        height, width = picture.shape[:2]
        boxes = np.array([fruit.outline(width, height) for fruit in found]).reshape(-1, 4)
        scores = np.array([fruit.score for fruit in found])
        if self._figures is not None:
            problem = self._figures.add(file, width, height, boxes, scores)
            if problem:
                sys.stderr.write(f"pomona detect: {file} {problem}\n")
        if words := self._sizes.announce(width, height):
            sys.stdout.write(f"{words}\n")
        sure = scores >= self._score
        self._sizes.add(width, height, boxes[sure, 2:].max(axis=1, initial=0.0))
        image = {"id": number, "width": width, "height": height, "file_name": str(file.absolute())}
        self._coco["images"].append(image)
        table = csv.writer(stream)
        for order, k in enumerate(np.flatnonzero(sure).tolist(), start=1):
            seen = found[k].visibility
            sides = [f"{value:.1f}" for value in boxes[k]]
            visible = "" if math.isnan(seen) else f"{seen:.2f}"
            table.writerow((shown(file), order, f"{scores[k]:.3f}", *sides, visible))
            self._annotate(number, boxes[k], float(scores[k]))
            draw(picture, boxes[k], order)
        stream.flush()
        write_picture(self._out / f"{number:04d}_{file.stem}.jpg", picture)
        return int(sure.sum())

    def _annotate(self, image: int, box: Float64, score: float) -> None:
        sides = [round(float(value), 1) for value in box]
        annotation = {"id": len(self._coco["annotations"]) + 1, "image_id": image, "category_id": 1}
        about = {"bbox": sides, "area": round(sides[2] * sides[3], 1), "iscrowd": 0}
        self._coco["annotations"].append({**annotation, **about, "score": round(score, 3)})

    def write(self) -> None:
        """Write what concerns all pictures, and print the sizes and figures."""
        (self._out / COCO).write_text(json.dumps(self._coco), encoding="utf-8")
        sys.stdout.writelines(f"{line}\n" for line in self._sizes.lines())
        if self._figures is not None:
            table = self._figures.table()
            (self._out / FIGURES).write_text(f"{table}\n", encoding="utf-8")
            sys.stdout.write(f"{table}\n")


def draw(picture: UInt8, box: Float64, number: int) -> None:
    """Draw a box with its number into a picture (h, w, 3), RGB."""
    thick = max(1, round(picture.shape[1] / 800))
    x, y, w, h = (round(float(value)) for value in box)
    cv2.rectangle(picture, (x, y), (x + w, y + h), COLOUR, thick)
    place = (x, max(y - 3, 12))
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(picture, str(number), place, font, 0.4 * thick, COLOUR, thick)


def shown(file: Path) -> str:
    """Return a name that every screen can show in one line: bytes that are not UTF-8 as \\xNN, a new line as \\n."""
    text = os.fsencode(file).decode("utf-8", "backslashreplace")
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)
