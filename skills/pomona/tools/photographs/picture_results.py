"""Results of `pomona detect` beside its table: pictures with boxes, a sheet of them, sizes, labels, figures."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pomona.executive import UInt8, write_picture
from pomona.tools.photographs.found_files import CocoFile, ContactSheet, Outlined, draw, yolo_lines
from pomona.tools.photographs.label_figures import LabelFigures
from pomona.tools.photographs.photo_folder import read_labels
from pomona.tools.photographs.sizes_found import SizesFound

SHEET, FIGURES, COCO, YOLO = (
    "contact_sheet.jpg",
    "figures.md",
    "found.json",
    "labels",
)  # files and a folder
FORMATS = ("csv", "coco", "yolo")


class UnusableInput(Exception):
    """A file that is no picture, a folder without any, or a file that cannot be written."""


class PictureResults:
    """All that is written and printed of the pictures, beside the table.

    Args:
        options: of the command.
        files: all pictures, in order.

    Raises BadPhotographs, UnusableInput: labels or names of pictures cannot be used; nothing has been written.
    """

    def __init__(self, options: argparse.Namespace, files: Sequence[Path]) -> None:
        self.score, self._out = options.score, options.out
        self._sheet = ContactSheet(len(files))
        self._sizes = SizesFound(options.width, options.boxes is None)
        self._fruit = Path(options.fruit).name
        self._coco = CocoFile(self._fruit) if options.format == "coco" else None
        self._yolo = options.out / YOLO if options.format == "yolo" else None
        by_name = {file.stem: file for file in files}
        if self._yolo is not None and len(by_name) < len(files):
            repeated = next(file for file in files if by_name[file.stem] != file)
            raise UnusableInput(
                f"{repeated}: YOLO's labels need a name for each picture, and another has this one"
            )
        self._figures = None
        if options.eval is not None:
            self._figures = LabelFigures(read_labels(options.eval, self._fruit), options.score)

    def add(self, number: int, file: Path, picture: UInt8, found: Sequence[Outlined]) -> None:
        """Take in the finds of a picture, and write its own files; boxes are drawn into the picture, RGB."""
        height, width = picture.shape[:2]
        sure = [fruit for fruit in found if fruit.score >= self.score]
        if self._figures is not None:
            boxes = np.array([fruit.outline(width, height) for fruit in found]).reshape(-1, 4)
            problem = self._figures.add(
                file, width, height, boxes, np.array([fruit.score for fruit in found])
            )
            if problem:
                sys.stderr.write(f"pomona detect: {file} {problem}\n")
        if words := self._sizes.announce(width, height):
            sys.stdout.write(f"{words}\n")
        self._sizes.add(
            width, height, np.array([fruit.outline(width, height)[2:].max() for fruit in sure])
        )
        if self._coco is not None:
            self._coco.add(file, width, height, sure)
        if self._yolo is not None:
            self._yolo.mkdir(exist_ok=True)
            (self._yolo / f"{file.stem}.txt").write_text(
                yolo_lines(width, height, sure), encoding="utf-8"
            )
        draw(picture, sure)
        write_picture(self._out / f"{number + 1:04d}_{file.stem}.jpg", picture)
        self._sheet.add(number, picture, f"{file.name}: {len(sure)} found")

    def write(self) -> None:
        """Write what concerns all pictures, and print the sizes and figures."""
        if (sheet := self._sheet.picture()) is not None:
            write_picture(self._out / SHEET, sheet)
        if self._coco is not None:
            (self._out / COCO).write_text(self._coco.text(), encoding="utf-8")
        if self._yolo is not None:
            (self._out / "data.yaml").write_text(f"names: [{self._fruit}]\n", encoding="utf-8")
        sys.stdout.writelines(f"{line}\n" for line in self._sizes.lines())
        if self._figures is not None:
            table = self._figures.table()
            (self._out / FIGURES).write_text(f"{table}\n", encoding="utf-8")
            sys.stdout.write(f"{table}\n")
