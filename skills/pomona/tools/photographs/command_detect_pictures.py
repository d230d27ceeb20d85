"""`pomona detect`: the fruit in pictures, without a tree: a table, and the pictures with boxes."""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from pomona.executive import (
    Number,
    UInt8,
    UnusablePicture,
    is_file,
    raise_again,
    read_picture,
)
from pomona.tools.photographs.labels import BadLabels
from pomona.tools.photographs.picture_results import (
    COCO,
    COLUMNS,
    TABLE,
    Outlined,
    PictureResults,
    shown,
)

if TYPE_CHECKING:
    from pomona.skills.perception import CompactDetector, DetectorOptions, FoundFruit

ENDINGS = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".heic", ".heif", ".avif")
"""Endings of files that are taken for pictures in a folder; one that cannot be decoded is named, not left out."""

BESIDE = (
    ".txt",
    ".json",
    ".xml",
    ".csv",
    ".yaml",
    ".yml",
    ".md",
    ".npy",
)  # labels and notes, beside pictures
DEPTH = "_depth_mm.png"  # of an RGB-D frame, beside its colour: no picture to find fruit in
# places that are looked at closely in one picture
MOST_LOOKS = 3000
MOST_LOOKS_AT_ONE_WIDTH = 200
BOXES_WIDTH = 1280  # width at which a detector of boxes searches, unless --width gives another [px]

Search = Callable[[UInt8], Sequence[Outlined]]  # finds the fruit in a picture (h, w, 3) uint8 RGB


class UnusableInput(Exception):
    """Options that do not go together, a missing file, or a folder without pictures."""


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "detect", help="find the fruit in pictures: a table, and the pictures with boxes"
    )
    parser.add_argument(
        "pictures", type=Path, nargs="+", metavar="PICTURE", help="files, or folders of them"
    )
    parser.add_argument(
        "--fruit",
        default="apple",
        help="name in the catalogue, or a path (apple)",
    )
    parser.add_argument(
        "--weights",
        help="another weights file, or the name of a shipped one: apple.weights is that of the simulated cell (the "
        "fruit's photo_weights, else its weights)",
    )
    parser.add_argument(
        "--boxes", type=Path, help="a detector of boxes as an ONNX file, instead of weights"
    )
    parser.add_argument(
        "--score",
        type=Number(0, 1).option,
        default=0.5,
        help="lowest score of a detection, 0 to 1 (0.5)",
    )
    parser.add_argument(
        "--width",
        type=int,
        help="the one width at which a picture is searched [px]: finds fruit of about 24 to 130 px at that width "
        "(several widths up to the picture's own, for fruit from 24 px in the picture on; 1280 with --boxes)",
    )
    parser.add_argument(
        "--eval",
        type=Path,
        metavar="LABELS",
        help="your own labels, a .json of COCO; gives recall and precision",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("detected"), help="new folder for all of it (detected)"
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Find, write and count; return 0, or 2 when a picture, the weights or the folder cannot be used.

    KeyboardInterrupt passes; the table then holds the pictures that were done.
    """
    from pomona.skills.perception import DetectError, FruitError

    table = options.out / TABLE
    try:
        if options.width is not None and not 64 <= options.width <= 4096:
            raise UnusableInput("--width must lie in 64 … 4096 px")
        if table.exists():
            raise UnusableInput(f"{table} is there already: name another folder with --out")
        files = list(_files(options.pictures))
        results = PictureResults(options)
        search = _search(options)
        options.out.mkdir(parents=True, exist_ok=True)
        with table.open("x", newline="", encoding="utf-8") as stream:
            try:
                unusable = _all(files, search, results, stream)
            finally:
                results.write()
    except (UnusableInput, BadLabels, DetectError, FruitError, OSError) as error:
        sys.stderr.write(f"pomona detect: {error}\n")
        return 2
    except KeyboardInterrupt:
        if table.is_file():
            sys.stderr.write(f"interrupted: {table} holds the results so far\n")
        raise
    sys.stdout.write(
        f"written to {options.out}: {TABLE}, {COCO}, and each picture with its boxes\n"
    )
    return 2 if unusable else 0


def _files(given: Sequence[Path]) -> Iterator[Path]:
    for path in given:
        if not path.is_dir():
            if not is_file(path):
                raise UnusableInput(f"{path}: there is no such file")
            yield path
            continue
        inside = sorted(file for file in path.iterdir() if _is_picture(file.name))
        if not inside:
            raise UnusableInput(f"{path} holds no pictures ({', '.join(ENDINGS)})")
        below = sorted({file.parent for file in path.glob("*/*") if _is_picture(file.name)})
        if below:
            sys.stderr.write(
                f"{path}: pictures of the folders in it are not searched: {', '.join(map(str, below))}\n"
            )
        others = sorted(
            file.name for file in path.iterdir() if file.is_file() and not _is_expected(file.name)
        )
        if others:
            more = f" and {len(others) - 3} more" if len(others) > 3 else ""
            sys.stderr.write(
                f"{path}: not searched, expected {', '.join(ENDINGS)}: {', '.join(others[:3])}{more}\n"
            )
        yield from inside


def _is_expected(name: str) -> bool:
    """Return True for a picture, and for what lies beside pictures: depth, labels, notes and hidden files."""
    return _is_picture(name) or name.startswith(".") or name.lower().endswith((*BESIDE, DEPTH))


def _is_picture(name: str) -> bool:
    return name.lower().endswith(ENDINGS) and not name.startswith(".") and not name.endswith(DEPTH)


def _search(options: argparse.Namespace) -> Search:
    """Return the search of one picture, by a detector of boxes or by weights.

    Raises:
        UnusableInput, DetectError, FruitError: the options do not go together, or a file cannot be used.
    """
    from pomona.skills.perception import (
        BadWeights,
        CompactDetector,
        find_weights,
        load_fruit,
    )
    from pomona.tools.box_detectors.box_model import load_boxes
    from pomona.tools.fruit_kinds.kind_head import CALIBRATION, kinds_beside

    fruit = load_fruit(options.fruit)
    name = fruit.name
    weights = fruit.photo_weights or fruit.weights
    if options.boxes is not None:
        if options.weights is not None:
            raise UnusableInput("--boxes and --weights: name one of them")
        return load_boxes(options.boxes, name, options.width or BOXES_WIDTH).find
    if options.weights is not None:
        weights = find_weights(Path(), options.weights)
        if weights is None:
            raise BadWeights(options.weights, "is neither a file nor the name of shipped weights")
    if weights is None:
        raise BadWeights(options.fruit, f"train some: pomona train detect --fruit {options.fruit}")
    kinds = kinds_beside(weights)
    if kinds is not None and name in kinds.kinds:
        others = ", ".join(kind for kind in kinds.kinds[:-1] if kind != name)
        note = (
            f"; {kinds.about[CALIBRATION]}"
            if name == kinds.kinds[0] and CALIBRATION in kinds.about
            else ""
        )
        sys.stdout.write(f"scores are those of {name}, not of {others}{note}\n")
    detector = CompactDetector.load(weights, photo_options(options.width, name))
    return lambda colour: find_fruit(detector, colour)


def photo_options(width: int | None, kind: str = "") -> DetectorOptions:
    """Return the detector's options for photographs, searched at one width [px] or, for None, at several.

    Where several widths agree on a place, one close look is as good as three, and takes a third of their time.
    """
    from pomona.skills.perception import DetectorOptions

    if width is None:
        return DetectorOptions(
            working_width=None, most_fruit=MOST_LOOKS, looks=1, mirrored=False, kind=kind
        )
    return DetectorOptions(working_width=width, most_fruit=MOST_LOOKS_AT_ONE_WIDTH, kind=kind)


def _all(files: Sequence[Path], search: Search, results: PictureResults, stream: TextIO) -> int:
    """Return how many pictures could not be used; each other one gets its line on the screen and rows in the table."""
    from pomona.skills.perception import BadFrame

    csv.writer(stream).writerow(COLUMNS)
    unusable = total = 0
    for number, file in enumerate(files):
        raise_again()
        try:
            picture = read_picture(file)
            found = search(picture)
        except (UnusablePicture, BadFrame) as error:
            sys.stderr.write(f"pomona detect: {shown(file)}: {error}\n")
            unusable += 1
            continue
        count = results.add(number + 1, file, picture, found, stream)
        total += count
        sys.stdout.write(f"{number + 1}/{len(files)}  {shown(file)}: {count} found\n")
        sys.stdout.flush()
    used = len(files) - unusable
    sys.stdout.write(f"{total} fruit in {used} {'picture' if used == 1 else 'pictures'}\n")
    return unusable


def find_fruit(detector: CompactDetector, colour: UInt8) -> list[FoundFruit]:
    """Find all fruit in a picture (h, w, 3) uint8 RGB of an unknown camera; only boxes and scores are valid."""
    height, width = colour.shape[:2]
    K = np.array([[width, 0.0, 0.5 * width], [0.0, width, 0.5 * height], [0.0, 0.0, 1.0]])
    return detector.find(np.ascontiguousarray(colour), K)
