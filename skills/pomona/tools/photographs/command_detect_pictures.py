"""`pomona detect`: the fruit in pictures, without a tree: a table, and the pictures with boxes."""

from __future__ import annotations

import argparse
import csv
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from pomona.executive import (
    ENDINGS,
    Number,
    UInt8,
    UnusablePicture,
    is_file,
    raise_again,
    read_picture,
)
from pomona.tools.photographs.picture_results import FORMATS, SHEET, PictureResults, UnusableInput

if TYPE_CHECKING:
    from pomona.skills.perception import CompactDetector, DetectorOptions, FoundFruit
    from pomona.tools.box_detectors.box_model import ScoredBox

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
TABLE = "found.csv"
COLUMNS = ("picture", "fruit", "score", "left_px", "top_px", "width_px", "height_px", "visible")
MOST_LOOKS, MOST_LOOKS_AT_ONE_WIDTH = 3000, 200  # places that are looked at closely in one picture
BOXES_WIDTH = 1280  # width at which a detector of boxes searches, unless --width gives another [px]


Search = Callable[
    [UInt8], "Sequence[FoundFruit | ScoredBox]"
]  # finds the fruit in a picture (h, w, 3) uint8 RGB


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
        help="name in the catalogue, or a path; or a kind of the apple's photo_weights, as tomato (apple)",
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
        help="your own labels: a folder of COCO, YOLO or tables, or a .json of COCO; gives recall and precision",
    )
    parser.add_argument(
        "--format",
        choices=FORMATS,
        default="csv",
        help=f"of the boxes, beside {TABLE}: coco, yolo (csv: that table)",
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
        results = PictureResults(options, files)
        search = _search(options)
        options.out.mkdir(parents=True, exist_ok=True)
        with table.open("x", newline="", encoding="utf-8") as stream:
            try:
                unusable = _all(files, search, results, stream)
            finally:
                results.write()
    except (UnusableInput, DetectError, FruitError, OSError) as error:
        sys.stderr.write(f"pomona detect: {error}\n")
        return 2
    except KeyboardInterrupt:
        if table.is_file():
            sys.stderr.write(f"interrupted: {table} holds the results so far\n")
        raise
    sys.stdout.write(
        f"written to {options.out}: {TABLE}, {SHEET}, and each picture with its boxes\n"
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
    )
    from pomona.tools.box_detectors.box_model import load_boxes
    from pomona.tools.fruit_kinds.kind_head import CALIBRATION, kinds_beside

    name, weights = _fruit(options.fruit)
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


def _fruit(name: str) -> tuple[str, Path | None]:
    """Return a fruit's name and weights: of the catalogue, else of a kind of the apple's photo_weights.

    Raises FruitError, BadWeights: there is neither, or a file cannot be used.
    """
    from pomona.skills.perception import FruitError, load_fruit
    from pomona.tools.fruit_kinds.kind_head import kinds_beside

    try:
        fruit = load_fruit(name)
    except FruitError:
        weights = load_fruit("apple").photo_weights
        kinds = None if weights is None else kinds_beside(weights)
        if kinds is None or name not in kinds.kinds[:-1]:
            raise
        return name, weights
    return fruit.name, fruit.photo_weights or fruit.weights


def _all(files: Sequence[Path], search: Search, results: PictureResults, stream: TextIO) -> int:
    """Return how many pictures could not be used; each other one gets its line on the screen and rows in the table."""
    from pomona.skills.perception import BadFrame

    table = csv.writer(stream)
    table.writerow(COLUMNS)
    unusable = total = 0
    for number, file in enumerate(files):
        raise_again()
        try:
            picture = read_picture(file)
            found = search(picture)
        except (UnusablePicture, BadFrame) as error:
            sys.stderr.write(f"pomona detect: {_shown(file)}: {error}\n")
            unusable += 1
            continue
        sure = [fruit for fruit in found if fruit.score >= results.score]
        results.add(number, file, picture, found)
        height, width = picture.shape[:2]
        table.writerows(_row(file, k + 1, fruit, width, height) for k, fruit in enumerate(sure))
        stream.flush()
        total += len(sure)
        sys.stdout.write(f"{number + 1}/{len(files)}  {_shown(file)}: {len(sure)} found\n")
        sys.stdout.flush()
    used = len(files) - unusable
    sys.stdout.write(f"{total} fruit in {used} {'picture' if used == 1 else 'pictures'}\n")
    return unusable


def _row(
    file: Path, number: int, fruit: FoundFruit | ScoredBox, width: int, height: int
) -> tuple[object, ...]:
    box = (f"{value:.1f}" for value in fruit.outline(width, height))
    visible = "" if math.isnan(fruit.visibility) else f"{fruit.visibility:.2f}"
    return _shown(file), number, f"{fruit.score:.3f}", *box, visible


def _shown(file: Path) -> str:
    """Return a name that every screen can show in one line: bytes that are not UTF-8 as \\xNN, a new line as \\n."""
    text = os.fsencode(file).decode("utf-8", "backslashreplace")
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def find_fruit(detector: CompactDetector, colour: UInt8) -> list[FoundFruit]:
    """Find all fruit in a picture (h, w, 3) uint8 RGB of an unknown camera; only boxes and scores are valid."""
    height, width = colour.shape[:2]
    K = np.array([[width, 0.0, 0.5 * width], [0.0, width, 0.5 * height], [0.0, 0.0, 1.0]])
    return detector.find(np.ascontiguousarray(colour), K)
